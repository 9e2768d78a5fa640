"""Drawing noise where the values live: tangents of poses, directions, plain numbers.

A pose x is disturbed on the right, x Exp(w), with the exponential of the twist: GTSAM's charts for
Pose2 and Pose3 (since 4.3 for both). So the error of a GTSAM BetweenFactor at the truth is the
noise that was drawn, up to sign. A direction in space moves along the sphere.
"""

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.models.hidden_state import square_root
from fgplan.models.pose import compose, skew
from fgplan.models.sensor import AbstractSensor
from fgplan.typing import Covariance, FloatArray, Pose


def exponential(tangent: FloatArray) -> Pose:
    """Pose of a tangent vector: the exponential of the twist, GTSAM's chart.

    Args:
        tangent: Shape (3,) planar (x, y, heading) or (6,) spatial (rotation first).

    Returns:
        Shape (3,) or (4, 4).
    """
    if tangent.size == 3:
        x, y, turned = tangent
        along = np.sinc(turned / np.pi)
        # (1 - cos a) / a, which cancels for small a
        across = np.sin(0.5 * turned) * np.sinc(0.5 * turned / np.pi)
        where = np.array([along * x - across * y, across * x + along * y, turned])
        return compose(np.zeros(3), where)
    turn, shift = tangent[:3], tangent[3:]
    angle = float(np.linalg.norm(turn))
    hat = skew(turn)
    # Below 1e-5 rad the series is exact to the last digit.
    if angle < 1e-5:
        first, second, third = 1.0, 0.5, 1.0 / 6.0
    else:
        first = np.sin(angle) / angle
        second = (1.0 - np.cos(angle)) / angle**2
        third = (angle - np.sin(angle)) / angle**3
    pose = np.eye(4)
    pose[:3, :3] += first * hat + second * hat @ hat
    pose[:3, 3] = (np.eye(3) + second * hat + third * hat @ hat) @ shift
    return pose


def disturb_pose(pose: Pose, covariance: Covariance, generator: np.random.Generator) -> Pose:
    """Draw x Exp(w), w ~ N(0, covariance).

    Args:
        pose: Shape (3,) or (4, 4).
        covariance: Shape (3, 3) or (6, 6), tangent of the pose.
        generator: Source of the noise.

    Returns:
        Same representation.
    """
    tangent = square_root(covariance) @ generator.standard_normal(len(covariance))
    return compose(pose, exponential(tangent))


def draw_measurement(
    sensor: AbstractSensor, pose: Pose, target: FloatArray, generator: np.random.Generator
) -> tuple[FloatArray, Covariance]:
    """Draw what a sensor reads: z = h(pose, target) + v, v ~ N(0, noise).

    Args:
        sensor: Any sensor. One whose noise has one row less than its value is taken to have a
            direction in space, a unit vector, as the value's first three numbers.
        pose: True pose of the robot, shape (3,) or (4, 4).
        target: True state of the target, shape (n,), metres, world frame.
        generator: Source of the noise.

    Returns:
        Value, shape (m,), with planar angles in (-pi, pi], and the covariance it was drawn with.

    Raises:
        InvalidInputError: If the sensor's value and noise do not fit each other.
    """
    exact = sensor.predict(pose, target)
    covariance = sensor.noise(pose, target)
    noise = square_root(covariance) @ generator.standard_normal(len(covariance))
    if noise.size == exact.size:
        # A sensor's difference wraps its angles, so the difference from zero is the wrapped value.
        return sensor.difference(exact + noise, np.zeros(exact.size)), covariance
    if noise.size == exact.size - 1 and exact.size >= 3:
        direction = _along_sphere(exact[:3], noise[:2])
        return np.concatenate([direction, exact[3:] + noise[2:]]), covariance
    raise InvalidInputError(
        f"sensor {sensor.kind!r}: expected noise of {exact.size} rows, as its value has, or one "
        f"less for a direction in space, got {noise.size}"
    )


def _along_sphere(unit: FloatArray, step: FloatArray) -> FloatArray:
    """Move a unit vector along the sphere by two tangent coordinates, radians."""
    first = np.cross(unit, np.eye(3)[int(np.argmin(np.abs(unit)))])
    first /= np.linalg.norm(first)
    tangent = step[0] * first + step[1] * np.cross(unit, first)
    angle = float(np.linalg.norm(tangent))
    return np.cos(angle) * unit + np.sinc(angle / np.pi) * tangent
