"""A team's past from any format, its joint estimate, and what holds its frame."""

import itertools
from pathlib import Path

import gtsam
import numpy as np
import pytest
from gtsam import symbol

from fgplan.errors import IllPosedBeliefError, InvalidInputError, ScenarioError
from fgplan.io.past_estimate import estimate_past
from fgplan.io.past_formats import is_team_past, read_team_past
from fgplan.io.past_scenario import derive_scenario
from fgplan.io.rotation_first import rotations_first
from fgplan.io.scenario_text import scenario_text
from fgplan.io.team_past import read_g2o_past, read_pyfg_past

ARGOS = Path(__file__).parents[2] / "examples" / "data" / "argos_10_robots"
GRID = Path(__file__).parents[1] / "data" / "g2o" / "smallGrid3D.g2o"
GOATS = Path(gtsam.findExampleDataFile("goats_15.pyfg"))
SQUARE = "100 0 0 100 0 400"


def planar(tmp_path, name, keys, extra="", offset=0.0):
    """One robot that goes along x, a metre a step."""
    lines = [f"VERTEX_SE2 {key} {step + offset} 0 0" for step, key in enumerate(keys)]
    lines += [
        f"EDGE_SE2 {first} {second} 1 0 0 {SQUARE}" for first, second in itertools.pairwise(keys)
    ]
    path = tmp_path / name
    path.write_text("\n".join([*lines, extra]) + "\n")
    return path


def test_ten_robots_by_their_letters():
    past = read_team_past(ARGOS)
    assert past.format == "g2o"
    assert list(past.robots) == list("abcdefghij")
    assert all(len(keys) == 107 for keys in past.robots.values())
    assert past.robots["c"][-1] == symbol("c", 106)
    assert past.robot_of[symbol("d", 5)] == "d"
    assert past.graph.size() == 1370
    assert any("226 edges stand in two files" in note for note in past.notes)


def test_robots_by_file_where_ids_have_no_letter(tmp_path):
    first = planar(tmp_path, "ann.g2o", [0, 1, 2])
    second = planar(tmp_path, "bob.g2o", [10, 11], f"EDGE_SE2 1 10 0 1 0 {SQUARE}")
    past = read_team_past(tmp_path)
    assert past.robots == {"ann": (0, 1, 2), "bob": (10, 11)}
    planar(tmp_path, "carl.g2o", [1, 12], offset=1.0)
    with pytest.raises(ScenarioError, match=r"pose 1 stands in ann.g2o and carl.g2o: whose is it"):
        read_team_past(tmp_path)
    third = planar(tmp_path, "dora.g2o", [symbol("d", 0), symbol("d", 1)])
    with pytest.raises(ScenarioError, match=r"a letter for every pose or for none, got d0 and 0"):
        read_g2o_past([first, second, third])


def test_robots_up_to_their_current_poses(tmp_path):
    path = planar(tmp_path, "one.g2o", list(range(6)))
    past = read_g2o_past(path, current={"late": 5, "early": 2})
    assert past.robots == {"late": (3, 4, 5), "early": (0, 1, 2)}


def test_poses_of_pyfg_are_in_the_order_of_time(tmp_path):
    path = tmp_path / "a.pyfg"
    path.write_text(
        "VERTEX_SE2 3 A0 0 0 0\nVERTEX_SE2 1 A1 1 0 0\nVERTEX_SE2 2 B0 1 0 0\nVERTEX_XY L0 1 1\n"
        "EDGE_RANGE 1 A1 L0 1 1\n"
    )
    past = read_team_past(tmp_path)
    assert past.robots == {"A": (symbol("A", 1), symbol("A", 0)), "B": (symbol("B", 0),)}
    assert past.stamps_s == (1.0,)
    (tmp_path / "b.pyfg").write_text("VERTEX_SE2 3 A0 0 0 0\n")
    with pytest.raises(ScenarioError, match=r"expected one \.pyfg file.* got 2; name one"):
        read_pyfg_past(tmp_path)


