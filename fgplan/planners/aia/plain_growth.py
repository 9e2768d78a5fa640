"""Algorithm 1 where numba does not compile: numpy over all targets, Python over the robots.

It is the guided growth with other pieces, for what the kernels know: uncompiled they read arrays
number by number, which costs a hundred times what a number costs in a numpy row. Drawing takes the
same random numbers, and the tree is that of the compiled loop (a test compares them). Poses and
groups are found by dictionaries, not by the hash tables of the kernels.

Where poses recur and targets stay, what is drawn from (u*, and the other controls) is remembered by
pose and target, and what is learnt by pose.
"""

from collections.abc import Iterable

import numpy as np

from fgplan.planners.aia.arrays import Prepared
from fgplan.planners.aia.control_rows import Reach, follow, prefer
from fgplan.planners.aia.covariance_rows import RowJudgement, is_below, measured, predicted
from fgplan.planners.aia.densities import Densities
from fgplan.planners.aia.guided_growth import GuidedGrowth
from fgplan.planners.aia.information_rows import information_rows
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.pose_rows import PoseRows, enter_poses
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.sampling_kernels import MOST_TRIES
from fgplan.planners.aia.tree_kernels import DEEPEST, DEPTH, GROUPS, NODES
from fgplan.typing import BoolArray, FloatArray, IntArray

Choice = tuple[int, tuple[int, ...]]
"""Where u* leads (-1: there is none), and where all controls to draw from lead (-1: blocked)."""


