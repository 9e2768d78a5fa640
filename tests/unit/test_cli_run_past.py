"""``fgplan run LOG``: what it derives, writes and says; the same again as a scenario; errors."""

import shutil

import msgspec
import numpy as np
import pytest

from fgplan.cli import main
from fgplan.io.mission_file import load_mission
from fgplan.io.plan_file import read_plans
from fgplan.io.result_file import read_result
from fgplan.io.scenario_file import read_scenario
from fgplan.io.tum import read_tum

TRIANGLE = "100 0 0 100 0 400"


def team(tmp_path, kind="g2o", loose=""):
    """Two robots beside each other, six poses each, joined at their second and fifth poses."""
    lines = []
    spread = "0.01 0 0 0.01 0 0.0025"
    keys = {(r, i): (ord(r) << 56) + i for r in "ab" for i in range(6)}
    for robot, y in (("a", 0), ("b", 6)):
        for step in range(6):
            name = f"{step} {robot}{step}" if kind == "pyfg" else keys[robot, step]
            lines.append(f"VERTEX_SE2 {name} {3 * step} {y} 0")
    for robot in "ab":
        for step in range(5):
            ends = f"{step + 1} {robot}{step} {robot}{step + 1}"
            if kind == "g2o":
                ends = f"{keys[robot, step]} {keys[robot, step + 1]}"
            lines.append(f"EDGE_SE2 {ends} 3 0 0 {spread if kind == 'pyfg' else TRIANGLE}")
    for step in (1, 4):
        ends = (
            f"{step} a{step} b{step}" if kind == "pyfg" else f"{keys['a', step]} {keys['b', step]}"
        )
        if not loose:
            lines.append(f"EDGE_SE2 {ends} 0 6 0 {spread if kind == 'pyfg' else TRIANGLE}")
    path = tmp_path / f"team.{kind}"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("kind", ["g2o", "pyfg"])
