"""The team's belief if every robot follows one path: equation (11), as a GTSAM graph.

    prior  x  for every robot: local factors of its path (9)  x  multi-robot factors of every pair

linearised at the planned poses and, for what the prior holds, at its estimate. Cut at a look-ahead
step l, only factors all of whose states have step <= l take part (equation 21), for all robots.
What a user gets is an ordinary factor graph with values, to look at, optimise or query.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol, get_args

import gtsam
import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.factors.boundary import gtsam_boundary
from fgplan.factors.factor_set import FactorSet
from fgplan.factors.motion import gtsam_pose
from fgplan.factors.path_factors import FactorProblem, path_keys, team_factors
from fgplan.models.pose import heading_slice, position_slice
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import Covariance, Key

Block = Literal["pose", "position", "heading"]
"""Part of a pose's tangent."""


class BeliefProblem(FactorProblem, Protocol):
    """What a belief needs of a planning problem (fgplan.evaluation.problem.PlanningProblem)."""

    @property
    def prior(self) -> Belief:
        """Belief at planning time."""
        ...

    def check_announced(self, announced: Mapping[str, CandidatePath]) -> None:
        """Check that paths belong to the problem, each under its robot's name."""
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

    Example:
        >>> from fgplan.io.mission_file import load_mission
        >>> from fgplan.planners.impacted_paths.candidates import candidate_sets
        >>> sets = candidate_sets(load_mission("examples/scenarios/two_robots.toml"))
        >>> joint = candidate_belief(sets.problem, {"ann": sets.candidates["ann"][0]})
        >>> joint.position_sigma_m("ann") > joint.position_sigma_m("ann", 0)
        True
    """

    graph: gtsam.NonlinearFactorGraph = field(repr=False)
    values: gtsam.Values = field(repr=False)
    factors: FactorSet = field(repr=False)
    keys: Mapping[str, tuple[Key, ...]]
    cut: int | None
    _made: list[Belief] = field(init=False, repr=False, default_factory=list)

    def key(self, robot: str, step: int | None = None) -> Key:
        """Key of a robot's pose.

        Args:
            robot: Name; a robot without a path has step 0 only.
            step: Look-ahead step, 0 to the last that path and cut leave; None is the last.

        Returns:
            The GTSAM key.

        Raises:
            UnknownNameError: If the robot is not in the team.
            InvalidInputError: If there is no such step.
        """
        if robot not in self.keys:
            raise UnknownNameError(f"robot {robot!r}: expected one of {', '.join(self.keys)}")
        keys = self.keys[robot]
        if step is None:
            return keys[-1]
        if not 0 <= step < len(keys):
            raise InvalidInputError(
                f"robot {robot!r}: expected a look-ahead step from 0 to {len(keys) - 1}, got "
                f"{step}; leave it out for the last"
            )
        return keys[step]

    def belief(self) -> Belief:
        """The belief to ask for covariances, by QR; made at the first call, then the same.

        It holds copies: what is added to ``graph`` later is not in it (make a ``Belief`` of both).

        Raises:
            IllPosedBeliefError: If a variable is not determined.
        """
        if not self._made:
            self._made.append(Belief(self.graph, self.values))
        return self._made[0]

    def covariance(self, robot: str, step: int | None = None, block: Block = "pose") -> Covariance:
        """Marginal covariance of a robot's pose.

        Args:
            robot: Name.
            step: Look-ahead step; None is the last.
            block: ``pose``, or only its ``position`` or ``heading``.

        Returns:
            Shape (d, d), in the pose's own tangent (GTSAM's order: planar x, y, heading; spatial
            rotation before translation): position is (2, 2) or (3, 3), square metres, heading
            (1, 1) or (3, 3), square radians.

        Raises:
            UnknownNameError: If the robot is not in the team.
            InvalidInputError: If there is no such step or block.
            IllPosedBeliefError: If a variable is not determined.
        """
        if block not in get_args(Block):
            raise InvalidInputError(
                f"covariance of robot {robot!r}: expected block pose, position or heading, got "
                f"{block!r}"
            )
        covariance = self.belief().covariance(self.key(robot, step))
        if block == "pose":
            return covariance
        dim = len(covariance)
        part = position_slice(dim) if block == "position" else heading_slice(dim)
        return covariance[part, part]

    def position_sigma_m(self, robot: str, step: int | None = None) -> float:
        """Standard deviation of a robot's position: root of the trace of its covariance, metres.

        Args:
            robot: Name.
            step: Look-ahead step; None is the last.

        Returns:
            Metres; the trace does not depend on the frame.

        Raises:
            UnknownNameError: If the robot is not in the team.
            InvalidInputError: If there is no such step.
            IllPosedBeliefError: If a variable is not determined.
        """
        return float(np.sqrt(np.trace(self.covariance(robot, step, "position"))))


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
        InvalidInputError: If a path is not given under its robot's name, does not start at the
            prior's current pose, or a noise is not positive definite.
    """
    problem.check_announced(paths)
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
