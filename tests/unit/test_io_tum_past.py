"""TUM trajectories as a team's past: assumed odometry, planar or spatial, and planning from it."""

import gtsam
import numpy as np
import pytest
from gtsam import symbol

from fgplan.cli import main
from fgplan.errors import ScenarioError
from fgplan.io.mission_file import load_mission
from fgplan.io.past_estimate import estimate_past
from fgplan.io.past_formats import read_team_past
from fgplan.io.past_scenario import derive_scenario
from fgplan.io.plan_file import read_plans
from fgplan.io.result_file import read_result
from fgplan.io.tum import write_tum
from fgplan.io.tum_past import read_tum_past

EAST = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 0.0, 0.0], [6.0, 0.0, 0.5], [9.0, 1.0, 0.5]]
"""A robot that goes along x, stands once, and turns."""


def two(tmp_path):
    """Two planar robots, five poses each, two seconds a step."""
    folder = tmp_path / "tracks"
    folder.mkdir()
    times = 1.3e9 + 2.0 * np.arange(5)
    write_tum(folder / "bob.tum", times, np.add(EAST, [0.0, 6.0, 0.0]))
    write_tum(folder / "ann.tum", times, np.array(EAST))
    return folder


def spatial(count=4):
    """Poses of a robot that climbs and rolls, (n, 4, 4)."""
    step = gtsam.Pose3.Expmap(np.array([0.2, -0.1, 0.3, 1.0, 0.5, 0.25]))
    poses = [gtsam.Pose3()]
    while len(poses) < count:
        poses.append(poses[-1].compose(step))
    return np.array([pose.matrix() for pose in poses])


def test_planar_robots_with_the_assumed_odometry(tmp_path):
    past = read_team_past(two(tmp_path))
    assert past.format == "tum"
    assert [file.name for file in past.files] == ["ann.tum", "bob.tum"]
    assert past.robots == {
        "ann": tuple(symbol("a", step) for step in range(5)),
        "bob": tuple(symbol("b", step) for step in range(5)),
    }
    assert past.times_s[symbol("b", 3)] == 1.3e9 + 6.0
    assert past.stamps_s == tuple(1.3e9 + 2.0 * step for step in (1, 2, 3, 4)) * 2
    assert past.graph.size() == 8
    assert past.graph.error(past.values) < 1e-24
    last = past.values.atPose2(symbol("b", 4))
    np.testing.assert_allclose([last.x(), last.y(), last.theta()], [9.0, 7.0, 0.5], rtol=1e-12)
    # 3 m: base^2 + distance * per_metre^2, by hand
    moving, standing = (past.graph.at(index).noiseModel().covariance() for index in (0, 1))
    np.testing.assert_allclose(np.diag(moving), [0.0076, 0.0076, 3.01e-4], rtol=1e-9)
    np.testing.assert_allclose(np.diag(standing), [1e-4, 1e-4, 1e-6], rtol=1e-9)
    assert "ASSUMED" in past.notes[0]
    assert "0.01 m and 0.001 rad a step and 0.05 m and 0.01 rad after a metre" in past.notes[0]
    assert "in the plane" in past.notes[0]
    assert "not correlated" in past.notes[1]


def test_every_robot_is_held_and_none_is_correlated(tmp_path):
    estimate = estimate_past(read_tum_past(two(tmp_path)))
    assert set(estimate.held) == {symbol("a", 0), symbol("b", 0)}
    assert not estimate.optimised
    joint = estimate.belief.covariance([symbol("a", 4), symbol("b", 4)])
    np.testing.assert_array_equal(joint[:3, 3:], np.zeros((3, 3)))
    # x at the second pose: held to 1 mm, and one step of 3 m
    variance = estimate.belief.covariance(symbol("a", 1))[0, 0]
    assert variance == pytest.approx(1e-6 + 0.0076, rel=1e-9)
    tables = derive_scenario(estimate, "two").tables
    assert tables["prior"] == {"kind": "tum", "folder": "past"}
    assert tables["team"] == {}
    metres = 3.0 + 3.0 + np.sqrt(10.0)
    motion = tables["robots"][0]["motion"]
    assert motion["speed_m_per_s"] == pytest.approx(metres / 8.0, rel=1e-5)
    assert motion["per_metre"][0] == pytest.approx(np.sqrt(4e-4 / metres + 0.0025), rel=1e-5)


def test_a_file_in_space(tmp_path):
    write_tum(tmp_path / "drone.tum", np.arange(4.0), spatial())
    past = read_team_past(tmp_path / "drone.tum")
    assert past.robots == {"drone": tuple(symbol("a", step) for step in range(4))}
    assert past.graph.error(past.values) < 1e-20
    distance = float(np.linalg.norm(spatial()[1, :3, 3]))
    want = [1e-6 + 1e-4 * distance] * 3 + [1e-4 + 2.5e-3 * distance] * 3  # rotation first
    found = np.diag(past.graph.at(0).noiseModel().covariance())
    np.testing.assert_allclose(found, want, rtol=1e-9)
    assert len(past.notes) == 1
    assert "in space" in past.notes[0]