def test_formats_are_told_apart(tmp_path):
    assert is_team_past(ARGOS)
    assert is_team_past(Path("a.g2o"))
    assert not is_team_past(Path("a.toml"))
    with pytest.raises(ScenarioError, match="expected a file or folder, found none"):
        read_team_past(tmp_path / "nothing.g2o")
    with pytest.raises(ScenarioError, match=r"a folder of one of g2o, pyfg.* got none of them"):
        read_team_past(tmp_path)
    (tmp_path / "ann.tum").write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    assert is_team_past(tmp_path / "ann.tum")
    for path in (tmp_path / "ann.tum", tmp_path):
        assert read_team_past(path).format == "tum"
    (tmp_path / "a.pyfg").write_text("VERTEX_XY L0 0 0\n")
    with pytest.raises(ScenarioError, match="expected poses of at least one robot, got none"):
        read_team_past(tmp_path / "a.pyfg")
    (tmp_path / "a.pyfg").unlink()
    planar(tmp_path, "a.g2o", [0, 1])
    assert read_team_past(tmp_path).format == "g2o"  # the trajectory beside it is a result
    (tmp_path / "a.pyfg").write_text("VERTEX_SE2 3 A0 0 0 0\n")
    with pytest.raises(ScenarioError, match="got g2o and pyfg"):
        read_team_past(tmp_path)
    (tmp_path / "points").mkdir()
    (tmp_path / "points" / "a.g2o").write_text("VERTEX_XY 0 0 0\n")
    with pytest.raises(ScenarioError, match="expected poses of at least one robot, got none"):
        read_team_past(tmp_path / "points")


def gradient(belief):
    """Largest entry of A'b over that of |A|'|b|: zero at a minimum."""
    linear = belief.linear()
    matrix, right = linear.jacobian()
    scale = np.abs(matrix).T @ np.abs(right)
    return float((np.abs(matrix.T @ right) / scale.max()).max())


@pytest.mark.parametrize("path", [GRID, GOATS])
def test_estimate_is_a_minimum(path):
    past = read_team_past(path)
    estimate = estimate_past(past)
    assert estimate.converged
    assert estimate.optimised
    assert estimate.error_after < 0.02 * estimate.error_before
    assert gradient(estimate.belief) < 1e-5
    assert estimate.error_before == past.graph.error(past.values)  # the held pose is at its value
    first = next(iter(past.robots.values()))[0]
    np.testing.assert_array_equal(estimate.held[first], [1e-3] * estimate.belief.dim(first))


def test_estimate_equals_gtsams_gauss_newton():
    past = read_team_past(ARGOS)
    estimate = estimate_past(past)
    graph = gtsam.NonlinearFactorGraph(past.graph)
    noise = gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)
    first = past.robots["a"][0]
    graph.add(gtsam.PriorFactorPose3(first, past.values.atPose3(first), noise))
    params = gtsam.GaussNewtonParams()
    params.setRelativeErrorTol(1e-14)
    values = gtsam.GaussNewtonOptimizer(graph, past.values, params).optimize()
    assert estimate.error_after == pytest.approx(graph.error(values), rel=1e-9)
    for keys in past.robots.values():
        have, want = estimate.belief.pose(keys[-1]), values.atPose3(keys[-1]).matrix()
        np.testing.assert_allclose(have, want, atol=1e-3)  # both stop where the error does not fall
    assert any("rotations first" in note for note in estimate.notes)


def test_kept_initial_values():
    past = read_team_past(GRID)
    estimate = estimate_past(past, optimise=False)
    assert not estimate.optimised
    assert estimate.error_after == estimate.error_before
    assert estimate.belief.values.equals(past.values, 0.0)


