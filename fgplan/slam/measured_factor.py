"""Factors of what was measured: P(z | x, l) and P(z | x, x') with the measured value.

Planning's factors have zero error at the planned states (fgplan.factors.observation); these have
the error that the measurement makes. Range, bearing, bearing-range and relative pose become GTSAM's
own factors; any other sensor, and noise that means another thing in GTSAM's basis of a bearing in
space, becomes a CustomFactor of the sensor's ``predict``, ``jacobians`` and ``difference``.
"""

from collections.abc import Callable

import gtsam
import numpy as np

from fgplan.factors.gaussian_noise import gaussian_noise
from fgplan.factors.observation import (
    JacobianList,
    bearing_basis_agrees,
    sensor_residual,
    store_jacobians,
)
from fgplan.models.measurement import Measurement
from fgplan.models.pose import point_jacobian, position
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.typing import Covariance, FloatArray, Jacobian, Key, Pose

Target = tuple[FloatArray, Jacobian]
"""A position, and its derivative by the tangent of the variable that has it."""


def rigid(pose: Pose) -> Pose:
    """The rigid motion nearest to a pose: rounding in a log's rotations must not add up."""
    if pose.ndim == 1:
        return pose
    clean = np.eye(4)
    clean[:3, :3] = gtsam.Rot3.ClosestTo(pose[:3, :3]).matrix()
    clean[:3, 3] = pose[:3, 3]
    return clean


def landmark_factor(
    measurement: Measurement,
    sensor: AbstractSensor,
    keys: tuple[Key, Key],
    noise: gtsam.noiseModel.Base,
    *,
    planar: bool,
    flat: bool,
) -> gtsam.NoiseModelFactor:
    """Factor of a measurement of a landmark.

    Args:
        measurement: What was measured; checked.
        sensor: The sensor that it names.
        keys: Keys of the pose and of the landmark.
        noise: Its noise model, Gaussian or robust.
        planar: Whether the pose is (x, y, heading), not a 4 x 4 matrix.
        flat: Whether the landmark has two coordinates, not three.

    Returns:
        GTSAM's own factor for the built-in sensors, else a CustomFactor.
    """
    value = measurement.value
    native = planar == flat and _basis_agrees(sensor, measurement, planar=planar)
    if native and type(sensor) is RangeSensor:
        ranging = gtsam.RangeFactor2D if planar else gtsam.RangeFactor3D
        return ranging(*keys, value[0], noise)
    if native and type(sensor) is BearingSensor:
        if planar:
            return gtsam.BearingFactor2D(*keys, gtsam.Rot2(value[0]), noise)
        return gtsam.BearingFactor3D(*keys, gtsam.Unit3(value), noise)
    if native and type(sensor) is BearingRangeSensor:
        if planar:
            return gtsam.BearingRangeFactor2D(*keys, gtsam.Rot2(value[0]), value[1], noise)
        return gtsam.BearingRangeFactor3D(*keys, gtsam.Unit3(value[:3]), value[3], noise)
    read = _read_flat if flat else _read_spatial
    return _custom_factor(sensor, keys, (value, noise), read, planar=planar)


def robot_factor(
    measurement: Measurement,
    sensor: AbstractSensor | RelativePoseSensor,
    keys: tuple[Key, Key],
    noise: gtsam.noiseModel.Base,
    *,
    planar: bool,
) -> gtsam.NoiseModelFactor:
    """Factor of a measurement of another robot: of its position, or of its relative pose.

    Args:
        measurement: What was measured; checked.
        sensor: The sensor that it names.
        keys: Keys of the pose of the robot that measured and of the one that was measured.
        noise: Its noise model, Gaussian or robust.
        planar: Whether the poses are (x, y, heading), not 4 x 4 matrices.

    Returns:
        GTSAM's own factor for the built-in sensors, else a CustomFactor.
    """
    value = measurement.value
    if isinstance(sensor, RelativePoseSensor):
        return _between(keys, rigid(value), noise)
    native = _basis_agrees(sensor, measurement, planar=planar)
    if native and type(sensor) is RangeSensor:
        ranging = gtsam.RangeFactorPose2 if planar else gtsam.RangeFactorPose3
        return ranging(*keys, value[0], noise)
    if native and type(sensor) is BearingRangeSensor:
        if planar:
            return gtsam.BearingRangeFactorPose2(*keys, gtsam.Rot2(value[0]), value[1], noise)
        return gtsam.BearingRangeFactorPose3(*keys, gtsam.Unit3(value[:3]), value[3], noise)
    if planar and type(sensor) is BearingSensor:
        return gtsam.BearingFactorPose2(*keys, gtsam.Rot2(value[0]), noise)
    read = _read_planar_pose if planar else _read_spatial_pose
    return _custom_factor(sensor, keys, (value, noise), read, planar=planar)


