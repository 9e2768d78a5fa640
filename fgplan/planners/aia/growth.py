"""One tree that grows: the state of a search, and the only thing that holds the kernels' arrays.

``run`` is a loop over the compiled ``grow`` that makes room when asked to. Where the problem has a
part that the kernels do not know, ``GuidedGrowth`` (``guided_growth``) drives them from Python.
"""

from typing import Literal

import numpy as np

from fgplan.planners.aia.arrays import Prepared, unpacked
from fgplan.planners.aia.extension_kernels import append_node
from fgplan.planners.aia.ground import Ground
from fgplan.planners.aia.grow_kernels import grow
from fgplan.planners.aia.information_kernels import team_information
from fgplan.planners.aia.judgement import Judgement
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.team_path import TeamPath
from fgplan.planners.aia.tree import (
    bytes_per_node,
    make_tree,
    more_nodes,
    needs_large_rows,
    way_to,
    with_large_rows,
)
from fgplan.planners.aia.tree_kernels import (
    BEST,
    BOUNDED,
    CLOSEST,
    COST,
    DOMINATED,
    GOALS,
    ITERATIONS,
    NEED_NODES,
    NODES,
    SHORTFALL,
    find_group,
)
from fgplan.riccati.block_diagonal import update_blocks
from fgplan.typing import FloatArray, IntArray

Ended = Literal["iterations", "feasible", "nodes"]


class Growth(Ground):
    """A tree with its problem; ``plant`` begins a new one."""

    def __init__(
        self, problem: AcquisitionProblem, options: TreeOptions, prepared: Prepared
    ) -> None:
        """Make room.

        Args:
            problem: What is planned for.
            options: How.
            prepared: The problem's arrays.
        """
        super().__init__(problem, options, prepared)
        self.options = options
        self.tree = make_tree(prepared, self.poses, options.node_budget)

    def plant(self, bound: float = np.inf) -> None:
        """Begin a tree at the root q(0) = [p(0), Sigma(0)], line 1 of Algorithm 1.

        Args:
            bound: Cost of the best plan so far; a finite one turns branch and bound on.
        """
        tree = self.tree
        tree.slots[:] = -1
        tree.counts[:] = 0
        tree.best[:] = (bound, np.inf)
        if np.isfinite(bound):
            self.settings = self.settings._replace(bound=True)
        rows = tree.drawn
        rows[:] = self._starts()
        self.scratch.covariance[:] = self.prepared.root
        if self.settings.at_child:
            self.scratch.covariance[:] = self._measured(rows)
        self._insert_root(rows)

    def run(self, iterations: int, generator: np.random.Generator) -> Ended:
        """Grow.

        Args:
            iterations: How many more at most.
            generator: Source of every random number.

        Returns:
            Why it ended.
        """
        last = self.iterations + iterations
        ended = self._grown(
            lambda: grow(
                self.prepared.setting,
                self.settings,
                self.poses,
                self.tree,
                self.scratch,
                last - self.iterations,
                generator,
            )
        )
        return ended or "iterations"

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return int(self.tree.counts[NODES])

    @property
    def iterations(self) -> int:
        """Number of iterations."""
        return int(self.tree.counts[ITERATIONS])

    @property
    def feasible(self) -> bool:
        """Whether a node satisfies the terminal constraint."""
        return bool(self.tree.counts[GOALS] > 0)

    @property
    def best_cost(self) -> float:
        """Cost of this tree's best plan; infinite if there is none."""
        return float(self.tree.best[COST]) if self.feasible else np.inf

    @property
    def shortfall(self) -> float:
        """Least shortfall of any node."""
        return float(self.tree.best[SHORTFALL])

    @property
    def farthest(self) -> str:
        """Name of the target farthest from its limit there; empty of a joint constraint."""
        node = int(self.tree.counts[CLOSEST])
        row, depth = self.tree.covariance[node], int(self.tree.depth[node])
        return Judgement(self.problem).farthest(row, depth)

    @property
    def bytes_per_node(self) -> float:
        """Memory by room for a node."""
        return bytes_per_node(self.tree)

    def counted(self) -> dict[str, int]:
        """What was counted, by name."""
        others = {"left_out_by_bound": BOUNDED, "left_out_by_dominance": DOMINATED}
        return self._counted(self.tree.counts, others)

    def best_path(self) -> TeamPath:
        """Path to the best node that satisfies the terminal constraint."""
        return self.path_to(int(self.tree.counts[BEST]))

    def closest_path(self) -> TeamPath:
        """Path to the node of least shortfall."""
        return self.path_to(int(self.tree.counts[CLOSEST]))

    def path_to(self, node: int) -> TeamPath:
        """Path from the root to a node.

        Args:
            node: Its number.

        Returns:
            Poses, covariances and cost.
        """
        tree = self.tree
        nodes = way_to(tree.parent, node)
        rows = tree.configuration[tree.group[nodes]].astype(np.int64)
        return TeamPath(
            poses=self.poses.pose[rows],
            covariances=unpacked(tree.covariance[nodes], packed=self.problem.packed),
            cost=float(tree.cost[node]),
            assigned=tree.assigned[nodes].astype(np.int64),
        )

    def _starts(self) -> list[int]:
        """Rows of the robots' poses at time 0."""
        return [self._start(j) for j in range(len(self.problem.robots))]

    def _insert_root(self, rows: IntArray) -> None:
        """Enter the root, whose covariance is in scratch."""
        tree, setting = self.tree, self.prepared.setting
        tree.covariance[0] = self.scratch.covariance
        cost = self._objective(self.scratch.covariance)
        _, place = find_group(tree.slots, tree.configuration, rows)
        append_node(
            setting, self.settings, self.poses, tree, self.scratch, -1, -1, place, rows, cost
        )

    def _measured(self, rows: IntArray) -> FloatArray:
        """The root's covariance after measuring there, for measuring at the child."""
        information = self._information(rows, 0)
        if self.problem.packed:
            now = unpacked(self.prepared.root, packed=True)
            after = update_blocks(now, unpacked(information, packed=True))
            return np.stack([after[:, 0, 0], after[:, 0, 1], after[:, 1, 1]], axis=1).ravel()
        size = self.problem.hidden.size
        now = self.prepared.root.reshape(1, size, size)
        return update_blocks(now, information.reshape(1, size, size)).ravel()

    def _information(self, rows: IntArray, time: int) -> FloatArray:
        """Information of a configuration at a time, shape (width,)."""
        setting = self.prepared.setting
        out = np.zeros(len(self.prepared.root))
        team_information(setting.sight, setting.obstacles, self.poses, rows, time, out)
        return out

    def _made_room(self, ended: int) -> bool:
        """Make the room that a kernel asked for; False where it asked for none."""
        if ended == NEED_NODES:
            self.tree = more_nodes(self.tree, self.options.node_budget)
            return True
        made = super()._made_room(ended)
        if made and needs_large_rows(self.tree, self.poses):
            self.tree = with_large_rows(self.tree)
        return made