def test_every_part_that_nothing_holds_is_held_and_named(tmp_path):
    planar(tmp_path, "ann.g2o", [0, 1, 2])
    planar(tmp_path, "bob.g2o", [10, 11], "FIX 10")
    planar(tmp_path, "carl.g2o", [20, 21])
    estimate = estimate_past(read_team_past(tmp_path))
    assert set(estimate.held) == {0, 10, 20}
    text = " ".join(estimate.notes)
    assert "fixes the frame of ann: pose 0 is held" in text
    assert "fixes the frame of carl: pose 20 is held" in text
    assert "how they lie to each other is not measured" in text
    alone = estimate_past(read_team_past(tmp_path / "bob.g2o"))
    assert (set(alone.held), alone.notes) == ({10}, ())
    with pytest.raises(IllPosedBeliefError):
        estimate_past(read_team_past(tmp_path), hold=[10])


def test_what_cannot_be_held_is_refused(tmp_path):
    past = read_team_past(planar(tmp_path, "ann.g2o", [0, 1, 2]))
    with pytest.raises(InvalidInputError, match="expected a pose to hold, got 7"):
        estimate_past(past, hold=[7])
    with pytest.raises(InvalidInputError, match="gauge sigmas: expected 3 numbers, got 6"):
        estimate_past(past, sigmas=[1.0] * 6)


@pytest.mark.parametrize("space", [2, 3])
def test_rotations_first_needs_no_initial_values(space):
    rng = np.random.default_rng(space)
    truth, wrong = gtsam.Values(), gtsam.Values()
    graph = gtsam.NonlinearFactorGraph()
    pose = gtsam.Pose2 if space == 2 else gtsam.Pose3
    between = gtsam.BetweenFactorPose2 if space == 2 else gtsam.BetweenFactorPose3
    tangent = 3 * (space - 1)
    poses = [pose.Expmap(2.0 * rng.normal(size=tangent)) for _ in range(30)]
    for key, value in enumerate(poses):
        truth.insert(key, value)
        wrong.insert(key, poses[0])
    noise = gtsam.noiseModel.Isotropic.Sigma(tangent, 0.1)
    for first, second in [*zip(range(29), range(1, 30), strict=True), (3, 20), (28, 1)]:
        graph.add(between(first, second, poses[first].between(poses[second]), noise))
    found = rotations_first(graph, wrong, 0)
    assert found.equals(truth, 1e-9)  # without noise the relaxation is exact
    apart = gtsam.Values(wrong)
    apart.insert(99, poses[0])
    assert rotations_first(graph, apart, 0) is None
    assert rotations_first(gtsam.NonlinearFactorGraph(), wrong, 0) is None
    other = gtsam.NonlinearFactorGraph(graph)
    ranged = gtsam.RangeFactorPose2 if space == 2 else gtsam.RangeFactorPose3
    other.add(ranged(0, 5, 1.0, gtsam.noiseModel.Isotropic.Sigma(1, 1.0)))
    assert rotations_first(other, wrong, 0) is None
    landmark = gtsam.Values(wrong)
    landmark.insert(98, np.zeros(space))
    assert rotations_first(graph, landmark, 0) is None


def test_scenario_derived_from_ten_robots():
    estimate = estimate_past(read_team_past(ARGOS))
    tables = derive_scenario(estimate, "ten").tables
    last = {robot: estimate.belief.pose(key)[:3, 3] for robot, key in estimate.current_keys.items()}
    goals = {robot["name"]: robot["goal"] for robot in tables["robots"]}
    np.testing.assert_allclose(goals["a"], last["b"], rtol=1e-5)
    np.testing.assert_allclose(goals["j"], last["a"], rtol=1e-5)
    every = np.array([estimate.belief.pose(k)[:2, 3] for k in estimate.belief.keys])
    lower, upper = np.array(tables["world"]["bounds"])
    margin = 0.1 * np.ptp(every, axis=0).max()
    np.testing.assert_allclose(every.min(axis=0) - lower, margin, rtol=1e-4)
    np.testing.assert_allclose(upper - every.max(axis=0), margin, rtol=1e-4)
    # 1060 odometry edges of 0.1 m and 0.01 rad each, 1077.82 m in all
    sigma = np.sqrt(1060 / 1077.82)
    want = [0.01 * sigma] * 3 + [0.1 * sigma] * 3
    np.testing.assert_allclose(tables["robots"][0]["motion"]["per_metre"], want, rtol=1e-5)
    [model] = tables["team"]["multi_robot"]
    assert 13.0 < model["distance_m"] < 16.0
    variances = np.diag(model["sensor"]["covariance"])
    np.testing.assert_allclose(variances, [1e-4] * 3 + [1e-2] * 3, rtol=1e-5)


