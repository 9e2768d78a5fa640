"""The tree of Algorithm 1: RRT* in the joint space of a team, with the cost of Algorithm 4.

This is ``roadmaps.RRTStar`` sample for sample (a test grows both and compares them node by node),
yet it does not use that class: there the cost of a motion is a function of its two ends, here of
the covariance and the arrival times at the parent, which change when the parent is rewired; and
one cost is a filter over some ten steps, so that the hot parts are compiled kernels over arrays
(600 samples: a second is what a plan may take).

Differences to RRT* are those of the paper: a node is rewired only if all bodies arrive at the
same time before and after (line 2 of Algorithm 3; not when ``relaxed``), and the new cost and
times are passed on to all successors by running their filters again. Costs grow along every path,
so a candidate whose parent already costs as much as the best is left out, exactly.
"""

import numpy as np

from fgplan.planners.aia.obstacle_arrays import obstacle_arrays
from fgplan.planners.intermittent.cost_task import CostTask
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from fgplan.planners.intermittent.tree_kernels import (
    RELAXED,
    SLOWDOWN,
    STRICT,
    Space,
    Tree,
    arrive,
    delay,
    is_way_free,
    near_nodes,
    nearest_node,
    open_ways,
    steer,
)
from fgplan.typing import BoolArray, FloatArray, IntArray
from roadmaps import euclidean_steering

MODES = {"strict": STRICT, "slowdown": SLOWDOWN, "relaxed": RELAXED}


