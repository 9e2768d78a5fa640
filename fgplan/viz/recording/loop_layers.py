"""A closed loop as named layers with stamps: what any recording holds, whatever its format.

Names are paths ("red/candidates"); a layer stays until one of the same name replaces it, and one
without lines removes what it showed. Everything is in the frame "map", metres, z up; planar loops
lie at height 0. Ellipses are 3 sigma at true size, seen from above.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from fgplan.closed_loop.records import LoopHistory, SessionRecord, SlamRecord
from fgplan.io.tum import spatial_matrix
from fgplan.typing import FloatArray
from fgplan.viz.ellipse import ellipse_outlines, world_position_covariances
from fgplan.viz.loop_tracks import LoopTracks, check_steps, loop_tracks
from fgplan.viz.palette import LANDMARK, OBSTACLE, UNCHANGED, UNMAPPED, robot_styles
from roadmaps import Workspace

FRAME = "map"
_SIGMAS = 3.0
_CHUNK = 50
"""Steps of one piece of a trail: a trail that grew whole would be stored once a step."""


@dataclass(frozen=True, slots=True)
class LineLayer:
    """Lines of one look.

    Attributes:
        lines: Each of shape (n, 3), metres.
        color: Hexadecimal.
        alpha: Opacity.
    """

    lines: tuple[FloatArray, ...]
    color: str
    alpha: float = 1.0


@dataclass(frozen=True, slots=True)
class PointLayer:
    """Points of one look.

    Attributes:
        points: Shape (n, 3), metres.
        color: Hexadecimal.
        labels: One a point, or none.
    """

    points: FloatArray
    color: str
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Layers:
    """What is new at one time.

    Attributes:
        step: Steps since the start.
        time_s: Seconds since the start.
        lines: By name.
        points: By name.
        poses: ``wTr`` by name, shape (4, 4).
        numbers: By name.
    """

    step: int
    time_s: float
    lines: Mapping[str, LineLayer] = field(default_factory=dict)
    points: Mapping[str, PointLayer] = field(default_factory=dict)
    poses: Mapping[str, FloatArray] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)


def static_layers(history: LoopHistory, workspace: Workspace | None = None) -> Layers:
    """What stays as it is: bounds, obstacles, goals, true landmarks.

    Args:
        history: The loop.
        workspace: Bounds and obstacles, or None.

    Returns:
        Layers at the first step.

    Raises:
        InvalidInputError: If there is no step.
    """
    check_steps(history)
    lines: dict[str, LineLayer] = {}
    if workspace is not None:
        (left, low), (right, high) = workspace.lower[:2], workspace.upper[:2]
        bounds = np.array([(left, low), (right, low), (right, high), (left, high), (left, low)])
        lines["world/bounds"] = LineLayer((_raise(bounds),), OBSTACLE)
        corners = [np.asarray(polygon) for polygon in workspace.obstacles]
        closed = [np.concatenate([polygon, polygon[:1]]) for polygon in corners]
        lines["world/obstacles"] = LineLayer(tuple(map(_raise, closed)), OBSTACLE)
    points = {}
    styles = robot_styles(history.robots)
    for robot, goals in history.goals.items():
        where = _raise(np.atleast_2d(goals))
        labels = tuple(f"{robot} {number}" for number in range(1, len(where) + 1))
        points[f"{robot}/goals"] = PointLayer(where, styles[robot].color, labels)
    if history.landmarks:
        places = _raise(np.array(list(history.landmarks.values())))
        points["world/landmarks_true"] = PointLayer(places, UNMAPPED)
    first = history.steps[0]
    return Layers(step=first.step, time_s=first.time_s, lines=lines, points=points)


def loop_layers(history: LoopHistory) -> Iterator[Layers]:
    """What is new at each step, in order.

    Args:
        history: The loop.

    Yields:
        Layers of each step; those of a planning session come after its step's own, at one stamp.

    Raises:
        InvalidInputError: If there is no step, or a step lacks a robot.
    """
    tracks = loop_tracks(history)
    for place, record in enumerate(history.steps):
        yield _step_layers(history, tracks, place)
        for session in history.sessions:
            if session.step == record.step:
                yield _session_layers(history, session)
    if history.final is not None:
        last = history.steps[-1]
        lines, points = _map_layers(history.final)
        yield Layers(step=last.step, time_s=last.time_s, lines=lines, points=points)


def _step_layers(history: LoopHistory, tracks: LoopTracks, place: int) -> Layers:
    """Where the robots are at a step, and what they measure."""
    record = history.steps[place]
    begin = place - place % _CHUNK
    styles = robot_styles(history.robots)
    lines: dict[str, LineLayer] = {}
    poses: dict[str, FloatArray] = {}
    numbers: dict[str, float] = {}
    for robot in history.robots:
        color = styles[robot].color
        poses[f"{robot}/estimate"] = estimate = spatial_matrix(record.estimates[robot])
        poses[f"{robot}/truth"] = truth = spatial_matrix(record.truth[robot])
        center = tracks.positions[robot][place : place + 1]
        covariance = tracks.covariances[robot][place : place + 1]
        outline = _closed(ellipse_outlines(center, covariance, _SIGMAS)[0], estimate[2, 3])
        lines[f"{robot}/covariance"] = LineLayer((outline,), color)
        # From the last pose of the piece before, so that pieces join.
        piece = history.steps[max(begin - 1, 0) : place + 1]
        for name, kind, look in (("estimated", "estimates", color), ("true", "truth", "#000000")):
            way = np.array([spatial_matrix(getattr(one, kind)[robot])[:3, 3] for one in piece])
            lines[f"{robot}/trail_{name}/{begin // _CHUNK}"] = LineLayer((way,), look)
        seen = tuple(
            np.stack([truth[:3, 3], _raise(history.landmarks[int(one.target)][None])[0]])
            for one in record.measurements
            if one.robot == robot and one.kind == "landmark" and one.target in history.landmarks
        )
        lines[f"{robot}/measurements"] = LineLayer(seen, color, 0.5)
        numbers[f"sigma_m/{robot}"] = float(np.sqrt(tracks.traces[robot][place]))
        numbers[f"error_m/{robot}"] = float(np.linalg.norm(estimate[:3, 3] - truth[:3, 3]))
    return Layers(step=record.step, time_s=record.time_s, lines=lines, poses=poses, numbers=numbers)


def _session_layers(history: LoopHistory, session: SessionRecord) -> Layers:
    """What a planning session looked at and chose."""
    lines, points = _map_layers(session.estimate)
    styles = robot_styles(history.robots)
    for robot in history.robots:
        color = styles[robot].color
        candidates = tuple(_way(path.poses) for path in session.candidates.get(robot, ()))
        lines[f"{robot}/candidates"] = LineLayer(candidates, color, 0.35)
        path = session.chosen.get(robot)
        chosen = () if path is None else (_way(path.poses),)
        lines[f"{robot}/chosen"] = LineLayer(chosen, color)
        planned: tuple[FloatArray, ...] = ()
        if path is not None and robot in session.covariances:
            blocks = world_position_covariances(path.poses, session.covariances[robot])
            where = _way(path.poses)
            outlines = ellipse_outlines(where[:, :2], blocks, _SIGMAS)
            planned = tuple(_closed(o, z) for o, z in zip(outlines, where[:, 2], strict=True))
        lines[f"{robot}/planned_covariance"] = LineLayer(planned, color, 0.6)
    factors = tuple(
        np.stack([spatial_matrix(one.pose)[:3, 3], spatial_matrix(other.pose)[:3, 3]])
        for one, other in session.joined
    )
    lines["multi_robot_factors"] = LineLayer(factors, UNCHANGED, 0.6)
    numbers = {f"planning_s/{name}": run.seconds for name, run in session.runs.items()}
    if session.values:
        numbers["objective"] = session.values[-1]
    return Layers(
        step=session.step, time_s=session.time_s, lines=lines, points=points, numbers=numbers
    )


def _map_layers(result: SlamRecord) -> tuple[dict[str, LineLayer], dict[str, PointLayer]]:
    """Estimated landmarks with their ellipses."""
    if not result.landmarks:
        return {}, {}
    where = _raise(np.array(list(result.landmarks.values())))
    blocks = [result.landmark_covariances[key][:2, :2] for key in result.landmarks]
    outlines = ellipse_outlines(where[:, :2], np.array(blocks), _SIGMAS)
    closed = tuple(_closed(o, z) for o, z in zip(outlines, where[:, 2], strict=True))
    lines = {"landmarks/covariance": LineLayer(closed, LANDMARK, 0.6)}
    return lines, {"landmarks/estimated": PointLayer(where, LANDMARK)}


def _way(poses: FloatArray) -> FloatArray:
    """Positions of poses, shape (n, 3)."""
    return np.array([spatial_matrix(pose)[:3, 3] for pose in poses])


def _raise(points: FloatArray) -> FloatArray:
    """Points of shape (n, 2) or (n, 3) as (n, 3); planar ones lie at height 0."""
    if points.shape[1] == 3:
        return points
    return np.pad(points, ((0, 0), (0, 1)))


def _closed(outline: FloatArray, height: float) -> FloatArray:
    """An outline as a closed line at a height."""
    return np.column_stack([outline, np.full(len(outline), height)])
