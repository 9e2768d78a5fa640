"""``fgplan run`` and ``fgplan plot``: the run folder, the same plan again, figures again."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from fgplan.cli import main
from fgplan.cli.run_recording import joined_states
from fgplan.io.mission_file import load_mission
from fgplan.io.run_folder import read_record
from fgplan.io.run_record import record_workspace
from fgplan.planners.plan import plan_of

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "scenarios" / "two_robots.toml"
FIGURES = ["candidate_paths.png", "chosen_paths.png", "objective.png"]


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    assert main(["run", str(EXAMPLE), "--out", str(folder), "--quick", "--check"]) == 0
    return folder


def plans(folder: Path):
    return [
        plan_of(data)
        for data in json.loads((folder / "result.json").read_text())["results"]["plans"]
    ]


def test_run_folder_holds_scenario_result_record_and_figures(run_folder):
    names = {path.name for path in run_folder.iterdir()}
    assert {"scenario.toml", "result.json", "record.json", *FIGURES} <= names
    assert (run_folder / "scenario.toml").read_bytes() == EXAMPLE.read_bytes()
    plan = plans(run_folder)[0]
    assert plan.scenario_digest == load_mission(EXAMPLE).digest
    assert [item.candidates for item in plan.robots] == [8, 8]


def test_record_reads_back_what_was_planned(run_folder):
    record, plan = read_record(run_folder), plans(run_folder)[0]
    assert list(record.goals) == ["ann", "bob"]
    for item in plan.robots:
        chosen = record.candidates[item.robot][item.candidate]
        np.testing.assert_array_equal(chosen.poses, item.path.poses)
        np.testing.assert_array_equal(record.chosen[item.robot].poses, item.path.poses)
        assert record.covariances[item.robot].shape == (item.path.steps + 1, 2, 2)
    np.testing.assert_array_equal(list(record.landmarks.values()), [[30.0, 4.0], [44.0, 20.0]])
    assert len(record.values) == len(record.announced_by) == len(plan.objective)
    mission = load_mission(EXAMPLE)
    again = joined_states(mission, plan.paths)
    assert len(record.joined) == len(again) > 0
    for first, second in again:
        assert np.linalg.norm(first.pose[:2] - second.pose[:2]) < 8.0  # the scenario's criterion


@pytest.mark.usefixtures("no_pictures")
def test_same_seed_gives_the_same_plan(run_folder, tmp_path):
    assert main(["run", str(EXAMPLE), "--out", str(tmp_path), "--quick", "--seeds", "2"]) == 0
    first, second = plans(tmp_path)
    assert (first.seed, second.seed) == (1, 2)
    assert first.value == plans(run_folder)[0].value
    assert first.value != second.value


@pytest.mark.usefixtures("no_pictures")
def test_first_seed_takes_the_place_of_the_scenarios(run_folder, tmp_path):
    words = ["run", str(EXAMPLE), "--out", str(tmp_path), "--quick", "--first-seed", "2"]
    assert main(words) == 0
    (plan,) = plans(tmp_path)
    assert plan.seed == 2
    assert plan.value != plans(run_folder)[0].value


def test_plot_draws_the_same_figures_without_running(run_folder, capsys):
    for name in FIGURES:
        (run_folder / name).unlink()
    assert main(["plot", str(run_folder)]) == 0
    assert all((run_folder / name).stat().st_size > 1000 for name in FIGURES)
    assert len(capsys.readouterr().out.splitlines()) >= len(FIGURES)


def test_workspace_with_a_grid_reads_back(tmp_path):
    text = EXAMPLE.read_text().replace("bounds =", 'map = "yard.map"\nmap_cell_m = 30.0\nbounds =')
    (tmp_path / "yard.map").write_text("type octile\nheight 2\nwidth 2\nmap\n..\n..\n")
    (tmp_path / "yard.toml").write_text(text)
    mission = load_mission(tmp_path / "yard.toml")
    again = record_workspace(mission.workspace).workspace()
    np.testing.assert_array_equal(again.grid.occupancy, mission.workspace.grid.occupancy)
    np.testing.assert_array_equal(again.upper, [60.0, 40.0])


def test_unreachable_goal_ends_with_one_and_names_the_robot(tmp_path, capsys):
    wall = "obstacles = [\n  [[50.0, 20.0], [51.0, 20.0], [51.0, 41.0], [50.0, 41.0]],"
    wall += "\n  [[50.0, 20.0], [60.0, 20.0], [60.0, 21.0], [50.0, 21.0]],"
    text = EXAMPLE.read_text().replace("obstacles = [", wall)
    (tmp_path / "walled.toml").write_text(text)
    words = ["run", str(tmp_path / "walled.toml"), "--out", str(tmp_path), "--quick"]
    assert main(words) == 1
    error = capsys.readouterr().err
    assert "no feasible plan" in error
    assert "'ann'" in error
    assert "without_path = 'stay'" in error


@pytest.mark.usefixtures("no_pictures")
def test_robot_without_a_path_may_stay(tmp_path, capsys):
    wall = "obstacles = [\n  [[50.0, 16.0], [60.0, 16.0], [60.0, 17.0], [50.0, 17.0]],"
    wall += "\n  [[50.0, 0.0], [51.0, 0.0], [51.0, 17.0], [50.0, 17.0]],"
    text = EXAMPLE.read_text().replace("obstacles = [", wall)
    text = text.replace(
        "[[team.multi_robot]]", '[team]\nwithout_path = "stay"\n[[team.multi_robot]]'
    )
    (tmp_path / "walled.toml").write_text(text)
    words = ["run", str(tmp_path / "walled.toml"), "--out", str(tmp_path), "--quick"]
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert "bob: stays" in shown
    assert "warning: robot 'bob' stays" in shown


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "impacted_paths"', 'name = "nobody"', ["planner 'nobody'", "$.planner.name"]),
        ('name = "impacted_paths"', 'name = "absent:P"', ["absent.py", "$.planner.name"]),
        ("candidates = 10", "candidate = 10", ["option 'candidate'", "impacted_paths"]),
        ("candidates = 10", "candidates = 0", ["candidates", "at least 1"]),
    ],
)
def test_wrong_planner_ends_with_two(tmp_path, capsys, old, new, words):
    path = tmp_path / "team.toml"
    path.write_text(EXAMPLE.read_text().replace(old, new))
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    for word in words:
        assert word in error


OWN_PLANNER = """
import numpy as np
from fgplan.planners.plan import Plan, RobotPlan

