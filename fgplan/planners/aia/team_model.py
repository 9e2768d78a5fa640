"""One step of a team as a value: what every planner that gathers information searches over.

A state is the team's poses with the targets' covariances at a time. Covariances, numbers and
collisions are those of the sampling tree, so that baselines and ``aia`` minimise the same cost over
the same steps.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError
from fgplan.planners.aia.arrays import prepare, unpacked
from fgplan.planners.aia.densities import Densities
from fgplan.planners.aia.judgement import Judgement
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.stepped_growth import SteppedGrowth
from fgplan.planners.aia.team_path import TeamPath
from fgplan.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class TeamState:
    """A team at a time.

    Attributes:
        rows: Pose of each robot, a row of the model's table, shape (N,).
        covariance: Row of covariances before measuring there.
        time: Steps from the start.
        cost: J so far.
        assigned: Target of each robot, shape (N,).
        before: The state before; None at the start.
    """

    rows: IntArray
    covariance: FloatArray
    time: int
    cost: float
    assigned: IntArray
    before: "TeamState | None" = None


class TeamModel:
    """Steps of one problem; keeps poses and information that it has computed."""

    def __init__(self, problem: AcquisitionProblem, near_m: float = 0.3) -> None:
        """Make ready.

        Args:
            problem: What is planned for.
            near_m: As the option of ``aia``.
        """
        options = TreeOptions(near_m=check_positive(near_m, "near_m"))
        self.problem = problem
        self._growth = SteppedGrowth(problem, options, prepare(problem, options), Densities())
        self._growth.plant()
        self._successors: dict[tuple[int, int], IntArray] = {}

    def start(self) -> TeamState:
        """The team at time 0."""
        tree = self._growth.tree
        rows = tree.configuration[0].astype(np.int64)
        assigned = tree.assigned[0].astype(np.int64)
        return TeamState(rows, np.array(tree.covariance[0]), 0, float(tree.cost[0]), assigned)

    def controls(self, robot: int, row: int) -> IntArray:
        """Poses that a robot's free controls lead to, in the order of its control set.

        Args:
            robot: Its place in the team.
            row: Its pose.

        Returns:
            Distinct rows.

        Raises:
            InvalidInputError: If it has no free control.
        """
        key = (int(self._growth.prepared.setting.kind[robot]), int(row))
        if key not in self._successors:
            rows = self._growth.successor_rows(int(row))
            if len(rows) == 0:
                raise InvalidInputError(
                    f"robot {self.problem.robots[robot].name!r}: expected a free control at "
                    f"{self._growth.poses.pose[row].tolist()}, got none"
                )
            self._successors[key] = np.array(list(dict.fromkeys(rows)), dtype=np.int64)
        return self._successors[key]

    def poses(self, rows: IntArray) -> FloatArray:
        """Poses of rows.

        Args:
            rows: Shape (n,).

        Returns:
            Shape (n, 3).
        """
        return np.array(self._growth.poses.pose[rows])

    def left(self, state: TeamState) -> FloatArray:
        """Covariances one step later: they do not depend on the controls chosen.

        Args:
            state: The team.

        Returns:
            Row of covariances.
        """
        information = self._growth.information(state.rows, state.time)
        return self._growth.propagated(state.covariance, information, state.time)

    def advance(
        self, state: TeamState, rows: IntArray, left: FloatArray | None = None
    ) -> TeamState:
        """The team one step later.

        Args:
            state: The team.
            rows: Where each robot goes.
            left: What ``left`` gives for the state, if at hand.

        Returns:
            The next state.
        """
        covariance = self.left(state) if left is None else left
        cost = state.cost + self._growth.judgement.term(covariance)
        satisfied = self._growth.judgement.judge(covariance, state.time + 1)[1]
        assigned = self._growth.assigned_after(state.assigned, state.time + 1, rows, satisfied)
        return TeamState(rows, covariance, state.time + 1, cost, assigned, state)

    def propagate(
        self, covariance: FloatArray, information: FloatArray, time: int
    ) -> tuple[FloatArray, float]:
        """Covariances one step later and the objective's term there.

        Args:
            covariance: Row before measuring.
            information: Row.
            time: When.

        Returns:
            Row of covariances, and the term.
        """
        after = self._growth.propagated(covariance, information, time)
        return after, self._growth.judgement.term(after)

    def information(self, robot: int, row: int, time: int) -> FloatArray:
        """What one robot would learn at a pose.

        Args:
            robot: Its place in the team.
            row: Its pose.
            time: When.

        Returns:
            Row of information.
        """
        return self._growth.information_of(robot, row, time)

    def shortfall(self, state: TeamState) -> float:
        """At most one iff the terminal constraint holds, terminal goals aside.

        Args:
            state: The team.
        """
        return self._growth.judgement.judge(state.covariance, state.time)[0]

    def farthest(self, state: TeamState) -> str:
        """Name of the target farthest from its limit; empty of a joint constraint.

        Args:
            state: The team.
        """
        return Judgement(self._growth.problem).farthest(state.covariance, state.time)

    def is_final(self, state: TeamState) -> bool:
        """Whether the terminal constraint holds, terminal goals included.

        Args:
            state: The team.
        """
        return self.shortfall(state) <= 1.0 and self._growth.at_goal(state.rows)

    def draw(self, state: TeamState, robot: int, generator: np.random.Generator) -> int:
        """Draw one robot's control by f_U (9).

        Args:
            state: The team.
            robot: Its place in the team.
            generator: Source of random numbers.

        Returns:
            Row that it leads to.
        """
        rows = self.controls(robot, int(state.rows[robot]))
        if generator.random() >= self._growth.options.p_control:
            return int(rows[int(generator.random() * len(rows))])
        return self.towards_target(state, robot, rows, generator)

    def towards_target(
        self, state: TeamState, robot: int, rows: IntArray, generator: np.random.Generator
    ) -> int:
        """The control towards the robot's target, or a uniform one where it is near.

        Args:
            state: The team.
            robot: Its place in the team.
            rows: What its controls lead to.
            generator: Source of random numbers.

        Returns:
            One of the rows.
        """
        distance, offset = self._growth.distances_to(
            rows, int(state.assigned[robot]), state.time + 1
        )
        best = int(np.argmin(distance))
        near = self._growth.prepared.setting.near_m[robot]
        if offset[best] > near and np.isfinite(distance[best]):
            return int(rows[best])
        return int(rows[int(generator.random() * len(rows))])

    def path(self, state: TeamState) -> TeamPath:
        """The way from the start to a state.

        Args:
            state: The last state.

        Returns:
            Poses, covariances and cost.
        """
        states = [state]
        while states[-1].before is not None:
            states.append(states[-1].before)
        states.reverse()
        rows = np.array([one.rows for one in states])
        covariances = np.array([one.covariance for one in states])
        return TeamPath(
            poses=self._growth.poses.pose[rows],
            covariances=unpacked(covariances, packed=self.problem.packed),
            cost=state.cost,
            assigned=np.array([one.assigned for one in states]),
        )