def test_scenario_derived_from_ranges(tmp_path):
    path = tmp_path / "a.pyfg"
    triangle = "0.01 0 0 0.01 0 0.0004"
    lines = ["VERTEX_XY L0 2 4", "VERTEX_SE2:PRIOR 0 A0 0 0 0 1 0 0 1 0 1"]
    lines.append("VERTEX_SE2:PRIOR 0 B0 0 3 0 1 0 0 1 0 1")
    for name, y in (("A", 0), ("B", 3)):
        for step in range(4):
            lines.append(f"VERTEX_SE2 {2 * step} {name}{step} {step} {y} 0")
            lines.append(f"EDGE_RANGE {2 * step} {name}{step} L0 {np.hypot(2 - step, 4 - y)} 0.25")
        lines += [f"EDGE_SE2 0 {name}{i} {name}{i + 1} 1 0 0 {triangle}" for i in range(3)]
    lines += [f"EDGE_RANGE 0 A{step} B{step} 3 0.04" for step in range(4)]
    path.write_text("\n".join(lines) + "\n")
    estimate = estimate_past(read_team_past(path))
    assert estimate.held == {}
    tables = derive_scenario(estimate, "two").tables
    assert tables["prior"] == {"kind": "pyfg", "file": "past/a.pyfg", "estimate": True}
    farthest = np.hypot(2, 4)
    assert tables["sensors"]["range"]["sigma_m"] == 0.5
    assert tables["sensors"]["range"]["max_range_m"] == pytest.approx(farthest, rel=1e-5)
    [model] = tables["team"]["multi_robot"]
    assert model["sensor"] == {"kind": "range", "sigma_m": 0.2}
    assert model["distance_m"] == pytest.approx(3.0, rel=1e-5)
    motion = tables["robots"][0]["motion"]
    assert motion["speed_m_per_s"] == 0.5
    np.testing.assert_allclose(motion["per_metre"], [0.1, 0.1, 0.02], rtol=1e-5)


def test_goal_of_one_robot_and_a_log_without_odometry(tmp_path):
    path = tmp_path / "a.pyfg"
    lines = ["VERTEX_SE2:PRIOR 0 A0 0 0 0 1 0 0 1 0 1", "VERTEX_SE2 0 A0 0 0 0"]
    lines += ["VERTEX_SE2:PRIOR 1 A1 9 0 0 1 0 0 1 0 1", "VERTEX_SE2 1 A1 9 0 0"]
    path.write_text("\n".join(lines) + "\n")
    derived = derive_scenario(estimate_past(read_team_past(path)), "one")
    assert derived.tables["robots"][0]["goal"] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert derived.tables["robots"][0]["motion"]["per_metre"] == [0.1] * 3
    assert derived.tables["team"] == {}
    notes = " ".join(derived.notes)
    for words in ("back to where it began", "no odometry that moves", "no factors, the log has"):
        assert words in notes


def test_scenario_text_reads_back():
    import tomllib

    tables = {
        "schema": 1,
        "name": 'a "quoted" name\n and \\ more',
        "on": True,
        "numbers": [1.5, np.float64(1e-9), -3],
        "empty": [],
        "rows": [[1, 2], [3, 4]],
        "left out": None,
        "inner": {"deep": {"x": 1.0}, "y": "z"},
        "list": [{"a": 1, "b": {"c": False}}, {"a": 2}],
    }
    want = {name: value for name, value in tables.items() if value is not None}
    text = scenario_text(tables, ["one", "two"])
    assert text.startswith("# one\n# two\n\nschema = 1\n")
    assert tomllib.loads(text) == want
    with pytest.raises(InvalidInputError, match="expected plain values, got ndarray"):
        scenario_text({"a": np.zeros(2)})
