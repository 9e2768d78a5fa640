"""Factors of what was measured: P(z | x, l) and P(z | x, x') with the measured value.

Planning's factors have zero error at the planned states (fgplan.factors.observation); these have
the error that the measurement makes. Range, bearing, bearing-range and relative pose become GTSAM's
own factors; any other sensor, and noise that means another thing in GTSAM's basis of a bearing in
space, becomes a CustomFactor of the sensor's ``predict``, ``jacobians`` and ``difference``.
"""

import gtsam
import numpy as np

from fgplan.checks import check_covariance, check_finite
from fgplan.errors import InvalidInputError
from fgplan.factors.gaussian_noise import gaussian_noise
from fgplan.factors.motion import gtsam_pose
from fgplan.factors.observation import (
    JacobianList,
    bearing_basis_agrees,
    sensor_residual,
    store_jacobians,
)
from fgplan.models.measurement import Measurement
from fgplan.models.pose import check_pose, point_jacobian, position, tangent_dim
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor, checked_jacobians
from fgplan.typing import Covariance, FloatArray, Key, Pose

UNIT_TOLERANCE = 1e-6
"""Largest deviation from one of the length of a measured direction in space."""


def checked_measurement(
    measurement: Measurement, sensor: AbstractSensor | RelativePoseSensor, pose: Pose
) -> None:
    """Check what GTSAM would silently accept: shape, numbers and noise of a measurement.

    Args:
        measurement: What was measured.
        sensor: The sensor that it names.
        pose: Any pose of the robot: tells planar from spatial.

    Raises:
        InvalidInputError: If value or covariance have another shape than the sensor's, are not
            finite, or the noise is not positive definite.
    """
    name = (
        f"measurement of {measurement.kind} {measurement.target!r} by robot {measurement.robot!r} "
        f"with sensor {measurement.sensor!r}"
    )
    planar = pose.ndim == 1
    if isinstance(sensor, RelativePoseSensor):
        if measurement.value.shape != pose.shape:
            raise InvalidInputError(
                f"{name}: expected a relative pose of shape {pose.shape}, as the robots' poses "
                f"have, got {measurement.value.shape}"
            )
        check_pose(measurement.value, name)
        rows: int | None = tangent_dim(pose)
    elif isinstance(sensor, RangeSensor):
        check_finite(measurement.value, name, (1,))
        rows = 1
    elif isinstance(sensor, BearingSensor | BearingRangeSensor):
        ranges = int(isinstance(sensor, BearingRangeSensor))
        value = check_finite(measurement.value, name, ((1 if planar else 3) + ranges,))
        rows = (1 if planar else 2) + ranges
        if not planar and abs(float(np.linalg.norm(value[:3])) - 1.0) > UNIT_TOLERANCE:
            raise InvalidInputError(
                f"{name}: expected a direction of length one, got {value[:3].tolist()}"
            )
    else:
        check_finite(measurement.value, name, (None,))
        rows = None
    check_covariance(measurement.covariance, f"covariance of {name}", rows)


def landmark_factor(
    measurement: Measurement,
    sensor: AbstractSensor,
    keys: tuple[Key, Key],
    pose: Pose,
    point: FloatArray,
) -> gtsam.NonlinearFactor:
    """Factor of a measurement of a landmark.

    Args:
        measurement: What was measured; checked.
        sensor: The sensor that it names.
        keys: Keys of the pose and of the landmark.
        pose: Estimate of the pose, shape (3,) or (4, 4), world frame.
        point: Estimate of the landmark, shape (2,) or (3,), metres, world frame.

    Returns:
        GTSAM's own factor for the built-in sensors, else a CustomFactor.

    Raises:
        InvalidInputError: If a user's own sensor does not fit the measurement.
    """
    planar = pose.ndim == 1
    value, noise = measurement.value, _noise(measurement)
    native = planar == (point.size == 2) and bearing_basis_agrees(
        sensor, pose, measurement.covariance
    )
    if native and type(sensor) is RangeSensor:
        ranging = gtsam.RangeFactor2D if planar else gtsam.RangeFactor3D
        return ranging(*keys, value[0], noise)
    if native and type(sensor) is BearingSensor:
        bearing = gtsam.BearingFactor2D if planar else gtsam.BearingFactor3D
        return bearing(*keys, _direction(value, planar=planar), noise)
    if native and type(sensor) is BearingRangeSensor:
        both = gtsam.BearingRangeFactor2D if planar else gtsam.BearingRangeFactor3D
        return both(*keys, _direction(value, planar=planar), value[-1], noise)
    return _custom_factor(sensor, keys, measurement, (pose, point), to_robot=False)


