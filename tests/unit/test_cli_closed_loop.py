"""``fgplan run`` of a scenario with [simulation]: the closed loop into a run folder."""

import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path

import closed_loop_worlds as worlds
import numpy as np
import pytest

from fgplan.cli import loop_command, main
from fgplan.closed_loop.loop import run_loop
from fgplan.errors import ScenarioError
from fgplan.factors.keys import symbol_key
from fgplan.io.loop_folder import LOOP, read_loop
from fgplan.io.loop_mission import load_loop_mission, make_loop_mission
from fgplan.io.mission_file import make_mission
from fgplan.io.place import Place
from fgplan.io.scenario_file import read_scenario
from fgplan.io.tum import read_tum
from fgplan.viz.animation import animate_loop
from fgplan.viz.loop_figures import draw_loop_figures

SCENARIO = """
schema = 1
name = "plain"
seed = 4

[world]
bounds = [[0.0, 0.0], [60.0, 50.0]]

[sensors.eye]
kind = "bearing_range"
bearing_sigma_rad = 0.01
range_sigma_m = 0.2
max_range_m = 20.0

[[robots]]
name = "ann"
start = [5.0, 5.0, 1.57]
start_sigmas = [0.01, 0.01, 0.01]
goals = [[10.0, 40.0], [40.0, 25.0]]
motion = { sigmas = [0.1, 0.1, 0.01], speed_m_per_s = 5.0 }
sensors = ["eye"]

[[robots]]
name = "bob/1"
start = [40.0, 5.0, 1.57]
start_covariance = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.0001]]
goal = [50.0, 40.0]
motion = { sigmas = [0.1, 0.1, 0.01], speed_m_per_s = 2.0 }
sensors = ["eye"]

[[landmarks]]
position = [20.0, 20.0]
sigma_m = 0.3

[[team.multi_robot]]
distance_m = 20.0
sensor = { kind = "relative_pose", sigmas = [0.3, 0.3, 0.02] }

[objective]
path_weight = 0.2

[planner]
name = "impacted_paths"

[planner.impacted_paths]
candidates = 4
vertices = 40
spacing_m = 8.0

[simulation]
compare = true

[simulation.landmarks]
count = 12
"""

FIGURES = ("session_1_candidates.png", "final_slam.png", "position_covariance.png", "mission.gif")


def write(tmp_path, *changes):
    text = SCENARIO
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path / "plain.toml"
    path.write_text(text)
    return path


def load(path, seed=None):
    return load_loop_mission(path, seed)


def draw_first_session(history, folder, workspace):
    """The figures; those of the other sessions are no different (test_viz_loop_figures)."""
    return draw_loop_figures(replace(history, sessions=history.sessions[:1]), folder, workspace)


@pytest.fixture(scope="module")
def said_and_folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario")
    out, said = path / "run", io.StringIO()
    with contextlib.redirect_stdout(said), pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop_command, "draw_loop_figures", draw_first_session)
        patch.setattr(loop_command, "QUICK_FRAMES", 3)
        assert main(["run", str(write(path)), "--out", str(out), "--quick", "--check"]) == 0
    return said.getvalue(), out


@pytest.fixture(scope="module")
def folder(said_and_folder):
    return said_and_folder[1]


@pytest.fixture
def _no_pictures(monkeypatch):
    monkeypatch.setattr(loop_command, "draw_loop_folder", lambda *_, **__: ())


def test_run_folder_holds_records_pictures_tracks_and_numbers(folder):
    history, _ = read_loop(folder)
    assert all((folder / name).stat().st_size > 1000 for name in FIGURES)
    assert (folder / "scenario.toml").read_text() == SCENARIO
    result = json.loads((folder / "result.json").read_text())
    assert result["complete"]
    assert result["seeds"] == [4]
    [run] = result["results"]["runs"]
    assert run["reached"] == {"ann": 2, "bob/1": 1} == dict(history.reached)
    assert run["steps"] == history.steps[-1].step
    assert len(run["sessions"]) == len(history.sessions)
    assert max(session["max_rel_diff"] for session in run["sessions"]) <= 1e-9
    for robot, name in (("ann", "ann"), ("bob/1", "bob%2F1")):
        estimate = read_tum(folder / "trajectories" / f"{name}.tum")
        truth = read_tum(folder / "truth" / f"{name}.tum")
        steps = history.final.trajectory_steps[robot]
        np.testing.assert_array_equal(estimate.times_s, 4.0 * np.array(steps))
        np.testing.assert_array_equal(estimate.times_s, truth.times_s)
        positions = history.final.trajectories[robot][:, :2]
        np.testing.assert_array_equal(estimate.poses[:, :2, 3], positions)
        error = np.linalg.norm(estimate.poses[-1, :2, 3] - truth.poses[-1, :2, 3])
        assert error == pytest.approx(run["position_error_m"][robot])


