"""The closed loop: noise of the size stated, what is visible and nothing else, resumable."""

import dataclasses
import pickle

import numpy as np
import pytest
from scipy.stats import chi2

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.models.hidden_state import HiddenBlock, HiddenState, independent_targets
from fgplan.models.motion import MotionModel
from fgplan.models.pose import between
from fgplan.models.range_bearing import BearingRangeSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.simulation.command import Commands, commands_along, commands_of, heading_changes
from fgplan.simulation.noise import exponential
from fgplan.simulation.simulate import advance, resume, simulate, start
from fgplan.simulation.world import World, WorldRobot
from roadmaps import Workspace

ACTUATION = MotionModel(sigmas=[0.1, 0.2, 0.01], per_metre=[0.05, 0.05, 0.002])
ODOMETRY = MotionModel(sigmas=[0.3, 0.1, 0.02])


def plan(steps, seed=0):
    generator = np.random.default_rng(seed)
    return heading_changes(generator.uniform(-0.5, 0.5, steps), generator.uniform(5, 10, steps))


def busy_world(**rest):
    """Two robots, landmarks, targets, all kinds of sensors."""
    camera = BearingRangeSensor(
        bearing_sigma_rad=0.02, range_sigma_m=0.5, max_range_m=40.0, field_of_view_rad=2.0
    )
    generator = np.random.default_rng(8)
    robots = tuple(
        WorldRobot(
            name=name,
            pose=np.array([50.0, 45.0 + 10.0 * place, 0.0]),
            actuation=ACTUATION,
            odometry=ODOMETRY,
            landmark_sensors=("camera",),
            target_sensors=("sonar",),
            robot_sensors=("sonar",),
        )
        for place, name in enumerate(("r1", "r2"))
    )
    return World(
        robots=robots,
        sensors={"camera": camera, "sonar": RangeSensor(sigma_m=0.5, max_range_m=60.0)},
        landmark_keys=tuple(range(40)),
        landmark_positions=generator.uniform(0, 150, (40, 2)),
        hidden=independent_targets(("a", "b"), np.array([[1.0, 0], [0, 1.0]]), 0.1 * np.eye(2)),
        hidden_state=np.array([60.0, 60.0, 80.0, 40.0]),
        **rest,
    )


def same(one, other):
    """Whether two products are equal to the last bit."""
    if dataclasses.is_dataclass(one):
        return type(one) is type(other) and all(
            same(getattr(one, each.name), getattr(other, each.name))
            for each in dataclasses.fields(one)
        )
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return np.array_equal(one, other)


def within_bounds(squared, degrees):
    low, high = chi2.ppf([0.0005, 0.9995], degrees)
    return low < squared < high


def test_motion_and_odometry_noise_have_the_covariance_stated():
    robots = tuple(
        WorldRobot(name=f"r{i}", pose=np.zeros(3), actuation=ACTUATION, odometry=ODOMETRY)
        for i in range(40)
    )
    world = World(robots=robots)
    commands = plan(40)
    moved = measured = 0.0
    poses = {one.name: one.pose for one in robots}
    for step in simulate(world, {one.name: commands for one in robots}, np.random.default_rng(1)):
        for reading in step.odometry:
            command = commands.relative[step.state.step - 1]
            true = between(poses[reading.robot], step.poses[reading.robot])
            error = between(command, true)
            moved += error @ np.linalg.solve(ACTUATION.covariance(command), error)
            error = between(true, reading.relative)
            np.testing.assert_array_equal(reading.covariance, ODOMETRY.covariance(command))
            measured += error @ np.linalg.solve(reading.covariance, error)
        poses = step.poses
    assert within_bounds(moved, 40 * 40 * 3)
    assert within_bounds(measured, 40 * 40 * 3)


def test_without_odometry_a_robot_reads_its_command():
    deaf = WorldRobot(name="r1", pose=np.zeros(3), actuation=ACTUATION)
    exact = WorldRobot(name="r2", pose=np.zeros(3))
    commands = plan(3)
    *_, last = simulate(
        World(robots=(deaf, exact)), {"r1": commands, "r2": commands}, np.random.default_rng(0)
    )
    first, second = last.odometry
    np.testing.assert_array_equal(first.relative, commands.relative[-1])
    np.testing.assert_array_equal(first.covariance, ACTUATION.covariance(commands.relative[-1]))
    assert second.covariance is None
    assert np.abs(last.poses["r1"] - last.poses["r2"]).max() > 1e-3


def test_measurement_noise_has_the_covariance_stated():
    world = busy_world()
    squared = degrees = 0
    kinds = set()
    for seed in range(25):
        commands = {"r1": plan(10), "r2": plan(10, 1)}
        for step in simulate(world, commands, np.random.default_rng(seed)):
            for seen in step.measurements:
                sensor, pose = world.sensors[seen.sensor], step.poses[seen.robot]
                if seen.kind == "landmark":
                    target = world.landmark_position(seen.target)
                elif seen.kind == "target":
                    target = step.hidden_state[world.hidden.slice_of(seen.target)]
                else:
                    target = step.poses[seen.target][:2]
                error = sensor.difference(seen.value, sensor.predict(pose, target))
                squared += error @ np.linalg.solve(seen.covariance, error)
                degrees += error.size
                kinds.add(seen.kind)
    assert kinds == {"landmark", "target", "robot"}
    assert degrees > 3000
    assert within_bounds(squared, degrees)


