"""What the team may do in the park: sensors, roadmap, goals, candidate paths, objective.

There is no obstacle map of the park. A robot may go anywhere within the bounds of what was driven
(and a margin), except through mapped trees, which are discs; nothing blocks a view.

Motion noise: the log has one noise for every odometry step, whatever its length. Half of its
variance is spread over the metres of the log and half over the radians turned, so that the log as
driven carries what its file says,

    per_metre^2 = sigma^2 steps / (2 metres),      per_radian^2 = sigma^2 steps / (2 radians).

Goals, from the data alone: robot i goes to the driven place to which its straight way leads
through the longest stretch without a mapped tree in sensor range (of equal ones to the farthest),
at least so far from its start and from the goals of the robots before it. So every robot leaves
mapped ground, crosses what nobody has seen where there is such ground, and comes back to mapped
ground.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import networkx as nx
import numpy as np
from scipy.spatial import cKDTree

from fgplan.demos.victoria_log import TeamPast, VictoriaLog
from fgplan.errors import NoCandidatePathError
from fgplan.evaluation.objective import length_and_uncertainty
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.paths.path_making import make_candidate_paths
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.planners.impacted_paths.vertex_paths import find_vertex_paths
from fgplan.typing import FloatArray, Key
from roadmaps import Workspace

LASER = "laser"
LASER_RANGE_M = 20.0
LASER_VIEW_RAD = np.pi
"""The vehicle's SICK laser sees half a circle; the log's farthest sighting is 20.7 m away."""

SPEED_M_PER_S = 2.0
MARGIN_M = 20.0
TREE_RADIUS_M = 1.0
"""Trunk and half the vehicle's width; the log passes no tree nearer than 1.5 m."""

_TREE_CORNERS = 8
_STRIDE = 10
_PROBE_M = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamOptions:
    """Numbers of the demo that are a choice, each printed.

    Attributes:
        candidates: Candidate paths a robot.
        vertices: Vertices of the PRM.
        neighbours: Nearest vertices that it tries to join.
        spacing_m: Greatest distance of consecutive poses on a path, metres.
        meeting_m: Two poses of different robots nearer than this are joined by a factor, metres.
        meeting_sigmas: Noise of a relative pose: m, m, rad.
        path_weight: Of (41), a metre.
        uncertainty_weight: Of (41), a square metre.
        goal_distance_m: Least distance between two goals, metres.
        way_m: Least straight distance to a goal, metres.
    """

    candidates: int = 20
    vertices: int = 250
    neighbours: int = 8
    spacing_m: float = 12.0
    meeting_m: float = 15.0
    meeting_sigmas: tuple[float, float, float] = (0.3, 0.3, 0.03)
    path_weight: float = 0.003
    uncertainty_weight: float = 1.0
    goal_distance_m: float = 40.0
    way_m: float = 100.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VictoriaTeam:
    """The planning problem and its candidate paths.

    Attributes:
        problem: Prior, team, objective and models.
        candidates: Candidate paths by robot, the shortest first.
        goals: Shape (2,) by robot, metres, world frame.
        unmapped_m: By robot, length of the straight way to its goal without a tree in range.
        workspace: Bounds, and trees as obstacles.
        roadmap: The PRM.
        motion: Motion model of every robot.
        laser: Sensor of every robot.
    """

    problem: PlanningProblem
    candidates: Mapping[str, tuple[CandidatePath, ...]] = field(repr=False)
    goals: Mapping[str, FloatArray]
    unmapped_m: Mapping[str, float]
    workspace: Workspace = field(repr=False)
    roadmap: nx.Graph = field(repr=False)
    motion: MotionModel
    laser: BearingRangeSensor


def prepare_team(
    log: VictoriaLog, past: TeamPast, options: TeamOptions, generator: np.random.Generator
) -> VictoriaTeam:
    """Make problem and candidate paths from the team's past.

    Args:
        log: For the noise of its sensors.
        past: What the team knows.
        options: What is a choice.
        generator: Source of the roadmap.

    Returns:
        Problem and candidates.

    Raises:
        NoCandidatePathError: If a robot's goal cannot be reached; names it.
    """
    robots = tuple(past.parts)
    trees = past.belief.landmarks()
    starts = {robot: past.belief.pose(keys[-1]) for robot, keys in past.parts.items()}
    laser = laser_of(log)
    motion = motion_of(log)
    goals, unmapped_m = choose_goals(past, starts, np.array(list(trees.values())), options)
    workspace = park_workspace(past, np.array(list(trees.values())))
    found = find_vertex_paths(
        workspace,
        {robot: np.vstack([starts[robot][:2], goals[robot]]) for robot in robots},
        CandidateOptions(
            candidates=options.candidates,
            vertices=options.vertices,
            neighbours=options.neighbours,
        ),
        generator,
    )
    for robot, reason in found.reasons.items():
        raise NoCandidatePathError(f"robot {robot!r}: expected a way to its goal: {reason}")
    # Trunks are thin and nothing else is mapped: without a workspace, nothing blocks a view.
    candidates = {
        robot: make_candidate_paths(
            robot,
            starts[robot],
            found.paths[robot],
            motion,
            sensors={LASER: laser},
            landmarks=trees,
            spacing_m=options.spacing_m,
        )
        for robot in robots
    }
    return VictoriaTeam(
        problem=PlanningProblem(
            prior=past.belief,
            start_keys={robot: keys[-1] for robot, keys in past.parts.items()},
            objective=length_and_uncertainty(
                robots, options.path_weight, options.uncertainty_weight
            ),
            multi_robot=(
                MultiRobotModel(
                    criterion=DistanceCriterion(options.meeting_m),
                    sensor=RelativePoseSensor(
                        covariance=np.diag(np.square(options.meeting_sigmas))
                    ),
                ),
            ),
            sensors={LASER: laser},
        ),
        candidates=candidates,
        goals=goals,
        unmapped_m=unmapped_m,
        workspace=workspace,
        roadmap=found.roadmaps[""],
        motion=motion,
        laser=laser,
    )


