"""What robots read, checked before any of it reaches GTSAM, which would accept it without a word.

Checked are shapes, numbers, noise, and keys. A user's own sensor is tried at a point one metre
ahead of the robot: inside GTSAM's callback an error would leave iSAM2 unusable.
"""

import numpy as np

from fgplan.checks import check_covariance, check_finite
from fgplan.errors import InvalidInputError
from fgplan.factors.keys import check_no_future_keys, describe_key
from fgplan.factors.observation import sensor_residual
from fgplan.models.measurement import Measurement, Odometry
from fgplan.models.pose import check_pose, position, rotation_matrix, tangent_dim
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor, checked_jacobians
from fgplan.slam.pose_key import is_pose_key
from fgplan.typing import ArrayLike, Covariance, FloatArray, Key, Pose

FARTHEST_BELOW_ZERO = 6.0
"""Sigmas that a range may be below zero: so near a robot drawn noise can take it there, once in
1e9 times farther. Logs write -1 where nothing came back."""

UNIT_TOLERANCE = 1e-6
"""Largest deviation from one of the length of a measured direction in space."""


def checked_odometry(reading: Odometry, step: int, before: Pose) -> Covariance:
    """Check odometry of one robot.

    Args:
        reading: What it read of its motion.
        step: Steps since the start, for messages.
        before: Its pose before: tells planar from spatial.

    Returns:
        The covariance, which is there.

    Raises:
        InvalidInputError: If it is of step 0, exact, of another shape than the pose, or not
            finite, or its covariance is none.
    """
    who = f"odometry of robot {reading.robot!r} at step {step}"
    if step == 0:
        raise InvalidInputError(
            f"{who}: expected none, because the start is the pose of step 0; count the first "
            "motion as step 1"
        )
    if reading.covariance is None:
        raise InvalidInputError(
            f"{who}: expected a covariance, got exact odometry, which leaves no belief; give the "
            "robot a MotionModel for its actuation or odometry, with small sigmas if it is good"
        )
    if reading.relative.shape != before.shape:
        raise InvalidInputError(
            f"{who}: expected a relative pose of shape {before.shape}, as the robot's start has, "
            f"got {reading.relative.shape}"
        )
    check_pose(reading.relative, who)
    return check_covariance(reading.covariance, f"covariance of {who}", tangent_dim(before))


def checked_step(step: object, last: int) -> int:
    """Check that an update comes after the last one.

    Raises:
        InvalidInputError: If it is no whole number, or not later.
    """
    if isinstance(step, bool) or not isinstance(step, int | np.integer) or step <= last:
        raise InvalidInputError(f"slam update: expected a step later than {last}, got {step!r}")
    return int(step)


