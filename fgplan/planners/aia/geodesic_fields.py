"""Geodesic distances to targets, one field a cell, kept.

The cells are those of ``roadmaps.build_geodesic_grid``, laid so that the first robot's start is at
a centre: poses on a lattice of that spacing then have no rounding. A source whose cell's centre is
not free takes the nearest centre that is. Fields are float32: sums that differ in their last bits
alone then tie, and ties go to the lowest index.
"""

import dataclasses

import numpy as np
from scipy.sparse.csgraph import dijkstra

from fgplan.errors import InvalidInputError
from fgplan.typing import ArrayLike, FloatArray, IntArray
from roadmaps import Workspace
from roadmaps.geodesic import build_geodesic_grid

_CELLS_A_CALL = 64


class GeodesicFields:
    """Fields by cell of their source; the one thing here that grows.

    Attributes:
        frame: (x0, y0, side, columns, rows), metres.
        cell_centers: Shape (cells, 2), metres.
        distance_m: Shape (F, cells), float32, metres; infinite where it cannot be reached.
    """

    def __init__(self, workspace: Workspace, start: ArrayLike, cell_m: float) -> None:
        """Lay cells over a workspace.

        Args:
            workspace: Bounds and obstacles.
            start: A position that is to be a centre, shape (2,), metres.
            cell_m: Side of a cell, metres.

        Raises:
            InvalidInputError: If no centre is free.
        """
        anchor = np.asarray(start, dtype=np.float64)
        before = np.floor((anchor - workspace.lower) / cell_m + 1e-9)
        after = np.floor((workspace.upper - anchor) / cell_m + 1e-9)
        lower = anchor - (before + 0.5) * cell_m
        covered = dataclasses.replace(
            workspace, lower=lower, upper=anchor + (after + 0.5) * cell_m, polygon_engine="numpy"
        )
        self._grid = build_geodesic_grid(covered, resolution_m=cell_m)
        rows, columns = self._grid.frame.shape
        self.frame: FloatArray = np.array([*lower, cell_m, columns, rows])
        centers = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
        self.cell_centers = (centers.reshape(-1, 2) + 0.5) * cell_m + lower
        self._free = np.flatnonzero(self._grid.free.ravel())
        if len(self._free) == 0:
            raise InvalidInputError(
                f"geodesic_cell_m: expected cells of which some are free, got none of {cell_m} m; "
                "use smaller cells"
            )
        self._row_of_cell: dict[int, int] = {}
        self.distance_m = np.zeros((0, rows * columns), dtype=np.float32)

    @property
    def graph(self) -> object:
        """Lengths of the motions between cells, for whoever computes distances otherwise."""
        return self._grid.motions

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
        inside = ~self._grid.free.ravel()
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
        parts = [self.distance_m]
        for begin in range(0, len(fresh), _CELLS_A_CALL):
            some = fresh[begin : begin + _CELLS_A_CALL]
            found = dijkstra(self._grid.motions, directed=False, indices=some)
            parts.append(np.atleast_2d(found).astype(np.float32))
        for cell in fresh:
            self._row_of_cell[cell] = len(self._row_of_cell)
        if fresh:
            self.distance_m = np.concatenate(parts)
        return np.array([self._row_of_cell[cell] for cell in cells], dtype=np.int64)

    def _source_cells(self, places: FloatArray) -> list[int]:
        """Cell of each source: its own, or the nearest whose centre is free."""
        x0, y0, side, columns, rows = self.frame
        corner, most = np.array([x0, y0]), np.array([columns - 1, rows - 1])
        found = np.clip(np.floor((places - corner) / side), 0, most).astype(np.int64)
        cells = found[:, 1] * int(columns) + found[:, 0]
        for index in np.flatnonzero(~self._grid.free.ravel()[cells]):
            square = ((self.cell_centers[self._free] - places[index]) ** 2).sum(axis=1)
            cells[index] = self._free[int(np.argmin(square))]
        return [int(cell) for cell in cells]
