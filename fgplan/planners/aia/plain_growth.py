"""Algorithm 1 where numba does not compile: numpy over all targets, Python over the robots.

It is the guided growth with other pieces, for what the kernels know: uncompiled they read arrays
number by number, which costs a hundred times what a number costs in a numpy row. Drawing takes the
same random numbers, and the tree is that of the compiled loop (a test compares them).

Where poses recur and targets stay, what is drawn from (u*, and the other controls) is remembered by
pose and target, and what is learnt by pose.
"""

import numpy as np

from fgplan.planners.aia.arrays import Prepared
from fgplan.planners.aia.control_rows import Reach, follow, prefer
from fgplan.planners.aia.covariance_rows import RowJudgement, is_below, measured, predicted
from fgplan.planners.aia.densities import Densities
from fgplan.planners.aia.guided_growth import GuidedGrowth
from fgplan.planners.aia.information_rows import information_rows
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.pose_kernels import enter_pose
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.tree_kernels import NEED_TIME, link_node
from fgplan.typing import BoolArray, FloatArray, IntArray

Choice = tuple[int, tuple[int, ...]]
"""What u* leads to (-1 for none), and what all controls that may be drawn lead to (-1 blocked)."""


class PlainGrowth(GuidedGrowth):
    """A tree grown without the compiler."""

    judgement: RowJudgement

    def __init__(
        self, problem: AcquisitionProblem, options: TreeOptions, prepared: Prepared
    ) -> None:
        """Make room.

        Args:
            problem: What is planned for: independent targets in the plane, known to the kernels.
            options: How; the assignment is not ``optimal``.
            prepared: The problem's arrays.
        """
        super().__init__(problem, options, prepared, Densities())
        self.judgement = RowJudgement(prepared.setting.criteria)
        self._recurs = len(self.poses.successors) > 0
        self._stays = self._recurs and prepared.setting.sight.fixed
        self._goals = bool(prepared.setting.fields.of_goal.max() >= 0)
        self._groups: dict[tuple[int, ...], int] = {}
        self._choices: dict[tuple[int, int], Choice] = {}
        self._learnt = np.full((len(self.poses.pose), len(prepared.root)), np.nan)

    def plant(self, bound: float = np.inf) -> None:
        """Begin a tree at the root; as ``Growth.plant``.

        Args:
            bound: Cost of the best plan so far.
        """
        self._groups.clear()
        super().plant(bound)

    def information(self, rows: IntArray, time: int) -> FloatArray:
        """Information of a configuration at a time, as ``GuidedGrowth.information``.

        Args:
            rows: The configuration.
            time: When.

        Returns:
            Shape (width,).
        """
        if self._stays:
            if len(self._learnt) < len(self.poses.pose):
                more = np.full((len(self.poses.pose) - len(self._learnt), len(self.prepared.root)), np.nan)
                self._learnt = np.concatenate([self._learnt, more])
            total = np.add.reduce(self._learnt.take(rows, axis=0))
            if total[0] == total[0]:  # not nan: every pose is known
                return total
            new = np.unique(rows[np.isnan(self._learnt[rows, 0])])
            self._learnt[new] = self._rows(new, 0)
            return np.add.reduce(self._learnt.take(rows, axis=0))
        while 1 < len(self.prepared.setting.sight.places) <= time:
            self._made_room(NEED_TIME)
        if not self._recurs:
            return np.add.reduce(self._rows(rows, time))
        names = [(0, row, time) for row in rows.tolist()]
        new = [name[1] for name in names if name not in self._known]
        if new:
            for row, line in zip(new, self._rows(np.array(new), time), strict=True):
                self._known[0, row, time] = line
        return np.add.reduce([self._known[name] for name in names])

    def _rows(self, rows, time):
        poses = self.poses
        return information_rows(
            self.prepared.setting.sight,
            self.problem.workspace,
            poses.pose[rows],
            poses.kind[rows],
            time,
        )

    def propagated(self, row: FloatArray, information: FloatArray, t: int) -> FloatArray:
        """Covariance row at t + 1; as ``GuidedGrowth.propagated``.

        Args:
            row: At t, shape (width,).
            information: Shape (width,).
            t: When.
        """
        dynamics = self.prepared.setting.dynamics
        if dynamics.still:
            return measured(row, information)
        if self.settings.at_child:
            return measured(predicted(row, dynamics, t), information)
        return predicted(measured(row, information), dynamics, t)

    def _draw_controls(self, k: int, generator: np.random.Generator) -> bool:
        """f_U (9), into ``tree.drawn``."""
        tree, settings = self.tree, self.settings
        node = int(tree.tail[k])
        uniform = self._uniform
        finished = self._goals and self.judgement.judge(tree.covariance[node])[0] <= 1.0
        rows = tree.configuration[k].tolist()
        targets = tree.assigned[node].tolist()
        numbers = generator.random(len(rows)).tolist()
        t = int(tree.depth[node]) + 1
        ends = None
        if self._stays and not uniform and not finished:
            keys = list(zip(rows, targets, strict=True))
            choices = list(map(self._choices.get, keys))
            if None in choices:
                new = [j for j, one in enumerate(choices) if one is None]
                found, _ = self._choices_of(new, rows, targets, t, uniform, finished)
                for j, choice in zip(new, found, strict=True):
                    self._choices[keys[j]] = choice
                choices = list(map(self._choices.get, keys))
        else:
            choices, ends = self._choices_of(range(len(rows)), rows, targets, t, uniform, finished)
        p_control, drawn, free = settings.p_control, tree.drawn, True
        after = []
        for (best, others), number in zip(choices, numbers, strict=True):
            if best >= 0:
                if number < p_control:
                    after.append(best)
                    continue
                number = (number - p_control) / (1.0 - p_control)
            after.append(others[int(number * len(others))] if others else -1)
        if not self._recurs:
            kinds, frame = self.prepared.setting.kind, self.prepared.setting.fields.frame
            for j, u in enumerate(after):
                if u >= 0:
                    after[j] = enter_pose(self.poses, frame, int(kinds[j]), *ends[j, u].tolist())
        drawn[:] = after
        return min(after) >= 0

    def _choices_of(self, robots, rows, targets, t, uniform, finished):
        robots = np.array(robots)
        rows = np.array(rows)[robots]
        targets = np.array(targets)[robots]
        setting, poses = self.prepared.setting, self.poses
        reach, names = self._reach(rows)
        if uniform:
            best = np.full(len(robots), -1)
        else:
            best = prefer(setting, reach, poses.pose[rows], robots, targets, t, to_goal=finished, circle=self.settings.circle)
        names = np.where(reach.free, names, -1).tolist()
        many = setting.motions.controls[setting.kind[robots]].tolist()
        choices = []
        for b, line, c in zip(best.tolist(), names, many):
            if self.settings.reject_jointly:
                others = tuple(line[:c])
            else:
                others = tuple(name for name in line if name >= 0)
            choices.append((line[b] if b >= 0 else -1, others))
        return choices, reach.ends

    def _reach(self, rows):
        setting, poses = self.prepared.setting, self.poses
        if not self._recurs:
            reach = follow(setting, self.problem.workspace, poses.pose[rows], poses.kind[rows], poses.cell[rows])
            return reach, np.arange(reach.free.shape[1])
        new = rows[poses.successors[rows, 0] == -2]
        if len(new):
            new = np.array(list(dict.fromkeys(new.tolist())))
            reach = follow(setting, self.problem.workspace, poses.pose[new], poses.kind[new], poses.cell[new])
            kinds = poses.kind[new].tolist()
            for row, kind, ends, free in zip(new.tolist(), kinds, reach.ends.tolist(), reach.free.tolist()):
                poses.successors[row] = [
                    enter_pose(poses, setting.fields.frame, kind, *end) if f else -1 for end, f in zip(ends, free)
                ]
                poses.free[row] = sum(free)
        after = poses.successors[rows]
        free = after >= 0
        reached = np.where(free, after, rows[:, None])
        return Reach(poses.pose[reached], poses.cell[reached], free), after

    def _group_of(self, rows: IntArray) -> int:
        """Group of a configuration, -1 where there is none yet."""
        return self._groups.get(tuple(rows.tolist()), -1)

    def _link(self, parent: int, k: int, rows: IntArray, cost: float) -> int:
        """Links, group and cost of a node; its group."""
        new = k < 0
        k = int(link_node(self.tree, parent, k, 0, rows, cost))
        if new:
            self._groups[tuple(rows.tolist())] = k
        return k

    def _assign(self, parent: int, node: int, rows: IntArray, satisfied: BoolArray) -> IntArray:
        """Algorithm 2."""
        tree, fields = self.tree, self.prepared.setting.fields
        if parent >= 0:
            assigned = tree.assigned[parent].tolist()
            if not self.settings.assign:
                return assigned
            met = satisfied.tolist()
            holders = [0] * len(met)
            for i in assigned:
                holders[i] += 1
            choosing = [j for j, i in enumerate(assigned) if met[i] or holders[i] > 1]
            again = [i for i, one in enumerate(met) if not one]
            if not choosing or not again:
                return assigned
            left = [i for i in again if holders[i] == 0]
        else:
            assigned = [0] * len(rows)
            choosing = range(len(rows))
            left = list(range(len(satisfied)))
            again = np.flatnonzero(~satisfied).tolist() or left.copy()
        of_target = fields.of_target[min(int(tree.depth[node]), len(fields.of_target) - 1)]
        for j in choosing:
            if not left:
                left = again.copy()
            distance = fields.distance_m[of_target, self.poses.cell[rows[j]]].tolist()
            assigned[j] = min(left, key=distance.__getitem__)
            left.remove(assigned[j])
        return assigned

    def _dominated(self, k: int, cost: float, depth: int, row: FloatArray) -> bool:
        """Whether a group holds a node that is as good in every respect."""
        tree, any_time = self.tree, self.settings.dominance == 2
        node = int(tree.head[k])
        while node >= 0:
            comparable = tree.cost[node] <= cost and (any_time or tree.depth[node] == depth)
            if comparable and is_below(tree.covariance[node], row):
                return True
            node = int(tree.next_in_group[node])
        return False