def test_run_says_what_each_session_did(said_and_folder):
    said, _ = said_and_folder
    assert "plain: closed loop, seed 4" in said
    assert "session 1 at step 0 (start); new candidates ann 4, bob/1 4; kept none" in said
    assert "ann: 2 of 2 goals; position off by" in said
    assert "met: max_rel_diff" in said


@pytest.mark.usefixtures("_no_pictures")
def test_run_that_is_done_is_not_run_again(folder, tmp_path):
    (tmp_path / LOOP).write_bytes((folder / LOOP).read_bytes())
    assert main(["run", str(folder / "scenario.toml"), "--out", str(tmp_path)]) == 0
    assert (tmp_path / LOOP).read_bytes() == (folder / LOOP).read_bytes()
    results = [json.loads((path / "result.json").read_text()) for path in (folder, tmp_path)]
    assert results[0]["results"] == results[1]["results"]


@pytest.mark.usefixtures("_no_pictures")
def test_run_that_was_stopped_goes_on_in_its_folder(folder, tmp_path):
    lines = (folder / LOOP).read_bytes().splitlines(keepends=True)
    (tmp_path / LOOP).write_bytes(b"".join(lines[:9]) + lines[9][:40])
    assert main(["run", str(folder / "scenario.toml"), "--out", str(tmp_path), "--quick"]) == 0
    (one, _), (other, _) = read_loop(folder), read_loop(tmp_path)
    worlds.assert_same(one, other)


def test_folder_of_another_mission_is_refused_and_left_as_it_is(folder, tmp_path, capsys):
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    other = write(tmp_path, ("seed = 4", "seed = 5"))
    assert main(["run", str(other), "--out", str(folder), "--quick"]) == 2
    assert "got another mission's ('plain')" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_plot_draws_a_loop_again(folder, capsys, monkeypatch):
    def short(history, path, **options):
        return animate_loop(history, path, **{**options, "frames": 3, "dpi": 40})

    monkeypatch.setattr(loop_command, "animate_loop", short)
    monkeypatch.setattr(loop_command, "draw_loop_figures", draw_first_session)
    for name in FIGURES:
        (folder / name).unlink()
    assert main(["plot", str(folder)]) == 0
    assert all((folder / name).stat().st_size > 1000 for name in FIGURES)
    assert "mission.gif" in capsys.readouterr().out


def test_several_runs_have_a_folder_each(tmp_path, capsys, monkeypatch):
    drawn = []
    monkeypatch.setattr(loop_command, "draw_loop_folder", lambda f, **_: drawn.append(f) or ())
    path = write(tmp_path, ("compare = true", "runs = 2\nsteps = 3"))
    assert main(["run", str(path), "--out", str(tmp_path / "out"), "--quick"]) == 0
    said = capsys.readouterr().out
    assert "2 runs: 3 to 3 steps; largest position error at the end median" in said
    assert "NOT MET: every_goal_is_reached" in said
    histories = [read_loop(tmp_path / "out" / f"seed-{seed}")[0] for seed in (4, 5)]
    assert not np.array_equal(
        histories[0].steps[1].truth["ann"], histories[1].steps[1].truth["ann"]
    )
    landmarks = [np.array(list(history.landmarks.values())) for history in histories]
    assert not np.array_equal(*landmarks)
    assert drawn == [tmp_path / "out" / "seed-4"]