def robot_factor(
    measurement: Measurement,
    sensor: AbstractSensor | RelativePoseSensor,
    keys: tuple[Key, Key],
    pose: Pose,
    other: Pose,
) -> gtsam.NonlinearFactor:
    """Factor of a measurement of another robot: of its position, or of its relative pose.

    Args:
        measurement: What was measured; checked.
        sensor: The sensor that it names.
        keys: Keys of the pose of the robot that measured and of the one that was measured.
        pose: Estimate of the pose of the robot that measured, world frame.
        other: Estimate of the pose of the one that was measured.

    Returns:
        GTSAM's own factor for the built-in sensors, else a CustomFactor.

    Raises:
        InvalidInputError: If a user's own sensor does not fit the measurement.
    """
    planar = pose.ndim == 1
    value, noise = measurement.value, _noise(measurement)
    if isinstance(sensor, RelativePoseSensor):
        between = gtsam.BetweenFactorPose2 if planar else gtsam.BetweenFactorPose3
        return between(*keys, gtsam_pose(value), noise)
    native = bearing_basis_agrees(sensor, pose, measurement.covariance)
    if native and type(sensor) is RangeSensor:
        ranging = gtsam.RangeFactorPose2 if planar else gtsam.RangeFactorPose3
        return ranging(*keys, value[0], noise)
    if native and type(sensor) is BearingRangeSensor:
        both = gtsam.BearingRangeFactorPose2 if planar else gtsam.BearingRangeFactorPose3
        return both(*keys, _direction(value, planar=planar), value[-1], noise)
    if planar and type(sensor) is BearingSensor:
        return gtsam.BearingFactorPose2(*keys, _direction(value, planar=planar), noise)
    return _custom_factor(sensor, keys, measurement, (pose, position(other)), to_robot=True)


def odometry_factor(
    keys: tuple[Key, Key], relative: Pose, covariance: Covariance, robot: str
) -> gtsam.NonlinearFactor:
    """Factor of the relative pose that odometry read, its noise in the later pose's tangent."""
    noise = gaussian_noise(covariance, f"odometry of robot {robot!r}")
    between = gtsam.BetweenFactorPose2 if relative.ndim == 1 else gtsam.BetweenFactorPose3
    return between(*keys, gtsam_pose(relative), noise)


def _noise(measurement: Measurement) -> gtsam.noiseModel.Gaussian:
    """Noise model of a measurement."""
    return gaussian_noise(measurement.covariance, f"sensor {measurement.sensor!r}")


def _direction(value: FloatArray, *, planar: bool) -> gtsam.Rot2 | gtsam.Unit3:
    """Measured bearing as GTSAM's type."""
    return gtsam.Rot2(value[0]) if planar else gtsam.Unit3(value[:3])


def _custom_factor(
    sensor: AbstractSensor,
    keys: tuple[Key, Key],
    measurement: Measurement,
    estimates: tuple[Pose, FloatArray],
    *,
    to_robot: bool,
) -> gtsam.CustomFactor:
    """Any sensor as a GTSAM factor, to a point or to another robot's position."""
    pose, point = estimates
    measured, planar, flat = measurement.value, pose.ndim == 1, point.size == 2
    # Checked here and not in GTSAM's callback, whose errors leave iSAM2 unusable.
    rows = len(checked_jacobians(sensor, pose, point)[0])
    found = (len(measurement.covariance), sensor_residual(sensor, pose, point, measured).shape)
    if found != (rows, (rows,)):
        raise InvalidInputError(
            f"measurement by robot {measurement.robot!r} with sensor {measurement.sensor!r}: "
            f"expected covariance and residual of {rows} rows, as its Jacobians have, got "
            f"{found[0]} rows and shape {found[1]}"
        )

    def read(values: gtsam.Values, key: Key) -> Pose:
        if not planar:
            return values.atPose3(key).matrix()
        found = values.atPose2(key)
        return np.array([found.x(), found.y(), found.theta()])

    def error(
        factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: JacobianList
    ) -> FloatArray:
        first, second = tuple(factor.keys())
        where = read(values, first)
        if to_robot:
            there = read(values, second)
            target = position(there)
            by_pose, by_position = sensor.jacobians(where, target)
            by_target = by_position @ point_jacobian(there, target.size)
        else:
            target = values.atPoint2(second) if flat else values.atPoint3(second)
            by_pose, by_target = sensor.jacobians(where, target)
        store_jacobians(jacobians, (by_pose, by_target))
        return sensor_residual(sensor, where, target, measured)

    return gtsam.CustomFactor(_noise(measurement), list(keys), error)
