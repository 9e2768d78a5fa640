"""Every planned factor linearised by GTSAM has the information of the numpy model."""

import gtsam
import numpy as np
import pytest
import scenes

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.factors.gaussian_noise import gaussian_noise, noise_digest
from fgplan.factors.motion import between_factor, gtsam_pose
from fgplan.factors.multi_robot import multi_robot_factor
from fgplan.factors.observation import observation_factor
from fgplan.models.pose import adjoint, between, position
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel

SENSORS = [
    RangeSensor(sigma_m=0.5, sigma_per_metre=0.01),
    BearingSensor(sigma_rad=0.02),
    BearingRangeSensor(bearing_sigma_rad=0.02, range_sigma_m=0.5, range_sigma_per_metre=0.01),
]


class SquaredRange(AbstractSensor):
    """A user's own sensor: half the squared distance."""

    kind = "squared_range"
    max_range_m = np.inf
    field_of_view_rad = 2 * np.pi

    def predict(self, pose, target):
        offset = target - position(pose)
        return np.array([0.5 * offset @ offset])

    def jacobians(self, pose, target):
        offset = target - position(pose)
        rotation = pose[:3, :3] if pose.ndim == 2 else gtsam.Rot2(pose[2]).matrix()
        rest = np.zeros(3) if pose.ndim == 2 else np.zeros(1)
        by_pose = (
            np.concatenate([rest, -offset @ rotation])
            if pose.ndim == 2
            else np.concatenate([-offset @ rotation, rest])
        )
        return by_pose[None], offset[None]

    def noise(self, pose, target):
        return np.array([[4.0]])


def random_pose(generator, planar):
    pose = np.array([*generator.uniform(-50, 50, 2), generator.uniform(-3, 3)])
    return pose if planar else scenes.spatial(pose, generator)


def point_of(generator, planar):
    return generator.uniform(-60, 60, 2 if planar else 3)


def values_of(**entries):
    values = gtsam.Values()
    for key, value in entries.items():
        values.insert(int(key[1:]), gtsam_pose(value) if key[0] == "x" else value)
    return values


def information_of(factor, values, keys=(0, 1)):
    """A'A of the linearised factor in the order of the keys."""
    linear = factor.linearize(values)
    assert tuple(linear.keys()) == tuple(keys)
    return linear.information()


def assert_same(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("sensor", [*SENSORS, SquaredRange()], ids=lambda s: s.kind)
def test_observation_factor_has_the_information_of_the_model(sensor, planar):
    generator = np.random.default_rng(1)
    for _ in range(20):
        pose, point = random_pose(generator, planar), point_of(generator, planar)
        covariance = sensor.noise(pose, point)
        factor = observation_factor(sensor, (0, 1), pose, point, covariance)
        rows = np.hstack(sensor.linearise(pose, point, covariance))
        values = values_of(x0=pose, l1=point)
        assert_same(information_of(factor, values), rows.T @ rows)
        assert factor.error(values) == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("sensor", SENSORS[1:], ids=lambda s: s.kind)
def test_observation_factor_takes_a_full_covariance(sensor, planar):
    """Unequal noise of a spatial bearing takes the CustomFactor: GTSAM's basis is another."""
    generator = np.random.default_rng(2)
    size = len(sensor.noise(random_pose(generator, planar), point_of(generator, planar)))
    covariance = scenes.random_covariance(generator, np.linspace(0.01, 0.05, size))
    pose, point = random_pose(generator, planar), point_of(generator, planar)
    factor = observation_factor(sensor, (0, 1), pose, point, covariance)
    assert isinstance(factor, gtsam.CustomFactor) == (not planar)
    rows = np.hstack(sensor.linearise(pose, point, covariance))
    assert_same(information_of(factor, values_of(x0=pose, l1=point)), rows.T @ rows)


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda s: s.kind)
def test_a_planar_robot_may_see_a_point_in_space(sensor):
    generator = np.random.default_rng(3)
    pose, point = random_pose(generator, True), point_of(generator, False)
    covariance = sensor.noise(pose, point)
    factor = observation_factor(sensor, (0, 1), pose, point, covariance)
    assert isinstance(factor, gtsam.CustomFactor)
    rows = np.hstack(sensor.linearise(pose, point, covariance))
    assert_same(information_of(factor, values_of(x0=pose, l1=point)), rows.T @ rows)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("sensor", [*SENSORS, SquaredRange()], ids=lambda s: s.kind)
