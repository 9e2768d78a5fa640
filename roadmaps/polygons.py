"""Polygon obstacles: closed sets, kept apart by distance.

A robot of radius r at p is free of a polygon Q iff dist(p, Q) > r; with r = 0, iff p is not in
Q or on its boundary. A motion is free iff every point of the segment is. So a motion touches Q
iff its start is in Q, or it comes within r of an edge of Q: two tests on pairs

    point in ring          even-odd rule (a ray to the right crosses an odd number of edges)
    segment near edge      they cross, or one of the four end-to-segment distances is <= r

Both are run only on pairs whose bounding boxes, grown by r, overlap. This module is the NumPy
form; `polygon_tree` asks shapely the same question faster. Both give the same answers, but for
positions whose distance to an obstacle equals r to the last bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from roadmaps.checks import as_positions, read_only
from roadmaps.errors import ParameterError, WorkspaceError
from roadmaps.typing import BoolArray, FloatArray, IntArray

_PAIRS_A_CHUNK = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class PolygonSet:
    """Simple polygons as flat arrays of edges.

    Attributes:
        rings: Corners of each polygon, shape (corners, 2), metres, world frame, not repeated.
        starts: First ends of all edges, ring by ring, shape (edges, 2), metres.
        ends: Second ends of all edges, shape (edges, 2), metres.
        first_edge: Edge at which each ring starts, shape (polygons + 1,).
        lower: Least coordinates of each ring, shape (polygons, 2), metres.
        upper: Greatest coordinates of each ring, shape (polygons, 2), metres.
    """

    rings: tuple[FloatArray, ...]
    starts: FloatArray
    ends: FloatArray
    first_edge: IntArray
    lower: FloatArray
    upper: FloatArray

    def touch_points(self, points: FloatArray, clearance_m: float) -> BoolArray:
        """Tell which points are within `clearance_m` of a polygon.

        Args:
            points: Shape (n, 2), metres, world frame.
            clearance_m: Distance that counts as touching, metres; 0 means the closed polygon.

        Returns:
            True where a polygon is touched, shape (n,).
        """
        return self.touch_segments(points, points, clearance_m)

    def touch_segments(self, starts: FloatArray, ends: FloatArray, clearance_m: float) -> BoolArray:
        """Tell which segments come within `clearance_m` of a polygon.

        Args:
            starts: Shape (n, 2), metres, world frame.
            ends: Shape (n, 2), metres, world frame.
            clearance_m: Distance that counts as touching, metres; 0 means the closed polygon.

        Returns:
            True where a polygon is touched, shape (n,).
        """
        touched = np.zeros(len(starts), dtype=np.bool_)
        if not self.rings:
            return touched
        size = max(1, _PAIRS_A_CHUNK // len(self.rings))
        for begin in range(0, len(starts), size):
            part = slice(begin, begin + size)
            touched[part] = self._touch_chunk(starts[part], ends[part], clearance_m)
        return touched

    def _touch_chunk(self, starts: FloatArray, ends: FloatArray, clearance_m: float) -> BoolArray:
        """Broad phase by boxes, then narrow phase on (segment, edge) pairs."""
        low = np.minimum(starts, ends) - clearance_m
        high = np.maximum(starts, ends) + clearance_m
        overlap = low[:, 0, None] <= self.upper[:, 0]
        overlap &= high[:, 0, None] >= self.lower[:, 0]
        overlap &= low[:, 1, None] <= self.upper[:, 1]
        overlap &= high[:, 1, None] >= self.lower[:, 1]
        segment, polygon = np.nonzero(overlap)
        touched = np.zeros(len(starts), dtype=np.bool_)
        if not len(segment):
            return touched
        counts = np.diff(self.first_edge)[polygon]
        pair_begin = np.cumsum(counts) - counts
        edge = np.arange(counts.sum()) + np.repeat(self.first_edge[polygon] - pair_begin, counts)
        of_segment = np.repeat(segment, counts)
        a, b = starts[of_segment], ends[of_segment]
        c, d = self.starts[edge], self.ends[edge]
        near = _segments_cross(a, b, c, d)
        if clearance_m > 0.0:
            squared = np.minimum(
                np.minimum(_squared_distance(a, c, d), _squared_distance(b, c, d)),
                np.minimum(_squared_distance(c, a, b), _squared_distance(d, a, b)),
            )
            near |= squared <= clearance_m * clearance_m
        touched[of_segment[near]] = True
        odd = np.add.reduceat(_ray_crosses(a, c, d).astype(np.int64), pair_begin) % 2 == 1
        touched[segment[odd]] = True
        return touched


def build_polygon_set(obstacles: Sequence[ArrayLike]) -> PolygonSet:
    """Check polygons and lay out their edges.

    Args:
        obstacles: Polygons, each of shape (corners, 2), metres, world frame, in either
            orientation; a repeated last corner is dropped. No holes.

    Returns:
        The set.

    Raises:
        WorkspaceError: If a polygon has fewer than three corners, a repeated corner, or edges
            that meet anywhere but at their common corner (so: no area, or self-crossing).
    """
    rings = tuple(_check_ring(obstacle, index) for index, obstacle in enumerate(obstacles))
    first_edge = np.cumsum([0, *(len(ring) for ring in rings)]).astype(np.int64)
    empty = np.zeros((0, 2))
    return PolygonSet(
        rings=rings,
        starts=np.concatenate([empty, *rings]),
        ends=np.concatenate([empty, *(np.roll(ring, -1, axis=0) for ring in rings)]),
        first_edge=first_edge,
        lower=np.array([ring.min(axis=0) for ring in rings]).reshape(-1, 2),
        upper=np.array([ring.max(axis=0) for ring in rings]).reshape(-1, 2),
    )


def _check_ring(corners: ArrayLike, index: int) -> FloatArray:
    """Return one polygon's corners, not repeated and read-only, or raise."""
    try:
        ring = as_positions(corners, 2, f"obstacles[{index}]")
    except ParameterError as error:
        raise WorkspaceError(str(error)) from error
    if len(ring) > 1 and np.array_equal(ring[0], ring[-1]):
        ring = ring[:-1]
    if len(ring) < 3:
        raise WorkspaceError(
            f"obstacles[{index}]: expected at least 3 different corners, got {len(ring)}; "
            "model a thin wall as a narrow rectangle"
        )
    start, end = ring, np.roll(ring, -1, axis=0)
    repeated = np.flatnonzero((start == end).all(axis=1))
    if len(repeated):
        raise WorkspaceError(
            f"obstacles[{index}]: expected consecutive corners to differ, but corner "
            f"{int(repeated[0])} at {ring[repeated[0]].tolist()} is repeated; drop one of them"
        )
    first, second = np.triu_indices(len(ring), k=1)
    adjacent = (second - first == 1) | (second - first == len(ring) - 1)
    crossing = _segments_cross(start[first], end[first], start[second], end[second]) & ~adjacent
    # Neighbours share one corner; they overlap in more only if they fold back on one line.
    before = np.roll(ring, 1, axis=0) - ring
    after = end - ring
    folded = (_cross(before, after) == 0.0) & ((before * after).sum(axis=1) > 0.0)
    if crossing.any() or folded.any():
        where = int(first[crossing][0]) if crossing.any() else int(np.flatnonzero(folded)[0])
        raise WorkspaceError(
            f"obstacles[{index}]: expected a simple polygon, but edge {where} starting at "
            f"{ring[where].tolist()} meets another edge; order the corners along the boundary, "
            "or split the obstacle"
        )
    return read_only(ring)


