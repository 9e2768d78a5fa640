"""Geodesic distances to targets, one field a cell, kept.

Cells and motions are those of ``roadmaps.build_geodesic_grid``, laid so that the first robot's
start is at a centre: poses on a lattice of that spacing then have no rounding. A source whose
cell's centre is not free takes the nearest centre that is. Fields are float32: sums that differ in
their last bits alone then tie, and ties go to the lowest index.
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from fgplan.errors import InvalidInputError
from fgplan.planners.aia.geodesic_kernels import lay_motions, spread_distances
from fgplan.planners.aia.obstacle_arrays import obstacle_arrays
from fgplan.typing import ArrayLike, FloatArray, IntArray
from roadmaps import Workspace

_MOST_CELLS = 25e6
_COMPILED = not numba.config.DISABLE_JIT


class GeodesicFields:
    """Fields by cell of their source; the one thing here that grows.

    Attributes:
        frame: (x0, y0, side, columns, rows), metres.
        cell_centers: Shape (cells, 2), metres.
        free: Whether a robot may be at the centre of each cell, shape (cells,).
        distance_m: Shape (F, cells), float32, metres; infinite where it cannot be reached.
    """

    def __init__(self, workspace: Workspace, start: ArrayLike, cell_m: float) -> None:
        """Lay cells over a workspace.

        Args:
            workspace: Bounds and obstacles.
            start: A position that is to be a centre, shape (2,), metres.
            cell_m: Side of a cell, metres.

        Raises:
            InvalidInputError: If no centre is free, or there are more than 25 million cells.
        """
        anchor = np.asarray(start, dtype=np.float64)
        before = np.floor((anchor - workspace.lower) / cell_m + 1e-9)
        after = np.floor((workspace.upper - anchor) / cell_m + 1e-9)
        columns, rows = (before + after + 1.0).astype(int).tolist()
        if columns * rows > _MOST_CELLS:
            raise InvalidInputError(
                f"geodesic_cell_m: expected at most 25 million cells, got {columns * rows:.3g} of "
                f"{cell_m} m; use greater cells"
            )
        lower = anchor - (before + 0.5) * cell_m
        self.frame: FloatArray = np.array([*lower, cell_m, columns, rows])
        centers = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
        self.cell_centers = (centers.reshape(-1, 2) + 0.5) * cell_m + lower
        self.free = np.empty(rows * columns, dtype=np.bool_)
        self._ways = np.empty((rows * columns, 8), dtype=np.int32)
        obstacles = obstacle_arrays(workspace)._replace(
            lower=lower, upper=anchor + (after + 0.5) * cell_m
        )
        lay_motions(obstacles, self.cell_centers, columns, self.free, self._ways)
        self._free = np.flatnonzero(self.free)
        if len(self._free) == 0:
            raise InvalidInputError(
                f"geodesic_cell_m: expected cells of which some are free, got none of {cell_m} m; "
                "use smaller cells"
            )
        self._row_of_cell: dict[int, int] = {}
        self.distance_m = np.zeros((0, rows * columns), dtype=np.float32)

    def clearances(self, workspace: Workspace) -> FloatArray:
        """From any position in each cell, at least so far to the next obstacle or bound.

        Args:
            workspace: The workspace; an occupancy grid gives no clearance here.

        Returns:
            Shape (cells,), metres, negative where nothing is known.
        """
        centers = self.cell_centers
        nearest = np.minimum(centers - workspace.lower, workspace.upper - centers).min(axis=1)
        if workspace.grid is not None:
            return np.full(len(centers), -1.0)
        for ring in workspace.obstacles:
            corners = np.asarray(ring)
            for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                along = end - start
                share = np.clip((centers - start) @ along / (along @ along), 0.0, 1.0)
                offset = centers - start - share[:, None] * along
                nearest = np.minimum(nearest, np.sqrt((offset * offset).sum(axis=1)))
        inside = ~self.free
        half_diagonal = self.frame[2] * np.sqrt(0.5)
        clear = nearest - half_diagonal - workspace.robot_radius_m
        return np.where(inside, -1.0, clear)

    def rows_of(self, places: ArrayLike) -> IntArray:
        """Rows of ``distance_m`` for sources, computed where they are new.

        Args:
            places: Shape (n, 2), metres, world frame.

        Returns:
            Shape (n,).
        """
        cells = self._source_cells(np.asarray(places, dtype=np.float64))
        fresh = [cell for cell in dict.fromkeys(cells) if cell not in self._row_of_cell]
        if fresh:
            self.distance_m = np.concatenate([self.distance_m, self._spread(fresh)])
        for cell in fresh:
            self._row_of_cell[cell] = len(self._row_of_cell)
        return np.array([self._row_of_cell[cell] for cell in cells], dtype=np.int64)

    def _spread(self, sources: list[int]) -> NDArray[np.float32]:
        """Fields of sources; without the compiler scipy spreads them, to the same numbers."""
        cells, side = len(self.free), float(self.frame[2])
        if not _COMPILED:
            start, place = np.nonzero(self._ways >= 0)
            length = np.where(place < 4, side, side * math.sqrt(2.0))
            motions = sparse.csr_array(
                (length, (start, self._ways[start, place])), shape=(cells, cells)
            )
            return np.asarray(dijkstra(motions, indices=sources), dtype=np.float32)
        fields = np.empty((len(sources), cells), dtype=np.float32)
        distance, queue = np.empty(cells), np.empty(cells, dtype=np.int32)
        waits = np.empty(cells, dtype=np.bool_)
        for field, source in zip(fields, sources, strict=True):
            spread_distances(
                self._ways, side, side * math.sqrt(2.0), source, distance, queue, waits
            )
            field[:] = distance
        return fields

    def _source_cells(self, places: FloatArray) -> list[int]:
        """Cell of each source: its own, or the nearest whose centre is free."""
        x0, y0, side, columns, rows = self.frame
        corner, most = np.array([x0, y0]), np.array([columns - 1, rows - 1])
        found = np.clip(np.floor((places - corner) / side), 0, most).astype(np.int64)
        cells = found[:, 1] * int(columns) + found[:, 0]
        for index in np.flatnonzero(~self.free[cells]):
            square = ((self.cell_centers[self._free] - places[index]) ** 2).sum(axis=1)
            cells[index] = self._free[int(np.argmin(square))]
        return [int(cell) for cell in cells]