class JointTree:
    """A tree that grows sample by sample.

    Args:
        problem: Starts, estimate and model.
        options: Of Algorithm 1.

    Attributes:
        tree: Nodes; the first ``count`` rows are used.
        count: Number of nodes.
        means: Predicted means from the estimate's time on, shape (T, n).
    """

    def __init__(self, problem: SegmentProblem, options: SegmentOptions) -> None:
        self.problem = problem
        self.options = options
        bodies = len(problem.starts)
        blocks = problem.estimate.covariance
        room = options.samples + 1
        self.space = Space(
            step_m=options.step_m,
            body=problem.bodies,
            offset=np.array(problem.offsets),
            tracks=np.array(problem.tracks),
            base=problem.estimate.time,
            mode=MODES[options.sync],
        )
        self.tree = Tree(
            position=np.zeros((room, bodies, 2)),
            time=np.zeros((room, bodies), dtype=np.int64),
            parent=np.full(room, -1, dtype=np.int64),
            cost=np.zeros(room),
            covariance=np.zeros((room, *blocks.shape)),
            travelled=np.zeros((room, bodies)),
        )
        steps = int(problem.times.max()) - problem.estimate.time + options.horizon_steps
        self.means = problem.model.predicted_means(problem.estimate, steps)
        carriers = len(problem.carriers)
        self._places = np.zeros((steps + 1, carriers, 2))
        self._there = np.zeros((steps + 1, carriers), dtype=np.bool_)
        self._obstacles = obstacle_arrays(problem.workspace)
        self._longest = int(np.floor(options.epsilon_m / options.step_m + 1e-9))
        low = np.tile(problem.workspace.lower, bodies)
        high = np.tile(problem.workspace.upper, bodies)
        reach = options.epsilon_m * np.sqrt(bodies)
        self._radius = euclidean_steering(reach, low, high).near_radius
        self._near = np.zeros(room, dtype=np.int64)
        self._children: list[list[int]] = [[]]
        self.count = 1
        self.tree.position[0] = problem.starts
        self.tree.time[0] = problem.times
        self._plant()

    def extend(self, wanted: FloatArray) -> int | None:
        """One sample: steer, choose a parent (Algorithm 2), rewire (Algorithm 3).

        Args:
            wanted: v_rand, shape (B, 2), metres.

        Returns:
            The new node, or None where there is none.
        """
        tree, space, node = self.tree, self.space, self.count
        nearest = nearest_node(tree, node, wanted)
        if not steer(tree, space, nearest, wanted, self._longest, tree.position[node]):
            return None
        if not is_way_free(self._obstacles, space, tree.position[nearest], tree.position[node]):
            return None
        radius = self._radius(node + 1)
        found = near_nodes(tree, node, tree.position[node], radius, self._near)
        near = self._near[:found]
        others = near[near != nearest].copy()
        if not self._choose_parent(node, nearest, others):
            return None
        self.count += 1
        self._children.append([])
        self._children[tree.parent[node]].append(node)
        rows = np.append(others, nearest) if found > len(others) else others
        rows.sort()
        self._rewire(node, rows[rows != tree.parent[node]])
        return node

    def settle(self, node: int) -> tuple[float, FloatArray]:
        """Cost and covariance of a node when its last body has arrived; the others wait.

        Args:
            node: Node.

        Returns:
            Cost, and covariance of shape (M, s, s).
        """
        times = np.full_like(self.tree.time[node], self.tree.time[node].max())
        if delay(self.tree.time[node]) == 0:
            return float(self.tree.cost[node]), self.tree.covariance[node]
        costs, covariances = self._cost(
            np.array([node]), self.tree.position[node][None], times[None], np.array([np.inf])
        )
        return float(costs[0]), covariances[0]

    def path(self, node: int) -> list[int]:
        """Nodes from the root to a node.

        Args:
            node: Node.

        Returns:
            Their numbers, the root first.
        """
        way = [node]
        while way[-1] != 0:
            way.append(int(self.tree.parent[way[-1]]))
        return way[::-1]

    def _plant(self) -> None:
        """Covariance of the root at its earliest start, with what is measured until then."""
        tree, problem, space = self.tree, self.problem, self.space
        tree.covariance[0] = problem.estimate.covariance
        base, start = problem.estimate.time, int(problem.times.min())
        if start == base:
            return
        # One body more, which nothing rides on and which starts at the estimate's time: the edge
        # from there to the earliest start has all others on their tracks.
        bodies = len(problem.starts)
        nobody = np.zeros((len(space.tracks), 1, 2))
        early = Tree(
            position=np.zeros((1, bodies + 1, 2)),
            time=np.append(problem.times, base)[None],
            parent=np.array([-1]),
            cost=np.zeros(1),
            covariance=problem.estimate.covariance[None].copy(),
            travelled=np.zeros((1, bodies + 1)),
        )
        on_tracks = space._replace(tracks=np.concatenate([space.tracks, nobody], axis=1))
        covariances = np.zeros((1, *tree.covariance.shape[1:]))
        problem.model.cost_pairs(
            CostTask(
                tree=early,
                space=on_tracks,
                carriers=problem.carriers,
                means=self.means,
                parents=np.zeros(1, dtype=np.int64),
                positions=early.position,
                times=np.full_like(early.time, start),
                limits=_NO,
                falling=False,
                costs=np.zeros(1),
                covariances=covariances,
                places=self._places,
                there=self._there,
            )
        )
        tree.covariance[0] = covariances[0]

    def _choose_parent(self, node: int, nearest: int, others: IntArray) -> bool:
        """Algorithm 2: the parent of least cost; on a tie the nearest, then the first."""
        tree = self.tree
        rows = np.concatenate([[nearest], others])
        times, is_open = self._ways(rows, node, to_node=True)
        is_open[0] = True
        rows, times = rows[is_open], times[is_open]
        positions = np.repeat(tree.position[node][None], len(rows), axis=0)
        limits = np.full(len(rows), np.inf)
        costs, covariances = self._cost(rows, positions, times, limits, falling=True)
        best = int(np.argmin(costs))
        if costs[best] == np.inf:
            return False
        self._enter(node, int(rows[best]), times[best], float(costs[best]), covariances[best])
        return True

    def _rewire(self, node: int, rows: IntArray) -> None:
        """Algorithm 3: the new node as parent of those near that it reaches at less cost."""
        tree = self.tree
        free_of_time = self.options.sync == "relaxed"
        rows = rows[tree.cost[rows] > tree.cost[node]]
        if not free_of_time:
            rows = rows[np.ptp(tree.time[rows], axis=1) == 0]
        if not len(rows):
            return
        times, is_open = self._ways(rows, node, to_node=False)
        if not free_of_time:
            is_open &= np.ptp(times, axis=1) == 0
        rows, times = rows[is_open], times[is_open]
        if not len(rows):
            return
        parents = np.full(len(rows), node)
        costs, covariances = self._cost(parents, tree.position[rows], times, tree.cost[rows])
        for place, row in enumerate(rows.tolist()):
            if costs[place] >= tree.cost[row]:
                continue  # too dear, or an earlier rewiring of this round has done better
            self._children[tree.parent[row]].remove(row)
            self._children[node].append(row)
            self._enter(row, node, times[place], float(costs[place]), covariances[place])
            self._pass_on(row)

    def _pass_on(self, row: int) -> None:
        """Times, costs and covariances of all successors of a rewired node."""
        tree = self.tree
        waiting = list(self._children[row])
        times = np.zeros((1, tree.time.shape[1]), dtype=np.int64)
        while waiting:
            child = waiting.pop()
            parent = int(tree.parent[child])
            arrive(tree, self.space, parent, tree.position[child], times[0])
            costs, covariances = self._cost(
                np.array([parent]), tree.position[child][None], times, _NO
            )
            self._enter(child, parent, times[0], float(costs[0]), covariances[0])
            waiting.extend(self._children[child])

    def _enter(
        self, node: int, parent: int, time: IntArray, cost: float, covariance: FloatArray
    ) -> None:
        """Write what a node owes to its parent."""
        tree = self.tree
        tree.parent[node] = parent
        tree.time[node] = time
        tree.cost[node] = cost
        tree.covariance[node] = covariance
        way = tree.position[node] - tree.position[parent]
        tree.travelled[node] = tree.travelled[parent] + np.hypot(way[:, 0], way[:, 1])

    def _ways(self, rows: IntArray, node: int, *, to_node: bool) -> tuple[IntArray, BoolArray]:
        """Arrival times and freedom of ways between nodes and one node."""
        times = np.zeros((len(rows), self.tree.time.shape[1]), dtype=np.int64)
        is_open = np.zeros(len(rows), dtype=np.bool_)
        open_ways(self.tree, self.space, self._obstacles, rows, node, to_node, times, is_open)
        return times, is_open

    def _cost(
        self,
        parents: IntArray,
        positions: FloatArray,
        times: IntArray,
        limits: FloatArray,
        *,
        falling: bool = False,
    ) -> tuple[FloatArray, FloatArray]:
        """Costs and covariances of children by Algorithm 4; infinite where not below a limit."""
        costs = np.zeros(len(parents))
        covariances = np.zeros((len(parents), *self.tree.covariance.shape[1:]))
        self.problem.model.cost_pairs(
            CostTask(
                tree=self.tree,
                space=self.space,
                carriers=self.problem.carriers,
                means=self.means,
                parents=parents,
                positions=positions,
                times=times,
                limits=limits,
                falling=falling,
                costs=costs,
                covariances=covariances,
                places=self._places,
                there=self._there,
            )
        )
        return costs, covariances


_NO = np.array([np.inf])