def _cross(u: FloatArray, v: FloatArray) -> FloatArray:
    """Signed area spanned by rows of two (n, 2) arrays."""
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _segments_cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> BoolArray:
    """Tell, row by row, whether closed segments ab and cd meet (boxes, then straddling)."""
    boxes = (np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b))
    side_c, side_d = _cross(b - a, c - a), _cross(b - a, d - a)
    side_a, side_b = _cross(d - c, a - c), _cross(d - c, b - c)
    apart = ((side_c > 0) & (side_d > 0)) | ((side_c < 0) & (side_d < 0))
    apart |= ((side_a > 0) & (side_b > 0)) | ((side_a < 0) & (side_b < 0))
    return np.asarray(boxes[:, 0] & boxes[:, 1] & ~apart)


def _squared_distance(point: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Squared distance of each point to segment cd, square metres."""
    along = d - c
    squared_length = (along * along).sum(axis=1)
    share = ((point - c) * along).sum(axis=1) / np.where(squared_length > 0, squared_length, 1.0)
    offset = point - c - np.clip(share, 0.0, 1.0)[:, None] * along
    return np.asarray((offset * offset).sum(axis=1))


def _ray_crosses(point: FloatArray, c: FloatArray, d: FloatArray) -> BoolArray:
    """Tell whether edge cd crosses the ray from the point to the right."""
    straddles = (c[:, 1] > point[:, 1]) != (d[:, 1] > point[:, 1])
    side = _cross(d - c, point - c)
    return np.asarray(straddles & np.where(d[:, 1] > c[:, 1], side > 0, side < 0))
