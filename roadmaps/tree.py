"""A tree of positions grown from a root: the product of RRT, RRT* and RRG.

Row 0 is the root. cost(v) = cost(parent(v)) + cost of the edge that arrives at v.
"""

from dataclasses import dataclass

import networkx as nx
import numpy as np

from roadmaps.checks import read_only
from roadmaps.errors import ParameterError, UnknownVertexError
from roadmaps.roadmap import build_roadmap
from roadmaps.typing import FloatArray, IntArray
from roadmaps.vertex_path import VertexPath


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    """Positions, parents and costs; vertex ids are row numbers.

    Attributes:
        positions: Shape (n, d), metres, read-only; row 0 is the root.
        parents: Parent of each vertex, -1 for the root, shape (n,), read-only.
        costs: Cost from the root, metres unless the builder's cost has another unit, shape
            (n,), read-only.

    Raises:
        ParameterError: If shapes differ, or the parents are not those of one tree rooted at 0.
    """

    positions: FloatArray
    parents: IntArray
    costs: FloatArray

    def __post_init__(self) -> None:
        parents = np.array(self.parents, dtype=np.int64)
        size = len(self.positions)
        if parents.shape != (size,) or np.shape(self.costs) != (size,) or size == 0:
            raise ParameterError(
                f"expected one parent and one cost for each of {size} (at least 1) positions, got "
                f"shapes {parents.shape} and {np.shape(self.costs)}"
            )
        sound = bool(parents[0] == -1 and ((parents[1:] >= 0) & (parents[1:] < size)).all())
        ancestors = parents.copy()
        for _ in range(size.bit_length() if sound else 0):  # after k rounds: the 2^k-th ancestor
            ancestors = np.where(ancestors < 0, -1, ancestors[ancestors])
        if not sound or (ancestors >= 0).any():
            raise ParameterError("parents: expected -1 for row 0 only, and no cycle")
        parents.flags.writeable = False
        object.__setattr__(self, "positions", read_only(self.positions))
        object.__setattr__(self, "parents", parents)
        object.__setattr__(self, "costs", read_only(self.costs))

    def path_to(self, vertex: int) -> VertexPath:
        """Give the path from the root to a vertex.

        Args:
            vertex: Vertex id.

        Returns:
            The path; its length is the vertex's cost.

        Raises:
            UnknownVertexError: If the tree has no such vertex.
        """
        if not 0 <= vertex < len(self.parents):
            raise UnknownVertexError(
                f"vertex: expected 0 to {len(self.parents) - 1}, got {vertex!r}"
            )
        way = [int(vertex)]
        while way[-1] != 0:
            way.append(int(self.parents[way[-1]]))
        way.reverse()
        return VertexPath(tuple(way), self.positions[way], float(self.costs[vertex]))

    def roadmap(self) -> nx.Graph:
        """Give the tree as a roadmap: the same vertex ids, one edge to each parent.

        Returns:
            The roadmap; lengths are differences of cost.
        """
        child = np.arange(1, len(self.parents))
        parent = self.parents[1:]
        lengths = self.costs[child] - self.costs[parent]
        return build_roadmap(self.positions, np.stack([parent, child], axis=1), lengths)