def odometry_factor(
    keys: tuple[Key, Key], relative: Pose, covariance: Covariance, robot: str
) -> gtsam.NoiseModelFactor:
    """Factor of the relative pose that odometry read, its noise in the later pose's tangent."""
    return _between(keys, relative, gaussian_noise(covariance, f"odometry of robot {robot!r}"))


def prior_factor(
    key: Key, pose: Pose, covariance: Covariance, robot: str
) -> gtsam.NoiseModelFactor:
    """Factor of what is known of a robot's first pose, its noise in that pose's tangent."""
    noise = gaussian_noise(covariance, f"prior of robot {robot!r}")
    if pose.ndim == 1:
        return gtsam.PriorFactorPose2(key, gtsam.Pose2(*pose), noise)
    return gtsam.PriorFactorPose3(key, gtsam.Pose3(pose), noise)


def landmark_prior_factor(
    key: Key, point: FloatArray, covariance: Covariance
) -> gtsam.NoiseModelFactor:
    """Factor of where a landmark is known to be beforehand."""
    noise = gaussian_noise(covariance, "prior of a landmark")
    if point.size == 2:
        return gtsam.PriorFactorPoint2(key, point, noise)
    return gtsam.PriorFactorPoint3(key, point, noise)


def _between(
    keys: tuple[Key, Key], relative: Pose, noise: gtsam.noiseModel.Base
) -> gtsam.NoiseModelFactor:
    """Factor of a measured relative pose."""
    if relative.ndim == 1:
        return gtsam.BetweenFactorPose2(*keys, gtsam.Pose2(*relative), noise)
    return gtsam.BetweenFactorPose3(*keys, gtsam.Pose3(relative), noise)


def measurement_noise(measurement: Measurement) -> gtsam.noiseModel.Gaussian:
    """Noise model of a measurement."""
    return gaussian_noise(measurement.covariance, f"sensor {measurement.sensor!r}")


def _basis_agrees(sensor: AbstractSensor, measurement: Measurement, *, planar: bool) -> bool:
    """Whether GTSAM's basis of a bearing in space means the same noise."""
    any_pose = np.zeros(3) if planar else np.eye(4)
    return bearing_basis_agrees(sensor, any_pose, measurement.covariance)


def _read_flat(values: gtsam.Values, key: Key) -> Target:
    """A landmark in the plane."""
    return values.atPoint2(key), np.eye(2)


def _read_spatial(values: gtsam.Values, key: Key) -> Target:
    """A landmark in space."""
    return values.atPoint3(key), np.eye(3)


def _read_planar_pose(values: gtsam.Values, key: Key) -> Target:
    """Position of a robot in the plane."""
    pose = _pose(values, key, planar=True)
    return position(pose), point_jacobian(pose, 2)


def _read_spatial_pose(values: gtsam.Values, key: Key) -> Target:
    """Position of a robot in space."""
    pose = _pose(values, key, planar=False)
    return position(pose), point_jacobian(pose, 3)


def _pose(values: gtsam.Values, key: Key, *, planar: bool) -> Pose:
    """A pose as an array."""
    if not planar:
        return values.atPose3(key).matrix()
    found = values.atPose2(key)
    return np.array([found.x(), found.y(), found.theta()])


def _custom_factor(
    sensor: AbstractSensor,
    keys: tuple[Key, Key],
    measured: tuple[FloatArray, gtsam.noiseModel.Base],
    read: Callable[[gtsam.Values, Key], Target],
    *,
    planar: bool,
) -> gtsam.CustomFactor:
    """Any sensor as a GTSAM factor."""
    value, noise = measured

    def error(
        factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: JacobianList
    ) -> FloatArray:
        first, second = tuple(factor.keys())
        pose, (target, by_variable) = _pose(values, first, planar=planar), read(values, second)
        by_pose, by_target = sensor.jacobians(pose, target)
        store_jacobians(jacobians, (by_pose, by_target @ by_variable))
        return sensor_residual(sensor, pose, target, value)

    return gtsam.CustomFactor(noise, list(keys), error)