def check_measurement(
    measurement: Measurement, sensor: AbstractSensor | RelativePoseSensor, pose: Pose
) -> None:
    """Check a measurement of a landmark or of another robot.

    Args:
        measurement: What was measured.
        sensor: The sensor that it names.
        pose: Estimated pose of the robot, shape (3,) or (4, 4), world frame.

    Raises:
        InvalidInputError: If value or covariance have another shape than the sensor's, are not
            finite, the noise is not positive definite, a range is below zero by more than noise, or
            the sensor does not measure such things.
    """
    target = measurement.target
    what = describe_key(target) if isinstance(target, int) and target >= 0 else repr(target)
    name = (
        f"measurement of {measurement.kind} {what} by robot {measurement.robot!r} with sensor "
        f"{measurement.sensor!r}"
    )
    value, planar = measurement.value, pose.ndim == 1
    if measurement.kind not in ("landmark", "robot"):
        raise InvalidInputError(f"{name}: expected kind 'landmark', 'robot' or 'target'")
    if isinstance(sensor, RelativePoseSensor):
        if measurement.kind != "robot":
            raise InvalidInputError(
                f"{name}: expected kind 'robot', because a landmark is a point, which has no "
                "relative pose"
            )
        if value.shape != pose.shape:
            raise InvalidInputError(
                f"{name}: expected a relative pose of shape {pose.shape}, as the robots' poses "
                f"have, got {value.shape}"
            )
        check_pose(value, name)
        rows = tangent_dim(pose)
    elif isinstance(sensor, RangeSensor):
        check_finite(value, name, (1,))
        rows = 1
    elif isinstance(sensor, BearingSensor | BearingRangeSensor):
        ranges = int(isinstance(sensor, BearingRangeSensor))
        check_finite(value, name, ((1 if planar else 3) + ranges,))
        rows = (1 if planar else 2) + ranges
        if not planar and abs(float(np.linalg.norm(value[:3])) - 1.0) > UNIT_TOLERANCE:
            raise InvalidInputError(
                f"{name}: expected a direction of length one, got {value[:3].tolist()}"
            )
    else:
        rows = _rows_of_own(measurement, sensor, pose, name)
    covariance = measurement.covariance
    plain = covariance.shape == (rows, rows) and np.count_nonzero(covariance) == rows
    diagonal = covariance.ravel()[:: rows + 1]
    # The usual noise, independent rows, at a tenth of the time.
    if not (plain and (diagonal > 0.0).all() and np.isfinite(diagonal).all()):
        check_covariance(covariance, f"covariance of {name}", rows)
    if isinstance(sensor, RangeSensor | BearingRangeSensor):
        sigma = float(np.sqrt(covariance[-1, -1]))
        if value[-1] < -FARTHEST_BELOW_ZERO * sigma:
            raise InvalidInputError(
                f"{name}: expected a range of zero or more but for noise, got {value[-1]:g} m with "
                f"sigma {sigma:g} m; leave out readings that stand for none"
            )


def landmark_key(key: object) -> Key:
    """Check that a key may be a landmark's.

    Raises:
        InvalidInputError: If it is no key, or of the form of fgplan's or SLAM's poses.
    """
    if isinstance(key, bool) or not isinstance(key, int | np.integer) or not 0 <= key < 2**64:
        raise InvalidInputError(f"landmark: expected a GTSAM key, got {key!r}")
    check_no_future_keys([int(key)])
    if is_pose_key(int(key)):
        raise InvalidInputError(
            f"landmark {describe_key(int(key))}: keys 'x' with a letter are SLAM's poses; use "
            "another character, as in gtsam.symbol('l', 0)"
        )
    return int(key)


def checked_landmark_prior(
    key: object, where: ArrayLike, covariance: ArrayLike, *, planar: bool
) -> tuple[Key, FloatArray, Covariance]:
    """Check where a landmark is known to be beforehand.

    Args:
        key: Its key.
        where: Position, shape (2,) or, always for robots in space, (3,), metres, world frame.
        covariance: Shape (2, 2) or (3, 3), square metres.
        planar: Whether the robots' poses are (x, y, heading).

    Returns:
        Key, position and covariance.

    Raises:
        InvalidInputError: If one is not usable.
    """
    landmark = landmark_key(key)
    name = f"prior of landmark {describe_key(landmark)}"
    point = check_finite(where, name, (None,))
    if point.size != 3 and not (planar and point.size == 2):
        raise InvalidInputError(
            f"{name}: expected {'2 or 3' if planar else '3'} coordinates, got {point.size}"
        )
    return landmark, point, check_covariance(covariance, name, point.size)


def _rows_of_own(measurement: Measurement, sensor: AbstractSensor, pose: Pose, name: str) -> int:
    """Rows of a user's own sensor, if its residual fits."""
    check_finite(measurement.value, name, (None,))
    ahead = position(pose) + rotation_matrix(pose)[:, 0]
    rows = len(checked_jacobians(sensor, pose, ahead)[0])
    found = np.shape(sensor_residual(sensor, pose, ahead, measurement.value))
    if found != (rows,):
        raise InvalidInputError(
            f"{name}: expected a residual of shape ({rows},), as many rows as the sensor's "
            f"Jacobians have, got {found}"
        )
    return rows
