"""A plan of distributed robots: the team's poses and what each robot knows along them.

Covariances are those of a replay of the whole team path through the distributed Kalman filter, not
the trees': a plan that does not satisfy the constraint there is never made. The horizon is the
first step at which it holds. Robots without a way of communicating, over others or not, plan on
their own (section VI-B); who is done stays where it is and has no further terms in the cost.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.checks import frozen
from fgplan.planners.aia.team_path import TeamPath
from fgplan.typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TeamPlan:
    """A replayed team path.

    Attributes:
        poses: Shape (F + 1, N, 3), world frame.
        covariances: Of each target at each robot, before measuring, shape (F + 1, N, M, 2, 2),
            square metres.
        horizons: Steps of each robot until its own part of the team is done, shape (N,); the
            greatest is F.
        satisfied: Whether the constraint holds at each robot at the end, shape (N,).
        cost: Sum over robots and steps of (6a).
        assigned: Target of each robot at each step, shape (F + 1, N).
        origins: (robot, goal node) from which each part of the team took its path.
    """

    poses: FloatArray
    covariances: FloatArray
    horizons: IntArray
    satisfied: BoolArray
    cost: float
    assigned: IntArray
    origins: tuple[tuple[int, int], ...]

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("poses", "covariances"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in ("horizons", "satisfied", "assigned"):
            array = np.array(getattr(self, name))
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def horizon(self) -> int:
        """F, the number of steps."""
        return len(self.poses) - 1

    @property
    def first_origin(self) -> int:
        """A robot at which the constraint holds."""
        return int(np.flatnonzero(self.satisfied)[0])

    def at(self, robot: int) -> TeamPath:
        """The plan as one robot sees it: its covariances, the team's cost.

        Args:
            robot: Its place in the team.

        Returns:
            A team path.
        """
        return TeamPath(
            poses=self.poses,
            covariances=self.covariances[:, robot],
            cost=self.cost,
            assigned=self.assigned,
        )
