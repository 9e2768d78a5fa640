"""RRT*: each new vertex takes the parent of least cost nearby, then offers itself as parent.

    parent(x_new) <- argmin over valid x in Near(x_new):  cost(x) + c(x, x_new)
    for valid x in Near(x_new): if cost(x_new) + c(x_new, x) < cost(x): parent(x) <- x_new

The vertex nearest to x_new is always a candidate, and rewiring only lowers costs; so with the
same samples no vertex costs more than in RRT. A rewired vertex passes its gain on to all its
descendants at once, so that costs are always those of the tree.
"""

from typing import final

import networkx as nx
import numpy as np

from roadmaps.growth import AbstractGrowth
from roadmaps.tree import Tree
from roadmaps.typing import FloatArray


@final
class RRTStar(AbstractGrowth):
    """Asymptotically optimal RRT; arguments as in `AbstractGrowth`.

    References:
        Karaman and Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR
        30(7), 2011, doi:10.1177/0278364911406761.
    """

    def tree(self) -> Tree:
        """Give the tree as it is now.

        Returns:
            The tree, rooted at the start.
        """
        return Tree(self.positions, np.array(self._parents), self._costs[: len(self)])

    def roadmap(self) -> nx.Graph:
        """Give the tree's edges as a roadmap.

        Returns:
            The roadmap, the start as vertex 0.
        """
        return self.tree().roadmap()

    def _begin(self) -> None:
        """The start has no parent, no children, and costs nothing."""
        self._parents = [-1]
        self._children: list[list[int]] = [[]]
        self._costs: FloatArray = np.zeros(64)

    def _attach(self, vertex: int, nearest: int) -> None:
        """Choose the parent of least cost, then rewire."""
        if vertex >= len(self._costs):
            self._costs = np.concatenate([self._costs, np.zeros_like(self._costs)])
        rows, valid, arriving = self._near(vertex, nearest)
        through = np.where(valid, self._costs[rows] + arriving, np.inf)
        # On a tie the nearest vertex stays the parent.
        best = int(np.argmin(through))
        kept = int(np.searchsorted(rows, nearest))
        if through[best] >= through[kept]:
            best = kept
        parent = int(rows[best])
        self._parents.append(parent)
        self._children.append([])
        self._children[parent].append(vertex)
        self._costs[vertex] = through[best]
        self._rewire(vertex, rows[rows != parent])

    def _rewire(self, vertex: int, rows: np.ndarray) -> None:
        """Make the new vertex the parent of those that it reaches at less cost."""
        if not len(rows):
            return
        positions = self.positions
        starts = np.broadcast_to(positions[vertex], (len(rows), positions.shape[1]))
        leaving = np.asarray(self.steering.costs(starts, positions[rows]), dtype=np.float64)
        better = (self._costs[vertex] + leaving < self._costs[rows]) & (leaving > 0.0)
        rows, leaving, starts = rows[better], leaving[better], starts[better]
        if not len(rows):
            return
        valid = self.checker.are_motions_valid(starts, positions[rows])
        for row, cost in zip(rows[valid].tolist(), leaving[valid].tolist(), strict=True):
            if self._costs[vertex] + cost >= self._costs[row]:
                continue  # an earlier rewiring of this round has done better
            self._children[self._parents[row]].remove(row)
            self._parents[row] = vertex
            self._children[vertex].append(row)
            self._pass_on(row, float(self._costs[vertex] + cost))

    def _pass_on(self, row: int, cost: float) -> None:
        """Set a vertex's cost and lower those of its descendants as much."""
        gain = self._costs[row] - cost
        waiting = [row]
        while waiting:
            lowered = waiting.pop()
            self._costs[lowered] -= gain
            waiting.extend(self._children[lowered])
        self._costs[row] = cost
