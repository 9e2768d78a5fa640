"""The team's belief if every robot follows one path: equation (11), as a GTSAM graph.

    prior  x  for every robot: local factors of its path (9)  x  multi-robot factors of every pair

linearised at the planned poses and, for what the prior holds, at its estimate. Cut at a look-ahead
step l, only factors all of whose states have step <= l take part (equation 21), for all robots.
What a user gets is an ordinary factor graph with values, to look at, optimise or query.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import gtsam

from fgplan.beliefs.belief import Belief
from fgplan.errors import UnknownNameError
from fgplan.factors.boundary import gtsam_boundary
from fgplan.factors.factor_set import FactorSet
from fgplan.factors.motion import gtsam_pose
from fgplan.factors.path_factors import KnownState, path_keys, team_factors
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.multi_robot import MultiRobotModel
from fgplan.typing import Key


class BeliefProblem(Protocol):
    """What a belief needs of a planning problem (fgplan.evaluation.problem.PlanningProblem)."""

    @property
    def prior(self) -> Belief:
        """Belief at planning time."""
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

    def check_path(self, path: CandidatePath) -> None:
        """Check that a path belongs to the problem."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CandidateBelief:
    """The joint belief over prior and paths.

    Attributes:
        graph: Prior and planned factors.
        values: Linearisation point: the prior's estimate and the planned poses.
        factors: The planned factors with their provenance, in the order of the graph's end.
        keys: By robot, the keys of its poses by step that the cut leaves; step 0 is the prior's.
        cut: Look-ahead step of the cut, or None.
    """

    graph: gtsam.NonlinearFactorGraph = field(repr=False)
    values: gtsam.Values = field(repr=False)
    factors: FactorSet = field(repr=False)
    keys: Mapping[str, tuple[Key, ...]]
    cut: int | None

    def key(self, robot: str, step: int) -> Key:
        """Key of a robot's pose at a step; a path that has ended keeps its last state.

        Raises:
            UnknownNameError: If the robot is not in the team.
        """
        if robot not in self.keys:
            raise UnknownNameError(f"robot {robot!r}: expected one of {', '.join(self.keys)}")
        keys = self.keys[robot]
        return keys[min(step, len(keys) - 1)]

    def belief(self) -> Belief:
        """The belief to ask for covariances, by QR.

        Raises:
            IllPosedBeliefError: If a variable is not determined.
        """
        return Belief(self.graph, self.values)


def candidate_belief(
    problem: BeliefProblem, paths: Mapping[str, CandidatePath], cut: int | None = None
) -> CandidateBelief:
    """Joint belief if the robots follow these paths.

    Args:
        problem: Prior, models and order of the team.
        paths: Path of each robot that has one; the others stay at their current pose.
        cut: Look-ahead step of equation (21) of Regev and Indelman 2017, or None for all.

    Returns:
        The belief's graph, values and keys.

    Raises:
        UnknownNameError: If a path's robot, sensor or landmark is not known.
        InvalidInputError: If a path does not start at the prior's current pose, or a noise is not
            positive definite.
    """
    for robot in paths:
        problem.check_path(paths[robot])
    factors = team_factors(problem, paths, cut)
    graph = gtsam.NonlinearFactorGraph(problem.prior.graph)
    graph.push_back(factors.graph())
    values = gtsam.Values(problem.prior.values)
    keys: dict[str, tuple[Key, ...]] = {
        robot: (start,) for robot, start in problem.start_keys.items()
    }
    for robot, path in paths.items():
        last = path.steps if cut is None else min(cut, path.steps)
        keys[robot] = path_keys(problem, path)[: last + 1]
        insert_poses(values, keys[robot], path)
    return CandidateBelief(graph=graph, values=values, factors=factors, keys=keys, cut=cut)


def insert_poses(values: gtsam.Values, keys: Sequence[Key], path: CandidatePath) -> None:
    """Insert the planned poses of steps 1 and up at their keys."""
    with gtsam_boundary(f"inserting the poses of robot {path.robot!r}"):
        for key, pose in zip(keys[1:], path.poses[1 : len(keys)], strict=True):
            values.insert(key, gtsam_pose(pose))
