from dataclasses import dataclass, replace

import gtsam
import numpy as np
import pytest
from slam_worlds import (
    BEARING_RANGE,
    fed,
    landmark,
    planar_world,
    run_of,
    slam_of,
    spatial_world,
    with_relative_poses,
)

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.factors.keys import describe_key, future_key
from fgplan.models.measurement import Measurement, Odometry
from fgplan.models.pose import between, compose, position
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.simulation.noise import disturb_pose, draw_measurement
from fgplan.slam.pose_key import MAX_TEAM, is_pose_key, pose_key
from fgplan.slam.robust_noise import RobustLoss
from fgplan.slam.team_slam import SlamOptions, SlamStart, TeamSlam

RANGE = RangeSensor(sigma_m=0.1)
BEARING = BearingSensor(sigma_rad=0.01)
BOTH = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.1)
MEETS = RelativePoseSensor(covariance=0.01 * np.eye(3))
SENSORS = {"range": RANGE, "bearing": BEARING, "both": BOTH, "meets": MEETS}
START = SlamStart(pose=np.zeros(3), covariance=1e-4 * np.eye(3))
FAR = SlamStart(pose=np.array([10.0, 0.0, 1.0]), covariance=1e-4 * np.eye(3))
COVARIANCE = 1e-4 * np.eye(3)
POINT = np.array([6.0, 5.0])


def two(**fields):
    return TeamSlam({"a": START, "b": FAR}, SENSORS, **fields)


def moved(robot="a", relative=(1.0, 0.0, 0.0), covariance=COVARIANCE):
    return Odometry(robot=robot, relative=np.array(relative), covariance=covariance)


def measured(sensor, pose, *, robot="a", target=None, point=POINT, kind="landmark", **fields):
    model = SENSORS[sensor]
    content = {
        "robot": robot,
        "sensor": sensor,
        "kind": kind,
        "target": landmark(0) if target is None else target,
        "value": model.predict(pose, point),
        "covariance": model.noise(pose, point),
    }
    return Measurement(**(content | fields))


# Keys


def test_pose_keys_read_well_and_never_meet():
    assert describe_key(pose_key(0, 12)) == "xA12"
    assert describe_key(pose_key(26, 100_000)) == "xa100000"
    keys = [pose_key(i, n) for i in range(MAX_TEAM) for n in (0, 1, 99_999, 2**48 - 1)]
    assert len(set(keys)) == len(keys)
    assert all(is_pose_key(key) for key in keys)
    others = [gtsam.symbol("x", 5), gtsam.symbol("l", 0), future_key(0, 1), 7]
    others.append(gtsam.LabeledSymbol(ord("l"), ord("A"), 5).key())
    assert not any(is_pose_key(key) for key in others)
    assert pose_key(1, 5) == gtsam.LabeledSymbol(ord("x"), ord("B"), 5).key()


def test_pose_keys_out_of_range_are_refused():
    with pytest.raises(InvalidInputError, match="robot_index: expected 0 to 51, got 52"):
        pose_key(MAX_TEAM, 0)
    with pytest.raises(InvalidInputError, match="count: expected 0 to"):
        pose_key(0, -1)


# What comes out


def test_before_anything_was_measured_the_starts_are_the_estimate():
    slam = two()
    assert slam.robots == ("a", "b")
    assert slam.keys("b") == (slam.key("b"),) == (pose_key(1, 0),)
    assert slam.steps("a") == (0,)
    np.testing.assert_allclose(slam.pose("b"), FAR.pose, atol=1e-15)
    np.testing.assert_allclose(slam.covariance("a"), START.covariance, rtol=1e-12, atol=1e-18)
    assert slam.landmarks() == slam.seen_by() == slam.waiting == {}


def test_a_robot_with_odometry_gets_a_pose_and_the_others_keep_theirs():
    slam = two()
    slam.update(0, [], [])
    slam.update(1, [moved("a", (1.0, 0.0, 0.5))], [])
    slam.update(4, [moved("a", (2.0, 0.0, 0.0))], [])
    assert slam.steps("a") == (0, 1, 4)
    assert slam.steps("b") == (0,)
    assert slam.keys("a") == tuple(pose_key(0, n) for n in range(3))
    expected = [START.pose]
    for step in ([1.0, 0.0, 0.5], [2.0, 0.0, 0.0]):
        expected.append(compose(expected[-1], np.array(step)))
    np.testing.assert_allclose(slam.trajectory("a"), expected, atol=1e-12)
    np.testing.assert_allclose(slam.pose("a"), expected[-1], atol=1e-12)
    # Headings add up: three variances of 1e-4.
    assert slam.covariance("a")[2, 2] == pytest.approx(3e-4, rel=1e-9)


