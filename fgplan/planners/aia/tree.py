"""Room for a tree and for the poses that it reaches, and more of it when it is full.

24 M bytes of covariance and 3 N of configuration and assignment a node (5 N where poses do not
recur), and about 60 for links, cost and the hash table: what ``bytes_per_node`` counts. A first
plan is small; a tree that outgrows its first room gets 256 MiB at once, which the system hands out
as rows are written: doubling from there on copied and faulted for half of the time (measured).
"""

import numpy as np
from numpy.typing import NDArray

from fgplan.errors import InvalidInputError
from fgplan.planners.aia.arrays import Prepared
from fgplan.planners.aia.pose_kernels import ENTRY_COUNT, POSE_COUNT, Poses
from fgplan.planners.aia.room_kernels import enter_groups, enter_rows
from fgplan.planners.aia.tree_kernels import GROUPS, NODES, Scratch, Tree

_FIRST_NODES = 4096
_FIRST_POSES = 2048
_SECOND_BYTES = 2**28
_SMALL_ROWS = 65_535
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
)
_BY_GROUP = ("configuration", "head", "tail", "size", "stamp", "deepest")


def make_poses(prepared: Prepared) -> Poses:
    """An empty table of poses.

    Args:
        prepared: The problem's arrays.

    Returns:
        The table; it remembers successors where every control set is a lattice's.
    """
    setting = prepared.setting
    controls = setting.motions.relative.shape[1]
    recurs = not setting.motions.body.any()
    rows = max(_FIRST_POSES, 4 * len(setting.kind) * controls)
    entries = max(_FIRST_POSES, 4 * len(setting.kind) * setting.sight.places.shape[1])
    return Poses(
        pose=np.empty((rows, 3)),
        kind=np.empty(rows, dtype=np.uint8),
        cell=np.empty(rows, dtype=np.int32),
        slots=np.full(_slots(rows), -1, dtype=np.int32),
        successors=np.empty((rows, controls) if recurs else (0, 0), dtype=np.int32),
        free=np.empty(rows if recurs else 0, dtype=np.int32),
        preferred=np.empty(
            (rows, setting.sight.places.shape[1]) if recurs and setting.sight.fixed else (0, 0),
            dtype=np.int16,
        ),
        first=np.empty(rows, dtype=np.int32),
        entries=np.empty(rows, dtype=np.int32),
        target=np.empty(entries, dtype=np.int32),
        information=np.empty((entries, 3)),
        counts=np.zeros(2, dtype=np.int64),
    )


def more_poses(poses: Poses) -> Poses:
    """The same table with twice the room.

    Args:
        poses: The table.

    Returns:
        A copy.
    """
    used, entries = poses.counts[POSE_COUNT], poses.counts[ENTRY_COUNT]
    rows = 2 * len(poses.pose)
    grown = poses._replace(
        pose=_grown(poses.pose, rows, used),
        kind=_grown(poses.kind, rows, used),
        cell=_grown(poses.cell, rows, used),
        slots=np.full(_slots(rows) if len(poses.slots) else 0, -1, dtype=np.int32),
        successors=_grown(poses.successors, rows, used)
        if len(poses.successors)
        else poses.successors,
        free=_grown(poses.free, rows, used) if len(poses.free) else poses.free,
        preferred=_grown(poses.preferred, rows, used) if len(poses.preferred) else poses.preferred,
        first=_grown(poses.first, rows, used),
        entries=_grown(poses.entries, rows, used),
        target=_grown(poses.target, 2 * len(poses.target), entries),
        information=_grown(poses.information, 2 * len(poses.information), entries),
    )
    if len(grown.slots):
        enter_rows(grown)
    return grown


