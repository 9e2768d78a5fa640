"""Single steps of a team outside of any tree, with the sampling tree's own poses and numbers."""

import numpy as np

from fgplan.planners.aia.assignment_kernels import assign_targets
from fgplan.planners.aia.guided_growth import GuidedGrowth
from fgplan.planners.aia.pose_kernels import enter_pose, follow_controls
from fgplan.planners.aia.tree_kernels import at_goal
from fgplan.typing import BoolArray, FloatArray, IntArray


class SteppedGrowth(GuidedGrowth):
    """A growth that is asked for single steps."""

    def successor_rows(self, row: int) -> list[int]:
        """Poses that the free controls of a pose lead to.

        Args:
            row: The pose.
        """
        self._make_room_for_poses()
        setting, kind = self.prepared.setting, int(self.poses.kind[row])
        pose, cell = np.array(self.poses.pose[row]), int(self.poses.cell[row])
        follow_controls(
            setting.motions, setting.obstacles, pose, kind, cell, self._ends, self._found
        )
        return [
            enter_pose(self.poses, setting.fields.frame, kind, *map(float, self._ends[u]))
            for u in range(int(setting.motions.controls[kind]))
            if self._found[u] != -1
        ]

    def distances_to(self, rows: IntArray, target: int, time: int) -> tuple[FloatArray, FloatArray]:
        """Geodesic and straight distances of poses to a target's predicted place.

        Args:
            rows: The poses, shape (n,).
            target: The target.
            time: When.

        Returns:
            Metres, shape (n,) each.
        """
        setting = self.setting_until(time)
        fields, sight = setting.fields, setting.sight
        field = fields.of_target[min(time, len(fields.of_target) - 1), target]
        place = sight.places[min(time, len(sight.places) - 1), target]
        geodesic = np.asarray(fields.distance_m[field, self.poses.cell[rows]], dtype=np.float64)
        return geodesic, np.linalg.norm(self.poses.pose[rows, :2] - place, axis=1)

    def at_goal(self, rows: IntArray) -> bool:
        """Whether every robot is at its terminal goal.

        Args:
            rows: The configuration.
        """
        return bool(at_goal(self.prepared.setting.goal, self.poses.pose, rows))

    def assigned_after(
        self, assigned: IntArray, time: int, rows: IntArray, satisfied: BoolArray
    ) -> IntArray:
        """Algorithm 2 for a state that is not in the tree.

        Args:
            assigned: The parent's assignment, shape (N,).
            time: When.
            rows: The configuration.
            satisfied: Which targets are, shape (M,).

        Returns:
            Shape (N,).
        """
        fields, out = self.setting_until(time).fields, np.array(assigned)
        assign_targets(
            fields.distance_m,
            fields.of_target[min(time, len(fields.of_target) - 1)],
            self.poses.cell,
            rows,
            satisfied,
            out,
            False,
            self.scratch.holders,
            self.scratch.open_targets,
        )
        return out
