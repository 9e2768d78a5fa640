"""A short free way between two places.

Down a field of geodesic distances, from cell to cell with a free straight way and the least
distance left, until the end is in sight; then corners are left out wherever the straight way past
them is free.
"""

from itertools import pairwise

import numpy as np

from fgplan.errors import NoCandidatePathError
from fgplan.typing import FloatArray
from roadmaps import GeodesicGrid, Workspace, build_geodesic_grid
from roadmaps.errors import InvalidPositionError


def geodesic_way(grid: GeodesicGrid, start: FloatArray, end: FloatArray) -> FloatArray:
    """Corners of a short way.

    Args:
        grid: Cells of the workspace.
        start: Shape (2,), metres, free.
        end: Shape (2,), metres, free.

    Returns:
        Shape (C, 2), from start to end, two or more; straight between corners, and free.

    Raises:
        NoCandidatePathError: If there is no way on these cells.
    """
    world = grid.workspace
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    if world.are_motions_valid(start, end)[0]:
        return np.stack([start, end])
    corners = [start]
    centers, values = _field(grid, end)
    reached = np.inf
    while not world.are_motions_valid(corners[-1], end)[0]:
        gap = np.hypot(*(centers - corners[-1]).T)
        near = np.flatnonzero((gap <= 2.0 * grid.frame.resolution_m) & np.isfinite(values))
        here = values[near] + gap[near]
        order = near[np.argsort(here, kind="stable")]
        starts = np.repeat(corners[-1][None], len(order), axis=0)
        free = world.are_motions_valid(starts, centers[order])
        lower = [
            int(cell)
            for cell, is_free in zip(order, free, strict=True)
            if is_free and values[cell] < reached
        ]
        if not lower:
            raise NoCandidatePathError(
                f"no free way from {start.tolist()} to {end.tolist()} on cells of "
                f"{grid.frame.resolution_m} m; check the workspace, or take smaller cells"
            )
        reached = values[lower[0]]
        corners.append(centers[lower[0]])
    return _straightened(world, np.array([*corners, end]))


def walk(corners: FloatArray, step_m: float) -> FloatArray:
    """Places along a way, one a step, each straight stretch in whole steps of equal length.

    Args:
        corners: Shape (C, 2), metres.
        step_m: Longest step.

    Returns:
        Shape (steps + 1, 2); the first is the first corner.
    """
    places = [corners[:1]]
    for a, b in pairwise(corners):
        count = int(np.ceil(np.hypot(*(b - a)) / step_m - 1e-9))
        shares = np.arange(1, count + 1)[:, None] / max(count, 1)
        places.append(a + shares * (b - a))
    return np.concatenate(places)


def geodesic_cells(workspace: Workspace, cell_m: float = 0.25) -> GeodesicGrid:
    """Cells for ways in a workspace.

    Args:
        workspace: The workspace.
        cell_m: Side of a cell, metres.

    Returns:
        The cells.
    """
    return build_geodesic_grid(workspace, resolution_m=cell_m)


def _field(grid: GeodesicGrid, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres of all cells, and their distance from a free cell next to the end, plus the rest."""
    rows, columns = grid.frame.shape
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    centers = grid.frame.centers(np.stack([column.ravel(), row.ravel()], axis=1))
    gap = np.hypot(*(centers - end).T)
    for cell in np.argsort(gap, kind="stable")[:16].tolist():
        if grid.free.ravel()[cell] and grid.workspace.are_motions_valid(centers[cell], end)[0]:
            try:
                return centers, grid.distances_from(centers[cell]).distances_m.ravel() + gap[cell]
            except InvalidPositionError:
                continue
    return centers, np.full(len(centers), np.inf)


def _straightened(world: Workspace, corners: FloatArray) -> FloatArray:
    """Leave out corners that the straight way past them makes needless."""
    kept = [0]
    while kept[-1] < len(corners) - 1:
        here = kept[-1]
        later = np.arange(here + 1, len(corners))
        free = world.are_motions_valid(corners[here], corners[later])
        free[0] = True
        kept.append(int(later[np.flatnonzero(free)[-1]]))
    return corners[kept]
