"""An MR.CLAM log as steps of multi-robot SLAM: one pose a robot at each tick of a common clock.

All robots get a pose at t_k = t_0 + k interval. Odometry between ticks is dead reckoning, its lag
taken out (fgplan.io.mrclam_motion). A measurement at time t belongs to the nearest tick and is
carried there by the robot's own odometry: the measured point p in the robot's frame at t is

    p_k = h p,     h = relative pose from t_k to t by dead reckoning,

and its bearing and range are those of p_k. Over half a second odometry adds a few milliradians,
much less than attaching the measurement as it is would (a robot turns at up to 0.56 rad/s). Another
robot that was measured drove a way d in between, by its own odometry, which way is not known:
d^2 / 2 is added to the variance across and along.

Start: the true pose of each robot at t_0, when none has moved yet, as a tight prior. That is all
that comes from Vicon; it is what "aligned at the first pose" means. Landmarks are unknown.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.factors.keys import symbol_key
from fgplan.io.mrclam import MrclamLog, MrclamRobot
from fgplan.io.mrclam_motion import DeadReckoning, dead_reckoning, odometry_lag, relative_poses
from fgplan.models.measurement import Measurement, Odometry
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.typing import Covariance, FloatArray, IntArray, Key, Pose

CAMERA, CAMERA_ROBOT = "camera", "camera_robot"
"""Names of the sensor: for landmarks, and for other robots. One camera; apart for counting."""

LANDMARK_CHARACTER = "l"


def _mrclam_camera() -> BearingRangeSensor:
    """Noise, range and view of the robots' cameras; see MrclamOptions."""
    return BearingRangeSensor(
        bearing_sigma_rad=0.01,
        range_sigma_m=0.05,
        range_sigma_per_metre=0.03,
        max_range_m=7.0,
        field_of_view_rad=1.1,
    )


