"""What the five robots of MR.CLAM may do next: roadmap, goals, candidate paths, objective.

The arena is what the robots have driven and mapped, with a margin; the tubes that carry the
barcodes are the only obstacles and nothing blocks a view. Each robot goes to the driven place
farthest from where it is now, apart from every other robot and from the goals of those before it.
Along the paths the camera sees mapped landmarks, and other robots that are in view at the same
time, with the noise that SLAM used.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import networkx as nx
import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.errors import NoCandidatePathError
from fgplan.evaluation.objective import length_and_uncertainty
from fgplan.evaluation.problem import PlanningProblem
from fgplan.io.mrclam_steps import CAMERA, MrclamOptions
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.paths.path_making import make_candidate_paths
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.planners.impacted_paths.vertex_paths import find_vertex_paths
from fgplan.slam.team_slam import TeamSlam
from fgplan.typing import FloatArray
from roadmaps import Workspace

MARGIN_M = 0.3
TUBE_RADIUS_M = 0.25
"""Barcode tube and half a robot; in Dataset 6 no robot comes nearer than 0.47 m."""

_CORNERS = 8
_STRIDE = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class MrclamTeamOptions:
    """Numbers of the planning session that are a choice, each printed.

    Attributes:
        candidates: Candidate paths a robot.
        vertices: Vertices of the PRM.
        neighbours: Nearest vertices that it tries to join.
        spacing_m: Greatest distance of consecutive poses on a path, metres.
        together_s: Two robots see each other where their poses are no farther apart in time.
        path_weight: Of (41), a metre.
        uncertainty_weight: Of (41), a square metre.
        goal_distance_m: Least distance of a goal from the other goals and from every robot, metres.
    """

    candidates: int = 20
    vertices: int = 150
    neighbours: int = 8
    spacing_m: float = 0.5
    together_s: float = 3.5
    path_weight: float = 1e-4
    uncertainty_weight: float = 1.0
    goal_distance_m: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MrclamTeam:
    """The planning problem and its candidate paths.

    Attributes:
        problem: Prior, team, objective and models.
        candidates: Candidate paths by robot, the shortest first.
        goals: Shape (2,) by robot, metres, world frame.
        workspace: Bounds, and landmarks as obstacles.
        roadmap: The PRM.
    """

    problem: PlanningProblem
    candidates: Mapping[str, tuple[CandidatePath, ...]] = field(repr=False)
    goals: Mapping[str, FloatArray]
    workspace: Workspace = field(repr=False)
    roadmap: nx.Graph = field(repr=False)


def prepare_mrclam_team(
    slam: TeamSlam,
    belief: Belief,
    options: MrclamOptions,
    choices: MrclamTeamOptions,
    generator: np.random.Generator,
) -> MrclamTeam:
    """Make problem and candidate paths from what SLAM knows at the last tick.

    Args:
        slam: SLAM after the last tick.
        belief: Its belief.
        options: Camera and motion noise.
        choices: What is a choice.
        generator: Source of the roadmap.

    Returns:
        Problem and candidates.

    Raises:
        NoCandidatePathError: If a robot's goal cannot be reached; names it.
    """
    landmarks = belief.landmarks()
    keys = {robot: slam.key(robot) for robot in slam.robots}
    starts = {robot: belief.pose(key) for robot, key in keys.items()}
    driven = np.vstack([slam.trajectory(robot)[:, :2] for robot in slam.robots])
    workspace = arena(driven, np.array(list(landmarks.values())))
    goals = choose_goals(starts, driven[::_STRIDE], choices.goal_distance_m)
    found = find_vertex_paths(
        workspace,
        {robot: np.vstack([starts[robot][:2], goals[robot]]) for robot in slam.robots},
        CandidateOptions(
            candidates=choices.candidates,
            vertices=choices.vertices,
            neighbours=choices.neighbours,
        ),
        generator,
    )
    for robot, reason in found.reasons.items():
        raise NoCandidatePathError(f"robot {robot!r}: expected a way to its goal: {reason}")
    candidates = {
        robot: make_candidate_paths(
            robot,
            starts[robot],
            found.paths[robot],
            options.motion,
            sensors={CAMERA: options.camera},
            landmarks=landmarks,
            spacing_m=choices.spacing_m,
        )
        for robot in slam.robots
    }
    return MrclamTeam(
        problem=PlanningProblem(
            prior=belief,
            start_keys=keys,
            objective=length_and_uncertainty(
                slam.robots, choices.path_weight, choices.uncertainty_weight
            ),
            multi_robot=(
                MultiRobotModel(
                    criterion=DistanceCriterion(options.camera.max_range_m),
                    sensor=options.camera,
                    time_tolerance_s=choices.together_s,
                ),
            ),
            sensors={CAMERA: options.camera},
        ),
        candidates=candidates,
        goals=goals,
        workspace=workspace,
        roadmap=found.roadmaps[""],
    )


def arena(driven: FloatArray, landmarks: FloatArray) -> Workspace:
    """Bounds of what was driven and mapped with a margin; landmarks are octagons.

    Args:
        driven: Shape (n, 2), metres, world frame.
        landmarks: Shape (L, 2), metres, world frame.

    Returns:
        The workspace.
    """
    angle = 2.0 * np.pi * (np.arange(_CORNERS) + 0.5) / _CORNERS
    corners = TUBE_RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)])
    known = np.vstack([driven, landmarks])
    return Workspace(
        lower=known.min(axis=0) - MARGIN_M,
        upper=known.max(axis=0) + MARGIN_M,
        obstacles=[landmark + corners for landmark in landmarks],
    )


def choose_goals(
    starts: Mapping[str, FloatArray], places: FloatArray, apart_m: float
) -> dict[str, FloatArray]:
    """The driven place farthest from each robot, apart from all robots and from earlier goals.

    Args:
        starts: Current pose of each robot, shape (3,).
        places: Driven places, shape (n, 2), metres, world frame.
        apart_m: Least distance of a goal from robots and other goals, metres.

    Returns:
        Goal of each robot, shape (2,).

    Raises:
        NoCandidatePathError: If no place is left for a robot.
    """
    goals: dict[str, FloatArray] = {}
    present = [start[:2] for start in starts.values()]
    for robot, start in starts.items():
        taken = np.array([*present, *goals.values()])
        apart = np.linalg.norm(places[:, None] - taken[None], axis=2).min(axis=1)
        way = np.where(apart >= apart_m, np.linalg.norm(places - start[:2], axis=1), -np.inf)
        best = int(np.argmax(way))
        if not np.isfinite(way[best]):
            raise NoCandidatePathError(
                f"robot {robot!r}: expected a driven place {apart_m:g} m from all robots and other "
                "goals; this part of the log is too short"
            )
        goals[robot] = places[best]
    return goals