def test_a_bearing_and_range_puts_a_landmark_where_it_was_seen():
    slam = two()
    slam.update(0, [], [measured("both", START.pose)])
    np.testing.assert_allclose(slam.landmarks()[landmark(0)], POINT, atol=1e-9)
    assert slam.seen_by() == {landmark(0): ("a",)}
    slam.update(1, [], [measured("both", FAR.pose, robot="b")])
    assert slam.seen_by() == {landmark(0): ("a", "b")}


def test_exact_measurements_give_an_exact_estimate():
    for world in (planar_world(robots=3), spatial_world(robots=3)):
        world = with_relative_poses(world)
        steps = run_of(world, 6)
        slam = slam_of(world, SlamOptions(relinearise_threshold=1e-9))
        previous = steps[0].poses
        for step in steps:
            odometry = [
                replace(one, relative=between(previous[one.robot], step.poses[one.robot]))
                for one in step.odometry
            ]
            exact = []
            for one in step.measurements:
                if one.kind == "robot":
                    value = between(step.poses[one.robot], step.poses[one.target])
                else:
                    point = world.landmark_positions[world.landmark_keys.index(one.target)]
                    value = BEARING_RANGE.predict(step.poses[one.robot], point)
                exact.append(replace(one, value=value))
            slam.update(step.state.step, odometry, exact)
            previous = step.poses
        for name, pose in previous.items():
            np.testing.assert_allclose(slam.pose(name), pose, atol=1e-7)
        for key, point in slam.landmarks().items():
            truth = world.landmark_positions[world.landmark_keys.index(key)]
            np.testing.assert_allclose(point, truth, atol=1e-6)


@pytest.mark.parametrize("sensor", ["range", "bearing"])
def test_landmarks_wait_until_determined_and_nothing_is_lost(sensor):
    slam, pose, taken = two(), START.pose, 0
    ways = [(2.0, 0.0, 0.0)] * 3 + [(1.0, 1.0, 1.0)] + [(2.0, 0.0, 0.3)] * 4
    # Straight towards the landmark for the bearing: no parallax.
    point = np.array([12.0, 7.0]) if sensor == "range" else np.array([20.0, 0.0])
    slam.update(0, [], [measured(sensor, pose, point=point)])
    started = None
    for step, way in enumerate(ways, start=1):
        pose = compose(pose, np.array(way))
        slam.update(step, [moved("a", way)], [measured(sensor, pose, point=point)])
        taken = slam.graph().size() - 2 - step
        assert taken + sum(slam.waiting.values()) == step + 1
        if started is None and slam.landmarks():
            started = step
            assert slam.waiting == {}
    assert started is not None
    assert started >= 4
    assert taken == len(ways) + 1
    np.testing.assert_allclose(slam.landmarks()[landmark(0)], point, atol=0.05)
    assert slam.seen_by()[landmark(0)] == ("a",)


def test_what_waited_joins_when_another_sensor_starts_the_landmark():
    slam = two()
    slam.update(0, [], [measured("range", START.pose), measured("both", START.pose)])
    assert slam.waiting == {}
    assert slam.graph().size() == 4
    slam.update(1, [], [measured("range", FAR.pose, robot="b", target=landmark(5))])
    assert slam.waiting == {landmark(5): 1}
    assert landmark(5) not in slam.landmarks()
    # The other robot sees it by bearing and range.
    slam.update(2, [], [measured("both", START.pose, target=landmark(5))])
    assert slam.seen_by()[landmark(5)] == ("a", "b")


def test_landmark_priors_are_landmarks_at_once():
    priors = {landmark(0): (POINT, 0.04 * np.eye(2))}
    slam = two(landmark_priors=priors)
    np.testing.assert_allclose(slam.landmarks()[landmark(0)], POINT)
    assert slam.seen_by() == {landmark(0): ()}
    before = slam.covariance("a")[2, 2]
    slam.update(0, [], [measured("bearing", START.pose)])
    assert slam.waiting == {}
    assert slam.covariance("a")[2, 2] < before


