"""Candidate paths from paths over roadmap vertices: poses, times, noise, planned observations.

Pose 0 is the estimate of the current pose; the heading of a later pose is the direction of the edge
by which it was reached. Time is travelled length over the robot's speed.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError
from fgplan.models.motion import MotionModel
from fgplan.models.pose import check_pose, position, tangent_dim
from fgplan.models.sensor import AbstractSensor, SightLines
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.paths.planned_observations import planned_observations
from fgplan.typing import ArrayLike, FloatArray, Key, Pose
from roadmaps import VertexPath, headings, space_positions

START_TOLERANCE_M = 1e-6
"""Farther than this from the current pose a path starts elsewhere."""


def make_candidate_paths(
    robot: str,
    start: ArrayLike,
    vertex_paths: Sequence[VertexPath],
    motion: MotionModel,
    *,
    sensors: Mapping[str, AbstractSensor] | None = None,
    landmarks: Mapping[Key, ArrayLike] | None = None,
    workspace: SightLines | None = None,
    spacing_m: float | None = None,
) -> tuple[CandidatePath, ...]:
    """Make candidate paths of one robot.

    Args:
        robot: Its name.
        start: The prior's estimate of its current pose, shape (3,) or (4, 4), world frame:
            ``Belief.pose`` of its key.
        vertex_paths: Vertices and positions in the plane from the start on, as
            ``roadmaps.find_candidate_paths`` gives them.
        motion: Gives noise and speed.
        sensors: Sensors that the robot carries, by their names in the planning problem.
        landmarks: Position of each mapped landmark by key, shape (2,) or (3,), metres, world
            frame: ``Belief.landmarks()``. Sensors and landmarks are given together.
        workspace: What blocks the view of landmarks; None blocks nothing.
        spacing_m: Greatest distance of consecutive poses, metres; None adds none along edges.

    Returns:
        One candidate a vertex path, in the same order, with an observation at every step >= 1 from
        which a sensor sees a landmark. A robot in space keeps its height and stays level.

    Raises:
        InvalidInputError: If a path starts elsewhere or has one vertex, the motion model is for
            other poses, or only one of sensors and landmarks is given; names the robot.

    Example:
        >>> way = VertexPath((0, 1), [[0.0, 0.0], [3.0, 4.0]], 5.0)
        >>> motion = MotionModel(sigmas=[0.1, 0.1, 0.01], speed_m_per_s=2.0)
        >>> [path] = make_candidate_paths("ann", [0.0, 0.0, 0.0], [way], motion)
        >>> path.poses[-1].round(3), path.times_s
        (array([3.   , 4.   , 0.927]), array([0. , 2.5]))
    """
    pose = check_pose(start, f"robot {robot!r}: start")
    _check_arguments(robot, pose, vertex_paths, motion, spacing_m)
    if (sensors is None) != (landmarks is None):
        missing = "sensors" if sensors is None else "landmarks"
        raise InvalidInputError(
            f"robot {robot!r}: expected sensors and landmarks together, got no {missing}; "
            "Belief.landmarks() gives those of a prior"
        )
    ways = [_way(path, pose, spacing_m) for path in vertex_paths]
    seen: list[tuple[Observation, ...]] = [()] * len(ways)
    if sensors and landmarks:
        seen = planned_observations([way.poses for way in ways], sensors, landmarks, workspace)
    return tuple(
        CandidatePath(
            robot=robot,
            poses=way.poses,
            times_s=way.lengths_m / motion.speed_m_per_s,
            motion_covariances=motion.covariances(way.poses),
            vertices=way.vertices,
            length_m=path.length_m,
            observations=observations,
        )
        for path, way, observations in zip(vertex_paths, ways, seen, strict=True)
    )


class _Way(NamedTuple):
    """Poses along a path, the vertex of each (-1 between vertices) and its length up to each."""

    poses: FloatArray
    vertices: tuple[int, ...]
    lengths_m: FloatArray


def _way(path: VertexPath, start: Pose, spacing_m: float | None) -> _Way:
    """Poses along a path over vertices."""
    places = space_positions(path, spacing_m)
    vertices, reached = [], 0
    for place in places:
        at_vertex = reached < len(path.vertices) and (place == path.positions[reached]).all()
        vertices.append(path.vertices[reached] if at_vertex else -1)
        reached += at_vertex
    if start.ndim == 1:
        angles = headings(places, first_heading_rad=float(start[2]))
        poses = np.column_stack([places, angles])
    else:
        angles = headings(places)
        poses = np.tile(np.eye(4), (len(places), 1, 1))
        poses[:, 0, 0] = poses[:, 1, 1] = np.cos(angles)
        poses[:, 1, 0] = np.sin(angles)
        poses[:, 0, 1] = -np.sin(angles)
        poses[:, :2, 3] = places
        poses[:, 2, 3] = start[2, 3]
    poses[0] = start
    steps_m = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return _Way(poses, tuple(vertices), np.append(0.0, np.cumsum(steps_m)))


def _check_arguments(
    robot: str,
    start: Pose,
    vertex_paths: Sequence[VertexPath],
    motion: MotionModel,
    spacing_m: float | None,
) -> None:
    """Refuse paths that start elsewhere and noise of another dimension."""
    if isinstance(vertex_paths, VertexPath) or not all(
        isinstance(path, VertexPath) for path in vertex_paths
    ):
        raise InvalidInputError(
            f"robot {robot!r}: expected a sequence of VertexPath, got "
            f"{type(vertex_paths).__name__}; roadmaps.find_candidate_paths gives one"
        )
    dim = tangent_dim(start)
    if motion.sigmas.size != dim:
        raise InvalidInputError(
            f"robot {robot!r}: expected a motion model of {dim} sigmas for its poses, got "
            f"{motion.sigmas.size}"
        )
    if spacing_m is not None:
        check_positive(spacing_m, f"robot {robot!r}: spacing_m")
    here = position(start)[:2]
    for place, path in enumerate(vertex_paths):
        if path.positions.shape[1] != 2:
            raise InvalidInputError(
                f"robot {robot!r}: expected paths in the plane, got positions of shape "
                f"{path.positions.shape}"
            )
        if len(path.vertices) < 2:
            raise InvalidInputError(
                f"robot {robot!r}: expected a path of at least two vertices, got one: path {place} "
                f"starts at its goal"
            )
        if np.abs(path.positions[0] - here).max() > START_TOLERANCE_M:
            raise InvalidInputError(
                f"robot {robot!r}: expected paths from its current position {here.tolist()}, got "
                f"path {place} from {path.positions[0].tolist()}; make the current position a "
                "vertex (build_prm: required_positions, connect_positions) and search from it"
            )
