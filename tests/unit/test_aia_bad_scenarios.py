"""Bad input of information gathering through ``fgplan run``: one clear line, no traceback."""

from pathlib import Path

import pytest

from fgplan.cli import main

SCENARIO = Path(__file__).parents[2] / "examples" / "scenarios" / "information_gathering.toml"
TEXT = SCENARIO.read_text(encoding="utf-8")
PROCESS = "process = [[1e-6, 0.0], [0.0, 1e-6]]"
MEAN = "mean = [5.3, 1.2]"
OPTION = 'preset = "reproduction"'

CASES = [
    ("delta = 1.8e-6", "delta = 1e-9\niterations = 300", 1, "the iterations are spent; the best"),
    (PROCESS, "process = [[0.1, 0.0], [0.0, 0.1]]", 1, "target 't0': its process noise keeps its"),
    ("delta = 1.8e-6", "delta = -1.0", 2, "expected a determinant above zero, got -1"),
    (PROCESS, "process = [[1e-6, 1e-3], [1e-3, 1e-6]]", 2, "expected a positive semidefinite"),
    (PROCESS, "process = [[-1e-6, 0.0], [0.0, 1e-6]]", 2, "expected a positive semidefinite"),
    ("slope = 0.25", "slope = -0.25", 2, "got -0.25"),
    (MEAN, "mean = [-1.0, 1.2]", 2, "expected a mean within the bounds [0.0, 0.0] to"),
    (MEAN, "mean = [5.3, 99.0]", 2, "- at `$.targets[0].mean` (target 't0')"),
    (MEAN, "mean = [2.5, 3.0]", 2, "target 't0': expected a place in free space"),
    (OPTION, 'dynamics = "own_parts:nothing"', 2, "expected at least one control, got an empty"),
    (OPTION, 'f_control = "own_parts:first_only"', 2, "Assumption 3.2"),
    (OPTION, 'f_control = "own_parts:missing"', 2, "expected an object 'missing'"),
    (OPTION, 'f_group = "nowhere_at_all:at_all"', 2, "nowhere_at_all"),
    (OPTION, 'terminal_goals = "yes"', 2, "expected true or false, got 'yes'"),
    (OPTION, "step_m = 50.0\niterations = 60000", 1, "the tree holds every node"),
]


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "own_parts.py").write_text(
        "import numpy as np\n"
        "from fgplan.models.motion_primitives import MotionPrimitives\n"
        "def nothing():\n    return MotionPrimitives(relative=np.zeros((0, 3)))\n"
        "def first_only(view):\n    return [np.eye(8)[0] for _ in view.poses]\n"
        "def uniform(view):\n    return [np.full(8, 1 / 8) for _ in view.poses]\n",
        encoding="utf-8",
    )
    return tmp_path


def run(folder, capsys, old, new):
    assert old in TEXT
    path = folder / "bad.toml"
    path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    status = main(["run", str(path), "--out", str(folder / "out")])
    return status, capsys.readouterr().err.strip().splitlines()


@pytest.mark.parametrize(("old", "new", "status", "message"), CASES)
def test_bad_scenarios_end_with_one_line(folder, capsys, old, new, status, message):
    got, lines = run(folder, capsys, old, new)
    assert got == status, lines
    said = [line for line in lines if line.startswith("fgplan: ")]
    assert len(said) == 1
    assert message in said[0]
    assert "bad.toml" in said[0]
    if "process noise keeps" in message:
        assert "budget" not in said[0], "a larger budget would not help"


def test_own_parts_may_lie_beside_the_scenario(folder, capsys):
    """A user's own density and their f_U's name resolve in the scenario's folder."""
    new = 'preset = "pruned"\nf_control = "own_parts:uniform"\niterations = 20'
    status, lines = run(folder, capsys, OPTION, new)
    assert status == 1
    assert "the iterations are spent" in lines[-1]
