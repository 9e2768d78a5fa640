"""Room for the trees of a team, and more of it when one is full.

24 M bytes of covariance, 4 for each neighbour's node, and about 100 for links, cost, position and
the hash table a node; all rows of a forest have the same room.
"""

import numpy as np
from numpy.typing import NDArray

from fgplan.planners.aia.arrays import Prepared
from fgplan.planners.aia.room_kernels import enter_groups
from fgplan.planners.aia.tree import BY_GROUP, BY_NODE, empty_slots, empty_trees
from fgplan.planners.aia.tree_kernels import Tree
from fgplan.planners.distributed_aia.extension_kernels import Heard
from fgplan.planners.distributed_aia.forest_kernels import Forest

_BY_NODE = ("uncertainty", "position", "source", "born", "is_goal")


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
    return Forest(
        trees=empty_trees((rows,), prepared, nodes, 1, np.dtype(np.int32)),
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
    trees, rows = forest.trees, len(forest.trees.counts)
    parts = {name: _grown(getattr(trees, name), nodes) for name in BY_NODE + BY_GROUP}
    grown = forest._replace(
        trees=trees._replace(slots=empty_slots((rows,), nodes), **parts),
        **{name: _grown(getattr(forest, name), nodes) for name in _BY_NODE},
    )
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
    return Tree(*(array[row] for array in forest.trees))


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
    trees, *others = forest
    return float(sum(array.nbytes for array in (*trees, *others)) / trees.parent.size)


def _grown(array: NDArray, nodes: int) -> NDArray:
    """A copy with more room along the second axis; what is new looks empty."""
    fill = -1 if array.dtype == np.int32 else 0
    grown = np.full((len(array), nodes, *array.shape[2:]), fill, dtype=array.dtype)
    grown[:, : array.shape[1]] = array
    return grown
