"""Compiled: the tree of Algorithm 1 of Kantaros et al. 2019 and how a group is extended.

A node is a team configuration with a covariance; nodes of one configuration form a group V_k,
whatever their time. Everything is in flat arrays: nodes point to their parent, first child and next
sibling; a group is a linked list in the order of insertion. A node already extended to a
configuration is not extended again: V is a set, so the same draw adds nothing.

Options that keep the optimum (the paper has none): a node whose cost is not below that of the best
plan is left out (costs only grow); so is one that is dominated, i.e. its group holds a node that is
no more expensive, no more uncertain in any target (Loewner order; the Riccati map is monotone) and
of the same time, or of any time where the hidden state does not vary with time.
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.assignment_kernels import Fields
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.covariance_kernels import Criteria, Dynamics
from fgplan.planners.aia.information_kernels import Sight
from fgplan.planners.aia.obstacle_kernels import Obstacles
from fgplan.planners.aia.pose_kernels import Motions
from fgplan.typing import BoolArray, FloatArray, IntArray

(
    NODES,
    GROUPS,
    DEEPEST,
    DEPTH,
    BEST,
    GOALS,
    CLOSEST,
    ITERATIONS,
    BOUNDED,
    DOMINATED,
    REPEATED,
    REJECTED,
    PENDING,
    DRAWN,
) = range(14)
"""Places in ``Tree.counts``."""
COST, SHORTFALL = 0, 1
"""Places in ``Tree.best``: cost of the best plan, least shortfall of any node."""
DONE, FEASIBLE, NEED_NODES, NEED_POSES, NEED_TIME, NODE_LIMIT = range(6)
"""Why a call ends."""


class Settings(NamedTuple):
    """How the tree grows.

    Attributes:
        at_child: Measure at the configuration reached, not at the one left.
        bound: Leave out nodes not cheaper than the best plan.
        dominance: 0 off, 1 among nodes of the same time, 2 among all.
        assign: Run Algorithm 2 for each new node; otherwise keep the parent's assignment.
        one_node: Extend one node of the group instead of all.
        reject_jointly: Draw from all controls and reject a draw that is not free; otherwise draw
            from the free ones, which has the same distribution of what is accepted.
        circle: Within ``near_m`` prefer to circle the target instead of drawing uniformly.
        stop_at_goal: End with the first node that satisfies the terminal constraint.
        uniform_after_goal: Draw uniformly once there is such a node (Remark 5.1).
        uniform_from: Iteration from which draws are uniform.
        p_group: p_V of equation (8).
        p_control: p_U of equation (9).
        node_limit: Nodes after which growing ends.
    """

    at_child: bool
    bound: bool
    dominance: int
    assign: bool
    one_node: bool
    reject_jointly: bool
    circle: bool
    stop_at_goal: bool
    uniform_after_goal: bool
    uniform_from: int
    p_group: float
    p_control: float
    node_limit: int


class Setting(NamedTuple):
    """What is planned for; constant while a tree grows.

    Attributes:
        obstacles: Where robots may be and what blocks sight.
        motions: Motion primitives by kind of robot.
        sight: Sensors and predicted targets.
        dynamics: Of the hidden state.
        criteria: Objective and terminal constraint.
        fields: Geodesic distances.
        kind: Kind of each robot, shape (N,).
        near_m: Distance below which a robot's controls are drawn uniformly, shape (N,).
        goal: Terminal goal of each robot, shape (N, 3): x, y, radius; radius infinite for none.
    """

    obstacles: Obstacles
    motions: Motions
    sight: Sight
    dynamics: Dynamics
    criteria: Criteria
    fields: Fields
    kind: IntArray
    near_m: FloatArray
    goal: FloatArray


class Tree(NamedTuple):
    """Nodes (leading axis C) and groups (leading axis C too), and counts.

    Attributes:
        parent: Node before; -1 for the root.
        first_child: Latest child, -1 for none; ``next_sibling`` its next.
        next_sibling: As said.
        group: Group of each node.
        next_in_group: Next node of the group, -1 at its end.
        depth: Number of steps from the root.
        cost: J of equation (6).
        covariance: Shape (C, width), see ``covariance_kernels``.
        assigned: Target of each robot, shape (C, N).
        configuration: Pose row of each robot of each group, shape (C, N).
        head: First node of each group.
        tail: Last node of each group.
        size: Number of nodes of each group.
        stamp: Greatest depth at which the group was entered into ``deepest``.
        deepest: Groups that hold a node of greatest depth.
        slots: Hash table of group numbers, -1 where free; shape (0,) where groups are found
            otherwise.
        counts: See ``NODES`` and so on.
        best: See ``COST`` and ``SHORTFALL``.
        drawn: Pose rows of the draw at hand, shape (N,).
    """

    parent: IntArray
    first_child: IntArray
    next_sibling: IntArray
    group: IntArray
    next_in_group: IntArray
    depth: IntArray
    cost: FloatArray
    covariance: FloatArray
    assigned: IntArray
    configuration: IntArray
    head: IntArray
    tail: IntArray
    size: IntArray
    stamp: IntArray
    deepest: IntArray
    slots: IntArray
    counts: IntArray
    best: FloatArray
    drawn: IntArray


class Scratch(NamedTuple):
    """Room for one node.

    Information and covariance (3 M,), numbers and sets of targets (M,), assignment and
    configuration (N,).
    """

    information: FloatArray
    covariance: FloatArray
    numbers: FloatArray
    satisfied: BoolArray
    holders: IntArray
    open_targets: BoolArray
    assigned: IntArray
    rows: IntArray


@njit(**UNCOUNTED)
def find_group(slots: IntArray, configuration: IntArray, rows: IntArray) -> tuple[int, int]:
    """Group of a configuration, or -1, and its place in the hash table."""
    mixed = np.int64(1469598103)
    for j in range(rows.shape[0]):
        mixed = ((mixed ^ np.int64(rows[j])) * np.int64(16777619)) & np.int64(0xFFFFFFFFFFF)
    mask = slots.shape[0] - 1
    place = (mixed ^ (mixed >> 17)) & mask
    while True:
        k = slots[place]
        if k < 0:
            return -1, place
        same = True
        for j in range(rows.shape[0]):
            if configuration[k, j] != rows[j]:
                same = False
                break
        if same:
            return int(k), place
        place = (place + 1) & mask


@njit(**UNCOUNTED)
def link_node(tree: Tree, parent: int, k: int, place: int, rows: IntArray, cost: float) -> int:
    """Append a node: links, group and cost; -1 parent makes the root.

    Where:
        k: Its group, or -1 where it is the first of a new one, which goes to ``place``.

    Returns:
        Its group.
    """
    counts = tree.counts
    node = counts[NODES]
    counts[NODES] = node + 1
    depth = 0 if parent < 0 else tree.depth[parent] + 1
    if k < 0:
        k = counts[GROUPS]
        counts[GROUPS] = k + 1
        tree.slots[place] = k
        tree.head[k] = node
        tree.size[k] = 0
        tree.stamp[k] = -1
        for j in range(rows.shape[0]):
            tree.configuration[k, j] = rows[j]
    else:
        tree.next_in_group[tree.tail[k]] = node
    tree.tail[k] = node
    tree.size[k] += 1
    tree.parent[node] = parent
    tree.first_child[node] = -1
    tree.next_sibling[node] = -1
    if parent >= 0:
        tree.next_sibling[node] = tree.first_child[parent]
        tree.first_child[parent] = node
    tree.group[node] = k
    tree.next_in_group[node] = -1
    tree.depth[node] = depth
    tree.cost[node] = cost
    if depth > counts[DEPTH] or parent < 0:
        counts[DEPTH] = depth
        counts[DEEPEST] = 0
    if depth == counts[DEPTH] and tree.stamp[k] != depth:
        tree.stamp[k] = depth
        tree.deepest[counts[DEEPEST]] = k
        counts[DEEPEST] += 1
    return int(k)


@njit(**UNCOUNTED)
def repeats(
    first_child: IntArray, next_sibling: IntArray, group: IntArray, node: int, k: int
) -> tuple[bool, int]:
    """Whether a node has a child in a group; and one of its children, -1 if it has none."""
    child = first_child[node]
    some = child
    while child >= 0:
        if group[child] == k:
            return True, some
        child = next_sibling[child]
    return False, some


@njit(**UNCOUNTED)
def note_node(
    counts: IntArray, best: FloatArray, node: int, cost: float, shortfall: float, is_goal: bool
) -> None:
    """Note the node that comes closest to the terminal constraint, and goal nodes and the best."""
    if shortfall < best[SHORTFALL]:
        best[SHORTFALL] = shortfall
        counts[CLOSEST] = node
    if is_goal:
        counts[GOALS] += 1
        if cost < best[COST]:
            best[COST] = cost
            counts[BEST] = node


@njit(**UNCOUNTED)
def at_goal(goal: FloatArray, pose: FloatArray, rows: IntArray) -> bool:
    """Whether every robot is at its terminal goal."""
    for j in range(rows.shape[0]):
        radius = goal[j, 2]
        if radius < np.inf:
            dx = pose[rows[j], 0] - goal[j, 0]
            dy = pose[rows[j], 1] - goal[j, 1]
            if dx * dx + dy * dy > radius * radius:
                return False
    return True