class PlainGrowth(GuidedGrowth):
    """A tree grown without the compiler."""

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
        self.tree = self.tree._replace(slots=self.tree.slots[:0])
        self.poses = self.poses._replace(slots=self.poses.slots[:0])
        self._pose_rows: PoseRows = {}
        self._groups: dict[tuple[int, ...], int] = {}
        self._choices: dict[tuple[int, int], Choice] = {}
        self._learnt = np.zeros((0, len(prepared.root)))

    def plant(self, bound: float = np.inf) -> None:
        """Begin a tree at the root; as ``Growth.plant``.

        Args:
            bound: Cost of the best plan so far.
        """
        self._groups.clear()
        super().plant(bound)

    def information(self, rows: IntArray, time: int) -> FloatArray:
        """Information of a configuration at a time; as ``GuidedGrowth.information``.

        Args:
            rows: The configuration.
            time: When.

        Returns:
            Shape (width,).
        """
        if not self._recurs:
            return np.add.reduce(self._learn(rows, time))
        if self._stays:
            if len(self._learnt) < len(self.poses.pose):
                missing = len(self.poses.pose) - len(self._learnt)
                unknown = np.full((missing, self._learnt.shape[1]), np.nan)
                self._learnt = np.concatenate([self._learnt, unknown])
            total: FloatArray = np.add.reduce(self._learnt.take(rows, axis=0))
            if total[0] == total[0]:  # a number: every pose is known
                return total
            new = rows[np.isnan(self._learnt[rows, 0])]
            self._learnt[new] = self._learn(new, time)
            return np.add.reduce(self._learnt[rows])
        names = [(0, row, time) for row in rows.tolist()]
        new_rows = [name[1] for name in names if name not in self._known]
        if new_rows:
            for row, learnt in zip(new_rows, self._learn(np.array(new_rows), time), strict=True):
                self._known[0, row, time] = learnt
        return np.add.reduce([self._known[name] for name in names])

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

    def _learn(self, rows: IntArray, time: int) -> FloatArray:
        """Information of each pose at a time, shape (n, width)."""
        sight, poses = self.setting_until(time).sight, self.poses
        return information_rows(
            sight, self.problem.workspace, poses.pose[rows], poses.kind[rows], time
        )

    def _enter(self, kinds: IntArray, ends: FloatArray) -> list[int]:
        """Rows of poses."""
        frame = self.prepared.setting.fields.frame
        return enter_poses(self.poses, self._pose_rows, frame, kinds, ends)

    def _starts(self) -> list[int]:
        """Rows of the robots' poses at time 0."""
        starts = np.array([robot.pose for robot in self.problem.robots], dtype=np.float64)
        return self._enter(self.prepared.setting.kind, starts)

    def _draw_group(self, generator: np.random.Generator) -> int:
        """f_V (8)."""
        tree, random = self.tree, generator.random
        groups = len(self._groups)
        if self._uniform:
            return int(random() * groups)
        biased, deep = random() < self.settings.p_group, int(tree.counts[DEEPEST])
        if biased or groups == deep:
            return int(tree.deepest[int(random() * deep)])
        depth = int(tree.counts[DEPTH])
        for _ in range(MOST_TRIES):
            k = int(random() * groups)
            if tree.stamp[k] != depth:
                return k
        others = np.flatnonzero(tree.stamp[:groups] != depth)
        return int(others[int(random() * len(others))])

    def _draw_controls(self, k: int, generator: np.random.Generator) -> bool:
        """f_U (9), into ``tree.drawn``."""
        tree, p_control = self.tree, self.settings.p_control
        node = int(tree.tail[k])
        uniform = self._uniform
        t = int(tree.depth[node])
        finished = self._goals and self.judgement.judge(tree.covariance[node], t)[0] <= 1.0
        rows, targets = tree.configuration[k].tolist(), tree.assigned[node].tolist()
        if self._stays and not uniform and not finished:
            names = list(zip(rows, targets, strict=True))
            new = [j for j, name in enumerate(names) if name not in self._choices]
            if new:
                found, _ = self._choices_of(new, k, node, uniform=False, finished=False)
                for j, choice in zip(new, found, strict=True):
                    self._choices[names[j]] = choice
            choices = [self._choices[name] for name in names]
        else:
            robots = list(range(len(rows)))
            choices, reach = self._choices_of(robots, k, node, uniform=uniform, finished=finished)
        numbers = generator.random(len(rows)).tolist()
        after = []
        for (best, others), number in zip(choices, numbers, strict=True):
            if best >= 0:
                if number < p_control:
                    after.append(best)
                    continue
                number = (number - p_control) / (1.0 - p_control)
            after.append(others[int(number * len(others))] if others else -1)
        if min(after) < 0:
            return False
        if not self._recurs:
            kinds = self.prepared.setting.kind
            after = self._enter(kinds, reach.ends[np.arange(len(after)), after])
        tree.drawn[:] = after
        return True

    def _choices_of(
        self, robots: list[int], k: int, node: int, *, uniform: bool, finished: bool
    ) -> tuple[list[Choice], Reach]:
        """What robots of a group draw from: poses where these recur, controls elsewhere."""
        setting, poses, tree = self.prepared.setting, self.poses, self.tree
        rows = tree.configuration[k][robots].astype(np.int64)
        kinds = setting.kind[robots]
        if self._recurs:
            self._remember_successors(rows)
            names = poses.successors[rows]
            free = names >= 0
            reached = np.where(free, names, rows[:, None])
            reach = Reach(poses.pose[reached], poses.cell[reached], free)
        else:
            reach = follow(
                setting, self.problem.workspace, poses.pose[rows], kinds, poses.cell[rows]
            )
            names = np.where(reach.free, np.arange(reach.free.shape[1]), -1)
        best = np.full(len(robots), -1)
        if not uniform:
            best = prefer(
                setting,
                reach,
                poses.pose[rows],
                np.array(robots),
                tree.assigned[node][robots],
                int(tree.depth[node]) + 1,
                to_goal=finished,
                circle=self.settings.circle,
            )
        choices = []
        many = setting.motions.controls[kinds].tolist()
        for u, leads, controls in zip(best.tolist(), names.tolist(), many, strict=True):
            others = leads[:controls]
            if not self.settings.reject_jointly:
                others = [name for name in others if name >= 0]
            choices.append((leads[u] if u >= 0 else -1, tuple(others)))
        return choices, reach

    def _remember_successors(self, rows: IntArray) -> None:
        """Fill in what rows lead to, once."""
        poses = self.poses
        new = np.array(list(dict.fromkeys(rows[poses.successors[rows, 0] == -2].tolist())))
        if not len(new):
            return
        setting, kinds = self.prepared.setting, poses.kind[new]
        reach = follow(setting, self.problem.workspace, poses.pose[new], kinds, poses.cell[new])
        after = np.full(reach.free.shape, -1)
        of, _ = np.nonzero(reach.free)
        after[reach.free] = self._enter(kinds[of], reach.ends[reach.free])
        poses.successors[new] = after
        poses.free[new] = reach.free.sum(axis=1)

    def _group_of(self, rows: IntArray) -> int:
        """Group of a configuration, -1 where there is none yet."""
        return self._groups.get(tuple(rows.tolist()), -1)

    def _link(self, parent: int, k: int, rows: IntArray, cost: float) -> int:
        """Links, group and cost of a node; its group."""
        tree, counts = self.tree, self.tree.counts
        node, deepest = int(counts[NODES]), int(counts[DEPTH])
        counts[NODES] = node + 1
        depth, sibling = 0, -1
        if parent >= 0:
            depth, sibling = int(tree.depth[parent]) + 1, int(tree.first_child[parent])
            tree.first_child[parent] = node
        if k < 0:
            k = len(self._groups)
            self._groups[tuple(rows.tolist())] = k
            counts[GROUPS] = k + 1
            tree.head[k] = node
            tree.size[k] = 0
            tree.stamp[k] = -1
            tree.configuration[k] = rows
        else:
            tree.next_in_group[tree.tail[k]] = node
        tree.tail[k] = node
        tree.size[k] += 1
        tree.parent[node] = parent
        tree.first_child[node] = -1
        tree.next_sibling[node] = sibling
        tree.group[node] = k
        tree.next_in_group[node] = -1
        tree.depth[node] = depth
        tree.cost[node] = cost
        if depth > deepest or parent < 0:
            counts[DEPTH] = deepest = depth
            counts[DEEPEST] = 0
        if depth == deepest and tree.stamp[k] != depth:
            tree.stamp[k] = depth
            tree.deepest[counts[DEEPEST]] = k
            counts[DEEPEST] += 1
        return k

    def _assign(self, parent: int, node: int, rows: IntArray, satisfied: BoolArray) -> IntArray:
        """Algorithm 2."""
        tree, fields = self.tree, self.prepared.setting.fields
        met = satisfied.tolist()
        again = [i for i, one in enumerate(met) if not one]
        if parent < 0:
            assigned = [0] * len(rows)
            choosing: Iterable[int] = range(len(rows))
            left = list(range(len(met)))
        else:
            if not self.settings.assign or not again:
                return tree.assigned[parent]
            assigned = tree.assigned[parent].tolist()
            holders = [0] * len(met)
            for i in assigned:
                holders[i] += 1
            choosing = [j for j, i in enumerate(assigned) if met[i] or holders[i] > 1]
            left = [i for i in again if holders[i] == 0] if choosing else []
        of_target = fields.of_target[min(int(tree.depth[node]), len(fields.of_target) - 1)]
        for j in choosing:
            left = left or again.copy() or list(range(len(met)))
            distance = fields.distance_m[of_target, self.poses.cell[rows[j]]].tolist()
            assigned[j] = min(left, key=distance.__getitem__)
            left.remove(assigned[j])
        return np.array(assigned)

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