class StayHome:
    name = "stay_home"

    def plan(self, mission, generator, progress=None):
        robots = tuple(
            RobotPlan(
                robot=robot.name,
                start=mission.prior.pose(robot.start_key),
                path=None,
                covariances=mission.prior.covariance(robot.start_key)[None],
                goals=robot.goals,
            )
            for robot in mission.robots
        )
        return Plan(
            planner=self.name,
            mission=mission.name,
            scenario_digest=mission.digest,
            seed=mission.seed,
            robots=robots,
            details=dict(mission.options),
        )
"""


def test_own_planner_lies_beside_the_scenario(tmp_path, capsys):
    (tmp_path / "home_planner.py").write_text(OWN_PLANNER)
    text = EXAMPLE.read_text().replace("impacted_paths", "home_planner:StayHome", 1)
    text = text.replace("[planner.impacted_paths]", '[planner."home_planner:StayHome"]')
    (tmp_path / "team.toml").write_text(text)
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "team.toml"), "--out", str(out), "--quick"]) == 0
    assert "ann: stays" in capsys.readouterr().out
    assert plans(out)[0].details == {"candidates": 8}
    assert read_record(out).chosen == {}
    assert main(["plot", str(out)]) == 0


WHAT = "planner 'other_planner:Other': expected plan(mission, generator, progress)"


@pytest.mark.parametrize(
    ("method", "message"),
    [
        ("def plan(self, mission, generator, progress=None): return 'up'", "Plan, got str"),
        ("def plan(self, mission, generator, progress=None): pass", "Plan, got None"),
        ("def plan(self, mission): return None", "got plan(mission)"),
        ("def plan(self, mission, *, generator, progress): pass", "got plan(mission, *, gen"),
        ("plan = 3", "got no method"),
    ],
)
def test_own_planner_that_takes_or_returns_something_else(
    tmp_path, capsys, monkeypatch, method, message
):
    monkeypatch.delitem(sys.modules, "other_planner", raising=False)  # the case before
    (tmp_path / "other_planner.py").write_text(f"class Other:\n    name = 'other'\n    {method}\n")
    text = EXAMPLE.read_text().replace("impacted_paths", "other_planner:Other", 1)
    (tmp_path / "team.toml").write_text(text)
    assert main(["run", str(tmp_path / "team.toml"), "--out", str(tmp_path / "out")]) == 2
    said = [one for one in capsys.readouterr().err.splitlines() if one.startswith("fgplan: ")]
    assert len(said) == 1
    assert WHAT in said[0]
    assert message in said[0]
    assert "team.toml" in said[0]


def test_an_own_planner_s_own_exception_stays_one(tmp_path):
    (tmp_path / "failing_planner.py").write_text(
        "class Failing:\n    name = 'failing'\n"
        "    def plan(self, mission, generator, progress=None):\n        return len(3)\n"
    )
    text = EXAMPLE.read_text().replace("impacted_paths", "failing_planner:Failing", 1)
    (tmp_path / "team.toml").write_text(text)
    with pytest.raises(TypeError, match=r"has no len\(\)"):
        main(["run", str(tmp_path / "team.toml"), "--out", str(tmp_path / "out")])


def test_a_planner_s_class_that_needs_arguments_is_refused(tmp_path, capsys):
    (tmp_path / "needy_planner.py").write_text(
        "class Needy:\n    name = 'needy'\n    def __init__(self, weight): pass\n"
        "    def plan(self, mission, generator, progress=None): pass\n"
    )
    text = EXAMPLE.read_text().replace("impacted_paths", "needy_planner:Needy", 1)
    (tmp_path / "team.toml").write_text(text)
    assert main(["run", str(tmp_path / "team.toml"), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "expected a class made without arguments, got Needy(weight)" in said


@pytest.mark.usefixtures("no_pictures")
def test_exhaustive_planner_runs_from_a_scenario(tmp_path):
    text = EXAMPLE.read_text().replace("impacted_paths", "exhaustive")
    (tmp_path / "team.toml").write_text(text.replace("candidates = 10", "candidates = 3"))
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "team.toml"), "--out", str(out), "--quick"]) == 0
    assert [item.candidates for item in plans(out)[0].robots] == [3, 3]
    assert set(read_record(out).candidates) == {"ann", "bob"}


def test_run_without_matplotlib_keeps_the_record_and_says_so(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert main(["run", str(EXAMPLE), "--out", str(tmp_path), "--quick"]) == 0
    assert "no figures: " in capsys.readouterr().out
    assert not list(tmp_path.glob("*.png"))
    assert read_record(tmp_path).chosen
    assert main(["plot", str(tmp_path)]) == 2
    assert "fgplan[viz]" in capsys.readouterr().err


def test_other_content_of_a_record_is_refused(tmp_path, capsys):
    (tmp_path / "record.json").write_text('{"name": 3}')
    assert main(["plot", str(tmp_path)]) == 2
    assert "expected the record of a run" in capsys.readouterr().err


@pytest.mark.usefixtures("no_pictures")
def test_simulation_that_is_not_run_is_said(tmp_path, capsys):
    path = tmp_path / "team.toml"
    text = EXAMPLE.read_text().replace("impacted_paths", "exhaustive")
    path.write_text(text + "\n[simulation]\nruns = 10\n")
    assert main(["run", str(path), "--out", str(tmp_path / "out"), "--quick"]) == 0
    assert "note: [simulation] was checked but not run" in capsys.readouterr().out
    assert main(["run", str(EXAMPLE), "--out", str(tmp_path / "out"), "--quick"]) == 0
    assert "note: [simulation]" not in capsys.readouterr().out
