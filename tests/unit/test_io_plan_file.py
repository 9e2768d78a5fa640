"""Plans and covariances as ROS has them: order and frame by finite differences, round trips."""

from dataclasses import replace

import gtsam
import msgspec
import numpy as np
import pytest
from gtsam import symbol
from scipy.spatial.transform import Rotation

from fgplan.errors import InvalidInputError
from fgplan.io.g2o import read_g2o
from fgplan.io.past_estimate import estimate_past
from fgplan.io.past_files import plan_start_s, read_covariances, write_past_files
from fgplan.io.plan_file import PlannedTrajectory, planned_trajectories, read_plans, write_plans
from fgplan.io.pyfg import read_pyfg
from fgplan.io.ros_covariance import ROS_ORDER, map_covariance, ros_covariance, ros_jacobian
from fgplan.io.team_past import TeamPast
from fgplan.io.tum import read_tum, spatial_matrix
from fgplan.paths.candidate_path import CandidatePath
from fgplan.planners.plan import Plan, RobotPlan


def random_pose(rng, planar):
    if planar:
        return np.append(rng.normal(size=2, scale=10.0), rng.uniform(-3.0, 3.0))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    pose[:3, 3] = rng.normal(size=3, scale=10.0)
    return pose


def random_covariance(rng, size):
    root = rng.normal(size=(size, size))
    return root @ root.T + np.eye(size)


def moved(pose, tangent):
    """GTSAM's own retraction."""
    if pose.ndim == 1:
        found = gtsam.Pose2(*pose).compose(gtsam.Pose2.Expmap(tangent))
        return spatial_matrix(np.array([found.x(), found.y(), found.theta()]))
    return gtsam.Pose3(pose).compose(gtsam.Pose3.Expmap(tangent)).matrix()


def ros_offset(before, after):
    """Move of the position and rotation about the fixed axes, world frame: what ROS speaks of."""
    turn = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
    return np.concatenate([after[:3, 3] - before[:3, 3], turn])


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("seed", range(5))
def test_order_and_frame_are_those_of_ros(planar, seed):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng, planar)
    size, step = (3 if planar else 6), 1e-5
    columns = []
    for tangent in step * np.eye(size):
        offset = ros_offset(moved(pose, -tangent), moved(pose, tangent))
        columns.append(offset / (2.0 * step))
    jacobian = np.array(columns).T
    covariance = random_covariance(rng, size)
    want = jacobian @ covariance @ jacobian.T
    # 1e-8: central differences of a step of 1e-5.
    np.testing.assert_allclose(ros_covariance(pose, covariance), want, atol=1e-8 * want.max())
    rows = [0, 1, 5] if planar else range(6)
    np.testing.assert_allclose(ros_jacobian(pose), jacobian[list(rows)], atol=1e-8)
    np.testing.assert_array_equal(
        map_covariance(pose, covariance), ros_covariance(pose, covariance)[np.ix_(rows, rows)]
    )


def test_sampled_positions_and_headings_have_the_covariance():
    rng = np.random.default_rng(7)
    pose = random_pose(rng, planar=False)
    covariance = 1e-6 * random_covariance(rng, 6)
    drawn = rng.multivariate_normal(np.zeros(6), covariance, size=4_000)
    offsets = np.array([ros_offset(pose, moved(pose, tangent)) for tangent in drawn])
    want = ros_covariance(pose, covariance)
    spread = np.sqrt(np.diag(want))
    # 4,000 draws leave 1.6 parts in a hundred, and five of these is no chance.
    error = (np.cov(offsets.T) - want) / np.outer(spread, spread)
    assert np.abs(error).max() < 0.08


def test_a_turned_robot_has_its_covariance_turned():
    along = np.diag([4.0, 1.0, 0.25])  # 2 m along, 1 m across, 0.5 rad
    found = ros_covariance([0.0, 0.0, np.pi / 2], along)
    want = np.zeros((6, 6))
    want[0, 0], want[1, 1], want[5, 5] = 1.0, 4.0, 0.25
    np.testing.assert_allclose(found, want, atol=1e-15)
    with pytest.raises(InvalidInputError, match="covariance: expected shape"):
        ros_covariance([0.0, 0.0, 0.0], np.eye(6))


