"""Every worked example is short and runs by itself.

Examples run two at a time: where kernels are not compiled yet, the first of either planner compiles
them, which takes longer than all the rest.
"""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from fgplan.cli import main

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
LONGEST = 80
GATHERING = ("12", "13", "14")
"""Examples of planner aia, whose kernels no other example needs."""


def _run(path, folder):
    search = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, str(path)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": search, "PYTHONWARNINGS": "error"},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.fixture(scope="module")
def runs(request, tmp_path_factory):
    """A future of each example that is asked for, by path."""
    asked = {
        item.callspec.params["path"]
        for item in request.session.items
        if item.path == request.path and "runs" in item.fixturenames
    }
    gathering = [path for path in EXAMPLES if path.name.startswith(GATHERING)]
    others = [path for path in EXAMPLES if path not in gathering]
    order = [*others[:1], *gathering, *others[1:]]
    with ThreadPoolExecutor(max_workers=2) as pool:
        yield {
            path: pool.submit(_run, path, tmp_path_factory.mktemp(path.stem))
            for path in order
            if path in asked
        }
        pool.shutdown(cancel_futures=True)


@pytest.mark.parametrize("path", EXAMPLES, ids=[path.name for path in EXAMPLES])
def test_example_is_short_and_runs(path, runs):
    assert len(path.read_text(encoding="utf-8").splitlines()) < LONGEST
    done = runs[path].result()
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip(), "an example shows something"


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
    assert ("closed loop, seed" if loop else "position on arrival") in said
    figure = "session_1_chosen.png" if loop else "chosen_paths.png"
    assert (tmp_path / figure).stat().st_size > 1000
