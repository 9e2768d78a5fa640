"""Is the covariance that SLAM reports that of the error it makes?

With the error e of an estimate, a tangent vector of the estimate, and its covariance P, the
normalised estimation error squared

    e' P^-1 e

is chi-square distributed with dim(e) degrees of freedom if SLAM is consistent. So its mean over n
independent runs lies, in a share p of all cases, between the quantiles (1 - p) / 2 and (1 + p) / 2
of the chi-square distribution with n dim(e) degrees, divided by n.
"""

import numpy as np
from scipy.stats import chi2

from fgplan.checks import check_covariance
from fgplan.errors import InvalidInputError
from fgplan.models.pose import between, check_pose
from fgplan.typing import ArrayLike, FloatArray, Pose


def pose_error(estimate: Pose, truth: Pose) -> FloatArray:
    """Tangent vector that leads from an estimate to the truth: Log(estimate^-1 truth).

    Args:
        estimate: Shape (3,) or (4, 4), world frame.
        truth: The same representation.

    Returns:
        Shape (3,) (x, y, heading) or (6,) (rotation first), in the tangent of the estimate.

    Raises:
        InvalidInputError: If one is no pose or the two differ in kind.
    """
    one, other = check_pose(estimate, "estimate"), check_pose(truth, "truth")
    if one.shape != other.shape:
        raise InvalidInputError(
            f"truth: expected a pose of shape {one.shape}, as the estimate has, got {other.shape}"
        )
    return logarithm(between(one, other))


def logarithm(pose: Pose) -> FloatArray:
    """Tangent vector whose exponential is a pose; fgplan.simulation.noise has the exponential.

    Args:
        pose: Shape (3,) or (4, 4); turned by less than pi.

    Returns:
        Shape (3,) or (6,).
    """
    if pose.ndim == 1:
        half = 0.5 * pose[2]
        along = half / np.tan(half) if abs(half) > 1e-9 else 1.0
        x, y = along * pose[0] + half * pose[1], along * pose[1] - half * pose[0]
        return np.array([x, y, pose[2]])
    rotation, shift = pose[:3, :3], pose[:3, 3]
    turn = _rotation_vector(rotation)
    angle = float(np.linalg.norm(turn))
    # The series is exact to the last digit below.
    factor = 1.0 / 12.0 if angle < 1e-4 else (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2
    across = np.cross(turn, shift)
    return np.append(turn, shift - 0.5 * across + factor * np.cross(turn, across))


def normalised_error_squared(estimate: Pose, truth: Pose, covariance: ArrayLike) -> float:
    """Normalised estimation error squared e' P^-1 e of a pose.

    Args:
        estimate: Shape (3,) or (4, 4), world frame.
        truth: The same representation.
        covariance: P, shape (3, 3) or (6, 6), tangent of the estimate.

    Returns:
        Zero or more; about the number of dimensions if P is right.

    Raises:
        InvalidInputError: If a pose is none or the covariance does not fit.
    """
    error = pose_error(estimate, truth)
    checked = check_covariance(covariance, "covariance of the estimate", error.size)
    scale = np.sqrt(np.diag(checked))
    lower = np.linalg.cholesky(checked / np.outer(scale, scale))
    return float((np.linalg.solve(lower, error / scale) ** 2).sum())


def chi_square_interval(degrees: int, share: float = 0.95) -> tuple[float, float]:
    """Two-sided interval that holds a share of a chi-square distribution.

    Args:
        degrees: Degrees of freedom; dim(e) times runs for a sum over runs. Divide the bounds by
            the number of runs for the mean.
        share: Between 0 and 1, both excluded.

    Returns:
        Lower and upper bound; as much lies below as above.

    Raises:
        InvalidInputError: If either is out of range.
    """
    if not degrees >= 1:
        raise InvalidInputError(f"chi-square degrees: expected 1 or more, got {degrees!r}")
    if not 0.0 < share < 1.0:
        raise InvalidInputError(f"chi-square share: expected between 0 and 1, got {share!r}")
    low, high = chi2.ppf([0.5 * (1.0 - share), 0.5 * (1.0 + share)], degrees)
    return float(low), float(high)


def _rotation_vector(rotation: FloatArray) -> FloatArray:
    """Axis times angle of a rotation matrix, by its quaternion, whose largest entry divides."""
    r = rotation
    squares = 1.0 + np.array(
        [
            r[0, 0] + r[1, 1] + r[2, 2],
            r[0, 0] - r[1, 1] - r[2, 2],
            r[1, 1] - r[0, 0] - r[2, 2],
            r[2, 2] - r[0, 0] - r[1, 1],
        ]
    )
    rows = np.array(
        [
            [squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], squares[1], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], squares[2], r[2, 1] + r[1, 2]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], squares[3]],
        ]
    )
    quaternion = rows[int(np.argmax(squares))]
    quaternion = quaternion / np.linalg.norm(quaternion) * (1.0 if quaternion[0] >= 0.0 else -1.0)
    sine = float(np.linalg.norm(quaternion[1:]))
    if sine == 0.0:
        return np.zeros(3)
    angle = 2.0 * np.arctan2(sine, quaternion[0])
    return angle / sine * quaternion[1:]