def test_goal_that_nobody_reaches_ends_with_one(tmp_path, capsys):
    walls = "obstacles = [[[0,20],[60,20],[60,21],[0,21]]]"
    path = write(
        tmp_path, ("[sensors.eye]", f"{walls}\n[sensors.eye]"), ("[20.0, 20.0]", "[20, 9]")
    )
    assert main(["run", str(path), "--out", str(tmp_path / "out"), "--quick"]) == 1
    assert "no feasible plan: closed loop: no robot can reach a goal" in capsys.readouterr().err


def test_mission_is_what_the_scenario_says(tmp_path):
    mission = load(write(tmp_path))
    world = mission.world
    assert world.step_s == 4.0  # 8 m at 2 m/s, the slowest
    assert (mission.seed, mission.path_weight, mission.uncertainty_weight) == (4, 0.2, 1.0)
    assert mission.candidates.vertices == 40
    assert len(world.landmark_keys) == 13
    assert world.landmark_keys[0] == symbol_key("l", 0)
    assert world.known_landmarks == {symbol_key("l", 0)}
    np.testing.assert_allclose(mission.landmark_covariances[symbol_key("l", 0)], 0.09 * np.eye(2))
    np.testing.assert_array_equal(world.robots[0].pose, [5.0, 5.0, 1.57])
    np.testing.assert_allclose(mission.robots[1].start_covariance, np.diag([0.01, 0.01, 0.0001]))
    assert list(world.multi_robot) == ["team.multi_robot[0]"]
    assert world.robots[0].actuation is world.robots[0].odometry is mission.robots[0].motion


def test_simulation_says_how_the_world_truly_is(tmp_path):
    wall = "[[[20,30],[30,30],[30,34]]]"
    more = (
        "compare = true",
        f"measure_robots = false\nstep_s = 1.5\nobstacles = {wall}\nobstacle_range_m = 9.0\n"
        "others_landmarks = false\nrelinearise_m = 0.5\nsteps = 50\n"
        "actuation = { sigmas = [0.3, 0.3, 0.03] }\n"
        "odometry = { sigmas = [0.2, 0.2, 0.02], per_metre = [0.1, 0.1, 0.1] }",
    )
    path = write(tmp_path, more, ("count = 12", "positions = [[3.0, 4.0], [5.0, 6.0]]"))
    mission = load(path)
    world = mission.world
    assert not world.multi_robot
    assert mission.multi_robot
    assert world.step_s == 1.5
    assert len(mission.unknown_obstacles) == 1
    assert not mission.workspace.obstacles
    assert (mission.obstacle_range_m, mission.relinearise_m, mission.max_steps) == (9.0, 0.5, 50)
    assert not mission.others_landmarks
    np.testing.assert_array_equal(world.landmark_positions, [[20.0, 20.0], [3.0, 4.0], [5.0, 6.0]])
    np.testing.assert_array_equal(world.robots[0].actuation.sigmas, [0.3, 0.3, 0.03])
    np.testing.assert_array_equal(world.robots[1].odometry.per_metre, [0.1, 0.1, 0.1])


def test_map_of_its_own_seed_is_the_same_in_every_run(tmp_path):
    path = write(tmp_path, ("count = 12", "count = 12\nseed = 9"))
    one, other = load(path, 4), load(path, 5)
    np.testing.assert_array_equal(one.world.landmark_positions, other.world.landmark_positions)
    assert (one.seed, other.seed) == (4, 5)


