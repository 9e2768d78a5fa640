"""A plan of a sampling tree: the team's poses, what is known along them, and the cost.

Poses are the tree's own: each is the end of a control from the one before, exactly. Covariances
have F + 1 entries; by default entry t is before measuring at configuration t (line 7 of
Algorithm 1), so that the last configuration's measurements are not counted.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.checks import frozen
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TeamPath:
    """A team's path with its beliefs.

    Attributes:
        poses: Shape (F + 1, N, 3), world frame.
        covariances: Shape (F + 1, M, 2, 2), square metres, for independent targets in the plane;
            else (F + 1, n, n), of the stacked state.
        cost: J of equation (5a).
        assigned: Target of each robot at each step, shape (F + 1, N); empty where the planner does
            not assign.
    """

    poses: FloatArray
    covariances: FloatArray
    cost: float
    assigned: IntArray

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        object.__setattr__(self, "poses", frozen(self.poses))
        object.__setattr__(self, "covariances", frozen(self.covariances))

    @property
    def horizon(self) -> int:
        """F, the number of steps."""
        return len(self.poses) - 1

    def of_target(self, problem: AcquisitionProblem, target: int) -> FloatArray:
        """Covariance of one target along the path.

        Args:
            problem: What was planned for.
            target: Its place among the targets.

        Returns:
            Shape (F + 1, n_i, n_i).
        """
        if self.covariances.ndim == 4:
            return self.covariances[:, target]
        part = problem.hidden.slice_of(problem.hidden.targets[target])
        return self.covariances[:, part, part]

    def controls(self, problem: AcquisitionProblem) -> IntArray:
        """Index of each robot's control at each step.

        Args:
            problem: What was planned for.

        Returns:
            Shape (F, N): the control whose end is nearest to the next pose.
        """
        out = np.empty((self.horizon, len(problem.robots)), dtype=np.int64)
        for j, robot in enumerate(problem.robots):
            for t in range(self.horizon):
                offset = robot.primitives.successors(self.poses[t, j]) - self.poses[t + 1, j]
                offset[:, 2] = np.sin(0.5 * offset[:, 2])
                out[t, j] = int(np.argmin((offset**2).sum(axis=1)))
        return out