def make_plan(planar):
    rng = np.random.default_rng(11)
    size = 3 if planar else 6
    start = random_pose(rng, planar)
    poses = np.array([start, *(random_pose(rng, planar) for _ in range(3))])
    path = CandidatePath(
        robot="ann",
        poses=poses,
        times_s=[0.0, 1.25, 2.5, 1e3 + 0.1],
        motion_covariances=np.array([np.eye(size)] * 3),
        vertices=(0, 1, -1, 2),
        length_m=12.0,
    )
    covariances = np.array([random_covariance(rng, size) for _ in range(4)])
    goals = np.zeros((1, 2))
    robots = (
        RobotPlan(robot="ann", start=start, path=path, covariances=covariances, goals=goals),
        RobotPlan(
            robot="bob", start=start, path=None, covariances=covariances[:1], goals=np.zeros((0, 2))
        ),
        RobotPlan(
            robot="eve", start=start, path=None, covariances=np.zeros((0, 0, 0)), goals=goals
        ),
    )
    return Plan(planner="p", mission="m", scenario_digest="", seed=0, robots=robots)


@pytest.mark.parametrize("planar", [True, False])
def test_written_plans_read_back(tmp_path, planar):
    plan = make_plan(planar)
    path = write_plans(tmp_path / "plans.json", plan, start_s=1288971842.161)
    have, want = read_plans(path), planned_trajectories(plan, start_s=1288971842.161)
    assert [item.robot for item in have] == ["ann", "bob", "eve"]
    assert [len(item.times_s) for item in have] == [4, 1, 1]
    assert [len(item.covariances) for item in have] == [4, 1, 0]
    for one, other in zip(have, want, strict=True):
        assert one.frame_id == "map"
        # Stamps are whole nanoseconds; a double of seconds since 1970 has 2.4e-7.
        np.testing.assert_allclose(one.times_s, other.times_s, atol=5e-7, rtol=0.0)
        assert one.start_s == pytest.approx(1288971842.161, abs=5e-7)
        np.testing.assert_allclose(one.poses, other.poses, atol=1e-14)
        np.testing.assert_array_equal(one.covariances, other.covariances)
    ann = plan.robots[0]
    np.testing.assert_array_equal(
        have[0].covariances[2], ros_covariance(ann.poses[2], ann.covariances[2])
    )
    np.testing.assert_allclose(have[0].poses[1], spatial_matrix(ann.poses[1]), atol=1e-14)


def test_plans_have_the_fields_of_ros_messages(tmp_path):
    content = msgspec.json.decode(
        write_plans(tmp_path / "a.json", make_plan(True), 2.5).read_bytes()
    )
    path = content["plans"][0]["path"]
    header = {"stamp": {"sec": 2, "nanosec": 500_000_000}, "frame_id": "map"}
    assert path["header"] == header
    assert set(path) == {"header", "poses"}
    second = path["poses"][1]
    assert second["header"]["stamp"] == {"sec": 3, "nanosec": 750_000_000}
    assert set(second) == {"header", "pose"}
    assert set(second["pose"]["position"]) == set("xyz")
    assert set(second["pose"]["orientation"]) == set("xyzw")
    assert len(path["poses"]) == len(content["plans"][0]["covariances"])
    assert all(len(numbers) == 36 for numbers in content["plans"][0]["covariances"])
    assert "fixed axes of frame_id" in content["convention"]


