"""A small closed loop made up by hand: what pictures and recordings are drawn from in tests.

Four robots, three goals each, four planning sessions, as in figures 8 to 15 of Regev and Indelman
2017: red is late at its second goal and keeps its candidates in session 3. Robots
follow their chosen paths with some noise; covariances grow with the way and shrink where a
landmark is seen again. No estimator runs: only shapes, orders and sizes are those of a real loop.
The same on every call.
"""

from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise

import numpy as np

from fgplan.closed_loop.records import (
    EvaluatorRecord,
    LoopHistory,
    SessionRecord,
    SlamRecord,
    StepRecord,
)
from fgplan.models.measurement import Measurement, Odometry
from fgplan.paths.candidate_path import CandidatePath, Observation

ROBOTS = ("red", "green", "blue", "purple")
STARTS = {"red": (300, 200), "green": (800, 150), "blue": (1300, 200), "purple": (1750, 150)}
GOALS = {
    "red": [(250, 900), (500, 2100), (900, 1200)],
    "green": [(800, 950), (900, 1900), (350, 1000)],
    "blue": [(1250, 900), (1300, 1850), (1700, 900)],
    "purple": [(1750, 950), (1700, 1950), (1250, 1100)],
}
LEGS = {
    # Steps of each robot on the way to its goals; red is late at its second one.
    "red": (12, 22, 8),
    "green": (12, 14, 16),
    "blue": (12, 14, 16),
    "purple": (12, 14, 16),
}
LANDMARK_KEYS = tuple(range(100, 160))
RANGE_M = 300.0
STEP_S = 5.0


@dataclass
class Made:
    """What has happened so far."""

    truth: dict
    estimates: dict
    covariances: dict
    steps: list = field(default_factory=list)
    sessions: list = field(default_factory=list)
    landmarks: dict = field(default_factory=dict)
    seen_by: dict = field(default_factory=dict)


@cache
def make_history(*, spatial=False, finished=True, seed=7):
    """A loop of 43 steps and four sessions; spatial poses are (4, 4), flying at 30 m."""
    rng = np.random.default_rng(seed)
    places = {key: rng.uniform((0, 0), (2000, 2500)).round(1) for key in LANDMARK_KEYS}
    made = Made(
        truth={robot: _pose(STARTS[robot], np.pi / 2) for robot in ROBOTS},
        estimates={robot: _pose(STARTS[robot], np.pi / 2) for robot in ROBOTS},
        covariances={robot: 1e-12 * np.eye(3) for robot in ROBOTS},
    )
    _record(made, 0, 0, (), (), ())
    leg = dict.fromkeys(ROBOTS, 0)
    left = {}
    for number in (1, 2, 3, 4):
        renewed = tuple(r for r in ROBOTS if r not in left and leg[r] < 3)
        left = {r: left.get(r, LEGS[r][leg[r]]) for r in ROBOTS if leg[r] < 3}
        candidates = {r: _candidates(r, GOALS[r][leg[r]], left[r], made) for r in left}
        chosen = {r: paths[1] for r, paths in candidates.items()}
        _plan(made, number, renewed, leg, candidates)
        for _ in range(min(left.values())):
            step = len(made.steps)
            arrived = []
            odometry = []
            for robot in left:
                path = chosen[robot]
                place = path.steps - left[robot] + 1
                odometry.append(_move(made, robot, path.poses[place - 1 : place + 1], rng))
                left[robot] -= 1
                if not left[robot]:
                    arrived.append(robot)
            seen = _look(made, places, rng)
            _record(made, step, number, odometry, seen, arrived)
        for robot in [r for r in left if not left[r]]:
            del left[robot]
            leg[robot] += 1
    history = LoopHistory(
        name="four robots",
        robots=ROBOTS,
        goals={robot: np.array(goals, dtype=float) for robot, goals in GOALS.items()},
        landmarks=places,
        steps=tuple(made.steps),
        sessions=tuple(made.sessions),
        final=_slam(made) if finished else None,
    )
    return _lifted(history) if spatial else history


def _pose(where, heading):
    return np.array([*where, heading], dtype=float)


