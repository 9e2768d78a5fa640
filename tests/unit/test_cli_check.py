"""``fgplan check``: what ``run`` and ``team`` would refuse, in their words; it writes nothing."""

from pathlib import Path

import pytest

from fgplan.cli import main
from fgplan.planners.planner import CheckedPlanner
from fgplan.planners.registry import PLANNERS, find_planner

SCENARIOS = Path(__file__).resolve().parents[2] / "examples" / "scenarios"
EXAMPLES = sorted(SCENARIOS.glob("*.toml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_is_taken(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert shown.out.startswith(f"{path}: ")
    assert shown.out.splitlines()[-1].startswith("nothing wrong was found")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", PLANNERS)
def test_every_planner_says_before_it_plans_that_an_option_is_wrong(name):
    planner = find_planner(name)
    assert isinstance(planner, CheckedPlanner)
    planner.check_options({})
    with pytest.raises(ValueError, match="wrong_one"):
        planner.check_options({"wrong_one": 1})


WRONG = {
    "candidates": ("two_robots", "candidates = 10", "candidates = 0"),
    "evaluator": ("two_robots", "candidates = 10", 'evaluator = "magic"'),
    "preset": ("information_gathering", 'preset = "reproduction"', 'preset = "mine"'),
    "iterations": ("distributed_gathering", "iterations = 5000", "iterations = -1"),
    "links": ("distributed_gathering", "iterations = 5000", 'communication = "none"'),
    "samples": ("intermittent", "epsilon_m = 0.5", "epsilon_m = -0.5"),
    "closed loop": ("closed_loop", "candidates = 8", "candidates = 8\norder = 'random'"),
    "network": ("two_robots", "[planner]\n", "[team.network]\nports = 3\n\n[planner]\n"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_said_as_run_says_it_and_an_earlier_run_stays(what, tmp_path, capsys):
    name, right, wrong = WRONG[what]
    text = (SCENARIOS / f"{name}.toml").read_text(encoding="utf-8")
    assert right in text
    path = tmp_path / "team.toml"
    path.write_text(text.replace(right, wrong, 1), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    assert shown.err.startswith(f"fgplan: error: {path}: ")
    if what == "network":  # which run does not need
        return
    out = tmp_path / "out"
    out.mkdir()
    (out / "chosen_paths.png").write_bytes(b"of an earlier run")
    assert main(["run", str(path), "--out", str(out)]) == 2
    assert capsys.readouterr().err == shown.err
    assert [item.name for item in out.iterdir()] == ["chosen_paths.png"]


def test_what_a_user_wrote_is_not_looked_into(tmp_path, capsys):
    assert main(["check", str(SCENARIOS / "own_planner.toml")]) == 0
    assert "its options are not checked before it plans" in capsys.readouterr().out
