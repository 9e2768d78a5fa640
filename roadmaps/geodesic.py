"""Shortest obstacle-free distances on a grid of cells.

The centres of free cells are joined to those of their eight neighbours, at distances s and
s sqrt(2), where the motion is valid; on an occupancy grid alone that means both cells are free
and a diagonal does not cut the corner of a blocked one. Dijkstra from the cell of the source
gives the field. Paths of eight directions are at most 8.3 % longer than straight ones
(1 / cos(pi / 8) = 1.082), and ends are rounded to cell centres.

Tiers: `build_geodesic_grid` once a workspace, `distances_from` once a source, `at` as often as
wished.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from roadmaps.checks import check_positive
from roadmaps.collision import check_position_valid
from roadmaps.errors import InvalidPositionError, ParameterError
from roadmaps.occupancy_grid import FREE, OccupancyGrid
from roadmaps.typing import BoolArray, FloatArray, IntArray
from roadmaps.workspace import Workspace

_NEIGHBORS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows, columns; the other four are their reverse


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """Distance from one source to every cell.

    Attributes:
        frame: The cells: a grid whose occupancy is not read.
        distances_m: Metres, infinite where it cannot be reached, shape (rows, columns),
            read-only.
        source: Shape (2,), metres, world frame.
    """

    frame: OccupancyGrid = field(repr=False)
    distances_m: FloatArray = field(repr=False)
    source: FloatArray

    def at(self, positions: ArrayLike) -> FloatArray:
        """Look up distances.

        Args:
            positions: Shape (n, 2) or (2,), metres, world frame.

        Returns:
            Distance from the source to the centre of each position's cell, metres, shape (n,);
            infinite where it cannot be reached or outside the cells.
        """
        row, column, inside = _cells(self.frame, positions)
        found = np.full(len(row), np.inf)
        found[inside] = self.distances_m[row[inside], column[inside]]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class GeodesicGrid:
    """The cells of a workspace and the motions between them.

    Attributes:
        workspace: The workspace.
        frame: The cells: a grid whose occupancy is not read.
        free: Cells at whose centre the robot may be, shape (rows, columns).
        motions: Lengths between cells (row * columns + column), metres, each motion once, shape
            (cells, cells).
    """

    workspace: Workspace = field(repr=False)
    frame: OccupancyGrid = field(repr=False)
    free: BoolArray = field(repr=False)
    motions: sparse.csr_array = field(repr=False)

    def distances_from(self, source: ArrayLike) -> DistanceField:
        """Compute the distances from a source.

        Args:
            source: Shape (2,), metres, world frame.

        Returns:
            The field.

        Raises:
            InvalidPositionError: If the source is not free, or the centre of its cell is not.
        """
        point = check_position_valid(self.workspace, source, "source")
        row, column, inside = _cells(self.frame, point)
        if not (inside[0] and self.free[row[0], column[0]]):
            raise InvalidPositionError(
                f"source: expected the centre of its cell to be free, but {point.tolist()} lies "
                f"in a cell of {self.frame.resolution_m} m whose centre is not; use a smaller "
                "resolution_m or move the source"
            )
        rows, columns = self.free.shape
        distances = dijkstra(self.motions, directed=False, indices=row[0] * columns + column[0])
        distances = np.asarray(distances, dtype=np.float64).reshape(rows, columns)
        distances.flags.writeable = False
        return DistanceField(self.frame, distances, point)


def build_geodesic_grid(workspace: Workspace, *, resolution_m: float | None = None) -> GeodesicGrid:
    """Lay cells over a workspace and find the motions between them.

    Args:
        workspace: The workspace.
        resolution_m: Side of a cell, metres. None takes the cells of the workspace's occupancy
            grid.

    Returns:
        The cells and motions.

    Raises:
        ParameterError: If `resolution_m` is None and the workspace has no occupancy grid, or if
            it is not positive, or gives more than 25 million cells.

    Example:
        >>> hall = Workspace(lower=[0, 0], upper=[4, 4])
        >>> build_geodesic_grid(hall, resolution_m=1.0).distances_from([0.5, 0.5]).at([3.5, 0.5])
        array([3.])
    """
    own_cells = resolution_m is None and workspace.grid is not None
    frame = workspace.grid if own_cells else _lay_cells(workspace, resolution_m)
    assert frame is not None
    rows, columns = frame.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    centers = frame.centers(np.stack([column.ravel(), row.ravel()], axis=1))
    free = workspace.are_positions_valid(centers).reshape(rows, columns)
    starts, ends, lengths = [], [], []
    for down, right in _NEIGHBORS:
        here = _shifted(free, 0, 0, down, right) & _shifted(free, down, right, down, right)
        if down and right and own_cells:
            here &= _shifted(free, down, 0, down, right) & _shifted(free, 0, right, down, right)
        starts.append(_shifted(index, 0, 0, down, right)[here])
        ends.append(_shifted(index, down, right, down, right)[here])
        lengths.append(np.full(len(starts[-1]), frame.resolution_m * math.hypot(down, right)))
    start, end, length = np.concatenate(starts), np.concatenate(ends), np.concatenate(lengths)
    if workspace.obstacles or not own_cells:
        valid = workspace.are_motions_valid(centers[start], centers[end])
        start, end, length = start[valid], end[valid], length[valid]
    size = rows * columns
    motions = sparse.csr_array((length, (start, end)), shape=(size, size))
    return GeodesicGrid(workspace, frame, free, motions)


def _lay_cells(workspace: Workspace, resolution_m: float | None) -> OccupancyGrid:
    """Cells that cover the bounds."""
    if resolution_m is None:
        raise ParameterError(
            "resolution_m: expected metres, for the workspace has no occupancy grid whose cells "
            "could be used; got None"
        )
    check_positive(resolution_m, "resolution_m")
    counts = np.ceil((workspace.upper - workspace.lower) / resolution_m - 1e-9)
    counts = np.maximum(counts, 1.0)
    if counts.prod() > 25e6:
        raise ParameterError(
            f"resolution_m: expected at most 25 million cells, got {counts.prod():.3g} of "
            f"{resolution_m} m; use greater cells"
        )
    columns, rows = counts.astype(int).tolist()
    return OccupancyGrid(
        occupancy=np.full((rows, columns), FREE, dtype=np.int8),
        resolution_m=resolution_m,
        origin=workspace.lower,
    )


def _shifted(cells: np.ndarray, down: int, right: int, rows: int, columns: int) -> np.ndarray:
    """The part of an array from which a step (rows, columns) stays inside, moved (down, right)."""
    height, width = cells.shape
    left = max(0, -columns)
    return cells[down : height - rows + down, left + right : width - abs(columns) + left + right]


def _cells(frame: OccupancyGrid, positions: ArrayLike) -> tuple[IntArray, IntArray, BoolArray]:
    """Row and column of each position, clipped, and whether it is inside."""
    rows, columns = frame.shape
    cells = frame.to_cells(positions)
    inside = ((cells >= 0) & (cells <= (columns, rows))).all(axis=1)
    clipped = np.clip(np.floor(cells), 0, (columns - 1, rows - 1)).astype(np.int64)
    return clipped[:, 1], clipped[:, 0], np.asarray(inside)