def test_robots_in_space(tmp_path):
    changes = (
        ("start = [5.0, 5.0, 1.57]", "start = [5.0, 5.0, 3.0, 0.0, 0.0, 0.7071, 0.7071]"),
        ("start_sigmas = [0.01, 0.01, 0.01]", "start_sigmas = [0.01, 0.01, 0.01, 0.1, 0.1, 0.1]"),
        ("goals = [[10.0, 40.0], [40.0, 25.0]]", "goals = [[10.0, 40.0, 3.0]]"),
        ("start = [40.0, 5.0, 1.57]", "start = [40.0, 5.0, 3.0, 0.0, 0.0, 0.0, 1.0]"),
        (
            "start_covariance = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.0001]]",
            "start_sigmas = [0.01, 0.01, 0.01, 0.1, 0.1, 0.1]",
        ),
        ("goal = [50.0, 40.0]", "goal = [50.0, 40.0, 3.0]"),
        ("position = [20.0, 20.0]", "position = [20.0, 20.0, 1.0]"),
        ("sigmas = [0.3, 0.3, 0.02]", "sigmas = [0.02, 0.02, 0.02, 0.3, 0.3, 0.3]"),
        ("count = 12", "count = 12\nheights_m = [0.0, 6.0]"),
    )
    path = write(tmp_path, *changes)
    text = path.read_text()
    motion = "sigmas = [0.1, 0.1, 0.01]"
    path.write_text(text.replace(motion, "sigmas = [0.01, 0.01, 0.01, 0.1, 0.1, 0.1]"))
    mission = load(path)
    assert mission.world.landmark_positions.shape == (13, 3)
    assert (mission.world.landmark_positions[:, 2] <= 6.0).all()
    records = list(run_loop(mission, compare=True))
    assert all(session.max_rel_diff <= 1e-9 for session in worlds.sessions_of(records))
    assert worlds.reached(records) == {"ann": 1, "bob/1": 1}
    path.write_text(path.read_text().replace("heights_m = [0.0, 6.0]", "heights_m = [6.0, 0.0]"))
    with pytest.raises(ScenarioError, match="expected the least first"):
        load(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("spacing_m = 8.0", "")], r"the longest step .*planner\.impacted_paths\.spacing_m`"),
        ([("spacing_m = 8.0", "spacing_m = 8.0\norder = 'random'")], r"got order .*paths\.order`"),
        ([("spacing_m = 8.0", "spacing_m = -8.0")], r"spacing_m.*planner\.impacted_paths`"),
        ([("compare = true", "comparison = true")], "unknown field `comparison`; expected one of"),
        ([("compare = true", "kind = 'dance'")], "expected 'closed_loop', got 'dance'"),
        ([("compare = true", "runs = 0")], r">= 1, got 0 - at `\$\.simulation\.runs`"),
        ([("compare = true", "options.rate = 3")], r"got rate - at `\$\.simulation\.options`"),
        (
            [("count = 12", "count = 12\npositions = [[1, 2]]")],
            "positions or count, one of the two",
        ),
        ([("count = 12", "count = 12\nheights_m = [0, 1]")], "for robots in space, and only there"),
        ([("count = 12", "positions = [[1, 2, 3]]")], r"expected 2 coordinates .*positions\[0\]`"),
        (
            [("compare = true", "obstacles = [[[20,30],[30,30],[30,34]]]")],
            "obstacle_range_m: expec",
        ),
        (
            [("compare = true", "obstacles = [[[20,30],[30,30],[40,30]]]")],
            r"simulation\.obstacles`",
        ),
        (
            [("compare = true", "odometry = { sigmas = [1, 1, 1, 1] }")],
            "sigmas.*simulation.odometry",
        ),
        ([("path_weight = 0.2", "terms = [{ kind = 'path_length' }]")], r"objective\.terms`"),
        (
            [("[planner]", "[[targets]]\nname = 't'\nmean = [1, 2]\nsigmas = [1, 1]\n[planner]")],
            r"targets`",
        ),
    ],
)
def test_scenario_is_refused_by_field(tmp_path, changes, message):
    with pytest.raises(ScenarioError, match=message):
        load(write(tmp_path, *changes))


def test_scenario_without_simulation_is_no_closed_loop(tmp_path):
    path = write(
        tmp_path, ("[simulation]\ncompare = true\n\n[simulation.landmarks]\ncount = 12\n", "")
    )
    with pytest.raises(ScenarioError, match=r"what is executed, got none - at `\$\.simulation`"):
        load(path)


def test_past_of_a_log_is_refused(tmp_path):
    examples = Path(__file__).parents[2] / "examples" / "scenarios"
    text = (examples / "shared_past.yaml").read_text() + "\nsimulation: {steps: 3}\n"
    path = examples / "shared_past.yaml"
    scenario = read_scenario(path)
    mission = make_mission(scenario, path)
    copy = tmp_path / "past.yaml"
    copy.write_text(text)
    simulated = read_scenario(copy)
    with pytest.raises(ScenarioError, match=r"expected independent with \[simulation\]"):
        make_loop_mission(simulated, simulated.simulation, mission, 0, Place(copy))
