"""RRT: each new vertex is joined to the nearest one; cheap, and far from shortest."""

from typing import final

import networkx as nx
import numpy as np

from roadmaps.growth import AbstractGrowth
from roadmaps.tree import Tree


@final
class RRT(AbstractGrowth):
    """Rapidly-exploring random tree; arguments as in `AbstractGrowth`.

    References:
        LaValle and Kuffner, "Randomized kinodynamic planning", IJRR 20(5), 2001,
        doi:10.1177/02783640122067453.

    Example:
        >>> from roadmaps import Workspace
        >>> hall = Workspace(lower=[0, 0], upper=[10, 10])
        >>> rrt = RRT(hall, [1, 1], np.random.default_rng(0), step_m=1.0, goal=[9, 9])
        >>> rrt.grow(sample_count=500).path_to_goal().positions[-1]
        array([9., 9.])
    """

    def tree(self) -> Tree:
        """Give the tree as it is now.

        Returns:
            The tree, rooted at the start.
        """
        return Tree(self.positions, np.array(self._parents), np.array(self._costs))

    def roadmap(self) -> nx.Graph:
        """Give the tree's edges as a roadmap.

        Returns:
            The roadmap, the start as vertex 0.
        """
        return self.tree().roadmap()

    def _begin(self) -> None:
        """The start has no parent and costs nothing."""
        self._parents = [-1]
        self._costs = [0.0]

    def _attach(self, vertex: int, nearest: int) -> None:
        """Join the new vertex to the nearest."""
        place = self.positions
        cost = self.steering.costs(place[nearest, None], place[vertex, None])
        self._parents.append(nearest)
        self._costs.append(self._costs[nearest] + float(cost[0]))
