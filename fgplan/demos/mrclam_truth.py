"""What is wrong in an MR.CLAM log, by measurement: clocks, barcodes, ranges against Vicon.

For every measurement the truth says what bearing and range should have been read. A bearing that is
off by more than MISREAD_RAD is not noise (sigma 0.006 rad): the barcode was misread, which is
confirmed where another subject stood in that direction at that range. The camera's clock is off by
the shift of its stamps at which bearings agree best (least median absolute deviation).

Nothing of this goes into the estimate; it explains what the estimate had to cope with.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fgplan.io.mrclam import MrclamLog, MrclamRobot
from fgplan.typing import BoolArray, FloatArray, IntArray

MISREAD_RAD = 0.2
WRONG_RANGE_M = 0.5
"""A bearing or range off by more is an outlier."""

FITS_RAD, FITS_M = 0.05, 0.5
"""So near to what was read another subject must have been, to be what was seen."""

SHIFTS_S = np.arange(-12, 13) * 0.025
_MAD = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class LogErrors:
    """Measurements of one robot against the truth, as far as Vicon saw it.

    Attributes:
        compared: Measurements with a true pose.
        camera_late_s: How late its stamps are against Vicon's, a multiple of 0.025 s.
        bearing_bias_rad: Median error.
        bearing_sigma_rad: From the median absolute deviation.
        range_bias_m: Median error.
        range_sigma_m: From the median absolute deviation.
        misread: Bearings off by more than MISREAD_RAD.
        misread_confirmed: Those that fit another subject.
        ranges_short: Ranges too short by more than WRONG_RANGE_M, misread ones aside.
        ranges_long: Ranges too long by more than that.
    """

    compared: int
    camera_late_s: float
    bearing_bias_rad: float
    bearing_sigma_rad: float
    range_bias_m: float
    range_sigma_m: float
    misread: int
    misread_confirmed: int
    ranges_short: int
    ranges_long: int


def log_errors(log: MrclamLog) -> dict[int, LogErrors]:
    """Measure what is wrong in a log.

    Args:
        log: As read.

    Returns:
        By subject of the robot that measured; none for a robot without a comparable measurement.
    """
    found = {robot.subject: _errors_of(log, robot) for robot in log.robots}
    return {subject: errors for subject, errors in found.items() if errors is not None}


def _errors_of(log: MrclamLog, robot: MrclamRobot) -> LogErrors | None:
    """One robot's measurements."""
    spreads = []
    for shift in SHIFTS_S:
        bearing, _ = _residuals(log, robot, float(shift))
        spreads.append(_sigma(bearing[np.isfinite(bearing)]))
    if not np.isfinite(spreads).any():
        return None
    shift = float(SHIFTS_S[int(np.nanargmin(spreads))])
    bearing, distance = _residuals(log, robot, shift)
    seen = np.isfinite(bearing)
    wrong = seen & (np.abs(bearing) > MISREAD_RAD)
    good = seen & ~wrong
    return LogErrors(
        compared=int(seen.sum()),
        camera_late_s=0.0 - shift,
        bearing_bias_rad=float(np.median(bearing[seen])),
        bearing_sigma_rad=_sigma(bearing[seen]),
        range_bias_m=float(np.median(distance[seen])),
        range_sigma_m=_sigma(distance[seen]),
        misread=int(wrong.sum()),
        misread_confirmed=_confirmed(log, robot, shift, wrong),
        ranges_short=int((distance[good] < -WRONG_RANGE_M).sum()),
        ranges_long=int((distance[good] > WRONG_RANGE_M).sum()),
    )


def _confirmed(log: MrclamLog, robot: MrclamRobot, shift_s: float, wrong: BoolArray) -> int:
    """How many misread measurements fit another subject."""
    fits = np.zeros(int(wrong.sum()), dtype=bool)
    others = {*log.landmarks, *(other.subject for other in log.robots)} - {robot.subject}
    for subject in sorted(others):
        taken_for = np.full(len(fits), subject, dtype=np.int64)
        bearing, distance = _residuals(log, robot, shift_s, wrong, taken_for)
        fits |= (np.abs(bearing) < FITS_RAD) & (np.abs(distance) < FITS_M)
    return int(fits.sum())


def _residuals(
    log: MrclamLog,
    robot: MrclamRobot,
    shift_s: float,
    chosen: BoolArray | None = None,
    subjects: IntArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Measured minus true bearings (rad, within pi) and ranges (m); NaN where there is no truth."""
    rows = np.ones(len(robot.measured), dtype=bool) if chosen is None else chosen
    when = robot.measured_at[rows] + shift_s
    here = robot.true_poses(when)
    there = _true_positions(log, robot.measured[rows] if subjects is None else subjects, when)
    offset = there - here[:, :2]
    angle = robot.bearings_rad[rows] - np.arctan2(offset[:, 1], offset[:, 0]) + here[:, 2]
    bearing = np.arctan2(np.sin(angle), np.cos(angle))
    return bearing, robot.ranges_m[rows] - np.linalg.norm(offset, axis=1)


def _true_positions(log: MrclamLog, subjects: IntArray, when: FloatArray) -> FloatArray:
    """Where subjects truly were, shape (n, 2); NaN where Vicon did not see a robot."""
    found = np.full((len(when), 2), np.nan)
    places: Mapping[int, FloatArray] = log.landmarks
    for subject in np.unique(subjects).tolist():
        mine = subjects == subject
        if subject in places:
            found[mine] = places[subject]
        else:
            found[mine] = log.robot(subject).true_poses(when[mine])[:, :2]
    return found


def _sigma(values: FloatArray) -> float:
    """Standard deviation from the median absolute deviation; NaN of nothing."""
    if not values.size:
        return float("nan")
    return float(_MAD * np.median(np.abs(values - np.median(values))))