def test_a_planar_robot_may_know_landmarks_in_space():
    point = np.array([6.0, 5.0, 4.0])
    slam = two(landmark_priors={landmark(0): (point, 1e-6 * np.eye(3))})
    pose = np.array([0.1, 0.0, 0.0])
    slam.update(0, [], [measured("range", pose, point=point)])
    # One range of 0.1 m hardly moves a robot known to 0.01 m, but towards the truth.
    assert 0.0 < slam.pose("a")[0] < 0.1
    np.testing.assert_allclose(slam.landmarks()[landmark(0)], point, atol=1e-4)


@pytest.mark.parametrize("spatial", [False, True], ids=["planar", "spatial"])
@pytest.mark.parametrize("sensor", [RANGE, BEARING, BOTH], ids=lambda one: one.kind)
def test_measuring_another_robots_position_places_it(sensor, spatial):
    """Two robots know where they are; the third, off by metres, is measured by both."""
    truth = [np.array([0.0, 0, 0]), np.array([10.0, 0, 1.0]), np.array([4.0, 6.0, 0.3])]
    if spatial:
        truth = [gtsam.Pose3(gtsam.Pose2(*pose)).matrix() for pose in truth]
        truth[2][2, 3] = 3.0
    dim = 6 if spatial else 3
    sure = 1e-8 * np.eye(dim)
    generator = np.random.default_rng(4)
    guess = disturb_pose(truth[2], 0.25 * sure / 1e-8 / 1e4, generator)
    place = (slice(None, 3), 3) if spatial else slice(0, 2)
    guess[place] += 0.5
    unsure = sure.copy()
    where = slice(3, 6) if spatial else slice(0, 2)
    unsure[where, where] *= 1e8
    starts = {
        "a": SlamStart(pose=truth[0], covariance=sure),
        "b": SlamStart(pose=truth[1], covariance=sure),
        "c": SlamStart(pose=guess, covariance=unsure),
    }
    slam = TeamSlam(starts, {"sees": sensor})
    before = np.linalg.norm(position(slam.pose("c")) - position(truth[2]))
    seen = [
        Measurement(
            robot=name,
            sensor="sees",
            kind="robot",
            target="c",
            value=sensor.predict(pose, position(truth[2])),
            covariance=1e-2 * sensor.noise(pose, position(truth[2])),
        )
        for name, pose in zip("ab", truth, strict=False)
    ]
    slam.update(0, [], seen)
    after = np.linalg.norm(position(slam.pose("c")) - position(truth[2]))
    undetermined = spatial and sensor is RANGE  # two spheres leave a circle
    assert after < (0.95 if undetermined else 0.05) * before
    assert slam.graph().size() == 5
    belief = slam.belief()
    exact = belief.covariance(slam.key("c"))
    # iSAM2 keeps where it linearised while an estimate moves by less than its threshold, 0.1.
    np.testing.assert_allclose(slam.covariance("c"), exact, atol=0.02 * np.abs(exact).max())


@pytest.mark.parametrize("world_of", [planar_world, spatial_world])
def test_relative_poses_tie_robots_that_share_no_landmark(world_of):
    world = with_relative_poses(world_of(landmarks=1))
    world = replace(world, landmark_keys=(), landmark_positions=world.landmark_positions[:0])
    steps = run_of(world, 4)
    tied = fed(slam_of(world), steps)
    free = slam_of(world)
    for step in steps:
        free.update(step.state.step, step.odometry, [])
    for robot in tied.robots:
        assert np.trace(tied.covariance(robot)) < np.trace(free.covariance(robot))
    first, second = (tied.key(robot) for robot in tied.robots)
    assert np.abs(tied.belief().covariance(first, second)).max() > 1e-5
    assert np.abs(free.belief().covariance(first, second)).max() < 1e-12


