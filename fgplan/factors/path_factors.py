"""All factors that a path, a pair of paths, or a team's joint choice brings into the belief.

Equation (11) of Regev and Indelman 2017: the prior, times for every robot the local factors of its
path (9), times the multi-robot factors of every pair of robots. A robot that has announced nothing
stays at its current pose and brings nothing, but others may join its past states.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Protocol

from fgplan.errors import InvalidInputError
from fgplan.factors.factor_set import FactorSet, PlannedFactor
from fgplan.factors.keys import future_key
from fgplan.factors.motion import motion_factors
from fgplan.factors.multi_robot import KeyedState, multi_robot_factors
from fgplan.factors.observation import Estimates, observation_factors
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.multi_robot import MultiRobotModel
from fgplan.paths.state import State
from fgplan.typing import Key


class KnownState(Protocol):
    """A past or current state and its key in the prior."""

    @property
    def key(self) -> Key:
        """Key in the prior."""
        ...

    @property
    def state(self) -> State:
        """Robot, step of zero or less, time and pose."""
        ...


class FactorProblem(Protocol):
    """What factors need of a planning problem (fgplan.evaluation.problem.PlanningProblem)."""

    @property
    def prior(self) -> Estimates:
        """Where landmarks are."""
        ...

    @property
    def start_keys(self) -> Mapping[str, Key]:
        """Key of each robot's current pose, in the order of the team."""
        ...

    @property
    def multi_robot(self) -> tuple[MultiRobotModel, ...]:
        """Models of factors between robots."""
        ...

    @property
    def sensors(self) -> Mapping[str, AbstractSensor]:
        """Sensors of landmarks by name."""
        ...

    @property
    def past_states(self) -> Sequence[KnownState]:
        """Past states that may take part in multi-robot factors."""
        ...


def pose_key(problem: FactorProblem, robot: str, step: int) -> Key:
    """Key of a robot's pose: the prior's at step 0, else the look-ahead pose's."""
    if step == 0:
        return problem.start_keys[robot]
    return future_key(tuple(problem.start_keys).index(robot), step)


def path_keys(problem: FactorProblem, path: CandidatePath) -> tuple[Key, ...]:
    """Keys of poses 0 to L of a path."""
    index = tuple(problem.start_keys).index(path.robot)
    start = problem.start_keys[path.robot]
    return (start, *(future_key(index, step) for step in range(1, path.steps + 1)))


def local_factors(problem: FactorProblem, path: CandidatePath) -> FactorSet:
    """Motion and observation factors of one path: FG_local of equation (9)."""
    keys = path_keys(problem, path)
    motion = motion_factors(path, keys)
    return FactorSet(motion + observation_factors(path, keys, problem.sensors, problem.prior))


def past_factors(problem: FactorProblem, path: CandidatePath) -> FactorSet:
    """Multi-robot factors of one path with past states of the others; no announcement matters."""
    factors: list[PlannedFactor] = []
    own = _future_states(problem, path)
    for other in problem.start_keys:
        if other != path.robot:
            factors.extend(_between(problem, path.robot, own, other, _past_states(problem, other)))
    return FactorSet(tuple(factors))


def pair_factors(problem: FactorProblem, path: CandidatePath, other: CandidatePath) -> FactorSet:
    """Multi-robot factors between the future states of two robots' paths.

    Args:
        problem: Models and order of the team.
        path: Path of one robot.
        other: Path of another; the order of the two does not matter.

    Returns:
        Factors by model, then by the states of the robot earlier in the team.

    Raises:
        InvalidInputError: If both paths are of one robot.
    """
    if path.robot == other.robot:
        raise InvalidInputError(
            f"multi-robot factors: expected paths of two robots, got two of {path.robot!r}"
        )
    own, theirs = _future_states(problem, path), _future_states(problem, other)
    return FactorSet(_between(problem, path.robot, own, other.robot, theirs))


def team_factors(
    problem: FactorProblem, paths: Mapping[str, CandidatePath], cut: int | None = None
) -> FactorSet:
    """All factors that a joint choice of paths adds to the prior.

    Args:
        problem: Models and order of the team.
        paths: Path of each robot that has one.
        cut: Look-ahead step of equation (21): only factors all of whose states have a step of at
            most ``cut``; None takes all.

    Returns:
        Local factors by robot, then factors with past states, then by pairs of robots.

    Raises:
        UnknownNameError: If a path's sensor or landmark is not known.
        InvalidInputError: If a noise is not positive definite.
    """
    chosen = [paths[robot] for robot in problem.start_keys if robot in paths]
    factors = [planned for path in chosen for planned in local_factors(problem, path)]
    factors += [planned for path in chosen for planned in past_factors(problem, path)]
    for path, other in combinations(chosen, 2):
        factors += pair_factors(problem, path, other)
    return FactorSet(tuple(factors)).cut(cut)


def _between(
    problem: FactorProblem,
    robot: str,
    own: Sequence[KeyedState],
    other: str,
    theirs: Sequence[KeyedState],
) -> tuple[PlannedFactor, ...]:
    """Factors between states of two robots, the earlier robot of the team first."""
    order = tuple(problem.start_keys)
    if order.index(robot) < order.index(other):
        return multi_robot_factors(problem.multi_robot, own, theirs)
    return multi_robot_factors(problem.multi_robot, theirs, own)


def _future_states(problem: FactorProblem, path: CandidatePath) -> list[KeyedState]:
    """States 1 to L with their keys."""
    return list(zip(path_keys(problem, path)[1:], path.states(), strict=True))


def _past_states(problem: FactorProblem, robot: str) -> list[KeyedState]:
    """Listed past and current states of one robot with their keys in the prior."""
    return [(past.key, past.state) for past in problem.past_states if past.state.robot == robot]
