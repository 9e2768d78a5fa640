"""Algorithm 1 an iteration at a time from Python, for parts that the kernels do not know.

A user's own sensor, density or uncertainty function, a coupled hidden state, a linear observation,
the optimal assignment. Drawing, links and hash tables are the kernels'; covariances are
``fgplan.riccati``'s, numbers the registry's. It draws the same random numbers as the compiled loop
and grows the same tree where both can (a test compares them).
"""

import numpy as np

from fgplan.models.linear_observation import AbstractLinearObservation
from fgplan.planners.aia.arrays import Prepared, unpacked
from fgplan.planners.aia.assignment_kernels import assign_targets
from fgplan.planners.aia.covariance_rows import RowJudgement
from fgplan.planners.aia.densities import Densities
from fgplan.planners.aia.growth import Ended, Growth
from fgplan.planners.aia.judgement import Judgement
from fgplan.planners.aia.optimal_assignment import assign_optimally
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.pose_kernels import (
    ENTRY_COUNT,
    POSE_COUNT,
    enter_pose,
    follow_controls,
)
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.sampling_kernels import draw_controls, draw_group, draw_member
from fgplan.planners.aia.tree_kernels import (
    BOUNDED,
    COST,
    DEPTH,
    DOMINATED,
    ITERATIONS,
    NEED_NODES,
    NEED_POSES,
    NEED_TIME,
    NODES,
    REJECTED,
    REPEATED,
    at_goal,
    find_group,
    link_node,
    note_node,
    repeats,
)
from fgplan.planners.aia.tree_view import view_tree
from fgplan.riccati.block_diagonal import riccati_map_blocks
from fgplan.typing import BoolArray, FloatArray, IntArray


