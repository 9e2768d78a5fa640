"""How good the joint estimate of an MR.CLAM log is: errors against Vicon, robot by robot.

Every trajectory, estimated or by odometry alone, is put onto the truth at its first pose and
nowhere else. Two more alignments say where the rest of the error comes from: one rigid motion for
all robots together (what remains is the error of the trajectories to each other), and each robot by
itself (what remains is the error of its shape).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.io.mrclam import MrclamLog
from fgplan.io.mrclam_steps import CAMERA, CAMERA_ROBOT, MrclamSteps
from fgplan.slam.team_slam import TeamSlam
from fgplan.slam.trajectory_error import absolute_trajectory_error, position_errors
from fgplan.typing import FloatArray

SHARE_OF_ODOMETRY, ENOUGH_M = 0.2, 0.2
"""Required error: a fifth of odometry's or 0.2 m, whichever is larger."""

OUTLIER_WEIGHT = 0.5
"""A measurement that the robust loss gives less weight counts as an outlier."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotErrors:
    """Errors of one robot's positions, metres, while Vicon saw it.

    Attributes:
        robot: Name.
        ate_m: Root mean square, aligned at the first pose.
        odometry_ate_m: The same of odometry alone.
        required_m: What ``ate_m`` must not exceed.
        largest_m: Largest error, aligned at the first pose.
        ate_own_alignment_m: Root mean square under the robot's own best alignment.
        poses: Poses estimated.
        poses_with_truth: Those that are judged.
        measurements: Measurements that it made and that were used.
        seen_by_others: Measurements of it by other robots that were used.
        longest_without_s: Longest time without a measurement of its own, seconds.
        sigma_now_m: Position sigma at the end (root of the trace).
    """

    robot: str
    ate_m: float
    odometry_ate_m: float
    required_m: float
    largest_m: float
    ate_own_alignment_m: float
    poses: int
    poses_with_truth: int
    measurements: int
    seen_by_others: int
    longest_without_s: float
    sigma_now_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judgement:
    """Errors of the whole estimate.

    Attributes:
        robots: In the order of the team.
        together_m: Root mean square over all robots under one common best alignment.
        landmarks_m: Root mean square error of the mapped landmarks, not aligned.
        landmarks_aligned_m: The same under their best alignment.
        outliers: Measurements that weigh less than OUTLIER_WEIGHT, by sensor; none without a
            robust loss.
        errors_m: By robot, error of the estimate at each tick, aligned at the first pose, NaN where
            there is no truth.
        odometry_errors_m: The same of odometry alone.
    """

    robots: tuple[RobotErrors, ...]
    together_m: float
    landmarks_m: float
    landmarks_aligned_m: float
    outliers: Mapping[str, int]
    errors_m: Mapping[str, FloatArray] = field(repr=False)
    odometry_errors_m: Mapping[str, FloatArray] = field(repr=False)


def judge(log: MrclamLog, steps: MrclamSteps, slam: TeamSlam, belief: Belief | None) -> Judgement:
    """Compare an estimate with the truth.

    Args:
        log: For the true landmarks.
        steps: What SLAM was given, and the truth.
        slam: SLAM after the last tick.
        belief: For the position sigmas; None gives NaN.

    Returns:
        All errors.
    """
    estimates = {robot: slam.trajectory(robot) for robot in steps.robots}
    seen = {robot: ~np.isnan(steps.truth[robot][:, 0]) for robot in steps.robots}
    robots = tuple(_robot_errors(robot, steps, slam, estimates[robot], belief) for robot in seen)
    stacked, true_stacked = (
        np.vstack([poses[robot][seen[robot]] for robot in steps.robots])
        for poses in (estimates, steps.truth)
    )
    mapped = slam.landmarks()
    pairs = [
        (mapped[key], log.landmarks[subject])
        for subject, key in steps.landmarks.items()
        if key in mapped
    ]
    points, true_points = (_as_poses([pair[side] for pair in pairs]) for side in (0, 1))
    return Judgement(
        robots=robots,
        together_m=absolute_trajectory_error(stacked, true_stacked, "all"),
        landmarks_m=absolute_trajectory_error(points, true_points, "none"),
        landmarks_aligned_m=absolute_trajectory_error(points, true_points, "all"),
        outliers={
            sensor: int((np.array(weights) < OUTLIER_WEIGHT).sum())
            for sensor, weights in slam.weights().items()
        },
        errors_m={robot: _errors(poses, steps.truth[robot]) for robot, poses in estimates.items()},
        odometry_errors_m={
            robot: _errors(poses, steps.truth[robot]) for robot, poses in steps.by_odometry.items()
        },
    )


def required_m(odometry_ate_m: float) -> float:
    """The error that SLAM must not exceed, metres."""
    return max(ENOUGH_M, SHARE_OF_ODOMETRY * odometry_ate_m)


def _robot_errors(
    robot: str, steps: MrclamSteps, slam: TeamSlam, estimate: FloatArray, belief: Belief | None
) -> RobotErrors:
    """Errors of one robot."""
    truth = steps.truth[robot]
    seen = ~np.isnan(truth[:, 0])
    odometry_m = absolute_trajectory_error(steps.by_odometry[robot][seen], truth[seen], "first")
    sigma = float("nan")
    if belief is not None:
        sigma = float(np.sqrt(np.trace(belief.covariance(slam.key(robot))[:2, :2])))
    own = [[one for one in of_tick if one.robot == robot] for of_tick in steps.measurements]
    ticks = [tick for tick, found in enumerate(own) if found]
    gaps = np.diff([0, *ticks, len(own) - 1])
    of_it = sum(
        one.sensor == CAMERA_ROBOT and one.target == robot
        for of_tick in steps.measurements
        for one in of_tick
    )
    return RobotErrors(
        robot=robot,
        ate_m=absolute_trajectory_error(estimate[seen], truth[seen], "first"),
        odometry_ate_m=odometry_m,
        required_m=required_m(odometry_m),
        largest_m=float(position_errors(estimate[seen], truth[seen], "first").max()),
        ate_own_alignment_m=absolute_trajectory_error(estimate[seen], truth[seen], "all"),
        poses=len(estimate),
        poses_with_truth=int(seen.sum()),
        measurements=sum(len(found) for found in own),
        seen_by_others=of_it,
        longest_without_s=float(gaps.max() * (steps.times_s[1] - steps.times_s[0])),
        sigma_now_m=sigma,
    )


def _errors(poses: FloatArray, truth: FloatArray) -> FloatArray:
    """Error at each tick, aligned at the first pose; NaN where there is no truth."""
    seen = ~np.isnan(truth[:, 0])
    errors = np.full(len(poses), np.nan)
    errors[seen] = position_errors(poses[seen], truth[seen], "first")
    return errors


def _as_poses(points: list[FloatArray]) -> FloatArray:
    """Points as poses of heading zero, shape (n, 3)."""
    return np.column_stack([np.array(points).reshape(-1, 2), np.zeros(len(points))])


def used_measurements(steps: MrclamSteps) -> dict[str, int]:
    """Measurements given to SLAM, by sensor."""
    counts = dict.fromkeys((CAMERA, CAMERA_ROBOT), 0)
    for of_tick in steps.measurements:
        for one in of_tick:
            counts[one.sensor] += 1
    return counts