def test_exactly_what_is_visible_is_measured():
    walls = [[(60, 40), (62, 40), (62, 70), (60, 70)], [(90, 20), (130, 20), (130, 25), (90, 25)]]
    workspace = Workspace(lower=[-500, -500], upper=[500, 500], obstacles=walls)
    world = busy_world(workspace=workspace)
    hidden_by_wall = out_of_view = out_of_range = seen_count = 0
    for step in simulate(world, {"r1": plan(12), "r2": plan(12, 1)}, np.random.default_rng(2)):
        for robot in world.robots:
            pose = step.poses[robot.name]
            offset = world.landmark_positions - pose[:2]
            near = np.linalg.norm(offset, axis=1) <= 40.0
            angle = np.arctan2(offset[:, 1], offset[:, 0]) - pose[2]
            ahead = np.abs(np.arctan2(np.sin(angle), np.cos(angle))) <= 1.0
            free = workspace.has_line_of_sight(pose[:2], world.landmark_positions)
            expected = np.flatnonzero(near & ahead & free).tolist()
            seen = [
                one.target for one in step.measurements_of(robot.name) if one.kind == "landmark"
            ]
            assert seen == expected
            seen_count += len(seen)
            hidden_by_wall += int((near & ahead & ~free).sum())
            out_of_view += int((near & ~ahead & free).sum())
            out_of_range += int((~near & ahead & free).sum())
    assert min(hidden_by_wall, out_of_view, out_of_range, seen_count) > 0


def test_same_seed_same_run():
    world = busy_world()
    commands = {"r1": plan(6), "r2": plan(4, 1)}
    runs = [list(simulate(world, commands, np.random.default_rng(seed))) for seed in (3, 3, 4)]
    assert len(runs[0]) == 7
    assert all(same(one, other) for one, other in zip(runs[0], runs[1], strict=True))
    assert not same(runs[0][-1], runs[2][-1])
    assert [len(step.odometry) for step in runs[0]] == [0, 2, 2, 2, 2, 1, 1]
    assert [step.time_s for step in runs[0]] == list(range(7))


def test_a_resumed_run_equals_an_uninterrupted_one():
    world = busy_world()
    commands = {"r1": plan(6), "r2": plan(4, 1)}
    whole = list(simulate(world, commands, np.random.default_rng(3)))
    for stop in range(7):
        state = pickle.loads(pickle.dumps(whole[stop].state))
        rest = list(resume(world, state, commands))
        assert len(rest) == 6 - stop
        assert all(same(*pair) for pair in zip(rest, whole[stop + 1 :], strict=True))
    later = list(resume(world, whole[6].state, {"r1": plan(2)}, begun_at=6))
    assert [step.state.step for step in later] == [7, 8]
    with pytest.raises(InvalidInputError, match="begun at step 2 or before, got 5"):
        resume(world, whole[2].state, commands, begun_at=5)


def test_truth_of_targets_does_not_depend_on_the_robots():
    world = busy_world()
    one = list(simulate(world, {"r1": plan(5)}, np.random.default_rng(3)))
    other = list(simulate(world, {"r1": plan(5, 9), "r2": plan(5)}, np.random.default_rng(3)))
    for first, second in zip(one, other, strict=True):
        np.testing.assert_array_equal(first.hidden_state, second.hidden_state)
    # And the noise of a robot's motion is its own: r1 differs by its commands alone.
    alone = list(simulate(world, {"r1": plan(5, 9)}, np.random.default_rng(3)))
    np.testing.assert_array_equal(alone[-1].poses["r1"], other[-1].poses["r1"])
    np.testing.assert_array_equal(alone[-1].poses["r2"], world.robot("r2").pose)


def test_hidden_targets_follow_their_dynamics():
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    world = World(
        robots=(WorldRobot(name="r1", pose=np.zeros(3)),),
        hidden=HiddenState((HiddenBlock(targets=("a",), transition=turn),)),
        hidden_state=np.array([1.0, 0.0]),
    )
    state, commands = start(world, np.random.default_rng(0)).state, {}
    for expected in ([0, 1], [-1, 0], [0, -1], [1, 0]):
        state, step = advance(world, state, commands)
        np.testing.assert_allclose(step.hidden_state, expected, atol=1e-15)
    assert step.odometry == ()


