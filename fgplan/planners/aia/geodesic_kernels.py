"""Compiled: motions between the cells of a grid, and geodesic distances along them.

The motions are those of ``roadmaps.build_geodesic_grid`` (a test compares them): between the free
centres of cells that touch by a side or a corner, where the straight way is free. Distances are
the least fixed point of d(v) = min over motions (u, v) of d(u) + length: a cell whose distance has
fallen waits in a queue, first in first out, to tell its neighbours. On a grid of eight neighbours
nearly every cell waits once, for a shortest way round few obstacles has the fewest motions too.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.obstacle_kernels import Obstacles, motion_free
from fgplan.typing import BoolArray, FloatArray, IntArray

_DOWN = (0, 1, 1, 1)
_RIGHT = (1, 0, 1, -1)


@njit(**UNCOUNTED)
def lay_motions(
    obstacles: Obstacles, centers: FloatArray, columns: int, free: BoolArray, ways: IntArray
) -> None:
    """Which cells are free, and where the motions of each lead.

    Where:
        centers: Shape (cells, 2), metres, row by row.
        free: Written, shape (cells,).
        ways: Written, shape (cells, 8), -1 for no motion; the diagonal ones are the last four.
    """
    cells = centers.shape[0]
    rows = cells // columns
    for c in range(cells):
        x, y = centers[c, 0], centers[c, 1]
        free[c] = motion_free(obstacles, x, y, x, y)
        for s in range(8):
            ways[c, s] = -1
    for c in range(cells):
        if not free[c]:
            continue
        row, column = c // columns, c % columns
        for s in range(4):
            down, right = row + _DOWN[s], column + _RIGHT[s]
            if down >= rows or right < 0 or right >= columns:
                continue
            other = down * columns + right
            if free[other] and motion_free(
                obstacles, centers[c, 0], centers[c, 1], centers[other, 0], centers[other, 1]
            ):
                place = s if s < 2 else s + 2
                ways[c, place] = other
                ways[other, place + 2] = c


@njit(**UNCOUNTED)
def spread_distances(
    ways: IntArray,
    straight_m: float,
    diagonal_m: float,
    source: int,
    distance_m: FloatArray,
    queue: IntArray,
    waits: BoolArray,
) -> None:
    """Distance of every cell to a source, infinite where it cannot be reached.

    Where:
        distance_m: Written, shape (cells,).
        queue: Scratch, shape (cells,), as is ``waits``.
    """
    cells = distance_m.shape[0]
    for c in range(cells):
        distance_m[c] = np.inf
        waits[c] = False
    distance_m[source] = 0.0
    queue[0] = source
    head, count = 0, 1
    while count > 0:
        c = queue[head]
        head = head + 1 if head + 1 < cells else 0
        count -= 1
        waits[c] = False
        for s in range(8):
            other = ways[c, s]
            if other < 0:
                continue
            through = distance_m[c] + (straight_m if s < 4 else diagonal_m)
            if through < distance_m[other]:
                distance_m[other] = through
                if not waits[other]:
                    waits[other] = True
                    place = head + count
                    queue[place if place < cells else place - cells] = other
                    count += 1
