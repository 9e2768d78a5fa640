"""Poses as arrays: planar (x, y, heading) and spatial 4 x 4 matrices ``wTr``.

Only what planning needs: composing, relative pose, and the adjoint, because the Jacobians of a
relative-pose factor h = x1^-1 x2 at zero error are -Ad(h^-1) and I (tangents on the right).
"""

import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.typing import ArrayLike, FloatArray, Pose

PLANAR_DIM = 3
SPATIAL_DIM = 6


def check_pose(pose: ArrayLike, name: str) -> Pose:
    """Check a pose: shape (3,) planar or (4, 4) spatial with a proper rotation.

    Raises:
        InvalidInputError: If it is neither.
    """
    array = np.asarray(pose, dtype=np.float64)
    if array.shape == (3,):
        return check_finite(array, name, (3,))
    if array.shape != (4, 4):
        raise InvalidInputError(
            f"{name}: expected (x, y, heading) or a 4 x 4 matrix, got shape {array.shape}"
        )
    array = check_finite(array, name, (4, 4))
    rotation = array[:3, :3]
    drift = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if drift > 1e-6 or np.linalg.det(rotation) < 0 or (array[3] != [0, 0, 0, 1]).any():
        raise InvalidInputError(
            f"{name}: expected a rigid motion, got |R R' - I| up to {drift:g}, last row {array[3]}"
        )
    return array


def tangent_dim(pose: Pose) -> int:
    """Dimension of the tangent space: 3 for a planar pose, 6 for a spatial one."""
    return PLANAR_DIM if pose.ndim == 1 else SPATIAL_DIM


def position(pose: Pose) -> FloatArray:
    """Position in the world frame, metres: shape (2,) or (3,)."""
    return pose[:2] if pose.ndim == 1 else pose[:3, 3]


def position_slice(dim: int) -> slice:
    """Where the position sits in the tangent of dimension ``dim`` (body frame)."""
    return slice(0, 2) if dim == PLANAR_DIM else slice(3, 6)


def heading_slice(dim: int) -> slice:
    """Where the rotation sits in the tangent of dimension ``dim``."""
    return slice(2, 3) if dim == PLANAR_DIM else slice(0, 3)


def rotation_matrix(pose: Pose) -> FloatArray:
    """Rotation ``wRr``: shape (2, 2) or (3, 3)."""
    if pose.ndim == 2:
        return pose[:3, :3]
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[cos, -sin], [sin, cos]])


def between(first: Pose, second: Pose) -> Pose:
    """Relative pose ``first^-1 second``, same representation."""
    if first.ndim == 2:
        inverse = np.eye(4)
        inverse[:3, :3] = first[:3, :3].T
        inverse[:3, 3] = -first[:3, :3].T @ first[:3, 3]
        return inverse @ second
    step = rotation_matrix(first).T @ (second[:2] - first[:2])
    turn = second[2] - first[2]
    return np.array([step[0], step[1], np.arctan2(np.sin(turn), np.cos(turn))])


def compose(first: Pose, second: Pose) -> Pose:
    """Composition ``first second``, same representation."""
    if first.ndim == 2:
        return first @ second
    where = first[:2] + rotation_matrix(first) @ second[:2]
    turn = first[2] + second[2]
    return np.array([where[0], where[1], np.arctan2(np.sin(turn), np.cos(turn))])


def inverse(pose: Pose) -> Pose:
    """Inverse pose, same representation."""
    identity = np.zeros(3) if pose.ndim == 1 else np.eye(4)
    return between(pose, identity)


def skew(vector: FloatArray) -> FloatArray:
    """Cross-product matrix of a vector of shape (3,)."""
    return np.array(
        [
            [0.0, -vector[2], vector[1]],
            [vector[2], 0.0, -vector[0]],
            [-vector[1], vector[0], 0.0],
        ]
    )


def adjoint(pose: Pose) -> FloatArray:
    """Adjoint matrix in GTSAM's tangent order: shape (3, 3) or (6, 6)."""
    if pose.ndim == 1:
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        return np.array([[cos, -sin, pose[1]], [sin, cos, -pose[0]], [0.0, 0.0, 1.0]])
    rotation, where = pose[:3, :3], pose[:3, 3]
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = rotation
    matrix[3:, :3] = skew(where) @ rotation
    matrix[3:, 3:] = rotation
    return matrix


def point_jacobian(pose: Pose, size: int) -> FloatArray:
    """Derivative of a robot's position by its pose tangent.

    Args:
        pose: Shape (3,) or (4, 4).
        size: Dimension of the position wanted: 3 for a planar robot puts it at height zero.

    Returns:
        Shape (size, d), world frame.
    """
    if pose.ndim == 2:
        return np.hstack([np.zeros((3, 3)), pose[:3, :3]])
    matrix = np.zeros((size, 3))
    matrix[:2, :2] = rotation_matrix(pose)
    return matrix


def position_in(pose: Pose, size: int) -> FloatArray:
    """Position with ``size`` coordinates: a planar robot is at height zero."""
    where = position(pose)
    return where if where.size == size else np.append(where, 0.0)


def travelled(relative: Pose) -> tuple[float, float]:
    """Distance in metres and turn in radians (zero or more) of a relative pose."""
    if relative.ndim == 1:
        return float(np.hypot(relative[0], relative[1])), float(abs(relative[2]))
    cos = np.clip((np.trace(relative[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)
    return float(np.linalg.norm(relative[:3, 3])), float(np.arccos(cos))
