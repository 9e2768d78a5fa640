"""Noise lives where GTSAM's factors look for it."""

from dataclasses import dataclass
from typing import ClassVar

import gtsam
import numpy as np
import pytest
from scipy.stats import chi2

from fgplan.errors import InvalidInputError
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.simulation.noise import disturb_pose, draw_measurement, exponential

DRAWS = 2000


def within_bounds(residuals, covariance):
    """Whether the sum of squared whitened residuals fits its chi-square distribution."""
    residuals = np.atleast_2d(residuals)
    squared = np.einsum("ti,ij,tj->t", residuals, np.linalg.inv(covariance), residuals).sum()
    low, high = chi2.ppf([0.0005, 0.9995], residuals.size)
    return low < squared < high


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1e-3, 1.0, 2.5])
def test_exponential_is_that_of_gtsam(scale):
    generator = np.random.default_rng(3)
    for _ in range(20):
        tangent = generator.uniform(-1, 1, 6) * scale
        expected = gtsam.Pose3.Expmap(tangent).matrix()
        np.testing.assert_allclose(exponential(tangent), expected, rtol=1e-12, atol=1e-14)
        planar = tangent[:3]
        retracted = gtsam.Pose2().retract(planar)
        # GTSAM's planar (1 - cos a) / a cancels for small a; ours does not.
        np.testing.assert_allclose(
            exponential(planar),
            [retracted.x(), retracted.y(), retracted.theta()],
            rtol=1e-12,
            atol=1e-14,
        )


def test_planar_exponential_is_that_of_the_plane_in_space():
    tangent = np.array([0.3, -0.7, 1.9])
    matrix = exponential(np.array([0, 0, tangent[2], tangent[0], tangent[1], 0]))
    x, y, heading = exponential(tangent)
    np.testing.assert_allclose(matrix[:2, 3], [x, y], rtol=1e-12)
    np.testing.assert_allclose(np.arctan2(matrix[1, 0], matrix[0, 0]), heading, rtol=1e-12)


def test_planar_pose_noise_is_the_error_of_a_between_factor():
    covariance = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.002], [0.0, 0.002, 0.01]])
    pose, generator = np.array([1.0, 2.0, 3.0]), np.random.default_rng(5)
    exact = gtsam.Pose2(*pose)
    residuals = np.array(
        [
            exact.localCoordinates(gtsam.Pose2(*disturb_pose(pose, covariance, generator)))
            for _ in range(DRAWS)
        ]
    )
    assert within_bounds(residuals, covariance)
    assert not within_bounds(residuals, 1.2 * covariance)
    np.testing.assert_allclose(np.cov(residuals.T), covariance, atol=0.01)


def test_spatial_pose_noise_is_the_error_of_a_between_factor():
    covariance = np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 0.3])
    pose = exponential(np.array([0.3, -0.2, 1.0, 4.0, 5.0, 6.0]))
    generator = np.random.default_rng(5)
    exact = gtsam.Pose3(pose)
    residuals = np.array(
        [
            exact.localCoordinates(gtsam.Pose3(disturb_pose(pose, covariance, generator)))
            for _ in range(DRAWS)
        ]
    )
    assert within_bounds(residuals, covariance)
    assert not within_bounds(residuals, 1.2 * covariance)


@pytest.mark.parametrize(
    "sensor",
    [
        RangeSensor(sigma_m=0.2, sigma_per_metre=0.1),
        BearingSensor(sigma_rad=0.05),
        BearingRangeSensor(bearing_sigma_rad=0.05, range_sigma_m=0.5),
    ],
)
def test_planar_measurements(sensor):
    pose, target = np.array([1.0, 1.0, 3.0]), np.array([-8.0, 0.5])
    generator = np.random.default_rng(11)
    drawn = [draw_measurement(sensor, pose, target, generator) for _ in range(DRAWS)]
    residuals = [sensor.difference(value, sensor.predict(pose, target)) for value, _ in drawn]
    covariance = drawn[0][1]
    np.testing.assert_array_equal(covariance, sensor.noise(pose, target))
    assert within_bounds(np.array(residuals), covariance)
    assert not within_bounds(np.array(residuals), 1.2 * covariance)


def test_planar_angles_are_wrapped():
    sensor = BearingRangeSensor(bearing_sigma_rad=0.5, range_sigma_m=0.1)
    generator = np.random.default_rng(2)
    angles = [
        draw_measurement(sensor, np.zeros(3), np.array([-5.0, 0.0]), generator)[0][0]
        for _ in range(200)
    ]
    assert np.abs(angles).max() <= np.pi
    assert min(angles) < -2.0
    assert max(angles) > 2.0


@pytest.mark.parametrize(
    ("sensor", "sigma"),
    [
        (BearingSensor(sigma_rad=0.02), 0.02),
        (BearingRangeSensor(bearing_sigma_rad=0.03, range_sigma_m=0.3), 0.03),
    ],
)
def test_directions_in_space_stay_on_the_sphere(sensor, sigma):
    pose = exponential(np.array([0.2, 0.1, -0.5, 1.0, 2.0, 3.0]))
    target, generator = np.array([4.0, -3.0, 6.0]), np.random.default_rng(4)
    values = np.array([draw_measurement(sensor, pose, target, generator)[0] for _ in range(DRAWS)])
    np.testing.assert_allclose(np.linalg.norm(values[:, :3], axis=1), 1.0, rtol=1e-12)
    exact = gtsam.Unit3(sensor.predict(pose, target)[:3])
    residuals = np.array([exact.localCoordinates(gtsam.Unit3(value[:3])) for value in values])
    assert within_bounds(residuals, sigma**2 * np.eye(2))
    assert not within_bounds(residuals, 1.2 * sigma**2 * np.eye(2))
    if values.shape[1] == 4:
        ranges = values[:, 3:] - sensor.predict(pose, target)[3]
        assert within_bounds(ranges, np.eye(1) * sensor.range_sigma_m**2)


@dataclass(frozen=True)
class OddSensor(AbstractSensor):
    """Noise that fits no value."""

    kind: ClassVar[str] = "odd"
    max_range_m: float = np.inf
    field_of_view_rad: float = 2 * np.pi

    def predict(self, pose, target):
        return np.zeros(2)

    def jacobians(self, pose, target):
        return np.zeros((3, 3)), np.zeros((3, 2))

    def noise(self, pose, target):
        return np.eye(3)


def test_noise_that_does_not_fit():
    with pytest.raises(InvalidInputError, match="'odd': expected noise of 2 rows"):
        draw_measurement(OddSensor(), np.zeros(3), np.ones(2), np.random.default_rng(0))
