"""Every worked example is short and runs by itself.

Those that start processes run as a process of their own, and the first one for all others: these
run as ``__main__`` of this process, where libraries are imported and kernels loaded once.
"""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from fgplan.cli import main

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
LONGEST = 80
NEEDS = {"18_sweep_on_dask.py": "distributed", "19_four_processes.py": "zenoh"}
"""Packages of extras that are not in "all"."""
PROCESSES = ("01_two_robots.py", *NEEDS)


@pytest.mark.parametrize("path", EXAMPLES, ids=[path.name for path in EXAMPLES])
def test_example_is_short_and_runs(path, tmp_path, monkeypatch, capsys):
    assert len(path.read_text(encoding="utf-8").splitlines()) < LONGEST
    if path.name in NEEDS:
        pytest.importorskip(NEEDS[path.name])
    if path.name in PROCESSES:
        said = said_by_a_process(path, tmp_path)
    else:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [str(path)])
        monkeypatch.setattr(sys, "path", [str(path.parent), *sys.path])
        modules = set(sys.modules)
        runpy.run_path(str(path), run_name="__main__")
        for name in set(sys.modules) - modules:  # an example's own ones
            if (path.parent / "scenarios" / f"{name}.py").exists():
                del sys.modules[name]
        said = capsys.readouterr().out
    assert said.strip(), "an example shows something"


def said_by_a_process(path, folder):
    search = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, str(path)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": search, "PYTHONWARNINGS": "error"},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


SCENARIOS = sorted(
    path
    for path in (ROOT / "examples" / "scenarios").iterdir()
    if path.suffix in (".toml", ".yaml", ".yml")
)


LONG = ("closed_loop.toml",)
"""Whole missions with figures and film: example 09 runs them without, and test_cli_closed_loop its
own."""


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[pytest.mark.full] if path.name in LONG else [], id=path.name)
        for path in SCENARIOS
    ],
)
def test_example_scenario_runs(path, tmp_path, capsys):
    assert main(["run", str(path), "--quick", "--check", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    loop = "[simulation]" in path.read_text(encoding="utf-8")
    gathers = "(1 sigma, worst direction)" in said  # what will be known of targets, not of poses
    assert gathers or ("closed loop, seed" if loop else "position on arrival") in said
    figure = "session_1_chosen.png" if loop else "chosen_paths.png"
    assert (tmp_path / figure).stat().st_size > 1000
