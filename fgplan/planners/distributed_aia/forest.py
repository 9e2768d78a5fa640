"""Room for the trees of a team, and more of it when one is full.

24 M bytes of covariance, 4 for each neighbour's node, and about 100 for links, cost, position and
the hash table a node; all rows of a forest have the same room.
"""

import numpy as np
from numpy.typing import NDArray

from fgplan.planners.aia.arrays import Prepared
from fgplan.planners.aia.room_kernels import enter_groups
from fgplan.planners.aia.tree_kernels import NODES, Tree
from fgplan.planners.distributed_aia.extension_kernels import Heard
from fgplan.planners.distributed_aia.forest_kernels import Forest
from fgplan.typing import IntArray

_BY_NODE = (
    "parent",
    "first_child",
    "next_sibling",
    "group",
    "next_in_group",
    "depth",
    "cost",
    "covariance",
    "assigned",
    "configuration",
    "head",
    "tail",
    "size",
    "stamp",
    "deepest",
    "uncertainty",
    "position",
    "source",
    "born",
    "is_goal",
)
_TREE = len(Tree._fields)


def make_forest(prepared: Prepared, rows: int, neighbours: int, nodes: int) -> Forest:
    """Room for the first nodes of every row.

    Args:
        prepared: The problem's arrays.
        rows: Number of trees R.
        neighbours: Most neighbours of a robot, D.
        nodes: Room C of each.

    Returns:
        An empty forest.
    """
    targets = prepared.setting.sight.places.shape[1]

    def links() -> IntArray:
        return np.full((rows, nodes), -1, dtype=np.int32)

    return Forest(
        parent=links(),
        first_child=links(),
        next_sibling=links(),
        group=links(),
        next_in_group=links(),
        depth=links(),
        cost=np.zeros((rows, nodes)),
        covariance=np.zeros((rows, nodes, len(prepared.root))),
        assigned=np.zeros((rows, nodes, 1), dtype=np.uint8 if targets <= 255 else np.uint16),
        configuration=np.zeros((rows, nodes, 1), dtype=np.int32),
        head=links(),
        tail=links(),
        size=np.zeros((rows, nodes), dtype=np.int32),
        stamp=links(),
        deepest=links(),
        slots=np.full((rows, _slots(nodes)), -1, dtype=np.int32),
        counts=np.zeros((rows, 16), dtype=np.int64),
        best=np.full((rows, 2), np.inf),
        drawn=np.zeros((rows, 1), dtype=np.int64),
        uncertainty=np.zeros((rows, nodes)),
        position=np.zeros((rows, nodes, 2)),
        source=np.full((rows, nodes, neighbours), -1, dtype=np.int32),
        born=np.zeros((rows, nodes), dtype=np.int32),
        is_goal=np.zeros((rows, nodes), dtype=np.bool_),
        known=np.zeros(rows, dtype=np.int64),
        goals=np.zeros(rows, dtype=np.int64),
        margin=np.ones(rows),
        clock=np.zeros(2, dtype=np.int64),
    )


def with_room(forest: Forest, nodes: int) -> Forest:
    """The same forest with room for more nodes in every row.

    Args:
        forest: The forest.
        nodes: New room, at least the old one.

    Returns:
        A copy.
    """
    parts = {name: _grown(getattr(forest, name), nodes) for name in _BY_NODE}
    rows = len(forest.counts)
    slots: IntArray = np.full((rows, _slots(nodes)), -1, dtype=np.int32)
    grown = forest._replace(slots=slots, **parts)
    for row in range(rows):
        enter_groups(tree_of(grown, row))
    return grown


def tree_of(forest: Forest, row: int) -> Tree:
    """One row as a sampling tree of one robot; the arrays are the forest's.

    Args:
        forest: The forest.
        row: The row.

    Returns:
        Views.
    """
    return Tree(*(array[row] for array in forest[:_TREE]))


def make_heard(prepared: Prepared, neighbours: int) -> Heard:
    """Room for one extension.

    Args:
        prepared: The problem's arrays.
        neighbours: Most neighbours of a robot, D.

    Returns:
        Scratch arrays; no neighbour heard.
    """
    return Heard(
        covariance=np.zeros((neighbours, len(prepared.root))),
        late=np.zeros(neighbours, dtype=np.bool_),
        node=np.full(neighbours, -1, dtype=np.int64),
        taken=np.zeros(prepared.setting.sight.places.shape[1], dtype=np.bool_),
    )


def bytes_per_node(forest: Forest) -> float:
    """Memory of the arrays by room for a node of a row.

    Args:
        forest: The forest.

    Returns:
        Bytes.
    """
    return float(sum(array.nbytes for array in forest) / forest.parent.size)


def way_to(parent: IntArray, node: int) -> list[int]:
    """Nodes from the root to a node.

    Args:
        parent: Of each node, -1 for the root.
        node: The last.

    Returns:
        Numbers, root first.
    """
    nodes = [int(node)]
    while parent[nodes[-1]] >= 0:
        nodes.append(int(parent[nodes[-1]]))
    return nodes[::-1]


def node_count(forest: Forest, row: int) -> int:
    """Nodes of a row that grows here.

    Args:
        forest: The forest.
        row: The row.
    """
    return int(forest.counts[row, NODES])


def _slots(size: int) -> int:
    """Length of a hash table: a power of two, at most four fifths full."""
    return int(2 ** np.ceil(np.log2(1.25 * size + 1)))


def _grown(array: NDArray, nodes: int) -> NDArray:
    """A copy with more room along the second axis; what is new looks empty."""
    fill = -1 if array.dtype == np.int32 else 0
    grown = np.full((len(array), nodes, *array.shape[2:]), fill, dtype=array.dtype)
    grown[:, : array.shape[1]] = array
    return grown