def test_prior_of_a_micrometre_keeps_its_digits():
    world = planar_world()
    slam = fed(slam_of(world, sigma=1e-6), run_of(world, 10))
    belief = slam.belief()
    for robot in slam.robots:
        first = slam.keys(robot)[0]
        expected = 1e-12 * np.eye(3)
        np.testing.assert_allclose(belief.covariance(first), expected, rtol=1e-7, atol=1e-19)
        start = next(one.pose for one in world.robots if one.name == robot)
        np.testing.assert_allclose(slam.trajectory(robot)[0], start, atol=1e-9)


def test_targets_are_not_used():
    slam = two()
    slam.update(0, [], [measured("both", START.pose, kind="target", target="t1")])
    assert slam.graph().size() == 2
    assert slam.waiting == {}


# Own sensors


@dataclass(frozen=True)
class Offset(AbstractSensor):
    """A user's own: the offset in the world frame."""

    kind = "offset"

    def predict(self, pose, target):
        return target - pose[:2]

    def jacobians(self, pose, target):
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        rotation = np.array([[cos, -sin], [sin, cos]])
        return np.hstack([-rotation, np.zeros((2, 1))]), np.eye(2)

    def noise(self, pose, target):
        return 1e-4 * np.eye(2)


def offset_measurement(robot="a", kind="landmark", target=None, size=2):
    return Measurement(
        robot=robot,
        sensor="own",
        kind=kind,
        target=landmark(0) if target is None else target,
        value=POINT[:size] if size <= 2 else np.zeros(size),
        covariance=1e-4 * np.eye(size),
    )


def test_an_own_sensor_counts_as_soon_as_its_landmark_has_started():
    slam = TeamSlam({"a": START, "b": FAR}, SENSORS | {"own": Offset()})
    slam.update(0, [], [offset_measurement()])
    assert slam.waiting == {landmark(0): 1}
    slam.update(1, [], [measured("both", START.pose, point=POINT + 0.05)])
    assert slam.waiting == {}
    # 0.01 m of the own sensor against 0.1 m.
    np.testing.assert_allclose(slam.landmarks()[landmark(0)], POINT, atol=0.005)


def test_an_own_sensor_may_measure_a_robot():
    slam = TeamSlam({"a": START, "b": FAR}, {"own": Offset()})
    slam.update(0, [], [replace(offset_measurement("a", "robot", "b"), value=np.array([10.2, 0]))])
    # Three equal variances along x: each takes a third of the 0.2 m.
    assert slam.pose("b")[0] - slam.pose("a")[0] == pytest.approx(10.0 + 0.4 / 3.0, rel=1e-3)


def test_own_sensors_that_do_not_fit_are_refused_before_isam2():
    slam = TeamSlam({"a": START, "b": FAR}, {"own": Offset()})
    with pytest.raises(InvalidInputError, match="covariance of measurement of landmark"):
        slam.update(0, [], [replace(offset_measurement(), covariance=np.eye(3))])

    class Odd(Offset):
        def difference(self, measured, predicted):
            return np.zeros(3)

    odd = TeamSlam({"a": START}, {"own": Odd()})
    with pytest.raises(InvalidInputError, match=r"expected a residual of shape \(2,\)"):
        odd.update(0, [], [offset_measurement()])


class Fails(Offset):
    """Works ahead of the robot, fails at the other robot."""

    def jacobians(self, pose, target):
        if target[0] > 9.0:
            raise ZeroDivisionError("own sensor")
        return super().jacobians(pose, target)


def test_after_an_error_inside_isam2_nothing_has_changed():
    sensors = SENSORS | {"own": Fails()}
    slam = TeamSlam({"a": START, "b": FAR}, sensors)
    slam.update(0, [], [measured("both", START.pose)])
    poses = {robot: slam.pose(robot) for robot in slam.robots}
    failing = offset_measurement("a", "robot", "b")
    with pytest.raises(ZeroDivisionError, match="own sensor"):
        slam.update(1, [moved("a")], [failing])
    assert slam.steps("a") == (0,)
    for robot in slam.robots:
        np.testing.assert_array_equal(slam.pose(robot), poses[robot])
    slam.update(1, [moved("a")], [measured("both", np.array([1.0, 0, 0]))])
    assert slam.steps("a") == (0, 1)
    np.testing.assert_allclose(slam.pose("a"), [1.0, 0.0, 0.0], atol=1e-6)


