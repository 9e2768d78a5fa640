"""README's commands are what they say they are: two set-ups, and CI runs the second."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```bash\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks() -> list[str]:
    return [found.strip() for found in BLOCK.findall((ROOT / "README.md").read_text("utf-8"))]


def test_readme_has_a_command_for_the_main_job_and_one_for_the_tests():
    main_job, tests = blocks()[:2]
    for command in (main_job, tests):
        assert "python3 -m venv .venv" in command
        assert ".venv/bin/pip install" in command
    assert ".venv/bin/fgplan demo victoria-park" in main_job
    assert ".venv/bin/pytest" in tests
    assert "[test]" in tests


def test_ci_takes_its_test_command_from_readme():
    script = (ROOT / ".ci" / "run").read_text("utf-8")
    assert "block == 2" in script
    assert "README.md" in script
    assert "pytest" not in script.replace("README's test command", "")


def test_commands_that_readme_shows_exist():
    from fgplan.cli.command_registry import REGISTRY

    text = (ROOT / "README.md").read_text("utf-8")
    shown = re.findall(r"fgplan (demo|bench|reproduce) ([a-z][a-z0-9-]*)", text)
    assert shown
    for verb, name in shown:
        assert name in REGISTRY[verb], f"fgplan {verb} {name}"


def test_versions_and_extras_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"version: {project['version']}" in citation
    assert {"all", "test"} <= set(project["optional-dependencies"])
    assert citation.count("  - type: ") >= 4
    assert project["scripts"]["fgplan"] == "fgplan.cli:main"


def test_python_that_readme_shows_runs(capsys):
    text = (ROOT / "README.md").read_text("utf-8")
    (shown,) = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    exec(compile(shown, "README.md", "exec"), {})
    assert "'ann'" in capsys.readouterr().out
