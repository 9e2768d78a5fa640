"""What an MR.CLAM robot's wheels say, and how late: dead reckoning and the odometry's lag.

The velocities of the log hold until the next row. Between two rows dt apart a robot drives an arc:

    heading += w dt,   (x, y) += v dt sinc(w dt / 2) (cos, sin)(heading + w dt / 2)

They are commands, and the wheels follow them later. How much later the log itself tells. A landmark
that a robot sees twice, at t1 and t2 less than MOST_APART_S apart, at bearings b1 and b2 and range
r, says how far the robot has turned in between, without any map:

    turned = b1 - b2 + driven sin((b1 + b2) / 2) / r

The lag is the shift of the odometry's clock at which its own turn and this one agree best: least
median of the residuals' absolute values about a robust line (scale and drift of the turn are free).
No truth is used.
"""

from dataclasses import dataclass, field

import numpy as np

from fgplan.io.mrclam import MrclamRobot
from fgplan.typing import FloatArray

MOST_APART_S = 1.0
LEAST_APART_S = 0.05
"""Two sightings of one landmark from which a turn is read."""

LAGS_S = 0.025 * np.arange(-20, 41)
LEAST_PAIRS = 50
"""Pairs of sightings below which no lag is read."""

_ROBUST_ROUNDS = 15


@dataclass(frozen=True, slots=True, eq=False)
class DeadReckoning:
    """Motion by odometry alone from the origin, at rest before the first row.

    Attributes:
        times_s: Shape (n,), ascending.
        columns: Shape (n, 5): x, y, heading (m, m, rad, unwrapped) in the frame of the first pose;
            metres driven; radians turned, either way.
    """

    times_s: FloatArray = field(repr=False)
    columns: FloatArray = field(repr=False)

    def at(self, times_s: FloatArray) -> FloatArray:
        """The columns at given times, shape (m, 5); at rest before the first row and after it."""
        return np.column_stack(
            [np.interp(times_s, self.times_s, column) for column in self.columns.T]
        )


def dead_reckoning(robot: MrclamRobot, lag_s: float = 0.0) -> DeadReckoning:
    """Integrate a robot's odometry.

    Args:
        robot: What it logged.
        lag_s: How long after its stamp a velocity takes effect.

    Returns:
        Its motion.
    """
    times = robot.odometry[:, 0] + lag_s
    apart = np.diff(times)
    forward = robot.odometry[:-1, 1] * apart
    turn = robot.odometry[:-1, 2] * apart
    heading = np.append(0.0, np.cumsum(turn))
    middle = heading[:-1] + 0.5 * turn
    chord = forward * np.sinc(0.5 * turn / np.pi)
    way = (chord * np.cos(middle), chord * np.sin(middle), np.abs(forward), np.abs(turn))
    x, y, driven, turned = (np.append(0.0, np.cumsum(column)) for column in way)
    return DeadReckoning(times, np.column_stack([x, y, heading, driven, turned]))


def relative_poses(first: FloatArray, second: FloatArray) -> FloatArray:
    """Second poses seen from the first.

    Args:
        first: Shape (n, 3 or more): x, y, heading first.
        second: Same shape.

    Returns:
        Shape (n, 3); the turn is the plain difference of the headings.
    """
    offset = second[:, :2] - first[:, :2]
    cos, sin = np.cos(first[:, 2]), np.sin(first[:, 2])
    return np.column_stack(
        [
            cos * offset[:, 0] + sin * offset[:, 1],
            cos * offset[:, 1] - sin * offset[:, 0],
            second[:, 2] - first[:, 2],
        ]
    )


def odometry_lag(robot: MrclamRobot, landmarks: frozenset[int]) -> tuple[float, int]:
    """How long after its stamp a robot's odometry takes effect, by its own camera.

    Args:
        robot: What it logged.
        landmarks: Subjects that do not move.

    Returns:
        The lag in seconds, a multiple of 0.025 s, against the clock of its measurements; and the
        number of pairs of sightings that it is from. 0 where these are fewer than LEAST_PAIRS.
    """
    pairs = _sighting_pairs(robot, landmarks)
    if len(pairs) < LEAST_PAIRS:
        return 0.0, len(pairs)
    motion = dead_reckoning(robot)
    start, end, first, second, distance = pairs.T
    spreads = []
    for lag in LAGS_S:
        moved = motion.at(end - lag) - motion.at(start - lag)
        turned = first - second + moved[:, 3] * np.sin(0.5 * (first + second)) / distance
        spreads.append(_spread_about_line(np.column_stack([moved[:, 2], end - start]), turned))
    return round(float(LAGS_S[int(np.argmin(spreads))]), 3), len(pairs)


def _sighting_pairs(robot: MrclamRobot, landmarks: frozenset[int]) -> FloatArray:
    """Two sightings of one landmark: both times, both bearings, the first's range; shape (n, 5)."""
    found = [np.zeros((0, 5))]
    for subject in sorted(landmarks):
        times, bearings, ranges = (
            values[robot.measured == subject]
            for values in (robot.measured_at, robot.bearings_rad, robot.ranges_m)
        )
        apart = np.diff(times)
        i = np.flatnonzero((apart > LEAST_APART_S) & (apart < MOST_APART_S))
        found.append(
            np.column_stack([times[i], times[i + 1], bearings[i], bearings[i + 1], ranges[i]])
        )
    return np.vstack(found)


def _spread_about_line(columns: FloatArray, values: FloatArray) -> float:
    """Median absolute residual about the line of least reweighted (Cauchy) squares."""
    weights = np.ones(len(values))
    residuals = values
    for _ in range(_ROBUST_ROUNDS):
        line = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=None)[0]
        residuals = np.abs(values - columns @ line)
        scale = 2.0 * 1.4826 * max(float(np.median(residuals)), 1e-12)
        weights = 1.0 / np.sqrt(1.0 + (residuals / scale) ** 2)
    return float(np.median(residuals))
