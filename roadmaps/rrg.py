"""RRG: each new vertex is joined to all near ones; the graph contains RRT's tree.

Unlike a tree it holds alternatives, so candidate paths can be searched in it while it grows.
Motions are taken to be possible both ways: validity and cost must be symmetric.
"""

from typing import final

import networkx as nx
import numpy as np
from scipy.sparse.csgraph import dijkstra

from roadmaps.growth import AbstractGrowth
from roadmaps.roadmap import build_roadmap, read_roadmap
from roadmaps.tree import Tree


@final
class RRG(AbstractGrowth):
    """Rapidly-exploring random graph; arguments as in `AbstractGrowth`.

    References:
        Karaman and Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR
        30(7), 2011, doi:10.1177/0278364911406761.
    """

    def tree(self) -> Tree:
        """Give the tree of shortest paths from the start in the graph as it is now.

        Returns:
            The tree, rooted at the start.
        """
        matrix = read_roadmap(self.roadmap())
        costs, parents = dijkstra(
            matrix.sparse(matrix.lengths), indices=0, return_predecessors=True
        )
        parents[0] = -1
        return Tree(self.positions, parents, costs)

    def roadmap(self) -> nx.Graph:
        """Give the graph as it is now.

        Returns:
            The roadmap, the start as vertex 0.
        """
        return build_roadmap(self.positions, np.array(self._edges), np.array(self._lengths))

    def _begin(self) -> None:
        """The start has no edges."""
        self._edges: list[tuple[int, int]] = []
        self._lengths: list[float] = []

    def _attach(self, vertex: int, nearest: int) -> None:
        """Join the new vertex to all that are near and can be reached."""
        rows, valid, costs = self._near(vertex, nearest)
        self._edges.extend((row, vertex) for row in rows[valid].tolist())
        self._lengths.extend(costs[valid].tolist())
