"""Which cells a segment touches, exactly, for many segments at once.

A segment crosses the grid's lines at known parameters t in [0, 1]. Between two consecutive ones
it stays in one cell, so the midpoint of each interval names a cell. Cells are closed: a segment
along a line touches the cells on both sides, one through a corner touches all four. So each
midpoint is looked up a hair to either side on both axes, and crossings that coincide (a corner)
leave an interval of no length whose midpoint is the corner itself. Hence no path squeezes
between two occupied cells that meet at a corner, as in the MovingAI benchmarks.

Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987, walk
one ray cell by cell; here all crossings of all segments are sorted in one go, for NumPy.
"""

from itertools import pairwise

import numpy as np

from roadmaps.typing import BoolArray, FloatArray, IntArray

_HAIR = 1e-9  # cells
_CROSSINGS_A_CHUNK = 1_000_000


def points_touch(blocked: BoolArray, points: FloatArray, outside_blocks: bool) -> BoolArray:
    """Tell which points touch a blocked cell.

    Args:
        blocked: Shape (rows, columns).
        points: Column and row coordinates, shape (n, 2), cells.
        outside_blocks: Whether everything outside the grid counts as blocked.

    Returns:
        True where it does, shape (n,).
    """
    rows, columns = blocked.shape
    padded = np.full((rows + 2, columns + 2), outside_blocks, dtype=np.bool_)
    padded[1:-1, 1:-1] = blocked
    low = np.clip(np.floor(points - _HAIR), -1, (columns, rows)).astype(np.int64) + 1
    high = np.clip(np.floor(points + _HAIR), -1, (columns, rows)).astype(np.int64) + 1
    touched = padded[low[:, 1], low[:, 0]] | padded[high[:, 1], high[:, 0]]
    touched |= padded[low[:, 1], high[:, 0]] | padded[high[:, 1], low[:, 0]]
    return np.asarray(touched)


def segments_touch(
    blocked: BoolArray, starts: FloatArray, ends: FloatArray, outside_blocks: bool
) -> BoolArray:
    """Tell which segments touch a blocked cell.

    Args:
        blocked: Shape (rows, columns).
        starts: Column and row coordinates, shape (n, 2), cells.
        ends: Column and row coordinates, shape (n, 2), cells.
        outside_blocks: Whether everything outside the grid counts as blocked.

    Returns:
        True where it does, shape (n,).
    """
    touched = np.zeros(len(starts), dtype=np.bool_)
    rows, columns = blocked.shape
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    first = np.maximum(np.floor(low) + 1, 0.0)
    last = np.minimum(np.ceil(high) - 1, (columns, rows))
    counts = np.maximum(last - first + 1, 0.0).astype(np.int64)
    chunk = (np.cumsum(counts.sum(axis=1) + 4)) // _CROSSINGS_A_CHUNK
    borders = [0, *(np.flatnonzero(np.diff(chunk)) + 1).tolist(), len(starts)]
    for begin, stop in pairwise(borders):
        part = slice(begin, stop)
        owner, share = _crossings(starts[part], ends[part], first[part], counts[part])
        middle = 0.5 * (share[1:] + share[:-1])[owner[1:] == owner[:-1]]
        owner = owner[1:][owner[1:] == owner[:-1]]
        origin = starts[part][owner]
        points = origin + middle[:, None] * (ends[part][owner] - origin)
        hit = points_touch(blocked, points, outside_blocks)
        touched[begin + owner[hit]] = True
    return touched


def _crossings(
    starts: FloatArray, ends: FloatArray, first: FloatArray, counts: IntArray
) -> tuple[IntArray, FloatArray]:
    """Sorted (segment, parameter) of all line crossings, with both ends twice."""
    indices = np.arange(len(starts))
    owners, shares = [np.tile(indices, 4)], [np.repeat([0.0, 0.0, 1.0, 1.0], len(starts))]
    for axis in (0, 1):
        owner = np.repeat(indices, counts[:, axis])
        rank = np.arange(len(owner)) - np.repeat(
            np.cumsum(counts[:, axis]) - counts[:, axis], counts[:, axis]
        )
        line = first[owner, axis] + rank
        origin = starts[owner, axis]
        owners.append(owner)
        shares.append((line - origin) / (ends[owner, axis] - origin))
    owner, share = np.concatenate(owners), np.concatenate(shares)
    order = np.lexsort((share, owner))
    return owner[order], share[order]