def _mrclam_motion() -> MotionModel:
    """Noise of the robots' odometry; see MrclamOptions."""
    return MotionModel(
        sigmas=np.array([0.001, 0.001, 0.002]),
        per_metre=np.array([0.02, 0.02, 0.03]),
        per_radian=np.array([0.05, 0.01, 0.05]),
        speed_m_per_s=0.07,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MrclamOptions:
    """Numbers that a log does not hold.

    The default noise is read off what SLAM leaves over on Dataset 6 (residuals against the
    estimate, not against Vicon, rounded up): bearings 0.007 rad, ranges 0.07 m near to 0.3 m far,
    heading after straight 10 cm 0.006 rad and after a turn of 0.15 rad 0.02 rad. Turning robots get
    ahead by 0.05 to 0.07 m a radian less than their odometry says; that is noise here, too.

    Attributes:
        interval_s: Seconds from tick to tick.
        motion: Noise of the odometry: base a tick, after one metre, after one radian.
        camera: Noise of a measurement (range and view are for planning).
        start_sigmas: Prior of each robot's first pose: m, m, rad.
        lags_s: Lag of each robot's odometry by subject; None reads them off the log.
    """

    interval_s: float = 1.0
    motion: MotionModel = field(default_factory=_mrclam_motion)
    camera: BearingRangeSensor = field(default_factory=_mrclam_camera)
    start_sigmas: tuple[float, float, float] = (1e-3, 1e-3, 1e-3)
    lags_s: Mapping[int, float] | None = None

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidInputError: If one is not above zero.
        """
        check_positive(self.interval_s, "MR.CLAM interval_s")
        for sigma in self.start_sigmas:
            check_positive(sigma, "MR.CLAM start_sigmas")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MrclamSteps:
    """What SLAM is given, and what it is judged by.

    Attributes:
        robots: Names, ``robot1`` and so on, in the order of subjects.
        times_s: Ticks, shape (n + 1,), seconds since the log's origin.
        starts: Pose of each robot at the first tick, shape (3,), world frame.
        start_covariance: Of each of them, shape (3, 3).
        odometry: Of all robots for each of the n steps after the first tick.
        measurements: Of all robots at each of the n + 1 ticks.
        by_odometry: By robot, poses that the odometry alone gives as it is in the log, shape
            (n + 1, 3), from the true first pose.
        truth: By robot, Vicon's poses, shape (n + 1, 3); NaN where it has none.
        landmarks: Key by subject.
        lags_s: Lag of the odometry by robot.
        lag_pairs: Pairs of sightings that each lag is from; 0 where it was given.
        longest_gap_s: By robot, the longest time between two rows of odometry.
        counts: Measurements ``used_landmark`` and ``used_robot``; left out: ``unknown_barcode``,
            ``own_barcode``, ``outside`` (before the first tick or after the last).
    """

    robots: tuple[str, ...]
    times_s: FloatArray = field(repr=False)
    starts: Mapping[str, Pose]
    start_covariance: Covariance
    odometry: tuple[tuple[Odometry, ...], ...] = field(repr=False)
    measurements: tuple[tuple[Measurement, ...], ...] = field(repr=False)
    by_odometry: Mapping[str, FloatArray] = field(repr=False)
    truth: Mapping[str, FloatArray] = field(repr=False)
    landmarks: Mapping[int, Key] = field(repr=False)
    lags_s: Mapping[str, float]
    lag_pairs: Mapping[str, int]
    longest_gap_s: Mapping[str, float]
    counts: Mapping[str, int]


def robot_name(subject: int) -> str:
    """Name of a robot by its subject number."""
    return f"robot{subject}"


def landmark_key(subject: int) -> Key:
    """Key of a landmark by its subject number: ``l6`` and so on."""
    return symbol_key(LANDMARK_CHARACTER, subject)


def mrclam_steps(
    log: MrclamLog, options: MrclamOptions | None = None, until_s: float | None = None
) -> MrclamSteps:
    """Turn a log into steps.

    Args:
        log: What was read.
        options: Interval, noise, lags.
        until_s: Seconds after the first tick at which to stop; None goes on as long as every robot
            has odometry.

    Returns:
        Steps, starts, truth and counts.

    Raises:
        ScenarioError: If a robot has no true pose at the first tick, or nothing is left.
        InvalidInputError: If lags are given and one is missing.
    """
    options = options or MrclamOptions()
    lags, pairs = _lags(log, options)
    motions = {r.subject: dead_reckoning(r, lags[r.subject]) for r in log.robots}
    times = _ticks(log, options.interval_s, until_s)
    truth = {robot_name(robot.subject): robot.true_poses(times) for robot in log.robots}
    for name, poses in truth.items():
        if np.isnan(poses[0]).any():
            raise ScenarioError(
                f"{log.folder}: {name}: expected a true pose when the odometry begins, at "
                f"{log.origin_s + times[0]:.3f} s, for the start; its Groundtruth file has none"
            )
    odometry = [
        _odometry(robot_name(subject), motion, times, options.motion)
        for subject, motion in motions.items()
    ]
    counts: Counter[str] = Counter()
    measurements: list[list[Measurement]] = [[] for _ in times]
    for robot in log.robots:
        counts["unknown_barcode"] += sum(robot.unknown_barcodes.values())
        counts["own_barcode"] += robot.own_barcode
        _measure(robot, motions, times, options.camera, measurements, counts)
    return MrclamSteps(
        robots=tuple(truth),
        times_s=times,
        starts={name: poses[0] for name, poses in truth.items()},
        start_covariance=np.diag(np.square(options.start_sigmas)),
        odometry=tuple(zip(*odometry, strict=True)),
        measurements=tuple(tuple(of_tick) for of_tick in measurements),
        by_odometry={
            robot_name(r.subject): _from_start(
                dead_reckoning(r), times, truth[robot_name(r.subject)][0]
            )
            for r in log.robots
        },
        truth=truth,
        landmarks={subject: landmark_key(subject) for subject in log.landmarks},
        lags_s={robot_name(subject): lag for subject, lag in lags.items()},
        lag_pairs={robot_name(subject): count for subject, count in pairs.items()},
        longest_gap_s={
            robot_name(r.subject): float(np.diff(r.odometry[:, 0]).max(initial=0.0))
            for r in log.robots
        },
        counts=dict(counts),
    )


def _lags(log: MrclamLog, options: MrclamOptions) -> tuple[dict[int, float], dict[int, int]]:
    """Lag of each robot's odometry, and from how many pairs of sightings it is."""
    if options.lags_s is None:
        found = {r.subject: odometry_lag(r, frozenset(log.landmarks)) for r in log.robots}
        return (
            {subject: lag for subject, (lag, _) in found.items()},
            {subject: count for subject, (_, count) in found.items()},
        )
    missing = [robot.subject for robot in log.robots if robot.subject not in options.lags_s]
    if missing:
        raise InvalidInputError(f"MR.CLAM lags_s: expected one of every robot, not of {missing[0]}")
    return {r.subject: float(options.lags_s[r.subject]) for r in log.robots}, dict.fromkeys(
        (robot.subject for robot in log.robots), 0
    )


def _ticks(log: MrclamLog, interval_s: float, until_s: float | None) -> FloatArray:
    """Ticks from the first odometry of all as long as every robot has odometry."""
    first = min(float(robot.odometry[0, 0]) for robot in log.robots)
    last = min(float(robot.odometry[-1, 0]) for robot in log.robots)
    if until_s is not None:
        last = min(last, first + until_s)
    count = int(np.floor((last - first) / interval_s + 1e-9))
    if count < 1:
        raise ScenarioError(
            f"{log.folder}: expected odometry of all robots for {interval_s:g} s or more, got "
            f"{max(last - first, 0.0):.3f} s"
        )
    ticks: FloatArray = np.array([first + interval_s * tick for tick in range(count + 1)])
    return ticks


def _odometry(
    name: str, motion: DeadReckoning, times: FloatArray, noise: MotionModel
) -> list[Odometry]:
    """Odometry from tick to tick; its noise grows with what was driven and turned either way."""
    at = motion.at(times)
    steps = relative_poses(at[:-1], at[1:])
    driven, turned = np.diff(at[:, 3:], axis=0).T
    variances = (
        noise.sigmas**2
        + driven[:, None] * noise.per_metre**2
        + turned[:, None] * noise.per_radian**2
    )
    return [
        Odometry(robot=name, relative=step, covariance=np.diag(variance))
        for step, variance in zip(steps, variances, strict=True)
    ]


def _measure(
    robot: MrclamRobot,
    motions: Mapping[int, DeadReckoning],
    times: FloatArray,
    camera: BearingRangeSensor,
    into: list[list[Measurement]],
    counts: Counter[str],
) -> None:
    """Add a robot's measurements to the ticks that they are nearest to."""
    interval = times[1] - times[0]
    ticks = np.rint((robot.measured_at - times[0]) / interval).astype(np.int64)
    inside = (ticks >= 0) & (ticks < len(times))
    counts["outside"] += int((~inside).sum())
    when, ticks, targets = robot.measured_at[inside], ticks[inside], robot.measured[inside]
    ranges, bearings = robot.ranges_m[inside], robot.bearings_rad[inside]
    carried = _carried(motions[robot.subject], times[ticks], when, bearings, ranges)
    unknown_way = _ways_between(motions, targets, times[ticks], when)
    name = robot_name(robot.subject)
    for tick, subject, (bearing, distance), way in zip(
        ticks.tolist(), targets.tolist(), carried, unknown_way, strict=True
    ):
        of_robot = subject in motions
        counts["used_robot" if of_robot else "used_landmark"] += 1
        spread = camera.range_sigma_m + camera.range_sigma_per_metre * distance
        across = 0.5 * way**2
        into[tick].append(
            Measurement(
                robot=name,
                sensor=CAMERA_ROBOT if of_robot else CAMERA,
                kind="robot" if of_robot else "landmark",
                target=robot_name(subject) if of_robot else landmark_key(subject),
                value=np.array([bearing, distance]),
                covariance=np.diag(
                    [camera.bearing_sigma_rad**2 + across / distance**2, spread**2 + across]
                ),
            )
        )


def _carried(
    motion: DeadReckoning,
    ticks_s: FloatArray,
    when: FloatArray,
    bearings: FloatArray,
    ranges: FloatArray,
) -> FloatArray:
    """Bearings and ranges as they would have been at the ticks, shape (m, 2)."""
    moved = relative_poses(motion.at(ticks_s), motion.at(when))
    angle = moved[:, 2] + bearings
    x, y = moved[:, 0] + ranges * np.cos(angle), moved[:, 1] + ranges * np.sin(angle)
    return np.column_stack([np.arctan2(y, x), np.hypot(x, y)])


def _ways_between(
    motions: Mapping[int, DeadReckoning], targets: IntArray, ticks_s: FloatArray, when: FloatArray
) -> FloatArray:
    """Metres that what was measured drove between measurement and tick; 0 for a landmark."""
    ways = np.zeros(len(targets))
    for subject, motion in motions.items():
        of_robot = targets == subject
        ways[of_robot] = np.abs(motion.at(when[of_robot]) - motion.at(ticks_s[of_robot]))[:, 3]
    return ways


def _from_start(motion: DeadReckoning, times: FloatArray, start: Pose) -> FloatArray:
    """Dead reckoning at the ticks, moved so that it begins at the true first pose."""
    at = motion.at(times)
    moved = relative_poses(np.repeat(at[:1], len(at), axis=0), at)
    cos, sin = np.cos(start[2]), np.sin(start[2])
    return np.column_stack(
        [
            start[0] + cos * moved[:, 0] - sin * moved[:, 1],
            start[1] + sin * moved[:, 0] + cos * moved[:, 1],
            start[2] + moved[:, 2],
        ]
    )