def test_steps_that_run_away_are_taken_anew_with_damping():
    """A robot passes a landmark at 0.1 m of which it sees the bearing and believes 1 m wrong."""
    truth, rebuilds = np.array([10.0, 0.1]), 0
    for aside in (-1.5, -1.0, 0.6, 1.1, 1.6):
        prior = {landmark(0): (np.array([9.7, aside]), 4.0 * np.eye(2))}
        slam, pose = TeamSlam({"a": START}, SENSORS, landmark_priors=prior), START.pose
        for step in range(1, 11):
            pose = compose(pose, np.array([2.0, 0.0, 0.0]))
            seen = measured("bearing", pose, point=truth)
            slam.update(step, [moved("a", (2.0, 0.0, 0.0))], [seen])
        np.testing.assert_allclose(slam.landmarks()[landmark(0)], truth, atol=0.05)
        np.testing.assert_allclose(slam.pose("a"), pose, atol=0.05)
        rebuilds += slam.rebuilds
    # Without damping some of them end at infinity.
    assert rebuilds > 0


def test_a_team_that_measures_nothing_never_rebuilds():
    slam = two()
    for step in range(1, 5):
        slam.update(step, [moved()], [])
    assert slam.rebuilds == 0


# Determinism


def test_replaying_a_log_gives_the_same_bits_whatever_was_asked_in_between():
    world = with_relative_poses(planar_world(RangeSensor(sigma_m=0.1, max_range_m=30.0)))
    steps = run_of(world, 12)
    options = SlamOptions(relinearise_every=3)
    quiet, asked = slam_of(world, options), slam_of(world, options)
    for step in steps:
        for slam in (quiet, asked):
            slam.update(step.state.step, step.odometry, step.measurements)
        asked.values()
        asked.belief()
        asked.landmarks()
        for robot in asked.robots:
            asked.covariance(robot)
    assert quiet.values().serialize() == asked.values().serialize()
    assert quiet.belief().digest() == asked.belief().digest()
    for robot in quiet.robots:
        assert quiet.covariance(robot).tobytes() == asked.covariance(robot).tobytes()
        assert quiet.pose(robot).tobytes() == asked.pose(robot).tobytes()


def test_what_is_handed_out_is_a_copy():
    slam = two()
    slam.values().insert(5, gtsam.Pose2())
    slam.graph().add(gtsam.PriorFactorPose2(5, gtsam.Pose2(), gtsam.noiseModel.Unit.Create(3)))
    assert slam.belief().keys == (pose_key(0, 0), pose_key(1, 0))
    with pytest.raises(ValueError, match="read-only"):
        slam.pose("a")[0] = 1.0


def test_belief_may_be_linearised_elsewhere():
    slam = two()
    slam.update(0, [], [measured("both", START.pose)])
    values = slam.values()
    values.update(landmark(0), POINT + 1.0)
    np.testing.assert_allclose(slam.belief(values).point(landmark(0)), POINT + 1.0)
    with pytest.raises(UnknownNameError, match="key xA0 is not in the values"):
        slam.belief(gtsam.Values())


# Robust noise


def with_outliers(steps, share, generator):
    for step in steps:
        wrong = []
        for one in step.measurements:
            if generator.uniform() < share:
                bearing = generator.uniform(-np.pi, np.pi)
                one = replace(one, value=np.array([bearing, generator.uniform(1.0, 30.0)]))
            wrong.append(one)
        yield replace(step, measurements=tuple(wrong))


@pytest.mark.parametrize("loss", [("huber", 1.345), ("cauchy", 2.3849)], ids=lambda one: one[0])
def test_robust_noise_withstands_outliers(loss):
    world = planar_world(robots=2, landmarks=20)
    known = {
        key: (point, 1e-4 * np.eye(2))
        for key, point in zip(world.landmark_keys, world.landmark_positions, strict=True)
    }
    steps = run_of(world, 15)
    wrong = list(with_outliers(steps, 0.1, np.random.default_rng(2)))
    robust = SlamOptions(robust={"sees": RobustLoss(loss=loss[0], parameter=loss[1])})

    def error(slam):
        gaps = [slam.pose(name)[:2] - steps[-1].poses[name][:2] for name in slam.robots]
        return float(np.linalg.norm(gaps))

    plain = fed(slam_of(world, landmark_priors=known), wrong)
    withstood = fed(slam_of(world, robust, landmark_priors=known), wrong)
    assert error(withstood) < 0.25 < error(plain)
    weights = np.array(withstood.weights()["sees"])
    assert len(weights) == sum(len(step.measurements) for step in wrong)
    assert ((weights > 0) & (weights <= 1)).all()
    assert 0.05 < (weights < 0.1).mean() < 0.15
    assert plain.weights() == {}