def test_what_is_no_plan_is_refused(tmp_path):
    path = write_plans(tmp_path / "a.json", make_plan(True))
    good = msgspec.json.decode(path.read_bytes())

    def refused(words, content):
        path.write_bytes(content if isinstance(content, bytes) else msgspec.json.encode(content))
        with pytest.raises(InvalidInputError, match=words):
            read_plans(path)

    refused("schema: expected 'plans.v1', got 'plans.v9'", {**good, "schema": "plans.v9"})
    refused("expected plans as fgplan run writes them", b"{")
    refused("expected plans as fgplan run writes them: KeyError: 'plans'", {"schema": "plans.v1"})
    other = msgspec.json.decode(msgspec.json.encode(good))
    other["plans"][0]["path"]["poses"][1]["header"]["frame_id"] = "odom"
    refused("robot 'ann': expected one frame_id, got map, odom", other)
    short = msgspec.json.decode(msgspec.json.encode(good))
    short["plans"][0]["covariances"].pop()
    refused("expected 4 covariances or none, got 3", short)
    bent = msgspec.json.decode(msgspec.json.encode(good))
    bent["plans"][0]["path"]["poses"][1]["pose"]["orientation"]["w"] = 2.0
    refused("robot 'ann': pose 1: expected a unit quaternion", bent)
    with pytest.raises(InvalidInputError, match="expected plans as fgplan run writes them"):
        read_plans(tmp_path / "none.json")
    with pytest.raises(InvalidInputError, match="trajectory of robot 'x': poses"):
        PlannedTrajectory(
            robot="x",
            frame_id="map",
            start_s=0.0,
            times_s=np.zeros(2),
            poses=np.zeros((1, 4, 4)),
            covariances=np.zeros((0, 6, 6)),
        )


def small_past(planar, times):
    """Two robots, two poses each, a landmark, and an edge between the robots."""
    rng = np.random.default_rng(5)
    pose, between = (
        (gtsam.Pose2, gtsam.BetweenFactorPose2)
        if planar
        else (gtsam.Pose3, gtsam.BetweenFactorPose3)
    )
    size = 3 if planar else 6
    keys = [symbol("A", 0), symbol("A", 1), symbol("B", 0), symbol("B", 1)]
    values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
    poses = [pose.Expmap(rng.normal(size=size)) for _ in keys]
    for key, value in zip(keys, poses, strict=True):
        values.insert(key, value)
    values.insert(symbol("L", 0), rng.normal(size=2 if planar else 3))
    for first, second in ((0, 1), (2, 3), (1, 2)):
        noise = gtsam.noiseModel.Gaussian.Covariance(random_covariance(rng, size))
        graph.add(between(keys[first], keys[second], poses[first].between(poses[second]), noise))
    name = "BearingRangeFactor2D" if planar else "BearingRangeFactor3D"
    bearing = gtsam.Rot2(0.3) if planar else gtsam.Unit3(np.array([1.0, 0.2, 0.1]))
    noise = gtsam.noiseModel.Isotropic.Sigma(2 if planar else 3, 0.1)
    graph.add(getattr(gtsam, name)(keys[3], symbol("L", 0), bearing, 2.0, noise))
    return TeamPast(
        format="test",
        files=(),
        graph=graph,
        values=values,
        robots={"A": tuple(keys[:2]), "B/1": tuple(keys[2:])},
        times_s=dict(zip(keys, times, strict=True)) if times else {},
        stamps_s=(1.5, 2.5, 2.5, 2.5) if times else (),
    )


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("times", [(), (0.5, 1.5, 0.25, 2.5)])
def test_past_is_written_in_forms_that_others_read(tmp_path, planar, times):
    estimate = estimate_past(small_past(planar, times))
    files, notes = write_past_files(tmp_path, estimate)
    assert notes == ()
    graph = "pose_graph.pyfg" if times else "pose_graph.g2o"
    names = {str(file.relative_to(tmp_path)) for file in files}
    assert names == {"trajectories/A.tum", "trajectories/B%2F1.tum", graph, "covariances.json"}
    keys = estimate.past.robots["B/1"]
    track = read_tum(tmp_path / "trajectories" / "B%2F1.tum")
    np.testing.assert_array_equal(track.times_s, times[2:] or [0.0, 1.0])
    want = [spatial_matrix(estimate.belief.pose(key)) for key in keys]
    np.testing.assert_allclose(track.poses, want, atol=1e-14)
    assert plan_start_s(estimate) == (2.5 if times else 1.0)

    read = read_pyfg(tmp_path / graph) if times else read_g2o(tmp_path / graph)
    assert read.values.equals(estimate.belief.values, 1e-9)
    held = next(iter(estimate.held))
    if times:
        assert read.graph.size() == estimate.belief.graph.size()
        assert read.stamps_s == (1.5, 2.5, 2.5, 2.5, 0.5)
    else:
        assert read.graph.size() == estimate.past.graph.size()
        assert read.fixed == (held,)

    found = read_covariances(tmp_path / "covariances.json")
    assert list(found) == ["A0", "A1", "B0", "B1", "L0"]
    order = ("x", "y", "rotation_z") if planar else ROS_ORDER
    for name, key, robot in (("A1", symbol("A", 1), "A"), ("B1", keys[1], "B/1")):
        item = found[name]
        assert (item.order, item.robot, item.frame_id) == (order, robot, "map")
        # 1e-9: one pass for all marginals beside a query of one.
        exact = map_covariance(estimate.belief.pose(key), estimate.belief.covariance(key))
        np.testing.assert_allclose(item.covariance, exact, rtol=1e-9, atol=1e-12)
    assert found["B1"].stamp_s == (2.5 if times else 1.0)
    landmark = found["L0"]
    assert (landmark.order, landmark.robot, landmark.stamp_s) == (
        order[: 2 + (not planar)],
        "",
        None,
    )
    exact = estimate.belief.covariance(symbol("L", 0))
    np.testing.assert_allclose(landmark.covariance, exact, rtol=1e-9)
    content = msgspec.json.decode((tmp_path / "covariances.json").read_bytes())
    assert content["held"] == {"A0": [1e-3] * len(order)}