def _move(made, robot, poses, rng):
    """One step: the truth strays, the estimate strays less, the covariance grows."""
    delta = poses[1] - poses[0]
    heading = poses[1][2]
    stray = rng.normal(0.0, (3.0, 3.0, 0.01))
    made.truth[robot] = _pose(made.truth[robot][:2] + delta[:2] + stray[:2], heading + stray[2])
    error = rng.normal(0.0, (2.0, 2.0, 0.005))
    made.estimates[robot] = _pose(
        made.estimates[robot][:2] + delta[:2] + stray[:2] + error[:2], heading + stray[2] + error[2]
    )
    made.covariances[robot] = made.covariances[robot] + np.diag([3.0, 9.0, 1e-4])
    return Odometry(
        robot=robot,
        relative=np.array([np.hypot(*delta[:2]), 0.0, stray[2]]),
        covariance=np.diag([4.0, 4.0, 1e-4]),
    )


def _look(made, places, rng):
    """Range and bearing of landmarks within reach; one seen before shrinks the covariance."""
    seen = []
    for robot in ROBOTS:
        x, y, heading = made.truth[robot]
        for key, where in places.items():
            dx, dy = where - (x, y)
            if np.hypot(dx, dy) > RANGE_M:
                continue
            if key in made.landmarks:
                made.covariances[robot] = 0.93 * made.covariances[robot]
            else:
                made.landmarks[key] = where + rng.normal(0.0, 4.0, 2)
            if robot not in made.seen_by.setdefault(key, ()):
                made.seen_by[key] += (robot,)
            value = np.array([np.hypot(dx, dy), np.arctan2(dy, dx) - heading])
            seen.append(
                Measurement(
                    robot=robot,
                    sensor="camera",
                    kind="landmark",
                    target=key,
                    value=value,
                    covariance=np.diag([4.0, 1e-4]),
                )
            )
    return seen


def _record(made, step, session, odometry, measurements, arrived):
    made.steps.append(
        StepRecord(
            step=step,
            time_s=STEP_S * step,
            session=session,
            truth=dict(made.truth),
            odometry=tuple(odometry),
            measurements=tuple(measurements),
            estimates=dict(made.estimates),
            covariances=dict(made.covariances),
            arrived=tuple(arrived),
            seconds=0.01,
        )
    )


def _slam(made):
    """The SLAM result: a robot that stands still has no new pose."""
    which = {
        robot: tuple(
            record.step
            for before, record in zip([None, *made.steps], made.steps, strict=False)
            if before is None or (record.estimates[robot] != before.estimates[robot]).any()
        )
        for robot in ROBOTS
    }
    return SlamRecord(
        step=made.steps[-1].step,
        trajectories={r: np.array([made.steps[s].estimates[r] for s in which[r]]) for r in ROBOTS},
        trajectory_steps=which,
        covariances={r: np.array([made.steps[s].covariances[r] for s in which[r]]) for r in ROBOTS},
        landmarks=dict(made.landmarks),
        landmark_covariances={key: np.diag([16.0, 9.0]) for key in made.landmarks},
        seen_by=dict(made.seen_by),
    )


def _candidates(robot, goal, count, made):
    """Five arcs from the estimate to the goal, each of the same number of steps."""
    start, goal = made.estimates[robot][:2], np.array(goal, dtype=float)
    along = np.linspace(0.0, 1.0, count + 1)[:, None]
    across = np.array([-(goal - start)[1], (goal - start)[0]])
    paths = []
    for bow in (-0.3, -0.12, 0.05, 0.2, 0.35):
        where = start + along * (goal - start) + bow * np.sin(np.pi * along) * across
        delta = np.diff(where, axis=0)
        heading = np.arctan2(delta[:, 1], delta[:, 0])
        poses = np.column_stack([where, [heading[0], *heading]])
        seen = [
            Observation(step=step, landmark=key, sensor="camera", covariance=np.diag([4.0, 1e-4]))
            for step in range(1, count + 1)
            for key, place in made.landmarks.items()
            if np.hypot(*(place - where[step])) < RANGE_M
        ]
        paths.append(
            CandidatePath(
                robot=robot,
                poses=poses,
                times_s=STEP_S * np.arange(count + 1.0),
                motion_covariances=np.tile(np.diag([3.0, 9.0, 1e-4]), (count, 1, 1)),
                observations=tuple(seen),
            )
        )
    return tuple(paths)


