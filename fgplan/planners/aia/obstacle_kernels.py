"""Compiled: is a straight way or a line of sight free, one at a time.

The answers are those of ``roadmaps.Workspace`` (a test compares them): closed polygons, and closed
cells of an occupancy grid. A segment touches a polygon iff its start is inside (a ray to the right
crosses an odd number of edges) or it comes within the clearance of an edge.
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.typing import BoolArray, FloatArray, IntArray

_HAIR = 1e-9  # cells


class Obstacles(NamedTuple):
    """A workspace as flat arrays.

    Attributes:
        lower: Least coordinates of a robot's centre, shape (2,), metres.
        upper: Greatest ones, shape (2,).
        radius_m: Radius of the robot's disc.
        starts: First ends of all edges, shape (E, 2), metres.
        ends: Second ends of all edges, shape (E, 2).
        first_edge: Edge at which each polygon starts, shape (P + 1,).
        box_low: Least coordinates of each polygon, shape (P, 2).
        box_high: Greatest coordinates of each polygon, shape (P, 2).
        blocked: Cells where the robot's centre may not be, with a border, shape (R + 2, C + 2);
            shape (0, 0) without a grid.
        opaque: Cells that block a line of sight, with a border, same shape.
        to_cells: Shape (2, 3): cell coordinates (column, row) = to_cells @ (x, y, 1).
    """

    lower: FloatArray
    upper: FloatArray
    radius_m: float
    starts: FloatArray
    ends: FloatArray
    first_edge: IntArray
    box_low: FloatArray
    box_high: FloatArray
    blocked: BoolArray
    opaque: BoolArray
    to_cells: FloatArray


@njit(inner=True, **UNCOUNTED)
def _squared_distance(px: float, py: float, cx: float, cy: float, dx: float, dy: float) -> float:
    """Squared distance of a point to segment cd."""
    ux, uy = dx - cx, dy - cy
    square = ux * ux + uy * uy
    share = ((px - cx) * ux + (py - cy) * uy) / (square if square > 0.0 else 1.0)
    share = min(max(share, 0.0), 1.0)
    ox, oy = px - cx - share * ux, py - cy - share * uy
    return ox * ox + oy * oy


@njit(inner=True, **UNCOUNTED)
def touches_polygon(
    obstacles: Obstacles, ax: float, ay: float, bx: float, by: float, clearance_m: float
) -> bool:
    """Whether segment ab comes within a clearance of a polygon; 0 means the closed polygon."""
    low_x, high_x = min(ax, bx) - clearance_m, max(ax, bx) + clearance_m
    low_y, high_y = min(ay, by) - clearance_m, max(ay, by) + clearance_m
    for p in range(obstacles.box_low.shape[0]):
        if low_x > obstacles.box_high[p, 0] or high_x < obstacles.box_low[p, 0]:
            continue
        if low_y > obstacles.box_high[p, 1] or high_y < obstacles.box_low[p, 1]:
            continue
        inside = False
        for e in range(obstacles.first_edge[p], obstacles.first_edge[p + 1]):
            cx, cy = obstacles.starts[e, 0], obstacles.starts[e, 1]
            dx, dy = obstacles.ends[e, 0], obstacles.ends[e, 1]
            side_a = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
            if (cy > ay) != (dy > ay) and ((side_a > 0.0) if dy > cy else (side_a < 0.0)):
                inside = not inside
            if clearance_m > 0.0:
                square = min(
                    min(
                        _squared_distance(ax, ay, cx, cy, dx, dy),
                        _squared_distance(bx, by, cx, cy, dx, dy),
                    ),
                    min(
                        _squared_distance(cx, cy, ax, ay, bx, by),
                        _squared_distance(dx, dy, ax, ay, bx, by),
                    ),
                )
                if square <= clearance_m * clearance_m:
                    return True
            if min(ax, bx) > max(cx, dx) or min(cx, dx) > max(ax, bx):
                continue
            if min(ay, by) > max(cy, dy) or min(cy, dy) > max(ay, by):
                continue
            side_b = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
            if (side_a > 0.0 and side_b > 0.0) or (side_a < 0.0 and side_b < 0.0):
                continue
            side_c = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            side_d = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
            if (side_c > 0.0 and side_d > 0.0) or (side_c < 0.0 and side_d < 0.0):
                continue
            return True
        if inside:
            return True
    return False


@njit(inner=True, **UNCOUNTED)
def _cell_touched(cells: BoolArray, column: float, row: float) -> bool:
    """Whether a point touches a marked cell of a grid with a border."""
    rows, columns = cells.shape[0] - 2, cells.shape[1] - 2
    c0 = int(min(max(np.floor(column - _HAIR), -1.0), float(columns))) + 1
    c1 = int(min(max(np.floor(column + _HAIR), -1.0), float(columns))) + 1
    r0 = int(min(max(np.floor(row - _HAIR), -1.0), float(rows))) + 1
    r1 = int(min(max(np.floor(row + _HAIR), -1.0), float(rows))) + 1
    return bool(cells[r0, c0] or cells[r1, c1] or cells[r0, c1] or cells[r1, c0])


@njit(inner=True, **UNCOUNTED)
def _next_line(start: float, step: float, line: float) -> float:
    """Parameter at which a coordinate reaches a grid line; 2 where it never does."""
    if step == 0.0:
        return 2.0
    return (line - start) / step


@njit(inner=True, **UNCOUNTED)
def touches_cells(
    cells: BoolArray, to_cells: FloatArray, ax: float, ay: float, bx: float, by: float
) -> bool:
    """Whether segment ab touches a marked cell: the midpoint between crossings names a cell."""
    ac = to_cells[0, 0] * ax + to_cells[0, 1] * ay + to_cells[0, 2]
    ar = to_cells[1, 0] * ax + to_cells[1, 1] * ay + to_cells[1, 2]
    bc = to_cells[0, 0] * bx + to_cells[0, 1] * by + to_cells[0, 2]
    br = to_cells[1, 0] * bx + to_cells[1, 1] * by + to_cells[1, 2]
    if _cell_touched(cells, ac, ar) or _cell_touched(cells, bc, br):
        return True
    sc, sr = bc - ac, br - ar
    line_c = np.floor(ac) + 1.0 if sc > 0.0 else np.ceil(ac) - 1.0
    line_r = np.floor(ar) + 1.0 if sr > 0.0 else np.ceil(ar) - 1.0
    tc, tr = _next_line(ac, sc, line_c), _next_line(ar, sr, line_r)
    before = 0.0
    while True:
        now = min(min(tc, tr), 1.0)
        middle = 0.5 * (before + now)
        if _cell_touched(cells, ac + middle * sc, ar + middle * sr):
            return True
        if now >= 1.0:
            return False
        before = now
        if tc <= tr:
            line_c += 1.0 if sc > 0.0 else -1.0
            tc = _next_line(ac, sc, line_c)
        else:
            line_r += 1.0 if sr > 0.0 else -1.0
            tr = _next_line(ar, sr, line_r)


@njit(**UNCOUNTED)
def motion_free(obstacles: Obstacles, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether a robot's disc stays free along a straight motion, its centre within the bounds."""
    lower, upper = obstacles.lower, obstacles.upper
    if bx < lower[0] or by < lower[1] or bx > upper[0] or by > upper[1]:
        return False
    if ax < lower[0] or ay < lower[1] or ax > upper[0] or ay > upper[1]:
        return False
    if touches_polygon(obstacles, ax, ay, bx, by, obstacles.radius_m):
        return False
    if obstacles.blocked.shape[0] == 0:
        return True
    return not touches_cells(obstacles.blocked, obstacles.to_cells, ax, ay, bx, by)


@njit(**UNCOUNTED)
def in_sight(obstacles: Obstacles, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether a straight line of sight is free."""
    if touches_polygon(obstacles, ax, ay, bx, by, 0.0):
        return False
    if obstacles.opaque.shape[0] == 0:
        return True
    return not touches_cells(obstacles.opaque, obstacles.to_cells, ax, ay, bx, by)