def test_robots_measure_each_other_by_multi_robot_models():
    relative = RelativePoseSensor(covariance=np.diag([0.04, 0.04, 0.001]))
    models = {
        "scene": MultiRobotModel(criterion=DistanceCriterion(30.0), sensor=relative),
        "ping": MultiRobotModel(
            criterion=DistanceCriterion(20.0),
            sensor=RangeSensor(sigma_m=0.1),
            time_tolerance_s=0.5,
        ),
    }
    wall = Workspace(
        lower=[-99, -99], upper=[99, 99], obstacles=[[(4, -5), (6, -5), (6, 5), (4, 5)]]
    )
    poses = {"r1": [0.0, 0, 0], "r2": [0.0, 15, 1], "r3": [10.0, 0, 2], "r4": [-25.0, 0, 3]}
    robots = tuple(WorldRobot(name=name, pose=np.array(pose)) for name, pose in poses.items())
    world = World(robots=robots, multi_robot=models, workspace=wall)
    squared = 0.0
    generator = np.random.default_rng(0)
    for _ in range(200):
        step = start(world, generator)
        pairs = [(one.sensor, one.robot, one.target) for one in step.measurements]
        assert pairs == [
            ("scene", "r1", "r2"),
            ("scene", "r1", "r3"),
            ("scene", "r1", "r4"),
            ("ping", "r1", "r2"),
            ("scene", "r2", "r3"),
            ("scene", "r2", "r4"),
            ("ping", "r2", "r3"),
        ]  # r1 and r3 are near, but the wall blocks the ping; r3 and r4 are too far apart
        for one in step.measurements:
            if one.sensor == "scene":
                true = between(step.poses[one.robot], step.poses[one.target])
                error = between(true, one.value)
                squared += error @ np.linalg.solve(one.covariance, error)
    assert within_bounds(squared, 200 * 5 * 3)


def test_robots_in_space():
    camera = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.1, max_range_m=50.0)
    noise = MotionModel(sigmas=0.01 * np.ones(6))
    robot = WorldRobot(name="r1", pose=np.eye(4), actuation=noise, landmark_sensors=("camera",))
    world = World(
        robots=(robot,),
        sensors={"camera": camera},
        landmark_keys=(1, 2),
        landmark_positions=[[10.0, 2.0, 3.0], [200.0, 0.0, 0.0]],
    )
    path = np.array([exponential(np.array([0, 0, 0.1, 1.0, 0, 0.2]) * i) for i in range(6)])
    steps = list(simulate(world, {"r1": commands_along(path)}, np.random.default_rng(0)))
    np.testing.assert_allclose(steps[-1].poses["r1"], path[-1], atol=0.3)
    assert [one.target for step in steps for one in step.measurements] == [1] * 6
    assert steps[0].measurements[0].value.shape == (4,)


def test_collisions_are_reported():
    workspace = Workspace(lower=[0, 0], upper=[50, 50], obstacles=[[(9, 0), (11, 0), (11, 3)]])
    robots = (
        WorldRobot(name="r1", pose=np.array([1.0, 1.0, 0.0])),
        WorldRobot(name="r2", pose=np.array([1.0, 9.0, 0.0])),
    )
    world = World(robots=robots, workspace=workspace)
    commands = {name: heading_changes([0.0, 0.0], [5.0, 10.0]) for name in ("r1", "r2")}
    steps = list(simulate(world, commands, np.random.default_rng(0)))
    assert [step.collided for step in steps] == [(), (), ("r1",)]


def test_commands_of_paths():
    poses = np.array([[0, 0, 0.5], [3, 4, 1.0], [3, 8, np.pi / 2]])
    path = CandidatePath(
        robot="r1", poses=poses, times_s=[0, 5, 9], motion_covariances=np.tile(np.eye(3), (2, 1, 1))
    )
    world = World(robots=(WorldRobot(name="r1", pose=poses[0]),))
    *_, last = simulate(world, {"r1": path}, np.random.default_rng(0))
    np.testing.assert_allclose(last.poses["r1"], poses[-1], atol=1e-12)
    again = commands_of(commands_of(path))
    np.testing.assert_array_equal(again.relative, commands_along(poses).relative)
    assert len(again) == 2
    assert len(commands_along(poses[:1])) == 0


def test_bad_commands():
    with pytest.raises(InvalidInputError, match=r"one relative pose a step, got \(3,\)"):
        Commands(np.zeros(3))
    with pytest.raises(InvalidInputError, match="expected poses of shape"):
        commands_along(np.zeros((2, 2)))
    with pytest.raises(InvalidInputError, match="distances_m"):
        heading_changes([0.0, 0.0], [1.0])
    world = World(robots=(WorldRobot(name="r1", pose=np.zeros(3)),))
    state = start(world, np.random.default_rng(0)).state
    with pytest.raises(UnknownNameError, match="robot 'r2'"):
        advance(world, state, {"r2": np.zeros(3)})
    with pytest.raises(InvalidInputError, match="command of robot 'r1'"):
        advance(world, state, {"r1": np.eye(4)})
    with pytest.raises(InvalidInputError, match="command of robot 'r1'"):
        advance(world, state, {"r1": np.array([np.nan, 0, 0])})
    with pytest.raises(UnknownNameError, match="robot 'r2'"):
        simulate(world, {"r2": plan(2)}, np.random.default_rng(0))