class GuidedGrowth(Growth):
    """A tree grown from Python."""

    def __init__(
        self,
        problem: AcquisitionProblem,
        options: TreeOptions,
        prepared: Prepared,
        densities: Densities,
    ) -> None:
        """Make room.

        Args:
            problem: What is planned for.
            options: How.
            prepared: The problem's arrays.
            densities: A user's own f_V and f_U.
        """
        super().__init__(problem, options, prepared)
        self.densities = densities
        self._known: dict[tuple[int, int, int], FloatArray] = {}
        sizes = problem.hidden.sizes
        ends = np.cumsum(sizes)
        self._parts = [slice(int(e - n), int(e)) for e, n in zip(ends, sizes, strict=True)]
        most = prepared.setting.motions.relative.shape[1]
        self._ends = np.empty((most, 3))
        self._cells = np.zeros(most, dtype=np.int64)
        self._found = np.empty(most, dtype=np.int64)
        robots = len(prepared.setting.kind)
        self._goals = bool(prepared.setting.fields.of_goal.max() >= 0)
        self._new_poses, self._new_entries = robots * most, 2 * robots * problem.targets
        self.judgement: Judgement | RowJudgement = Judgement(problem)

    def run(self, iterations: int, generator: np.random.Generator) -> Ended:
        """Grow; as ``Growth.run``.

        Args:
            iterations: How many more at most.
            generator: Source of every random number.

        Returns:
            Why it ended.
        """
        for _ in range(iterations):
            self._make_room_for_poses()
            counts = self.tree.counts
            k = self._draw_group(generator)
            if not self._draw_controls(k, generator):
                counts[ITERATIONS] += 1
                counts[REJECTED] += 1
                continue
            nodes = self._nodes_to_extend(k, generator)
            if counts[NODES] + len(nodes) > self.settings.node_limit:
                return "nodes"
            counts[ITERATIONS] += 1
            while counts[NODES] + len(nodes) > len(self.tree.parent):
                self._made_room(NEED_NODES)
                counts = self.tree.counts
            rows = self.tree.drawn.copy()
            new = self._group_of(rows)
            for node in nodes:
                new = self._extend(node, new, rows)
            if self.settings.stop_at_goal and self.feasible:
                return "feasible"
        return "iterations"

    def _make_room_for_poses(self) -> None:
        """Room for one more iteration."""
        poses, entries, table = self._new_poses, self._new_entries, self.poses
        used = table.counts
        if used[POSE_COUNT] + poses > len(table.pose) or (
            used[ENTRY_COUNT] + entries > len(table.target)
        ):
            self._made_room(NEED_POSES)  # twice as much, which is enough (see ``make_poses``)
        times = len(self.prepared.setting.fields.of_target)
        if times > 1 and self.tree.counts[DEPTH] + 3 > times:
            self._made_room(NEED_TIME)

    @property
    def _uniform(self) -> bool:
        """Whether draws are uniform (Remark 5.1)."""
        settings = self.settings
        late = settings.uniform_after_goal and self.feasible
        return late or self.iterations >= settings.uniform_from

    def _draw_group(self, generator: np.random.Generator) -> int:
        """f_V: the user's own or (8)."""
        tree = self.tree
        if self.densities.groups is not None:
            shares = self.densities.group_probabilities(view_tree(self, -1))
            k = int(np.searchsorted(np.cumsum(shares), generator.random(), side="right"))
            return min(k, len(shares) - 1)
        return int(
            draw_group(
                tree.counts,
                tree.deepest,
                tree.stamp,
                self.settings.p_group,
                self._uniform,
                generator,
            )
        )

    def _draw_controls(self, k: int, generator: np.random.Generator) -> bool:
        """f_U: the user's own or (9), into ``tree.drawn``."""
        tree, setting = self.tree, self.prepared.setting
        if self.densities.controls is None:
            node = int(tree.tail[k])
            t = int(tree.depth[node])
            finished = self._goals and self.judgement.judge(tree.covariance[node], t)[0] <= 1.0
            return bool(
                draw_controls(
                    setting,
                    self.settings,
                    self.poses,
                    tree,
                    k,
                    self._uniform,
                    finished,
                    0,
                    self._ends,
                    self._cells,
                    self._found,
                    generator,
                )
            )
        counts = [len(robot.primitives) for robot in self.problem.robots]
        shares = self.densities.control_probabilities(view_tree(self, k), counts)
        everywhere = True
        for j, share in enumerate(shares):
            number = generator.random()
            row = int(tree.configuration[k, j])
            kind = int(self.poses.kind[row])
            pose, cell = self.poses.pose[row], int(self.poses.cell[row])
            follow_controls(
                setting.motions, setting.obstacles, pose, kind, cell, self._ends, self._found
            )
            free = self._found[: len(share)] != -1
            if not free.any():
                everywhere = False
                continue
            if not self.settings.reject_jointly:
                share = np.where(free, share, 0.0)
            summed = np.cumsum(share)
            chosen = int(np.searchsorted(summed, number * summed[-1], side="right"))
            chosen = min(chosen, len(share) - 1)
            if not free[chosen]:
                everywhere = False
                continue
            end = self._ends[chosen]
            tree.drawn[j] = enter_pose(self.poses, setting.fields.frame, kind, *map(float, end))
        return everywhere

    def _nodes_to_extend(self, k: int, generator: np.random.Generator) -> list[int]:
        """The whole group as it is now, or one node of it."""
        tree, settings = self.tree, self.settings
        node = int(tree.head[k])
        if settings.one_node:
            tail, size, following = int(tree.tail[k]), int(tree.size[k]), tree.next_in_group
            return [int(draw_member(node, tail, size, following, settings.p_group, generator))]
        nodes = []
        while node >= 0:
            nodes.append(node)
            node = int(tree.next_in_group[node])
        return nodes

    def _group_of(self, rows: IntArray) -> int:
        """Group of a configuration, -1 where there is none yet."""
        return int(find_group(self.tree.slots, self.tree.configuration, rows)[0])

    def _extend(self, node: int, new: int, rows: IntArray) -> int:
        """Lines 7 to 17 of Algorithm 1 for one node."""
        tree, settings, counts = self.tree, self.settings, self.tree.counts
        if settings.bound and tree.cost[node] >= tree.best[COST]:
            counts[BOUNDED] += 1
            return new
        again, child = repeats(tree.first_child, tree.next_sibling, tree.group, node, new)
        if again:
            counts[REPEATED] += 1
            return new
        t = int(tree.depth[node])
        if child >= 0 and not settings.at_child:
            after = tree.covariance[child]  # the same for all children
        else:
            left = tree.configuration[tree.group[node]].astype(np.int64)
            seen_from = rows if settings.at_child else left
            information = self.information(seen_from, t + 1 if settings.at_child else t)
            after = self.propagated(tree.covariance[node], information, t)
        cost = float(tree.cost[node]) + self.judgement.term(after)
        if settings.bound and cost >= tree.best[COST]:
            counts[BOUNDED] += 1
            return new
        if settings.dominance and new >= 0 and self._dominated(new, cost, t + 1, after):
            counts[DOMINATED] += 1
            return new
        return self._append(node, new, rows, cost, after)

    def _insert_root(self, rows: IntArray) -> None:
        """Enter the root, whose covariance is in scratch."""
        after = self.scratch.covariance.copy()
        self._append(-1, -1, rows, self.judgement.term(after), after)

    def _append(self, parent: int, k: int, rows: IntArray, cost: float, after: FloatArray) -> int:
        """Append a node; its group."""
        tree, setting = self.tree, self.prepared.setting
        node = int(tree.counts[NODES])
        k = self._link(parent, k, rows, cost)
        tree.covariance[node] = after
        shortfall, satisfied = self.judgement.judge(after, int(tree.depth[node]))
        is_goal = shortfall <= 1.0 and (
            not self._goals or bool(at_goal(setting.goal, self.poses.pose, rows))
        )
        note_node(tree.counts, tree.best, node, cost, shortfall, is_goal)
        tree.assigned[node] = self._assign(parent, node, rows, satisfied)
        return k

    def _link(self, parent: int, k: int, rows: IntArray, cost: float) -> int:
        """Links, group and cost of a node; its group."""
        _, place = find_group(self.tree.slots, self.tree.configuration, rows)
        return int(link_node(self.tree, parent, k, place, rows, cost))

    def _assign(self, parent: int, node: int, rows: IntArray, satisfied: BoolArray) -> IntArray:
        """Algorithm 2, or another choice in its place."""
        tree, fields = self.tree, self.prepared.setting.fields
        assigned = np.zeros(len(rows), dtype=np.int64)
        if parent >= 0:
            assigned[:] = tree.assigned[parent]
            if self.options.assignment == "keep":
                return assigned
        of_target = fields.of_target[min(int(tree.depth[node]), len(fields.of_target) - 1)]
        if self.options.assignment == "optimal":
            distance = fields.distance_m[of_target][:, self.poses.cell[rows]].astype(np.float64)
            return assign_optimally(assigned, satisfied, distance.T, everybody=parent < 0)
        assign_targets(
            fields.distance_m,
            of_target,
            self.poses.cell,
            rows,
            satisfied,
            assigned,
            parent < 0,
            self.scratch.holders,
            self.scratch.open_targets,
        )
        return assigned

    def propagated(self, row: FloatArray, information: FloatArray, t: int) -> FloatArray:
        """Covariance row at t + 1.

        Args:
            row: At t, shape (width,).
            information: Shape (width,).
            t: When.
        """
        packed, hidden = self.problem.packed, self.problem.hidden
        before, gained = unpacked(row, packed=packed), unpacked(information, packed=packed)
        if packed:
            steps = [block.at(t) for block in hidden.blocks]
            A, Q = np.array([s[0] for s in steps]), np.array([s[2] for s in steps])  # noqa: N806
        else:
            A, _, Q = hidden.dense(t)  # noqa: N806
        after = riccati_map_blocks(before, gained, A, Q, at_child=self.settings.at_child)
        if not packed:
            return after.ravel()
        return np.stack([after[:, 0, 0], after[:, 0, 1], after[:, 1, 1]], axis=1).ravel()

    def information(self, rows: IntArray, time: int) -> FloatArray:
        """Information of a configuration at a time.

        Args:
            rows: The configuration.
            time: When.

        Returns:
            Shape (width,).
        """
        return np.sum(
            [self.information_of(j, int(row), time) for j, row in enumerate(rows)], axis=0
        )

    def _information(self, rows: IntArray, time: int) -> FloatArray:
        """As ``information``: what the root's measurement asks for."""
        return self.information(rows, time)

    def _robot_information(self, j: int, pose: FloatArray, time: int) -> FloatArray:
        """Information of one robot at a pose, from its sensors' whitened rows."""
        hidden, world = self.problem.hidden, self.problem.workspace
        dense = np.zeros((hidden.size, hidden.size))
        points = not len(self.problem.places)
        mean = hidden.predicted_means(self.problem.mean, time)[-1] if points else np.zeros(0)
        for sensor in self.problem.robots[j].sensors:
            if isinstance(sensor, AbstractLinearObservation):
                weighted = sensor.rows(pose, hidden.size, world)
                dense += weighted.T @ weighted
                continue
            for part in self._parts:
                if sensor.visible(pose, mean[part], world):
                    _, weighted = sensor.linearise(pose, mean[part])
                    dense[part, part] += weighted.T @ weighted
        if not self.problem.packed:
            return dense.ravel()
        return np.concatenate(
            [[dense[p, p][0, 0], dense[p, p][0, 1], dense[p, p][1, 1]] for p in self._parts]
        )

    def information_of(self, robot: int, row: int, time: int) -> FloatArray:
        """What one robot learns at a pose, remembered.

        Args:
            robot: Its place in the team.
            row: The pose.
            time: When.

        Returns:
            Shape (width,).
        """
        time = 0 if self.prepared.setting.sight.fixed else time
        key = (int(self.prepared.setting.kind[robot]), int(row), time)
        if key not in self._known:
            if self.prepared.compiled_sensors and self.problem.packed:
                self._make_room_for_poses()
                self.setting_until(time)
                known = super()._information(np.array([row], dtype=np.int64), time)
            else:
                known = self._robot_information(robot, self.poses.pose[row], time)
            self._known[key] = known
        return self._known[key]

    def _dominated(self, k: int, cost: float, depth: int, row: FloatArray) -> bool:
        """Whether a group holds a node that is as good in every respect."""
        tree = self.tree
        after = unpacked(row, packed=self.problem.packed)
        node = int(tree.head[k])
        while node >= 0:
            same = self.settings.dominance == 2 or tree.depth[node] == depth
            if same and tree.cost[node] <= cost:
                gap = after - unpacked(tree.covariance[node], packed=self.problem.packed)
                if np.linalg.eigvalsh(gap).min() >= 0.0:
                    return True
            node = int(tree.next_in_group[node])
        return False
