"""What pictures of a closed loop are drawn from: its records as arrays over time, seen from above.

Records hold a mapping a step; a curve or a trail wants an array a robot. Nothing is estimated
here: poses are cut down to positions, and position covariances turned into the world frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fgplan.checks import frozen
from fgplan.closed_loop.records import LoopHistory, SlamRecord
from fgplan.errors import InvalidInputError
from fgplan.models.pose import position_slice
from fgplan.typing import FloatArray, IntArray, Key, Pose
from fgplan.viz.ellipse import world_position_covariances
from fgplan.viz.map_drawing import Extent, map_extent, pose_positions
from roadmaps import Workspace


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopTracks:
    """Every robot's way through a closed loop of T records, step by step.

    Attributes:
        steps: Step of each record, shape (T,).
        times_s: Seconds since the start, shape (T,).
        true_positions: By robot, shape (T, 2), metres, world frame.
        positions: Estimated, by robot, shape (T, 2), metres, world frame.
        covariances: Of the estimated positions, by robot, shape (T, 2, 2), square metres, world
            frame.
        traces: Trace of the position covariance, in space with height, by robot, shape (T,),
            square metres.
    """

    steps: IntArray
    times_s: FloatArray
    true_positions: Mapping[str, FloatArray]
    positions: Mapping[str, FloatArray]
    covariances: Mapping[str, FloatArray]
    traces: Mapping[str, FloatArray]

    def __post_init__(self) -> None:
        """Make arrays read-only."""
        object.__setattr__(self, "times_s", frozen(self.times_s))
        for name in ("true_positions", "positions", "covariances", "traces"):
            by_robot = getattr(self, name)
            object.__setattr__(self, name, {r: frozen(array) for r, array in by_robot.items()})


def loop_tracks(history: LoopHistory) -> LoopTracks:
    """Stack the step records of a closed loop.

    Args:
        history: At least one step.

    Returns:
        One array a robot.

    Raises:
        InvalidInputError: If there is no step, or a step lacks a robot.
    """
    check_steps(history)
    true_positions, positions, covariances, traces = {}, {}, {}, {}
    for robot in history.robots:
        true_positions[robot] = pose_positions(_stack(history, "truth", robot))
        poses = _stack(history, "estimates", robot)
        blocks = _stack(history, "covariances", robot)
        span = position_slice(blocks.shape[1])
        positions[robot] = pose_positions(poses)
        covariances[robot] = world_position_covariances(poses, blocks)
        traces[robot] = np.trace(blocks[:, span, span], axis1=1, axis2=2)
    return LoopTracks(
        steps=np.array([record.step for record in history.steps]),
        times_s=np.array([record.time_s for record in history.steps]),
        true_positions=true_positions,
        positions=positions,
        covariances=covariances,
        traces=traces,
    )


def check_steps(history: LoopHistory) -> None:
    """Check that there is something to draw.

    Raises:
        InvalidInputError: If there is no step.
    """
    if not history.steps:
        raise InvalidInputError(
            f"closed loop {history.name!r}: expected at least one step to draw, got none"
        )


def loop_extent(history: LoopHistory, workspace: Workspace | None = None) -> Extent:
    """What every map of a closed loop shows: the workspace, or all that there is in the loop.

    Raises:
        InvalidInputError: If there is neither a workspace nor anything in the loop.
    """
    points = [
        pose_positions(np.array([pose]))
        for record in history.steps
        for poses in (record.truth, record.estimates)
        for pose in poses.values()
    ]
    points += [np.atleast_2d(goals)[:, :2] for goals in history.goals.values()]
    for session in history.sessions:
        for paths in session.candidates.values():
            points += [pose_positions(path.poses) for path in paths]
    points += [np.atleast_2d(where)[:, :2] for where in history.landmarks.values()]
    return map_extent(workspace, points)


def true_landmarks(history: LoopHistory) -> FloatArray:
    """True positions of all landmarks seen from above, shape (N, 2), metres."""
    return np.array([where[:2] for where in history.landmarks.values()]).reshape(-1, 2)


def first_seen(history: LoopHistory) -> dict[Key, int]:
    """Step at which each landmark was first measured, in the order in which they were."""
    steps: dict[Key, int] = {}
    for record in history.steps:
        for one in record.measurements:
            if one.kind == "landmark":
                steps.setdefault(int(one.target), record.step)
    return steps


def sightings(
    history: LoopHistory, result: SlamRecord, first: int, last: int
) -> dict[str, FloatArray]:
    """Lines from where a robot measured landmarks to where these are, as a SLAM result has both.

    Args:
        history: Whose measurements.
        result: Estimated trajectories and landmarks.
        first: First step.
        last: Last step.

    Returns:
        By robot, shape (n, 2, 2): robot and landmark, metres, world frame; measurements of
        landmarks that the result does not hold are left out.
    """
    lines: dict[str, list[FloatArray]] = {robot: [] for robot in history.robots}
    for record in history.steps:
        if not first <= record.step <= last:
            continue
        for one in record.measurements:
            if one.kind == "landmark" and one.target in result.landmarks:
                pose = pose_at(result, one.robot, record.step)
                where = np.asarray(result.landmarks[int(one.target)])[:2]
                lines[one.robot].append(np.stack([pose_positions(pose[None])[0], where]))
    return {robot: np.array(each).reshape(-1, 2, 2) for robot, each in lines.items()}


def pose_at(result: SlamRecord, robot: str, step: int) -> Pose:
    """Estimated pose of a robot at a step; one that stands still keeps its last.

    Raises:
        InvalidInputError: If the robot has no pose so early.
    """
    place = int(np.searchsorted(result.trajectory_steps[robot], step, side="right")) - 1
    if place < 0:
        raise InvalidInputError(
            f"SLAM result of step {result.step}: robot {robot!r} has no pose at step {step}"
        )
    return result.trajectories[robot][place]


def result_of_session(history: LoopHistory, place: int) -> SlamRecord | None:
    """SLAM result once the paths of a session were followed; None if that is still to come.

    Args:
        history: The loop.
        place: Place of the session, from 0.

    Returns:
        What the next session starts from, or the final result.
    """
    if place + 1 < len(history.sessions):
        return history.sessions[place + 1].estimate
    return history.final


def _stack(history: LoopHistory, name: str, robot: str) -> FloatArray:
    """One field of one robot over all steps."""
    rows = []
    for record in history.steps:
        by_robot = getattr(record, name)
        if robot not in by_robot:
            raise InvalidInputError(
                f"closed loop {history.name!r}, step {record.step}: expected {name} of robot "
                f"{robot!r}, got those of {', '.join(by_robot) or 'none'}"
            )
        rows.append(np.asarray(by_robot[robot], dtype=np.float64))
    return np.array(rows)