def test_what_leaves_the_plane_is_in_space(tmp_path):
    folder = two(tmp_path)
    assert read_tum_past(folder).values.dims()[symbol("a", 0)] == 3
    level = np.array([np.eye(4)] * 2)
    off = level.copy()
    off[1, 2, 3] = 2e-6
    over = np.array([np.diag([1.0, -1.0, -1.0, 1.0])] * 2)  # upside down
    rolled = np.array([np.eye(4), gtsam.Pose3.Expmap([2e-6, 0, 0, 0, 0, 0]).matrix()])
    for poses in (off, over, rolled):
        write_tum(folder / "carl.tum", [0.0, 1.0], poses)
        assert set(read_tum_past(folder).values.dims().values()) == {6}
    off[1, 2, 3] = 5e-7
    write_tum(folder / "carl.tum", [0.0, 1.0], off)
    assert read_tum_past(folder).values.dims()[symbol("c", 1)] == 3


def test_robots_named_by_letters_keep_them(tmp_path):
    for name in ("d", "c"):
        write_tum(tmp_path / f"{name}.tum", [0.0, 1.0], np.array(EAST[:2]))
    past = read_tum_past(tmp_path)
    assert past.robots == {name: (symbol(name, 0), symbol(name, 1)) for name in "cd"}
    write_tum(tmp_path / "l.tum", [0.0, 1.0], np.array(EAST[:2]))  # landmarks' letter
    assert [keys[0] for keys in read_tum_past(tmp_path).robots.values()] == [
        symbol(letter, 0) for letter in "abc"
    ]


@pytest.mark.parametrize("stamp", ["1.0", "0.5"])
def test_stamps_that_do_not_increase_are_refused(tmp_path, stamp):
    path = tmp_path / "ann.tum"
    lines = ["# a remark", "0 0 0 0 0 0 0 1", "", "1.0 1 0 0 0 0 0 1", f"{stamp} 2 0 0 0 0 0 1"]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(ScenarioError, match=rf"ann\.tum:5: pose: .*increase, got {stamp} after 1"):
        read_team_past(path)


def test_files_that_are_no_past_are_refused(tmp_path):
    path = tmp_path / "ann.tum"
    path.write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(ScenarioError, match=r"ann\.tum: expected two poses at least.* got one"):
        read_team_past(path)
    path.write_text("0 0 0 0 0 0 0 1\n1 0 0\n")
    with pytest.raises(ScenarioError, match=r"ann\.tum:2: pose: expected 8 numbers.* got 3"):
        read_team_past(path)
    (tmp_path / "none").mkdir()
    with pytest.raises(ScenarioError, match=r"expected 1 to 50 files ROBOT\.tum.* got 0"):
        read_tum_past(tmp_path / "none")


@pytest.mark.usefixtures("no_pictures")
def test_two_robots_are_planned_for_and_their_folder_runs_again(tmp_path, capsys):
    folder, out, again = two(tmp_path), tmp_path / "out", tmp_path / "again"
    assert main(["run", str(folder), "--quick", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    for words in (
        "past: tum, 2 robots, 10 poses, 8 factors, from 2 files",
        "ASSUMED: odometry between consecutive poses, in the plane",
        "fixes the frame of bob: pose b0 is held",
        "their poses are not correlated",
        "how they lie to each other is not measured",
    ):
        assert words in said, words
    plans = read_plans(out / "plans.json")
    assert [plan.robot for plan in plans] == ["ann", "bob"]
    assert plans[0].start_s == 1.3e9 + 8.0
    np.testing.assert_allclose(plans[0].poses[-1][:2, 3], [9.0, 7.0], atol=1e-4)
    assert (out / "past" / "bob.tum").read_bytes() == (folder / "bob.tum").read_bytes()
    assert main(["run", str(out / "scenario.toml"), "--quick", "--out", str(again)]) == 0
    for name in ("plans.json", "covariances.json", "past/ann.tum", "past/bob.tum"):
        assert (again / name).read_bytes() == (out / name).read_bytes()
    digests = [
        read_result(run / "result.json").results["plans"][0]["scenario_digest"]
        for run in (out, again)
    ]
    assert digests[0] == digests[1]
    # What a run writes beside its pose graph is a past of its own, and the graph stays one.
    assert read_team_past(out / "trajectories").format == "tum"
    assert read_team_past(out).format == "pyfg"
    # One file, its ending in capitals, into the same run folder: the other robot's copy goes.
    one = (folder / "ann.tum").rename(folder / "ann.TUM")
    assert main(["run", str(one), "--quick", "--out", str(out)]) == 0
    assert [file.name for file in (out / "past").iterdir()] == ["ann.tum"]
    assert main(["run", str(out / "scenario.toml"), "--quick", "--out", str(again)]) == 0
    capsys.readouterr()


def test_a_scenario_names_one_file_and_its_past_takes_part(tmp_path):
    two(tmp_path)
    text = """
schema = 1
world = { bounds = [[-10, -10], [40, 20]] }
prior = { kind = "tum", folder = "tracks/ann.tum", past = true }
planner = { name = "impacted_paths" }
objective = { preset = "length_and_uncertainty" }
robots = [{ name = "ann", goal = [30, 0], motion = { sigmas = [0.1, 0.1, 0.01] } }]
"""
    (tmp_path / "s.toml").write_text(text)
    states = [state.state for state in load_mission(tmp_path / "s.toml").past_states]
    assert [(s.robot, s.step, s.time_s) for s in states] == [
        ("ann", step, 2.0 * step) for step in (-4, -3, -2, -1)
    ]
    (tmp_path / "t.toml").write_text(text.replace("ann.tum", "eve.tum"))
    with pytest.raises(ScenarioError, match=r"eve\.tum - at `\$\.prior\.folder`"):
        load_mission(tmp_path / "t.toml")