def _plan(made, number, renewed, leg, candidates):
    """A planning session at the present step; everybody takes its second candidate."""
    chosen = {robot: paths[1] for robot, paths in candidates.items()}
    joined = [
        (chosen[one].state(a), chosen[other].state(b))
        for one, other in pairwise(ROBOTS)
        if one in chosen and other in chosen
        for a in range(1, chosen[one].steps + 1)
        for b in range(1, chosen[other].steps + 1)
        if np.hypot(*(chosen[one].poses[a] - chosen[other].poses[b])[:2]) < 260.0
    ]
    covariances = {
        robot: made.covariances[robot]
        + np.arange(path.steps + 1.0)[:, None, None] * np.diag([3.0, 9.0, 1e-4])
        for robot, path in chosen.items()
    }
    slow = (4.0, 9.0, 14.0, 12.0)[number - 1]
    runs = {
        name: EvaluatorRecord(
            seconds=seconds,
            chosen=dict.fromkeys(chosen, 1),
            objective=100.0 - number,
            turns=9,
            impacted_share=share,
        )
        for name, seconds, share in (
            ("incremental", 0.08 * number, 0.4),
            ("from_scratch_fastest", 0.4 * slow, None),
            ("from_scratch", slow, None),
        )
    }
    made.sessions.append(
        SessionRecord(
            session=number,
            step=made.steps[-1].step,
            time_s=made.steps[-1].time_s,
            trigger="start" if number == 1 else "goal",
            renewed=renewed,
            goals={robot: np.array(GOALS[robot][leg[robot]], dtype=float) for robot in chosen},
            goal_numbers={robot: leg[robot] + 1 for robot in chosen},
            estimate=_slam(made),
            candidates=candidates,
            chosen=chosen,
            chosen_index=dict.fromkeys(chosen, 1),
            covariances=covariances,
            joined=tuple(joined),
            values=(120.0, 110.0, 100.0 - number),
            announced_by=("all", "red", "blue"),
            runs=runs,
            counts={"factors": 100 * number, "messages_reused": 10 * (number - 1)},
            candidates_kept={robot: 5 for robot in chosen if robot not in renewed},
        )
    )


def _lifted(history):
    """The same loop in space: level flight at 30 m, with headings as they were."""
    return replace(
        history,
        goals={robot: _lift_points(goals) for robot, goals in history.goals.items()},
        landmarks={key: _lift_points(where) for key, where in history.landmarks.items()},
        steps=tuple(
            replace(
                step,
                truth={r: _lift_poses(pose) for r, pose in step.truth.items()},
                estimates={r: _lift_poses(pose) for r, pose in step.estimates.items()},
                covariances={r: _lift_covariances(c) for r, c in step.covariances.items()},
            )
            for step in history.steps
        ),
        sessions=tuple(
            replace(
                session,
                goals={r: _lift_points(where) for r, where in session.goals.items()},
                estimate=_lift_slam(session.estimate),
                candidates={
                    r: tuple(map(_lift_path, each)) for r, each in session.candidates.items()
                },
                chosen={r: _lift_path(path) for r, path in session.chosen.items()},
                covariances={r: _lift_covariances(c) for r, c in session.covariances.items()},
                joined=tuple(
                    tuple(replace(state, pose=_lift_poses(state.pose)) for state in pair)
                    for pair in session.joined
                ),
            )
            for session in history.sessions
        ),
        final=None if history.final is None else _lift_slam(history.final),
    )


def _lift_points(where):
    return np.concatenate([where, np.full((*where.shape[:-1], 1), 30.0)], axis=-1)


def _lift_poses(poses):
    matrix = np.zeros((*poses.shape[:-1], 4, 4))
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 0], matrix[..., 1, 1] = cos, -sin, sin, cos
    matrix[..., 2, 2] = matrix[..., 3, 3] = 1.0
    matrix[..., :2, 3], matrix[..., 2, 3] = poses[..., :2], 30.0
    return matrix


def _lift_covariances(planar):
    """Roll, pitch, yaw, then x, y, z: GTSAM's order in space."""
    spatial = np.zeros((*planar.shape[:-2], 6, 6))
    places = np.array([3, 4, 2])
    spatial[..., places[:, None], places] = planar
    for place in (0, 1, 5):
        spatial[..., place, place] = 1e-6
    return spatial


def _lift_path(path):
    return replace(
        path,
        poses=_lift_poses(path.poses),
        motion_covariances=_lift_covariances(path.motion_covariances),
    )


def _lift_slam(record):
    return replace(
        record,
        trajectories={r: _lift_poses(poses) for r, poses in record.trajectories.items()},
        covariances={r: _lift_covariances(c) for r, c in record.covariances.items()},
        landmarks={key: _lift_points(where) for key, where in record.landmarks.items()},
        landmark_covariances={
            key: np.diag([*np.diag(c), 4.0]) for key, c in record.landmark_covariances.items()
        },
    )
