"""The open world of section 7.1 of Regev and Indelman 2017, as far as the paper prints it.

2000 x 2500 m without obstacles, a PRM, robots that start in the south and have goals in the north,
multi-robot factors between any two poses nearer than 300 m, objective (41) with 0.1 and 1. The
paper does not print its noise, its roadmap or how candidates are drawn; ours: 400 vertices and 8
nearest neighbours; starts in y < 300 and goals in y > 2200, uniform; candidates are shortest paths
under randomly perturbed edge weights; odometry 1 m, 1 m, 0.01 rad a step, relative pose 5 m, 5 m,
0.05 rad, start 1 mm, 1 mm, 0.1 mrad.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.evaluation.objective import length_and_uncertainty
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.motion import MotionModel
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.paths.path_making import make_candidate_paths
from fgplan.typing import FloatArray
from roadmaps import (
    KNearest,
    Workspace,
    build_prm,
    find_perturbed_paths,
    read_roadmap,
)

WIDTH_M, HEIGHT_M = 2000.0, 2500.0
START_BELOW_M, GOAL_ABOVE_M = 300.0, 2200.0
VERTICES, NEIGHBOURS = 400, 8
CRITERION_M = 300.0
START_SIGMAS = (1e-3, 1e-3, 1e-4)
STEP_SIGMAS = (1.0, 1.0, 0.01)
MEETING_SIGMAS = (5.0, 5.0, 0.05)
SPEED_M_PER_S = 10.0
SPREAD = 1.0


@dataclass(frozen=True, slots=True)
class OpenWorld:
    """One drawn world.

    Attributes:
        workspace: Bounds.
        roadmap: The PRM as a networkx graph.
        problem: Prior, team, objective and models.
        candidates: Candidate paths by robot.
        starts: Shape (R, 2), metres.
        goals: Shape (R, 2), metres.
    """

    workspace: Workspace
    roadmap: object
    problem: PlanningProblem
    candidates: dict[str, tuple[CandidatePath, ...]]
    starts: FloatArray
    goals: FloatArray


def draw_world(
    robots: int,
    candidates: int,
    generator: np.random.Generator,
    *,
    criterion_m: float = CRITERION_M,
    lanes: bool = False,
) -> OpenWorld:
    """Draw a world.

    Args:
        robots: Number of robots.
        candidates: Candidate paths a robot.
        generator: Source of all randomness.
        criterion_m: Distance below which two poses are joined by a factor, metres.
        lanes: The world in which robots meet seldom: robot i starts and ends in the i-th of
            equally wide lanes; otherwise starts and goals are anywhere in the two strips.

    Returns:
        The world.
    """
    workspace = Workspace(lower=np.zeros(2), upper=np.array([WIDTH_M, HEIGHT_M]))
    starts = _positions(generator, robots, (0.0, START_BELOW_M), lanes)
    goals = _positions(generator, robots, (GOAL_ABOVE_M, HEIGHT_M), lanes)
    roadmap = build_prm(
        workspace,
        VERTICES,
        generator,
        connection=KNearest(NEIGHBOURS),
        required_positions=np.vstack([starts, goals]),
    )
    names = tuple(f"robot{index}" for index in range(robots))
    problem = _problem(names, starts, criterion_m)
    motion = MotionModel(sigmas=np.array(STEP_SIGMAS), speed_m_per_s=SPEED_M_PER_S)
    matrix = read_roadmap(roadmap)
    paths = {
        name: make_candidate_paths(
            name,
            problem.prior.pose(problem.start_keys[name]),
            find_perturbed_paths(
                matrix, index, robots + index, candidates, generator, spread=SPREAD
            ),
            motion,
        )
        for index, name in enumerate(names)
    }
    return OpenWorld(workspace, roadmap, problem, paths, starts, goals)


def _positions(
    generator: np.random.Generator, robots: int, strip: tuple[float, float], lanes: bool
) -> FloatArray:
    """A position a robot in a strip of y; in lanes, in the middle fifth of the robot's lane."""
    share = generator.uniform(0.0, 1.0, robots)
    lane = WIDTH_M / robots
    x = lane * (np.arange(robots) + 0.4 + 0.2 * share) if lanes else WIDTH_M * share
    return np.column_stack([x, generator.uniform(*strip, robots)])


def _problem(names: Sequence[str], starts: FloatArray, criterion_m: float) -> PlanningProblem:
    """Independent priors, one relative-pose model."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array(START_SIGMAS))
    for key, (x, y) in enumerate(starts):
        pose = gtsam.Pose2(x, y, np.pi / 2)
        graph.add(gtsam.PriorFactorPose2(key, pose, noise))
        values.insert(key, pose)
    meeting = MultiRobotModel(
        criterion=DistanceCriterion(criterion_m),
        sensor=RelativePoseSensor(covariance=np.diag(np.array(MEETING_SIGMAS) ** 2)),
    )
    return PlanningProblem(
        prior=Belief(graph, values),
        start_keys={name: key for key, name in enumerate(names)},
        objective=length_and_uncertainty(names),
        multi_robot=(meeting,),
    )
