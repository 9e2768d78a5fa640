"""How far an estimated trajectory is from the truth: the absolute trajectory error.

    sqrt(mean |R p_i + t - q_i|^2)    metres, over positions p_i estimated and q_i true

with the rigid motion (R, t) that puts the estimate's first pose onto the truth's ("first"), the one
that makes the error least ("all": Umeyama 1991 without scale), or none. With H = sum (q_i - mean)
(p_i - mean)' = U S V', the least error has R = U diag(1, ..., det(U V')) V'.
"""

from typing import Literal

import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.models.pose import position, rotation_matrix
from fgplan.typing import ArrayLike, FloatArray, Pose

Alignment = Literal["none", "first", "all"]


def absolute_trajectory_error(
    estimate: ArrayLike, truth: ArrayLike, alignment: Alignment = "first"
) -> float:
    """Root mean square of the distances between estimated and true positions.

    Args:
        estimate: Poses, shape (n, 3) or (n, 4, 4), world frame.
        truth: Poses at the same times, same shape.
        alignment: Rigid motion applied to the estimate before.

    Returns:
        Metres.

    Raises:
        InvalidInputError: If the shapes differ, a number is not finite, or the alignment is not
            known.
    """
    distances = position_errors(estimate, truth, alignment)
    return float(np.sqrt((distances**2).mean()))


def position_errors(
    estimate: ArrayLike, truth: ArrayLike, alignment: Alignment = "first"
) -> FloatArray:
    """Distance between estimated and true position at each time.

    Args:
        estimate: Poses, shape (n, 3) or (n, 4, 4), world frame.
        truth: Poses at the same times, same shape.
        alignment: Rigid motion applied to the estimate before.

    Returns:
        Shape (n,), metres.

    Raises:
        InvalidInputError: If the shapes differ, a number is not finite, or the alignment is not
            known.
    """
    poses, true_poses = _trajectory(estimate, "estimate"), _trajectory(truth, "truth")
    if poses.shape != true_poses.shape:
        raise InvalidInputError(
            f"trajectories: expected one true pose for each estimate, got {true_poses.shape} for "
            f"{poses.shape}"
        )
    positions = np.array([position(pose) for pose in poses])
    wanted = np.array([position(pose) for pose in true_poses])
    if alignment == "first":
        positions = _onto_first(positions, wanted, poses[0], true_poses[0])
    elif alignment == "all":
        positions = _onto_all(positions, wanted)
    elif alignment != "none":
        raise InvalidInputError(f"alignment: expected 'none', 'first' or 'all', got {alignment!r}")
    distances: FloatArray = np.linalg.norm(positions - wanted, axis=1)
    return distances


def _trajectory(poses: ArrayLike, name: str) -> FloatArray:
    """Poses, at least one, checked."""
    shape = np.shape(poses)
    if shape[1:] not in ((3,), (4, 4)) or shape[0] == 0:
        raise InvalidInputError(
            f"trajectory of the {name}: expected shape (n, 3) or (n, 4, 4), got {shape}"
        )
    return check_finite(poses, f"trajectory of the {name}", shape)


def _onto_first(positions: FloatArray, wanted: FloatArray, first: Pose, true: Pose) -> FloatArray:
    """Positions moved so that the first poses agree."""
    turn = rotation_matrix(true) @ rotation_matrix(first).T
    moved: FloatArray = (positions - positions[0]) @ turn.T + wanted[0]
    return moved


def _onto_all(positions: FloatArray, wanted: FloatArray) -> FloatArray:
    """Positions moved so that the error is least."""
    centre, aim = positions.mean(axis=0), wanted.mean(axis=0)
    left, _, right = np.linalg.svd((wanted - aim).T @ (positions - centre))
    signs = np.ones(positions.shape[1])
    signs[-1] = 1.0 if np.linalg.det(left @ right) > 0.0 else -1.0
    turn = left @ np.diag(signs) @ right
    moved: FloatArray = (positions - centre) @ turn.T + aim
    return moved
