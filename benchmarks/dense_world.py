"""What both dense references know of the world: controls, obstacles, targets and the sensor.

Every method takes one pose, shape (3,), or poses of several robots, shape (N, 3), at once.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np


@dataclass(eq=False, kw_only=True)
class DenseWorld:
    """Controls, obstacles, predicted targets, geodesic fields, sensor and densities.

    ``relative`` (U, 3), ``waypoints`` (U, W, 2) and ``body`` say the controls, ``places`` (T, M, 2)
    the predicted targets (one row if they stay), ``distance`` (F, cells) and ``frame`` the geodesic
    fields, ``field_of`` (T, M) which one is a target's at a time; ``are_free(a, b)`` tests
    ways between rows of points, ``is_seen(a, b)`` one line of sight. ``every_row`` stacks a row for
    every robot and target, as (3) prints it, those that measure nothing as zeros; otherwise only
    rows of what is seen are kept.
    """

    relative: np.ndarray
    waypoints: np.ndarray
    body: bool
    places: np.ndarray
    distance: np.ndarray
    frame: np.ndarray
    field_of: np.ndarray
    are_free: Callable[[np.ndarray, np.ndarray], np.ndarray]
    is_seen: Callable[[np.ndarray, np.ndarray], bool]
    range_m: float = 2.0
    slope: float = 0.25
    floor_m: float = 0.01
    near_m: float = 0.3
    p_group: float = 0.9
    p_control: float = 0.9
    every_row: bool = False
    seen_of: dict = field(default_factory=dict)

    @cached_property
    def reach(self) -> float:
        """Distance of the farthest waypoint, metres."""
        return float(np.linalg.norm(self.waypoints, axis=-1).max())

    def at(self, series: np.ndarray, time: int) -> np.ndarray:
        """Entry of a series at a time; the last one for ever."""
        return series[min(time, len(series) - 1)]

    def cells(self, points: np.ndarray) -> np.ndarray:
        """Geodesic cell of points of shape (..., 2)."""
        x0, y0, side, columns, rows = self.frame
        column = np.clip(np.floor((points[..., 0] - x0) / side), 0, columns - 1)
        row = np.clip(np.floor((points[..., 1] - y0) / side), 0, rows - 1)
        return (row * columns + column).astype(np.int64)

    def successors(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends (..., U, 3) of all controls and whether their ways are free (..., U)."""
        turned = np.zeros((*poses.shape[:-1], 2, 2))  # transposed: rows of points times it
        turned[..., 0, 0] = turned[..., 1, 1] = 1.0
        if self.body:
            turned[..., 0, 0] = turned[..., 1, 1] = np.cos(poses[..., 2])
            turned[..., 0, 1] = np.sin(poses[..., 2])
            turned[..., 1, 0] = -turned[..., 0, 1]
        ends = np.empty((*poses.shape[:-1], len(self.relative), 3))
        ends[..., :2] = poses[..., None, :2] + self.relative[:, :2] @ turned
        ends[..., 2] = poses[..., None, 2] + self.relative[:, 2]
        ends[..., 2] -= 2 * np.pi * (ends[..., 2] > np.pi)
        ends[..., 2] += 2 * np.pi * (ends[..., 2] <= -np.pi)
        ways = poses[..., None, None, :2] + self.waypoints @ turned[..., None, :, :]
        before = np.empty_like(ways)
        before[..., 0, :] = poses[..., None, :2]
        before[..., 1:, :] = ways[..., :-1, :]
        free = self.are_free(before.reshape(-1, 2), ways.reshape(-1, 2))
        return ends, free.reshape(ways.shape[:-1]).all(axis=-1)

    def distances(self, fields: int | np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Geodesic distances (..., U) from ends on; ``fields`` as many, or to be repeated."""
        distance = self.distance[fields, self.cells(ends[..., :2])].astype(np.float64)
        if not self.body:
            return distance
        # A thousandth counts where the heading would lead.
        heading = np.stack([np.cos(ends[..., 2]), np.sin(ends[..., 2])], axis=-1)
        ahead = self.distance[fields, self.cells(ends[..., :2] + self.reach * heading)]
        return distance + 1e-3 * np.minimum(ahead, distance + 2.0 * self.reach)

    def measurements(
        self, poses: np.ndarray, time: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Measurement matrix at a time, which of its rows measure something, and their noise."""
        places = self.at(self.places, time)
        offset = places - poses[..., None, :2]
        length = np.sqrt((offset**2).sum(axis=-1))
        near = (length <= self.range_m) & (length > 1e-9)
        for *robot, target in zip(*near.nonzero(), strict=True):
            point, place = poses[*robot, :2], places[target]
            key = (*point.tolist(), *place.tolist())
            seen = self.seen_of.get(key)
            if seen is None:
                seen = self.seen_of[key] = self.is_seen(point, place)
            near[*robot, target] = seen
        target, length = near.nonzero()[-1], length[near]
        row, count = np.arange(len(target)), len(target)
        if self.every_row:
            row, count = np.flatnonzero(near), near.size
        rows = np.zeros((count, 2 * len(places)))
        rows[row[:, None], 2 * target[:, None] + (0, 1)] = offset[near] / length[:, None]
        return rows, row, np.maximum(self.floor_m, self.slope * length) ** 2