def test_belief_of_a_robust_graph_is_that_of_its_weights():
    options = SlamOptions(robust={"both": RobustLoss(loss="huber", parameter=1.0)})
    slam = TeamSlam({"a": START}, SENSORS, options)
    slam.update(0, [], [measured("both", START.pose)])
    off = measured("both", START.pose)
    slam.update(1, [], [replace(off, value=off.value + np.array([0.0, 5.0]))])
    # 5 m against 0.1 m: the first gives way a little, the second is some 50 sigmas away.
    first, second = slam.weights()["both"]
    assert first > 20 * second
    noise = slam.graph().at(2).noiseModel()
    np.testing.assert_allclose(noise.sigmas(), np.array([0.01, 0.1]) / np.sqrt(second), rtol=1e-12)
    assert not isinstance(noise, gtsam.noiseModel.Robust)
    exact = slam.belief().covariance(slam.key("a"))
    np.testing.assert_allclose(slam.covariance("a"), exact, rtol=1e-6, atol=1e-12)


def test_robust_noise_takes_full_covariances_and_own_sensors():
    loss = RobustLoss(loss="cauchy", parameter=1.0)
    sensors = {"meets": MEETS, "own": Offset()}
    options = SlamOptions(robust={"meets": loss, "own": loss})
    slam = TeamSlam({"a": START, "b": FAR}, sensors, options)
    full = 0.01 * np.eye(3) + 0.005
    seen = Measurement(
        robot="a",
        sensor="meets",
        kind="robot",
        target="b",
        value=FAR.pose + np.array([1.0, 0.0, 0.0]),
        covariance=full,
    )
    own = replace(offset_measurement("a", "robot", "b"), value=np.array([10.2, 0.0]))
    slam.update(0, [], [seen, own])
    weight = slam.weights()["meets"][0]
    assert weight < 0.5
    root = slam.graph().at(2).noiseModel().R()
    np.testing.assert_allclose(root.T @ root, weight * np.linalg.inv(full), rtol=1e-9)
    assert slam.graph().at(3).noiseModel().sigmas()[0] > 0.01
    slam.belief().covariance(slam.key("b"))


@pytest.mark.parametrize(("loss", "parameter"), [("huber", 1.345), ("cauchy", 2.3849)])
def test_weights_are_gtsams(loss, parameter):
    robust = RobustLoss(loss=loss, parameter=parameter)
    model = robust.around(gtsam.noiseModel.Unit.Create(2)).robust()
    for length in (0.0, 0.5, parameter, 5.0, 1e3):
        assert robust.weight(length) == pytest.approx(model.weight(length), rel=1e-12)


# Refusals


def bad(slam, *, step=1, odometry=(), measurements=()):
    slam.update(step, list(odometry), list(measurements))


@pytest.mark.parametrize(
    ("content", "error", "words"),
    [
        ({"odometry": [moved("z")]}, UnknownNameError, "robot 'z' is not one of: a, b"),
        ({"odometry": [moved(), moved()]}, InvalidInputError, "'a' at step 1: expected at most"),
        ({"odometry": [moved(covariance=None)]}, InvalidInputError, "got exact odometry"),
        ({"odometry": [moved()], "step": 0}, InvalidInputError, "start is the pose of step 0"),
        ({"odometry": [moved(relative=[1.0, 0])]}, InvalidInputError, r"of shape \(3,\)"),
        ({"odometry": [moved(relative=[np.nan, 0, 0])]}, InvalidInputError, "finite"),
        ({"odometry": [moved(covariance=np.zeros((3, 3)))]}, InvalidInputError, "positive"),
        ({"odometry": [moved(covariance=np.eye(2))]}, InvalidInputError, r"shape \(3, 3\)"),
        ({"step": -1}, InvalidInputError, "expected a step later than -1"),
        ({"step": 1.5}, InvalidInputError, "expected a step later than -1, got 1.5"),
    ],
)
def test_odometry_that_cannot_be_is_refused(content, error, words):
    slam = two()
    with pytest.raises(error, match=words):
        bad(slam, **content)
    assert slam.graph().size() == 2


