"""Covariance ellipses: where a position is, to so many sigmas.

The ellipse {p : (p - m)' P^-1 (p - m) = k^2} is m + k L u with L L' = P and u on the unit circle;
it holds 1 - exp(-k^2 / 2) of a planar Gaussian. Beliefs hold positions in the robot's own frame:
P in the world is R S R'.
"""

import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.models.pose import position_slice
from fgplan.typing import ArrayLike, FloatArray

_CORNERS = 48
_MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_VISIBLE = 0.02
"""Half axis of the largest ellipse as a share of the map's longer side, if it is to be seen."""


def world_position_covariances(poses: ArrayLike, covariances: ArrayLike) -> FloatArray:
    """Turn the position blocks of pose covariances into the world frame: R S R'.

    Args:
        poses: Shape (n, 3) or (n, 4, 4), world frame.
        covariances: Shape (n, 3, 3), (n, 6, 6) (GTSAM's tangents), or the position block alone,
            (n, 2, 2) or (n, 3, 3) for poses in space; square metres, body frame.

    Returns:
        Shape (n, 2, 2), square metres, world frame: the plane seen from above.

    Raises:
        InvalidInputError: If the shapes do not fit, or a number is not finite.
    """
    try:
        where = np.asarray(poses, dtype=np.float64)
        blocks = np.asarray(covariances, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"ellipses: expected numbers: {error}") from error
    planar = where.ndim == 2
    if where.shape[1:] not in ((3,), (4, 4)):
        raise InvalidInputError(
            f"ellipses: expected poses of shape (n, 3) or (n, 4, 4), got {where.shape}"
        )
    where = check_finite(where, "poses of ellipses", where.shape)
    tangent, size = (3, 2) if planar else (6, 3)
    if blocks.shape == (len(where), tangent, tangent):
        span = position_slice(tangent)
        blocks = blocks[:, span, span]
    blocks = check_finite(blocks, "covariances of positions", (len(where), size, size))
    if planar:
        cos, sin = np.cos(where[:, 2]), np.sin(where[:, 2])
        rotations = np.stack([cos, -sin, sin, cos], axis=1).reshape(-1, 2, 2)
    else:
        rotations = where[:, :3, :3]
    return (rotations @ blocks @ rotations.swapaxes(1, 2))[:, :2, :2]


def ellipse_outlines(centers: ArrayLike, covariances: ArrayLike, sigmas: float) -> FloatArray:
    """Outlines of covariance ellipses.

    Args:
        centers: Shape (n, 2), metres.
        covariances: Shape (n, 2, 2), square metres, the frame of the centres; zero gives a point.
        sigmas: Size k.

    Returns:
        Shape (n, 48, 2), metres.

    Raises:
        InvalidInputError: If a covariance has a negative eigenvalue or shapes do not fit.
    """
    middle = check_finite(centers, "centres of ellipses", (None, 2))
    blocks = check_finite(covariances, "covariances of positions", (len(middle), 2, 2))
    values, vectors = np.linalg.eigh(0.5 * (blocks + blocks.swapaxes(1, 2)))
    if (values < -1e-9 * np.abs(blocks).max(initial=1e-300)).any():
        row = int(np.argmin(values.min(axis=1)))
        raise InvalidInputError(
            f"covariances of positions: expected no negative eigenvalue, got {values[row].min():g} "
            f"at {row}"
        )
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    roots = vectors * np.sqrt(np.clip(values, 0.0, None))[:, None, :]
    return middle[:, None, :] + sigmas * (roots @ circle).swapaxes(1, 2)


def coverage(sigmas: float) -> float:
    """Share of a planar Gaussian inside its k-sigma ellipse: 1 - exp(-k^2 / 2)."""
    return float(1.0 - np.exp(-0.5 * sigmas**2))


def magnification_to_see(
    covariances: FloatArray, sigmas: float, span_m: float, share: float = _VISIBLE
) -> int:
    """Smallest round factor at which the largest ellipse shows on a map.

    Args:
        covariances: Shape (n, 2, 2), square metres.
        sigmas: Size k of the ellipses.
        span_m: Longer side of the map, metres.
        share: Half axis of the largest ellipse as a share of the map's side, at least.

    Returns:
        1, 2, 5, 10, ... 1000.
    """
    largest = np.linalg.eigvalsh(covariances).max(initial=0.0)
    axis = sigmas * np.sqrt(max(float(largest), 0.0))
    fitting = [factor for factor in _MAGNIFICATIONS if factor * axis >= share * span_m]
    return fitting[0] if fitting else _MAGNIFICATIONS[-1]
