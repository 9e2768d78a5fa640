"""Candidate paths of a mission: poses, times, motion noise and planned observations.

Pose 0 is the prior's estimate of the current pose; the heading of a later pose is the direction of
the edge by which it was reached. Time is travelled length over the robot's speed. A landmark of
the prior is planned to be observed from every pose from which a sensor of the robot sees it: range
and field of view by the sensor, line of sight by the workspace.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import networkx as nx
import numpy as np
from scipy.spatial import cKDTree

from fgplan.beliefs.belief import Belief
from fgplan.errors import InvalidInputError, NoCandidatePathError, UnknownNameError
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.pose import position
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.planners.impacted_paths.vertex_paths import find_vertex_paths
from fgplan.planners.mission import Mission, MissionRobot
from fgplan.typing import Covariance, FloatArray, Key, Pose
from roadmaps import VertexPath, Workspace, headings, space_positions


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateSets:
    """A mission turned into a planning problem with candidate paths.

    Attributes:
        problem: Prior, team, objective and models.
        candidates: Candidate paths of each robot, the shortest first.
        reasons: Why a robot has none.
        roadmaps: The team's roadmap under the empty name, or each robot's own.
    """

    problem: PlanningProblem
    candidates: Mapping[str, tuple[CandidatePath, ...]]
    reasons: Mapping[str, str]
    roadmaps: Mapping[str, nx.Graph]


def candidate_sets(
    mission: Mission,
    options: CandidateOptions,
    generator: np.random.Generator,
    *,
    without_path: str = "refuse",
) -> CandidateSets:
    """Make the candidate paths of every robot of a mission.

    Args:
        mission: What is given.
        options: How candidate paths are made.
        generator: Source of randomness.
        without_path: ``refuse`` or ``stay``: whether a robot may be without a candidate.

    Returns:
        Problem and candidates.

    Raises:
        NoCandidatePathError: If a robot has no candidate and may not stay, or no robot has one;
            names robots and reason.
        UnknownNameError: If a robot's sensor is not in the mission.
    """
    if not mission.robots:
        raise InvalidInputError("mission: expected at least one robot, got none")
    problem = planning_problem(mission)
    starts = {robot.name: mission.prior.pose(robot.start_key) for robot in mission.robots}
    stops = {
        robot.name: np.vstack([position(starts[robot.name])[:2], robot.goals[:, :2]])
        for robot in mission.robots
        if len(robot.goals)
    }
    found = find_vertex_paths(mission.workspace, stops, options, generator)
    reasons = {robot.name: "it has no goal" for robot in mission.robots if not len(robot.goals)}
    reasons |= found.reasons
    if reasons and (without_path == "refuse" or len(reasons) == len(mission.robots)):
        raise NoCandidatePathError(_without_paths(reasons, len(mission.robots)))
    landmarks = mapped_landmarks(mission.prior)
    candidates = {}
    for robot in mission.robots:
        bare = [
            candidate_path(robot, starts[robot.name], path, options.spacing_m)
            for path in found.paths.get(robot.name, ())
        ]
        carried = {name: problem.sensors[name] for name in robot.sensors}
        candidates[robot.name] = with_observations(bare, carried, landmarks, mission.workspace)
    return CandidateSets(
        problem=problem, candidates=candidates, reasons=reasons, roadmaps=found.roadmaps
    )


def _without_paths(reasons: Mapping[str, str], robots: int) -> str:
    """What to say of robots without candidates: why, and how to go on."""
    name, reason = next(iter(reasons.items()))
    others = [repr(other) for other in list(reasons)[1:]]
    also = (
        f" (nor {'have robots' if others[1:] else 'has robot'} {', '.join(others)})"
        if others
        else ""
    )
    remedy = "no robot of the team has one, so nothing is left to plan"
    if len(reasons) < robots:
        remedy = (
            f"to go on without {'them' if others else 'it'}, set without_path = 'stay' (in a "
            "scenario: under [team])"
        )
    return (
        f"robot {name!r}: expected at least one candidate path, got none: {reason}{also}; {remedy}"
    )


def planning_problem(mission: Mission) -> PlanningProblem:
    """What every robot knows alike.

    Raises:
        UnknownNameError: If a robot carries a sensor that the mission does not have.
    """
    for robot in mission.robots:
        for name in robot.sensors:
            if name not in mission.sensors:
                known = ", ".join(mission.sensors) or "none"
                raise UnknownNameError(
                    f"robot {robot.name!r}: sensor {name!r} is not one of: {known}"
                )
    return PlanningProblem(
        prior=mission.prior,
        start_keys={robot.name: robot.start_key for robot in mission.robots},
        objective=mission.objective,
        multi_robot=mission.multi_robot,
        sensors=mission.sensors,
        past_states=mission.past_states,
    )


def candidate_path(
    robot: MissionRobot, start: Pose, path: VertexPath, spacing_m: float | None = None
) -> CandidatePath:
    """Candidate path over roadmap vertices, without observations.

    Args:
        robot: Whose motion model gives noise and speed.
        start: The prior's estimate of its current pose, shape (3,) or (4, 4).
        path: Vertices and positions, from the start on.
        spacing_m: Greatest distance of consecutive poses, metres; None adds none.

    Returns:
        The path; a robot in space keeps its height and stays level.
    """
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
    way = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return CandidatePath(
        robot=robot.name,
        poses=poses,
        times_s=np.append(0.0, np.cumsum(way)) / robot.motion.speed_m_per_s,
        motion_covariances=robot.motion.covariances(poses),
        vertices=tuple(vertices),
        length_m=path.length_m,
    )


def mapped_landmarks(prior: Belief) -> dict[Key, FloatArray]:
    """Position of every landmark of a prior by key, metres, world frame."""
    return {key: prior.point(key) for key in prior.keys if prior.kinds[key] in ("Point2", "Point3")}


def with_observations(
    paths: Sequence[CandidatePath],
    sensors: Mapping[str, AbstractSensor],
    landmarks: Mapping[Key, FloatArray],
    workspace: Workspace | None = None,
) -> tuple[CandidatePath, ...]:
    """Add the planned observations of mapped landmarks.

    Args:
        paths: Candidates of one robot.
        sensors: The sensors that it carries, by name.
        landmarks: Position of each landmark by key, metres, world frame.
        workspace: What blocks the view; None blocks nothing.

    Returns:
        The same paths with an observation at every step >= 1 from which a sensor sees a landmark.
    """
    if not paths or not sensors or not landmarks:
        return tuple(paths)
    # Candidates share most states: each distinct pose is looked at once.
    place_of: dict[bytes, int] = {}
    poses: list[Pose] = []
    for path in paths:
        for pose in path.poses[1:]:
            if place_of.setdefault(pose.tobytes(), len(poses)) == len(poses):
                poses.append(pose)
    seen = _seen_landmarks(poses, sensors, landmarks, workspace)
    return tuple(
        CandidatePath(
            robot=path.robot,
            poses=path.poses,
            times_s=path.times_s,
            motion_covariances=path.motion_covariances,
            vertices=path.vertices,
            length_m=path.length_m,
            observations=tuple(
                Observation(step=step, landmark=key, sensor=name, covariance=covariance)
                for step in range(1, path.steps + 1)
                for key, name, covariance in seen[place_of[path.poses[step].tobytes()]]
            ),
        )
        for path in paths
    )


Seen = list[tuple[Key, str, Covariance]]


def _seen_landmarks(
    poses: Sequence[Pose],
    sensors: Mapping[str, AbstractSensor],
    landmarks: Mapping[Key, FloatArray],
    workspace: Workspace | None,
) -> list[Seen]:
    """Landmarks seen from each pose: by range from a tree, then by the sensor, then by sight."""
    keys = list(landmarks)
    flat = np.array([landmarks[key][:2] for key in keys])
    where = np.array([position(pose)[:2] for pose in poses])
    tree = cKDTree(flat)
    pairs: list[tuple[int, int, str]] = []
    for name, sensor in sensors.items():
        if np.isfinite(sensor.max_range_m):
            reach = sensor.max_range_m * (1.0 + 1e-9)  # the sensor itself decides at the edge
            near = tree.query_ball_point(where, reach, return_sorted=True)
        else:
            near = [range(len(keys))] * len(poses)
        pairs += [
            (place, index, name)
            for place, indices in enumerate(near)
            for index in indices
            if sensor.visible(poses[place], landmarks[keys[index]])
        ]
    if workspace is not None and pairs:
        starts = where[[pair[0] for pair in pairs]]
        ends = flat[[pair[1] for pair in pairs]]
        free = workspace.has_line_of_sight(starts, ends)
        pairs = [pair for pair, in_sight in zip(pairs, free.tolist(), strict=True) if in_sight]
    seen: list[Seen] = [[] for _ in poses]
    for place, index, name in pairs:
        key = keys[index]
        noise = sensors[name].noise(poses[place], landmarks[key])
        seen[place].append((key, name, noise))
    return seen