def laser_of(log: VictoriaLog) -> BearingRangeSensor:
    """The log's laser: its noise, 20 m, half a circle."""
    bearing_rad, range_m = log.sighting_sigmas
    return BearingRangeSensor(
        bearing_sigma_rad=float(bearing_rad),
        range_sigma_m=float(range_m),
        max_range_m=LASER_RANGE_M,
        field_of_view_rad=LASER_VIEW_RAD,
    )


def motion_of(log: VictoriaLog) -> MotionModel:
    """Motion noise that gives the log as driven the variance that its file says."""
    metres = float(np.linalg.norm(log.steps[:, :2], axis=1).sum())
    radians = float(np.abs(log.steps[:, 2]).sum())
    half = 0.5 * len(log.steps) * log.odometry_sigmas**2
    return MotionModel(
        sigmas=np.zeros(3),
        per_metre=np.sqrt(half / metres),
        per_radian=np.sqrt(half / radians),
        speed_m_per_s=SPEED_M_PER_S,
    )


def park_workspace(past: TeamPast, trees: FloatArray) -> Workspace:
    """Bounds of what was driven with a margin; trees are octagons.

    Args:
        past: What was driven.
        trees: Shape (T, 2), metres, world frame.

    Returns:
        The workspace.
    """
    driven = np.vstack([past.trajectory(robot)[:, :2] for robot in past.parts])
    angle = 2.0 * np.pi * (np.arange(_TREE_CORNERS) + 0.5) / _TREE_CORNERS
    corners = TREE_RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)])
    return Workspace(
        lower=driven.min(axis=0) - MARGIN_M,
        upper=driven.max(axis=0) + MARGIN_M,
        obstacles=[tree + corners for tree in trees],
    )


def choose_goals(
    past: TeamPast, starts: Mapping[str, FloatArray], trees: FloatArray, options: TeamOptions
) -> tuple[dict[str, FloatArray], dict[str, float]]:
    """Goals across unmapped ground, see the module header.

    Args:
        past: What was driven.
        starts: Current pose of each robot, shape (3,).
        trees: Shape (T, 2), metres, world frame.
        options: Least distances.

    Returns:
        Goal of each robot, shape (2,), metres; and the longest unmapped stretch of its straight
        way, metres.

    Raises:
        NoCandidatePathError: If no driven place is far enough.
    """
    driven = np.vstack([past.trajectory(robot)[::_STRIDE, :2] for robot in past.parts])
    tree = cKDTree(trees)
    places = driven[tree.query(driven)[0] <= LASER_RANGE_M]
    goals: dict[str, FloatArray] = {}
    unmapped_m: dict[str, float] = {}
    for robot, start in starts.items():
        taken = np.array(list(goals.values())).reshape(-1, 2)
        apart = np.linalg.norm(places[:, None] - taken[None], axis=2).min(axis=1, initial=np.inf)
        way = np.linalg.norm(places - start[:2], axis=1)
        eligible = np.flatnonzero((apart >= options.goal_distance_m) & (way >= options.way_m))
        if not eligible.size:
            raise NoCandidatePathError(
                f"robot {robot!r}: expected a driven place {options.way_m:g} m away and "
                f"{options.goal_distance_m:g} m from other goals; this part of the log is too short"
            )
        stretches = {
            int(index): _longest_unmapped_m(start[:2], places[index], tree) for index in eligible
        }
        best = max(stretches, key=lambda index: (stretches[index], way[index]))
        goals[robot], unmapped_m[robot] = places[best], stretches[best]
    return goals, unmapped_m


def _longest_unmapped_m(start: FloatArray, goal: FloatArray, trees: cKDTree) -> float:
    """Longest stretch of a straight way that is out of sensor range of every tree, metres."""
    length = float(np.linalg.norm(goal - start))
    count = max(2, int(np.ceil(length / _PROBE_M)) + 1)
    probes = start + np.linspace(0.0, 1.0, count)[:, None] * (goal - start)
    longest = run = 0
    for far in trees.query(probes)[0] > LASER_RANGE_M:
        run = run + 1 if far else 0
        longest = max(longest, run)
    return longest * length / (count - 1)


def observed_trees(path: CandidatePath) -> tuple[Key, ...]:
    """Mapped trees that a path would observe, each once, ascending."""
    return tuple(sorted({seen.landmark for seen in path.observations}))


def steps_with_a_view(paths: Sequence[CandidatePath]) -> tuple[int, int]:
    """How many steps of some paths observe a mapped tree, and how many none."""
    total = sum(path.steps for path in paths)
    seeing = sum(len({seen.step for seen in path.observations}) for path in paths)
    return seeing, total - seeing