def see(**fields):
    return replace(measured("both", START.pose), **fields)


@pytest.mark.parametrize(
    ("measurement", "error", "words"),
    [
        (see(robot="z"), UnknownNameError, "robot 'z'"),
        (see(sensor="none"), UnknownNameError, "sensor 'none' is not one of: range, bearing"),
        (see(kind="robot", target="z"), UnknownNameError, "robot 'z'"),
        (see(kind="robot", target="a"), InvalidInputError, "got itself"),
        (see(kind="wall"), InvalidInputError, "expected kind 'landmark', 'robot' or 'target'"),
        (see(target="l0"), InvalidInputError, "landmark: expected a GTSAM key, got 'l0'"),
        (see(target=True), InvalidInputError, "expected a GTSAM key"),
        (see(target=-1), InvalidInputError, "expected a GTSAM key"),
        (see(target=2**64), InvalidInputError, "expected a GTSAM key"),
        (see(target=pose_key(0, 3)), InvalidInputError, "xA3.*SLAM's poses"),
        (see(target=future_key(0, 1)), InvalidInputError, "begin with '~'"),
        (see(value=np.array([np.nan, 1.0])), InvalidInputError, "'both': expected finite"),
        (
            see(value=np.array([0.0, -1.0])),
            InvalidInputError,
            "a range of zero or more .* got -1 m",
        ),
        (
            see(sensor="range", value=np.array([-0.7]), covariance=np.array([[0.01]])),
            InvalidInputError,
            "leave out readings that stand for none",
        ),
        (see(value=np.zeros(3)), InvalidInputError, r"expected shape \(2\), got \(3,\)"),
        (see(covariance=np.eye(3)), InvalidInputError, "covariance of measurement"),
        (see(covariance=np.array([[1.0, 2.0], [2.0, 1.0]])), InvalidInputError, "positive"),
        (see(covariance=np.diag([1.0, -1.0])), InvalidInputError, "landmark l0 .*positive var"),
        (see(covariance=np.diag([1.0, np.nan])), InvalidInputError, "finite"),
        (see(covariance=np.diag([1.0, np.inf])), InvalidInputError, "finite"),
        (see(covariance=np.diag([1.0, 0.0])), InvalidInputError, "positive variances"),
        (see(covariance=np.array([[1.0, 0.5], [0.0, 1.0]])), InvalidInputError, "symmetric"),
        (see(sensor="range"), InvalidInputError, r"'range': expected shape \(1\)"),
        (see(sensor="meets", value=np.zeros(3)), InvalidInputError, "has no relative pose"),
        (
            see(sensor="meets", kind="robot", target="b", value=np.zeros(2)),
            InvalidInputError,
            r"a relative pose of shape \(3,\)",
        ),
        (
            see(sensor="meets", kind="robot", target="b", value=np.array([0, np.inf, 0])),
            InvalidInputError,
            "finite",
        ),
    ],
)
def test_measurements_that_cannot_be_are_refused(measurement, error, words):
    slam = two()
    with pytest.raises(error, match=words):
        slam.update(1, [moved()], [measurement])
    assert slam.steps("a") == (0,)
    slam.update(1, [moved()], [see()])
    assert slam.steps("a") == (0, 1)


def test_a_direction_in_space_has_length_one():
    start = SlamStart(pose=np.eye(4), covariance=np.eye(6))
    slam = TeamSlam({"a": start}, SENSORS)
    point = np.array([1.0, 2.0, 3.0])
    value, covariance = draw_measurement(BEARING, np.eye(4), point, np.random.default_rng(0))
    seen = measured("bearing", np.eye(4), point=point, value=2.0 * value, covariance=covariance)
    with pytest.raises(InvalidInputError, match="expected a direction of length one"):
        slam.update(0, [], [seen])


