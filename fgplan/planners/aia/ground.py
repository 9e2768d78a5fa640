"""What sampling trees grow on: the problem's arrays, the table of poses, and more of either.

A growth, of one tree or of a team's, calls a compiled loop again and again; whenever that returns
for want of room it is made here, and nothing is lost.
"""

from collections.abc import Callable, Mapping
from typing import Literal

from fgplan.planners.aia.arrays import Prepared, further, settings_of
from fgplan.planners.aia.covariance_kernels import read_numbers, total_of
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.pose_kernels import enter_pose
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.tree import make_poses, make_scratch, more_poses
from fgplan.planners.aia.tree_kernels import (
    FEASIBLE,
    GOALS,
    ITERATIONS,
    NEED_POSES,
    NEED_TIME,
    NODE_LIMIT,
    NODES,
    REJECTED,
    REPEATED,
    Setting,
)
from fgplan.typing import FloatArray, IntArray

_COUNTED = {
    "nodes": NODES,
    "iterations": ITERATIONS,
    "feasible_nodes": GOALS,
    "rejected_draws": REJECTED,
    "repeated": REPEATED,
}


class Ground:
    """Arrays that do not depend on how many trees grow here."""

    def __init__(
        self, problem: AcquisitionProblem, options: TreeOptions, prepared: Prepared
    ) -> None:
        """Make room.

        Args:
            problem: What is planned for.
            options: How a tree grows.
            prepared: The problem's arrays.
        """
        self.problem = problem
        self.prepared = prepared
        self.settings = settings_of(options, prepared)
        self.scratch = make_scratch(prepared)
        self.poses = make_poses(prepared)

    def setting_until(self, time: int) -> Setting:
        """What the kernels read, with targets predicted until a time at least.

        Args:
            time: Last time asked for.
        """
        while 1 < len(self.prepared.setting.sight.places) <= time:
            self._made_room(NEED_TIME)
        return self.prepared.setting

    def _grown(self, grow: Callable[[], int]) -> Literal["feasible", "nodes"] | None:
        """Call until no more room is asked for; why it ended, None where all is done."""
        while self._made_room(ended := grow()):
            pass
        if ended == FEASIBLE:
            return "feasible"
        return "nodes" if ended == NODE_LIMIT else None

    def _start(self, j: int) -> int:
        """Row of a robot's pose at time 0."""
        setting = self.prepared.setting
        pose = map(float, self.problem.robots[j].pose)
        return int(enter_pose(self.poses, setting.fields.frame, setting.kind[j], *pose))

    def _objective(self, row: FloatArray) -> float:
        """The objective's term of a covariance row, whose numbers stay in scratch."""
        criteria, numbers = self.prepared.setting.criteria, self.scratch.numbers
        read_numbers(row, criteria.objective, numbers)
        return float(total_of(numbers, criteria))

    def _counted(self, counts: IntArray, others: Mapping[str, int]) -> dict[str, int]:
        """What was counted, by name; ``others`` are places of what not every growth counts."""
        return {name: int(counts[place]) for name, place in {**_COUNTED, **others}.items()}

    def _made_room(self, ended: int) -> bool:
        """Make the room that a kernel asked for; False where it asked for none."""
        if ended == NEED_POSES:
            self.poses = more_poses(self.poses)
        elif ended == NEED_TIME:
            self.prepared = further(self.prepared, self.problem)
        else:
            return False
        return True