def test_jacobians_are_central_differences_of_the_factor_error(sensor, planar):
    """Central differences of the whitened error; truncation ~ h^2 limits them to about 1e-6."""
    generator = np.random.default_rng(4)
    pose, point = random_pose(generator, planar), point_of(generator, planar)
    covariance = scenes.random_covariance(generator, [0.02] * len(sensor.noise(pose, point)))
    factor = observation_factor(sensor, (0, 1), pose, point, covariance)
    other = random_pose(generator, planar)
    model = MultiRobotModel(criterion=DistanceCriterion(1e3), sensor=sensor, time_tolerance_s=1.0)
    noise = gaussian_noise(sensor.noise(pose, position(other)), "test")
    pair = multi_robot_factor(model, (0, 1), pose, other, noise)
    for made, second in ((factor, point), (pair, other)):
        poses = [pose, second]

        def whitened(shifts, made=made, poses=poses):
            values = gtsam.Values()
            for key, (at, shift) in enumerate(zip(poses, shifts, strict=True)):
                moved = at + shift if at is point else gtsam_pose(at).retract(shift)
                values.insert(key, moved)
            return made.noiseModel().whiten(made.unwhitenedError(values))

        dims = [3 if planar else 6, point.size if second is point else (3 if planar else 6)]
        step = 1e-5
        columns = []
        for which, dim in enumerate(dims):
            for unit in np.eye(dim):
                forward = [np.zeros(d) for d in dims]
                backward = [np.zeros(d) for d in dims]
                forward[which], backward[which] = step * unit, -step * unit
                columns.append((whitened(forward) - whitened(backward)) / (2 * step))
        numeric = np.array(columns).T
        kind = {"l1": point} if second is point else {"x1": other}
        analytic = information_of(made, values_of(x0=pose, **kind))
        np.testing.assert_allclose(
            numeric.T @ numeric, analytic, rtol=0, atol=1e-6 * np.abs(analytic).max()
        )


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("sensor", [*SENSORS, SquaredRange()], ids=lambda s: s.kind)
def test_multi_robot_factor_has_the_information_of_the_model(sensor, planar):
    generator = np.random.default_rng(5)
    model = MultiRobotModel(criterion=DistanceCriterion(1e3), sensor=sensor, time_tolerance_s=1.0)
    for _ in range(20):
        pose, other = random_pose(generator, planar), random_pose(generator, planar)
        noise = gaussian_noise(sensor.noise(pose, position(other)), "test")
        factor = multi_robot_factor(model, (0, 1), pose, other, noise)
        rows = np.hstack(sensor.linearise_between(pose, other))
        values = values_of(x0=pose, x1=other)
        assert_same(information_of(factor, values), rows.T @ rows)
        assert factor.error(values) == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize("planar", [True, False])
def test_relative_pose_and_motion_factors_have_the_adjoint_form(planar):
    generator = np.random.default_rng(6)
    size = 3 if planar else 6
    for _ in range(20):
        pose, other = random_pose(generator, planar), random_pose(generator, planar)
        covariance = scenes.random_covariance(generator, generator.uniform(0.01, 2.0, size))
        sensor = RelativePoseSensor(covariance=covariance)
        model = MultiRobotModel(criterion=DistanceCriterion(1e3), sensor=sensor)
        noise = gaussian_noise(covariance, "test")
        rows = np.hstack(sensor.linearise_between(pose, other))
        expected = rows.T @ rows
        values = values_of(x0=pose, x1=other)
        for factor in (
            multi_robot_factor(model, (0, 1), pose, other, noise),
            between_factor(0, 1, pose, other, noise),
        ):
            assert_same(information_of(factor, values), expected)
        information = np.linalg.inv(covariance)
        move = adjoint(between(other, pose))
        assert_same(expected[:size, :size], move.T @ information @ move)


def test_gaussian_noise_whitens_with_the_inverse():
    generator = np.random.default_rng(7)
    covariance = scenes.random_covariance(generator, [1e-3, 1.0, 20.0])
    whitening = gaussian_noise(covariance, "test").R()
    np.testing.assert_allclose(whitening @ covariance @ whitening.T, np.eye(3), atol=1e-12)
    assert np.allclose(whitening, np.triu(whitening))
    diagonal = np.diag([1.0, 4.0, 9.0])
    np.testing.assert_allclose(gaussian_noise(diagonal, "test").sigmas(), [1, 2, 3])


@pytest.mark.parametrize(
    "covariance",
    [np.array([[1.0, 2.0], [2.0, 1.0]]), np.diag([1.0, 0.0]), np.diag([1.0, np.nan])],
)
def test_gaussian_noise_refuses_what_gtsam_would_take(covariance):
    with pytest.raises(InvalidInputError, match=r"noise of camera.*positive definite"):
        gaussian_noise(covariance, "camera")


def test_noise_digest_tells_covariances_apart():
    assert noise_digest(np.eye(3)) == noise_digest(np.eye(3).copy())
    assert noise_digest(np.eye(3)) != noise_digest(2 * np.eye(3))


def test_noise_of_another_size_is_refused():
    generator = np.random.default_rng(9)
    pose, point = random_pose(generator, True), point_of(generator, True)
    with pytest.raises(InvalidInputError, match=r"bearing_range.*\(2, 2\), got \(1, 1\)"):
        observation_factor(SENSORS[2], (0, 1), pose, point, np.eye(1))


def test_an_unknown_sensor_of_a_path_is_named():
    from fgplan.factors.observation import observation_factors

    problem, paths = scenes.random_scene(np.random.default_rng(8), landmarks=8)
    path = next(p for p in paths["robot0"] if p.observations)
    keys = range(path.steps + 1)
    with pytest.raises(UnknownNameError, match=r"robot0.*is not one of: other"):
        observation_factors(path, keys, {"other": SENSORS[0]}, problem.prior)
