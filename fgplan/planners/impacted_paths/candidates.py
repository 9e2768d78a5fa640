"""Candidate paths of a mission: a roadmap, paths over its vertices, poses and observations.

The options say how: one roadmap for the team or one a robot and leg, how many paths, how far apart
the poses. Landmarks of the prior are planned to be observed by the sensors that a robot carries.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import networkx as nx
import numpy as np

from fgplan.checks import check_generator
from fgplan.errors import InvalidInputError, NoCandidatePathError, UnknownNameError
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.pose import position
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.path_making import make_candidate_paths
from fgplan.planners.impacted_paths.options import CandidateOptions, read_options
from fgplan.planners.impacted_paths.vertex_paths import find_vertex_paths
from fgplan.planners.mission import Mission
from fgplan.team.options import WithoutPath


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
    options: CandidateOptions | None = None,
    generator: np.random.Generator | None = None,
    *,
    without_path: WithoutPath = "refuse",
) -> CandidateSets:
    """Make the candidate paths of every robot of a mission.

    Args:
        mission: What is given.
        options: How candidate paths are made; None takes what the mission's options say of it and
            leaves the planner's other options alone.
        generator: Source of randomness; None makes one from the mission's seed.
        without_path: ``refuse`` or ``stay``: whether a robot may be without a candidate.

    Returns:
        Problem and candidates.

    Raises:
        NoCandidatePathError: If a robot has no candidate and may not stay, or no robot has one;
            names robots and reason.
        OptionError: If an option of the mission has a value that is not usable.
        UnknownNameError: If a robot's sensor is not in the mission.

    Example:
        >>> from fgplan.io.mission_file import load_mission
        >>> sets = candidate_sets(load_mission("examples/scenarios/two_robots.toml"))
        >>> {robot: len(paths) for robot, paths in sets.candidates.items()}
        {'ann': 10, 'bob': 10}
    """
    if options is None:
        names = {option.name for option in fields(CandidateOptions)}
        given = {name: value for name, value in mission.options.items() if name in names}
        options = read_options(CandidateOptions, given, "candidate_sets")
    if generator is None:
        generator = np.random.default_rng(mission.seed)
    check_generator(generator, "candidate paths")
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
    landmarks = mission.prior.landmarks()
    candidates = {
        robot.name: make_candidate_paths(
            robot.name,
            starts[robot.name],
            found.paths.get(robot.name, ()),
            robot.motion,
            sensors={name: problem.sensors[name] for name in robot.sensors},
            landmarks=landmarks,
            workspace=mission.workspace,
            spacing_m=options.spacing_m,
        )
        for robot in mission.robots
    }
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
