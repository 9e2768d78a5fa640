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
from fgplan.typing import IntArray

_FIRST_NODES = 4096
_FIRST_POSES = 2048
_SECOND_BYTES = 2**28
_SMALL_ROWS = 65_535
BY_NODE = (
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
"""Arrays of a tree with a place for each node."""
BY_GROUP = ("configuration", "head", "tail", "size", "stamp", "deepest")
"""Those with a place for each group."""


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
        slots=empty_slots((), rows),
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
        slots=empty_slots((), rows) if len(poses.slots) else poses.slots,
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
    return empty_trees((), prepared, size, robots, np.dtype(np.uint16 if small else np.int32))


def empty_trees(
    lead: tuple[int, ...], prepared: Prepared, size: int, robots: int, row_type: np.dtype
) -> Tree:
    """Room for the first nodes of one tree or of many alike.

    Args:
        lead: Leading axes of every array: () for one tree, (R,) for so many.
        prepared: The problem's arrays.
        size: Room for nodes.
        robots: Robots that a tree plans for.
        row_type: Of the configurations' numbers.

    Returns:
        Links -1, all else zero; no plan yet.
    """
    targets = prepared.setting.sight.places.shape[1]

    def links() -> IntArray:
        return np.full((*lead, size), -1, dtype=np.int32)

    return Tree(
        parent=links(),
        first_child=links(),
        next_sibling=links(),
        group=links(),
        next_in_group=links(),
        depth=links(),
        cost=np.zeros((*lead, size)),
        covariance=np.zeros((*lead, size, len(prepared.root))),
        assigned=np.zeros((*lead, size, robots), dtype=np.uint8 if targets <= 255 else np.uint16),
        configuration=np.zeros((*lead, size, robots), dtype=row_type),
        head=links(),
        tail=links(),
        size=np.zeros((*lead, size), dtype=np.int32),
        stamp=links(),
        deepest=links(),
        slots=empty_slots(lead, size),
        counts=np.zeros((*lead, 16), dtype=np.int64),
        best=np.full((*lead, 2), np.inf),
        drawn=np.zeros((*lead, robots), dtype=np.int64),
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
    parts = {name: _grown(getattr(tree, name), size, nodes) for name in BY_NODE}
    parts |= {name: _grown(getattr(tree, name), size, groups) for name in BY_GROUP}
    grown = tree._replace(slots=empty_slots((), size) if len(tree.slots) else tree.slots, **parts)
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


def empty_slots(lead: tuple[int, ...], size: int) -> IntArray:
    """Empty hash tables: a power of two long, at most four fifths full.

    Args:
        lead: Leading axes: () for one table, (R,) for so many.
        size: Most entries of a table.

    Returns:
        Shape (*lead, length), -1 everywhere.
    """
    length = int(2 ** np.ceil(np.log2(1.25 * size + 1)))
    return np.full((*lead, length), -1, dtype=np.int32)


def _grown(array: NDArray, size: int, used: int) -> NDArray:
    """A copy with room for more rows."""
    grown = np.empty((size, *array.shape[1:]), dtype=array.dtype)
    grown[:used] = array[:used]
    return grown