def make_tree(prepared: Prepared, poses: Poses, node_budget: int) -> Tree:
    """Room for the first nodes.

    Args:
        prepared: The problem's arrays.
        poses: The table of poses.
        node_budget: Most nodes there will ever be.

    Returns:
        An empty tree.

    Raises:
        InvalidInputError: If there are more targets than an assignment can name.
    """
    robots = len(prepared.setting.kind)
    targets = prepared.setting.sight.places.shape[1]
    if targets > _SMALL_ROWS:
        raise InvalidInputError(f"planner aia: expected at most {_SMALL_ROWS} targets")
    size = min(_FIRST_NODES, max(node_budget, 1))
    small = len(poses.successors) > 0 and len(poses.pose) <= _SMALL_ROWS
    return Tree(
        parent=np.empty(size, dtype=np.int32),
        first_child=np.empty(size, dtype=np.int32),
        next_sibling=np.empty(size, dtype=np.int32),
        group=np.empty(size, dtype=np.int32),
        next_in_group=np.empty(size, dtype=np.int32),
        depth=np.empty(size, dtype=np.int32),
        cost=np.empty(size),
        covariance=np.empty((size, len(prepared.root))),
        assigned=np.empty((size, robots), dtype=np.uint8 if targets <= 255 else np.uint16),
        configuration=np.empty((size, robots), dtype=np.uint16 if small else np.int32),
        head=np.empty(size, dtype=np.int32),
        tail=np.empty(size, dtype=np.int32),
        size=np.empty(size, dtype=np.int32),
        stamp=np.empty(size, dtype=np.int32),
        deepest=np.empty(size, dtype=np.int32),
        slots=np.full(_slots(size), -1, dtype=np.int32),
        counts=np.zeros(16, dtype=np.int64),
        best=np.array([np.inf, np.inf]),
        drawn=np.zeros(robots, dtype=np.int64),
    )


def more_nodes(tree: Tree, node_budget: int) -> Tree:
    """The same tree with at least twice the room, within the budget.

    Args:
        tree: The tree.
        node_budget: Most nodes there will ever be.

    Returns:
        A copy.
    """
    nodes, groups = tree.counts[NODES], tree.counts[GROUPS]
    many = int(_SECOND_BYTES / bytes_per_node(tree))
    size = min(max(2 * len(tree.parent), many), node_budget)
    parts = {name: _grown(getattr(tree, name), size, nodes) for name in _BY_NODE}
    parts |= {name: _grown(getattr(tree, name), size, groups) for name in _BY_GROUP}
    grown = tree._replace(
        slots=np.full(_slots(size) if len(tree.slots) else 0, -1, dtype=np.int32), **parts
    )
    if len(grown.slots):
        enter_groups(grown)
    return grown


def with_large_rows(tree: Tree) -> Tree:
    """The same tree for tables of more poses than 16 bits can name.

    Args:
        tree: The tree.

    Returns:
        The tree, configurations in 32 bits.
    """
    return tree._replace(configuration=tree.configuration.astype(np.int32))


def needs_large_rows(tree: Tree, poses: Poses) -> bool:
    """Whether the table of poses has outgrown the tree's configurations.

    Args:
        tree: The tree.
        poses: The table.

    Returns:
        True where ``with_large_rows`` is due.
    """
    return tree.configuration.dtype == np.uint16 and len(poses.pose) > _SMALL_ROWS


def make_scratch(prepared: Prepared) -> Scratch:
    """Room for one node.

    Args:
        prepared: The problem's arrays.

    Returns:
        Scratch arrays.
    """
    robots, targets = len(prepared.setting.kind), prepared.setting.sight.places.shape[1]
    return Scratch(
        information=np.zeros(len(prepared.root)),
        covariance=np.zeros(len(prepared.root)),
        numbers=np.zeros(targets),
        satisfied=np.zeros(targets, dtype=np.bool_),
        holders=np.zeros(targets, dtype=np.int64),
        open_targets=np.zeros(targets, dtype=np.bool_),
        assigned=np.zeros(robots, dtype=np.int64),
        rows=np.zeros(robots, dtype=np.int64),
    )


def bytes_per_node(tree: Tree) -> float:
    """Memory of the tree's arrays by room for a node.

    Args:
        tree: The tree.

    Returns:
        Bytes.
    """
    return float(sum(array.nbytes for array in tree) / len(tree.parent))


def _slots(size: int) -> int:
    """Length of a hash table: a power of two, at most four fifths full."""
    return int(2 ** np.ceil(np.log2(1.25 * size + 1)))


def _grown(array: NDArray, size: int, used: int) -> NDArray:
    """A copy with room for more rows."""
    grown = np.empty((size, *array.shape[1:]), dtype=array.dtype)
    grown[:used] = array[:used]
    return grown
