"""From the vertices of a path to the poses along it.

Spacing cuts each edge into the fewest equal parts that are no longer than wished; vertices stay.
The heading of pose i >= 1 is the direction of the edge by which it was reached,

    heading_i = atan2(y_i - y_(i-1), x_i - x_(i-1)),

so it belongs to the path and not to the vertex. A robot that waits keeps its heading.
"""

import numpy as np
from numpy.typing import ArrayLike

from roadmaps.checks import as_positions, check_positive
from roadmaps.errors import ParameterError
from roadmaps.typing import FloatArray
from roadmaps.vertex_path import VertexPath


def space_positions(path: VertexPath | ArrayLike, spacing_m: float | None = None) -> FloatArray:
    """Give the positions along a path, at most `spacing_m` apart.

    Args:
        path: A path, or its positions of shape (L + 1, d), metres.
        spacing_m: Greatest distance between consecutive positions, metres; None adds none.

    Returns:
        Positions from start to goal, vertices included, shape (m, d), metres, world frame.

    Raises:
        ParameterError: If `spacing_m` is not positive.

    Example:
        >>> space_positions([[0.0, 0.0], [3.0, 0.0]], spacing_m=2.0)
        array([[0. , 0. ],
               [1.5, 0. ],
               [3. , 0. ]])
    """
    points = _positions(path)
    if spacing_m is None or len(points) < 2:
        if spacing_m is not None:
            check_positive(spacing_m, "spacing_m")
        return points.copy()
    check_positive(spacing_m, "spacing_m")
    steps = np.diff(points, axis=0)
    # A hair less, so that an edge of exactly k spacings is not cut into k + 1 by rounding.
    parts = np.ceil(np.linalg.norm(steps, axis=1) / spacing_m - 1e-9).astype(np.int64)
    parts = np.maximum(parts, 1)
    edge = np.repeat(np.arange(len(steps)), parts)
    rank = np.arange(len(edge)) - np.repeat(np.cumsum(parts) - parts, parts)
    inner = points[edge] + (rank / parts[edge])[:, None] * steps[edge]
    return np.concatenate([inner, points[-1:]])


def headings(path: VertexPath | ArrayLike, *, first_heading_rad: float | None = None) -> FloatArray:
    """Give the heading at each position of a path in the plane.

    Args:
        path: A path, or positions of shape (m, 2), metres, world frame.
        first_heading_rad: Heading of the first pose, radians; None means that of the first edge
            (0 if there is none).

    Returns:
        Headings in [-pi, pi] (the first as given), radians, world frame, shape (m,).

    Raises:
        ParameterError: If the path is not in the plane.

    Example:
        >>> headings([[0, 0], [1, 0], [1, 2]], first_heading_rad=0.5)
        array([0.5       , 0.        , 1.57079633])
    """
    points = _positions(path)
    if points.shape[1] != 2:
        raise ParameterError(f"path: expected positions in the plane, got shape {points.shape}")
    steps = np.diff(points, axis=0)
    moves = (steps != 0.0).any(axis=1)
    directions = np.arctan2(steps[:, 1], steps[:, 0])
    if first_heading_rad is None:
        first_heading_rad = float(directions[moves][0]) if moves.any() else 0.0
    arriving = np.concatenate([[first_heading_rad], directions])
    last_move = np.where(np.concatenate([[True], moves]), np.arange(len(points)), 0)
    return np.asarray(arriving[np.maximum.accumulate(last_move)])


def _positions(path: VertexPath | ArrayLike) -> FloatArray:
    """Positions of a path or array, at least one."""
    points = path.positions if isinstance(path, VertexPath) else as_positions(path, None, "path")
    if not len(points):
        raise ParameterError("path: expected at least one position, got none")
    return points