def test_a_log_is_planned_from_and_its_folder_runs_again(tmp_path, capsys, kind):
    path, out, again = team(tmp_path, kind), tmp_path / "out", tmp_path / "again"
    assert main(["run", str(path), "--quick", "--check", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert f"past: {kind}, 2 robots, 12 poses, 12 factors, from 1 file" in said
    for words in (
        "joint estimate: half squared error",
        "nothing in the files fixes the frame: pose a0 is held",
        "goals: each robot goes to the last pose of the next",
        "between robots: relative pose nearer than 6 m",
        "met: agreed",
        "met: estimate_converged",
        "position on arrival",
    ):
        assert words in said, words
    names = {str(file.relative_to(out)) for file in out.rglob("*") if file.is_file()}
    assert names >= {
        "scenario.toml",
        f"past/team.{kind}",
        "trajectories/a.tum",
        "trajectories/b.tum",
        f"pose_graph.{kind}",
        "covariances.json",
        "plans.json",
        "result.json",
        "record.json",
        "chosen_paths.png",
    }
    first = read_plans(out / "plans.json")
    assert [plan.robot for plan in first] == ["a", "b"]
    track = read_tum(out / "trajectories" / "a.tum")
    np.testing.assert_array_equal(track.times_s, np.arange(6.0))
    assert first[0].start_s == 5.0
    np.testing.assert_allclose(first[0].poses[0], track.poses[-1], atol=1e-12)
    np.testing.assert_allclose(first[0].poses[-1][:2, 3], [15.0, 6.0], atol=1e-12)
    results = read_result(out / "result.json").results["past"]
    assert results["format"] == kind
    assert results["poses"] == {"a": 6, "b": 6}
    assert results["factors"] == 12

    # The derived scenario is a scenario like any other: the same plan, digest and files again.
    assert main(["run", str(out / "scenario.toml"), "--quick", "--out", str(again)]) == 0
    assert (again / "plans.json").read_bytes() == (out / "plans.json").read_bytes()
    assert (again / "covariances.json").read_bytes() == (out / "covariances.json").read_bytes()
    assert (again / "past" / f"team.{kind}").is_file()
    plans = [read_result(folder / "result.json").results["plans"][0] for folder in (out, again)]
    assert plans[0]["scenario_digest"] == plans[1]["scenario_digest"]


@pytest.mark.usefixtures("no_pictures")
def test_a_run_folder_is_used_again_for_another_log(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["run", str(team(tmp_path, "pyfg")), "--quick", "--out", str(out)]) == 0
    folder = tmp_path / "parts"
    folder.mkdir()
    shutil.copy(team(tmp_path), folder / "0.g2o")
    assert main(["run", str(folder), "--quick", "--out", str(out)]) == 0
    assert [path.name for path in (out / "past").iterdir()] == ["0.g2o"]
    assert not (out / "pose_graph.pyfg").exists()
    assert read_scenario(out / "scenario.toml").name == "parts"
    # Its own past, copied onto itself.
    assert main(["run", str(out / "past"), "--quick", "--out", str(out)]) == 0
    assert [path.name for path in (out / "past").iterdir()] == ["0.g2o"]
    capsys.readouterr()


@pytest.mark.usefixtures("no_pictures")
def test_a_run_never_removes_a_log_or_files_of_a_user(tmp_path, capsys):
    graph = team(tmp_path).rename(tmp_path / "pose_graph.g2o")
    content = graph.read_bytes()
    assert main(["run", str(graph), "--quick", "--out", str(tmp_path)]) == 2
    assert "expected a run folder other than that of the log" in capsys.readouterr().err
    assert graph.read_bytes() == content
    # A scenario that names such a file, run where it lies.
    out = tmp_path / "out"
    assert main(["run", str(graph), "--quick", "--out", str(out)]) == 0
    text = (out / "scenario.toml").read_text().replace('["past"]', '["pose_graph.g2o"]')
    (tmp_path / "scenario.toml").write_text(text)
    assert main(["run", str(tmp_path / "scenario.toml"), "--quick", "--out", str(tmp_path)]) == 2
    assert graph.read_bytes() == content
    # A user's own folder of the name that a log is copied to.
    mine = tmp_path / "mine" / "past"
    mine.mkdir(parents=True)
    (mine / "notes.txt").write_text("mine")
    assert main(["run", str(graph), "--quick", "--out", str(mine.parent)]) == 2
    assert "choose another --out" in capsys.readouterr().err
    assert (mine / "notes.txt").read_text() == "mine"
    # Beside the copy that a run made, what is no log stays.
    (out / "past" / "notes.txt").write_text("mine")
    assert main(["run", str(team(tmp_path, "pyfg")), "--quick", "--out", str(out)]) == 0
    assert sorted(path.name for path in (out / "past").iterdir()) == ["notes.txt", "team.pyfg"]
    capsys.readouterr()


@pytest.mark.usefixtures("no_pictures")
def test_a_log_with_an_ending_in_capitals_runs_again_from_its_folder(tmp_path, capsys):
    graph, out = team(tmp_path).rename(tmp_path / "team.G2O"), tmp_path / "out"
    assert main(["run", str(graph), "--quick", "--out", str(out)]) == 0
    again = str(tmp_path / "again")
    assert main(["run", str(out / "scenario.toml"), "--quick", "--out", again]) == 0
    assert "12 poses, 12 factors" in capsys.readouterr().out


@pytest.mark.usefixtures("no_pictures")
def test_everything_can_be_overridden(tmp_path, capsys):
    team(tmp_path)
    text = """
schema = 1
[world]
bounds = [[-10, -10], [40, 20]]
[prior]
kind = "g2o"
files = ["team.g2o"]
estimate = true
past_step_s = 2.0
start_keys = { ann = "a3", bob = "b5" }
gauge = { key = "b0", sigmas = [0.5, 0.5, 0.1] }
[[robots]]
name = "ann"
goal = [30, 0]
motion = { sigmas = [0.1, 0.1, 0.01] }
[[robots]]
name = "bob"
goal = [0, 0]
motion = { sigmas = [0.1, 0.1, 0.01] }
[objective]
preset = "length_and_uncertainty"
[planner]
name = "impacted_paths"
"""
    path = tmp_path / "scenario.toml"
    path.write_text(text)
    mission = load_mission(path)
    assert [robot.name for robot in mission.robots] == ["ann", "bob"]
    assert mission.prior.pose(mission.robots[0].start_key) == pytest.approx([9, 0, 0], abs=1e-9)
    assert [state.key for state in mission.past_states[:3]] == [
        ord("a") << 56 | i for i in range(3)
    ]
    held = mission.prior.covariance(ord("b") << 56)
    np.testing.assert_allclose(np.diag(held), [0.25, 0.25, 0.01], rtol=1e-9)
    out = tmp_path / "out"
    assert main(["run", str(path), "--quick", "--out", str(out)]) == 0
    assert len(read_tum(out / "trajectories" / "ann.tum").times_s) == 4
    assert "joint estimate" in capsys.readouterr().out


def test_past_of_pyfg_takes_part_at_its_times(tmp_path):
    path = team(tmp_path, "pyfg")
    text = """
schema = 1
world = { bounds = [[-10, -10], [40, 20]] }
prior = { kind = "pyfg", file = "team.pyfg", estimate = true, past = true }
planner = { name = "impacted_paths" }
objective = { preset = "length_and_uncertainty" }
robots = [
  { name = "a", goal = [30, 0], motion = { sigmas = [0.1, 0.1, 0.01] } },
  { name = "b", goal = [0, 0], motion = { sigmas = [0.1, 0.1, 0.01] } },
]
"""
    (tmp_path / "s.toml").write_text(text)
    states = [state.state for state in load_mission(tmp_path / "s.toml").past_states]
    assert len(states) == 10
    assert [(s.robot, s.step, s.time_s) for s in states[:2]] == [("a", -5, -5.0), ("a", -4, -4.0)]
    (tmp_path / "t.toml").write_text(text.replace("estimate = true", "estimate = false"))
    with pytest.raises(ValueError, match=r"expected a pose to hold.* at `\$\.prior\.gauge`"):
        load_mission(tmp_path / "t.toml")
    (tmp_path / "u.toml").write_text(text.replace('"team.pyfg"', '"absent.pyfg"'))
    with pytest.raises(ValueError, match=r"no .*absent\.pyfg - at `\$\.prior\.file`"):
        load_mission(tmp_path / "u.toml")
    (tmp_path / "v.toml").write_text(text.replace('name = "b"', 'name = "bob"'))
    with pytest.raises(ValueError, match="expected a start key of this robot from the prior"):
        load_mission(tmp_path / "v.toml")
    path.write_text(path.read_text().replace("EDGE_SE2", "EDGE_NEW", 1))
    with pytest.raises(ValueError, match=r"team\.pyfg:13: unknown tag EDGE_NEW.*prior\.file"):
        load_mission(tmp_path / "s.toml")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path / "absent", "scenario file named .toml"),
        (lambda path: path / "absent.g2o", "expected a file or folder, found none"),
        (lambda path: path, "got none of them"),
    ],
)
def test_what_cannot_be_run_is_one_line(tmp_path, capsys, make, words):
    (tmp_path / "in").mkdir()
    out = tmp_path / "out"
    assert main(["run", str(make(tmp_path / "in")), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert words in said
    assert not out.exists()


def test_an_estimate_that_is_not_determined_is_one_line(tmp_path, capsys):
    path = team(tmp_path)
    path.write_text(path.read_text() + f"VERTEX_SE2 {(ord('a') << 56) + 9} 0 0 0\n")
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "team.g2o" in said
    assert "a9" in said


@pytest.mark.usefixtures("no_pictures")
def test_team_without_a_common_measurement_is_said(tmp_path, capsys):
    path = team(tmp_path, loose="yes")
    assert main(["run", str(path), "--quick", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "how they lie to each other is not measured" in said
    assert "between robots: no factors, the log has none" in said
    held = msgspec.json.decode((tmp_path / "out" / "covariances.json").read_bytes())["held"]
    assert list(held) == ["a0", "b0"]


@pytest.mark.usefixtures("no_pictures")
def test_a_scenario_without_a_log_leaves_nothing_of_an_earlier_log(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["run", str(team(tmp_path)), "--quick", "--out", str(out)]) == 0
    assert (out / "trajectories" / "a.tum").is_file()
    text = """
schema = 1
world = { bounds = [[-10, -10], [40, 20]] }
planner = { name = "impacted_paths" }
objective = { preset = "length_and_uncertainty" }

[[robots]]
name = "ann"
start = [0, 0, 0]
start_sigmas = [0.1, 0.1, 0.1]
goal = [30, 0]
motion = { sigmas = [0.1, 0.1, 0.01] }
"""
    (tmp_path / "plain.toml").write_text(text)
    assert main(["run", str(tmp_path / "plain.toml"), "--quick", "--out", str(out)]) == 0
    for name in ("trajectories", "pose_graph.g2o", "covariances.json"):
        assert not (out / name).exists()
    [plan] = read_plans(out / "plans.json")
    assert (plan.robot, plan.start_s) == ("ann", 0.0)
    capsys.readouterr()