def test_factors_that_the_format_does_not_hold_are_named(tmp_path):
    past = small_past(True, (0.5, 1.5, 0.25, 2.5))
    first, second = symbol("A", 1), symbol("B", 1)
    noise = gtsam.noiseModel.Isotropic.Sigma(2, 0.1)
    for _ in range(2):
        sight = gtsam.BearingRangeFactorPose2(first, second, gtsam.Rot2(0.1), 2.0, noise)
        past.graph.add(sight)
    estimate = estimate_past(replace(past, stamps_s=(*past.stamps_s, 3.0, 3.5)))
    _, notes = write_past_files(tmp_path, estimate)
    assert notes == (
        "pose_graph.pyfg leaves out 2 BearingRangeFactorPose2: PyFactorGraph text has no line for "
        "them",
    )
    path = tmp_path / "pose_graph.pyfg"
    assert path.read_text().startswith(f"# {notes[0]}\n")
    read = read_pyfg(path)
    assert read.graph.size() == estimate.belief.graph.size() - 2
    assert read.stamps_s == (1.5, 2.5, 2.5, 2.5, 0.5)


def test_what_an_earlier_run_left_goes(tmp_path):
    (tmp_path / "trajectories").mkdir()
    for name in ("trajectories/z.tum", "pose_graph.pyfg"):
        (tmp_path / name).write_text("old")
    write_past_files(tmp_path, estimate_past(small_past(True, ())))
    assert sorted(path.name for path in (tmp_path / "trajectories").iterdir()) == [
        "A.tum",
        "B%2F1.tum",
    ]
    assert not (tmp_path / "pose_graph.pyfg").exists()


def test_past_files_that_cannot_be_written_or_read(tmp_path):
    estimate = estimate_past(small_past(True, ()))
    (tmp_path / "trajectories").write_text("a file")
    with pytest.raises(InvalidInputError, match="expected a folder to write to"):
        write_past_files(tmp_path, estimate)
    path = tmp_path / "covariances.json"
    for content, words in (
        (b"[", "expected covariances as fgplan run writes them"),
        (b'{"schema": "x"}', "schema: expected 'covariances.v1', got 'x'"),
        (b'{"schema": "covariances.v1"}', "expected covariances as fgplan run writes them"),
    ):
        path.write_bytes(content)
        with pytest.raises(InvalidInputError, match=words):
            read_covariances(path)
