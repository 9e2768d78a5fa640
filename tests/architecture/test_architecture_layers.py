"""The order of the layers and who may import what: import-linter's contracts are kept."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


def test_import_contracts_are_kept():
    done = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_importing_the_packages_is_light():
    heavy = ("numba", "matplotlib", "shapely", "zenoh", "yaml")
    program = (
        "import sys, fgplan, roadmaps\n"
        "[getattr(fgplan, name) for name in fgplan.__all__]\n"
        f"print([name for name in {heavy!r} if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.full
def test_importing_fgplan_is_hardly_slower_than_importing_gtsam():
    """At most 0.25 s more; the least of several, interleaved, as the machine is shared."""
    least = {"gtsam": np.inf, "fgplan": np.inf}
    for _ in range(7):
        for name in least:
            program = f"import time; t = time.perf_counter(); import {name}; "
            done = subprocess.run(
                [sys.executable, "-c", program + "print(time.perf_counter() - t)"],
                cwd=ROOT,
                capture_output=True,
                text=True,
                check=True,
            )
            least[name] = min(least[name], float(done.stdout))
    assert least["fgplan"] - least["gtsam"] <= 0.25, least


def test_the_command_starts_without_numpy():
    program = (
        "import sys\n"
        "from fgplan.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "heavy = [n for n in ('numpy', 'gtsam', 'networkx', 'scipy') if n in sys.modules]\n"
        "print(heavy, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stderr.strip() == "[]"
    assert "demo" in done.stdout