def test_noise_that_differs_by_direction_in_space_keeps_its_meaning():
    """GTSAM's basis of a bearing is another than ours: such noise takes our own factor."""
    start = SlamStart(pose=np.eye(4), covariance=1e-12 * np.eye(6))
    point = np.array([8.0, 2.0, 3.0])
    covariance = np.diag([1e-2, 1e-8, 1e-2])
    value = BOTH.predict(np.eye(4), point)
    seen = measured("both", np.eye(4), point=point, value=value, covariance=covariance)
    slam = TeamSlam({"a": start}, SENSORS)
    slam.update(0, [], [seen])
    by_point = BOTH.jacobians(np.eye(4), point)[1]
    expected = np.linalg.inv(by_point.T @ np.linalg.inv(covariance) @ by_point)
    np.testing.assert_allclose(
        slam.belief().covariance(landmark(0)), expected, rtol=1e-6, atol=1e-12
    )


def test_steps_go_forward():
    slam = two()
    slam.update(3, [], [])
    for step in (3, np.int64(2), 4.5, np.nan, "4", None, True):
        with pytest.raises(InvalidInputError, match="expected a step later than 3, got"):
            slam.update(step, [], [])
    slam.update(np.int64(4), [], [])


def test_unknown_robots_are_named():
    slam = two()
    for ask in (slam.key, slam.keys, slam.steps, slam.pose, slam.covariance, slam.trajectory):
        with pytest.raises(UnknownNameError, match="robot 'z' is not one of: a, b"):
            ask("z")


def test_starts_that_cannot_be_are_refused():
    with pytest.raises(InvalidInputError, match="start pose"):
        SlamStart(pose=np.zeros(2), covariance=np.eye(3))
    with pytest.raises(InvalidInputError, match="start covariance"):
        SlamStart(pose=np.zeros(3), covariance=np.zeros((3, 3)))
    with pytest.raises(InvalidInputError, match="expected 1 to 52 robots, got 0"):
        TeamSlam({}, {})
    with pytest.raises(InvalidInputError, match="or all as 4 x 4 matrices, got both"):
        TeamSlam({"a": START, "b": SlamStart(pose=np.eye(4), covariance=np.eye(6))}, {})
    loss = RobustLoss(loss="huber", parameter=1.0)
    with pytest.raises(UnknownNameError, match="robust loss: sensor 'radar' is not one of: none"):
        TeamSlam({"a": START}, {}, SlamOptions(robust={"radar": loss}))


@pytest.mark.parametrize(
    ("prior", "words"),
    [
        ({landmark(0): (np.zeros(4), np.eye(4))}, "expected 2 or 3 coordinates, got 4"),
        ({landmark(0): (np.array([np.nan, 0.0]), np.eye(2))}, "prior of landmark l0: .*finite"),
        ({landmark(0): (np.zeros(2), np.eye(3))}, "prior of landmark l0"),
        ({pose_key(0, 0): (np.zeros(2), np.eye(2))}, "SLAM's poses"),
    ],
)
def test_landmark_priors_that_cannot_be_are_refused(prior, words):
    with pytest.raises(InvalidInputError, match=words):
        two(landmark_priors=prior)


def test_robots_in_space_need_landmarks_in_space():
    start = SlamStart(pose=np.eye(4), covariance=np.eye(6))
    with pytest.raises(InvalidInputError, match="expected 3 coordinates, got 2"):
        TeamSlam({"a": start}, {}, landmark_priors={landmark(0): (np.zeros(2), np.eye(2))})


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"relinearise_threshold": -1.0}, "relinearise_threshold: expected zero or more"),
        ({"relinearise_every": 0}, "relinearise_every: expected a whole number above zero"),
        ({"iterations": True}, "iterations: expected a whole number above zero"),
        ({"robust": {"both": "huber"}}, "expected a RobustLoss for sensor 'both'"),
    ],
)
def test_options_that_cannot_be_are_refused(fields, words):
    with pytest.raises(InvalidInputError, match=words):
        SlamOptions(**fields)


def test_robust_losses_that_cannot_be_are_refused():
    with pytest.raises(InvalidInputError, match="expected one of huber, cauchy, got 'tukey'"):
        RobustLoss(loss="tukey", parameter=1.0)
    with pytest.raises(InvalidInputError, match="parameter of robust loss 'huber'"):
        RobustLoss(loss="huber", parameter=0.0)
