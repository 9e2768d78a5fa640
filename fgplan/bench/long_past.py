"""Pasts of a team of four that differ in length and in nothing that planning touches.

Synthetic: 60 landmarks on a 1000 m square. Each robot drives rounds of 25 poses on a circle of its
own; circles overlap, so landmarks seen by several robots and in every round tie everything
together. A longer past has more rounds; the last round, the landmarks and the current poses are the
same. Measurements are exact: a covariance depends on where a graph is linearised only.

Victoria Park: the first poses of the real log (in GTSAM's wheel), cut into consecutive parts, one a
robot, with the odometry between parts left out; landmarks that several parts have seen tie the
robots together. Values are what Levenberg-Marquardt makes of the uncut prefix from dead
reckoning; a better optimum would change covariances, not the work.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import gtsam
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.typing import FloatArray, Key

ROBOTS = 4
ROUND = 25
LANDMARKS = 60
SIDE_M, RADIUS_M = 1000.0, 300.0
SEEN_FROM_EACH = 2
STEP_SIGMAS = (1.0, 1.0, 0.01)
SIGHT_SIGMAS = (0.02, 2.0)
FIRST_SIGMAS = (0.01, 0.01, 0.001)
LOG = "victoria_park.txt"


@dataclass(frozen=True, slots=True, eq=False)
class LongPast:
    """A team's past.

    Attributes:
        kind: ``synthetic`` or ``victoria_park``.
        poses: Past poses of all robots together, current ones included.
        graph: Everything measured so far, and one prior on the very first pose.
        values: Linearisation point.
        start_keys: Current pose by robot.
    """

    kind: str
    poses: int
    graph: gtsam.NonlinearFactorGraph = field(repr=False)
    values: gtsam.Values = field(repr=False)
    start_keys: dict[str, Key]


def synthetic_past(poses: int) -> LongPast:
    """A past of rounds through one field of landmarks.

    Args:
        poses: Past poses of the four robots together, a multiple of 100: whole rounds.

    Returns:
        The past.

    Raises:
        InvalidInputError: If the poses are not whole rounds.
    """
    if poses < ROBOTS * ROUND or poses % (ROBOTS * ROUND):
        raise InvalidInputError(
            f"synthetic past: expected poses in multiples of {ROBOTS * ROUND}, got {poses}"
        )
    each = poses // ROBOTS
    landmarks = np.random.default_rng(0).uniform(0.0, SIDE_M, (LANDMARKS, 2))
    rounds = [_round(robot) for robot in range(ROBOTS)]
    seen = _seen(rounds, landmarks)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for index, where in enumerate(landmarks):
        values.insert(_landmark_key(index), where)
    sight = gtsam.noiseModel.Diagonal.Sigmas(np.array(SIGHT_SIGMAS))
    motion = gtsam.noiseModel.Diagonal.Sigmas(np.array(STEP_SIGMAS))
    for robot, circle in enumerate(rounds):
        keys = [_pose_key(robot, step) for step in range(each)]
        for step, key in enumerate(keys):
            pose = circle[step % ROUND]
            values.insert(key, pose)
            for index in seen[robot][step % ROUND]:
                where = landmarks[index]
                graph.add(
                    gtsam.BearingRangeFactor2D(
                        key, _landmark_key(index), pose.bearing(where), pose.range(where), sight
                    )
                )
        for step, (before, after) in enumerate(pairwise(keys)):
            moved = circle[step % ROUND].between(circle[(step + 1) % ROUND])
            graph.add(gtsam.BetweenFactorPose2(before, after, moved, motion))
    _fix_first(graph, values, _pose_key(0, 0))
    starts = {f"robot{robot}": _pose_key(robot, each - 1) for robot in range(ROBOTS)}
    return LongPast("synthetic", poses, graph, values, starts)


def victoria_park_past(poses: int) -> LongPast:
    """The first poses of the Victoria Park log as the past of four robots.

    Args:
        poses: Length of the prefix, at most the log's 6,969.

    Returns:
        The past.

    Raises:
        InvalidInputError: If the log is shorter, or the prefix has fewer than two poses a robot.
    """
    whole, initial = gtsam.load2D(gtsam.findExampleDataFile(LOG))
    dims = initial.dims()
    log = [int(key) for key in sorted(dims) if dims[key] == 3]
    if not 2 * ROBOTS <= poses <= len(log):
        raise InvalidInputError(
            f"Victoria Park: expected a prefix of {2 * ROBOTS} to {len(log)} poses, got {poses}"
        )
    place = {key: index for index, key in enumerate(log[:poses])}
    uncut, graph = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()
    known = dict.fromkeys(place)
    for index in range(whole.size()):
        factor = whole.at(index)
        keys = tuple(factor.keys())
        places = [place.get(key) for key in keys if dims[key] == 3]
        if None in places:
            continue
        known.update(dict.fromkeys(keys))
        uncut.add(factor)
        parts = {at * ROBOTS // poses for at in places if at is not None}
        if len(parts) == 1:
            graph.add(factor)
    start = gtsam.Values()
    for key in known:
        start.insert(key, initial.atPose2(key) if dims[key] == 3 else initial.atPoint2(key))
    _fix_first(uncut, start, log[0])
    values = gtsam.LevenbergMarquardtOptimizer(uncut, start).optimize()
    _fix_first(graph, values, log[0])
    starts = {
        f"robot{robot}": log[-(-(robot + 1) * poses // ROBOTS) - 1] for robot in range(ROBOTS)
    }
    return LongPast("victoria_park", poses, graph, values, starts)


def _round(robot: int) -> list[gtsam.Pose2]:
    """One round of a robot, counter-clockwise; the current pose is its last."""
    middle = SIDE_M * np.array([0.35 + 0.3 * (robot % 2), 0.35 + 0.3 * (robot // 2)])
    angles = 2.0 * np.pi * (np.arange(ROUND) + 1) / ROUND + 0.5 * np.pi * robot
    where = middle + RADIUS_M * np.column_stack([np.cos(angles), np.sin(angles)])
    return [
        gtsam.Pose2(x, y, angle + 0.5 * np.pi) for (x, y), angle in zip(where, angles, strict=True)
    ]


def _seen(rounds: Sequence[Sequence[gtsam.Pose2]], landmarks: FloatArray) -> list[list[set[int]]]:
    """Landmarks seen from each pose of a round: the nearest, and each from its nearest pose."""
    where = np.array([pose.translation() for circle in rounds for pose in circle])
    distance = np.linalg.norm(where[:, None] - landmarks[None], axis=2)
    seen = [set(row) for row in np.argsort(distance, axis=1)[:, :SEEN_FROM_EACH].tolist()]
    for index, nearest in enumerate(np.argmin(distance, axis=0).tolist()):
        seen[nearest].add(index)
    return [seen[robot * ROUND : (robot + 1) * ROUND] for robot in range(len(rounds))]


def _fix_first(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, key: Key) -> None:
    """Put a prior on the very first pose: nothing else fixes the frame."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array(FIRST_SIGMAS))
    graph.add(gtsam.PriorFactorPose2(key, values.atPose2(key), noise))


def _pose_key(robot: int, step: int) -> Key:
    """Key of a past pose."""
    return int(gtsam.symbol("abcd"[robot], step))


def _landmark_key(index: int) -> Key:
    """Key of a landmark."""
    return int(gtsam.symbol("l", index))
