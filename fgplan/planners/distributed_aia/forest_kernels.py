"""Compiled: the trees of a team, one a robot, and what each robot holds of its neighbours' trees.

A node of robot i's tree is q_i = [p_i, Sigma_i, S_i] (section III of Tzes et al. 2021): its pose,
its covariance before measuring there, and which node of each neighbour's tree was fused to make it.
Everything is in flat arrays with a leading axis over *rows*: a row is a robot's tree. In one
process every robot's tree is a row and a neighbour's tree is read where it is, as far as it was
sent; a robot on its own has a row for its tree and one for what has arrived of each neighbour's.

Within a row links are those of ``fgplan.planners.aia.tree_kernels``. Children are listed from the
greatest number down, whatever the order in which they arrived.
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.tree_kernels import Tree
from fgplan.typing import BoolArray, FloatArray, IntArray

FUSED, MEASURED = 14, 15
"""Places in ``counts`` beside those of one tree: covariances fused (own ones too), and measurement
models of the robot itself used."""
NEED_NUMBERS = 6
"""Why a call ends, beside the reasons of ``fgplan.planners.aia.tree_kernels``."""
TURN, SWEEP = 0, 1
"""Places in ``Forest.clock``: row whose turn it is, sweeps that are over."""


class Forest(NamedTuple):
    """Trees, leading axis R over rows, then C over nodes or groups.

    Attributes:
        trees: All arrays of a tree, each with the leading axis, of one robot; children have the
            greatest number first, and a node that has not arrived has depth -1.
        uncertainty: Log-determinant of each node's joint covariance, shape (R, C).
        position: Of the robot at each node, shape (R, C, 2), metres.
        source: S_i: node of each neighbour's tree, -1 at the root, shape (R, C, D).
        born: Sweep in which each node was made, shape (R, C).
        is_goal: Whether the node satisfies the terminal constraint, shape (R, C).
        known: Nodes of each row up to which others may read it, shape (R,).
        goals: Goal nodes of each row that have been looked at, shape (R,).
        margin: What each robot asks for is the limit times this: less than one once the replay has
            refused what its tree took for a goal, shape (R,).
        clock: See ``TURN`` and ``SWEEP``.
    """

    trees: Tree
    uncertainty: FloatArray
    position: FloatArray
    source: IntArray
    born: IntArray
    is_goal: BoolArray
    known: IntArray
    goals: IntArray
    margin: FloatArray
    clock: IntArray


class Links(NamedTuple):
    """Who hears whom, and how what is heard is used.

    Attributes:
        robot: Robot of each row, shape (R,).
        grows: Whether a row grows here; others hold what has arrived, shape (R,).
        neighbour: Rows of each row's neighbours in the order of the team, shape (R, D); -1 beyond
            its last.
        linked: Whether robots are linked, by sets of the schedule in turn, shape (T, N, N).
        period: Steps for which each set holds.
        range_m: Distance up to which they are; infinite where it does not matter.
        p_group: p_V of (8) of each row's robot, shape (R,).
        p_control: p_U of (9), shape (R,).
        p_candidate: p_C of (10), shape (R,).
        kappa: Weight of the most certain robot.
        literal: Whether a covariance that lags is fused as it is (Remark 3), not predicted forward.
    """

    robot: IntArray
    grows: BoolArray
    neighbour: IntArray
    linked: BoolArray
    period: int
    range_m: float
    p_group: FloatArray
    p_control: FloatArray
    p_candidate: FloatArray
    kappa: float
    literal: bool


@njit(inner=True, **UNCOUNTED)
def log_determinant(row: FloatArray) -> float:
    """Log-determinant of the joint covariance of independent planar targets."""
    total = 0.0
    for o in range(0, row.shape[0], 3):
        total += np.log(row[o] * row[o + 2] - row[o + 1] * row[o + 1])
    return total


@njit(inner=True, **UNCOUNTED)
def link_child(first_child: IntArray, next_sibling: IntArray, parent: int, child: int) -> None:
    """Enter a child among its siblings, greatest number first."""
    before = -1
    after = first_child[parent]
    while after > child:
        before = after
        after = next_sibling[after]
    next_sibling[child] = after
    if before < 0:
        first_child[parent] = child
    else:
        next_sibling[before] = child


@njit(cache=True)
def receive_nodes(
    forest: Forest,
    row: int,
    first: int,
    parents: IntArray,
    depths: IntArray,
    covariances: FloatArray,
    assigned: IntArray,
    positions: FloatArray,
) -> None:
    """Enter nodes of a neighbour's tree that have arrived; ones that are there stay as they are.

    Where:
        first: Number of the first one; the caller has made room for all.
        parents: Shape (n,), -1 for the root; so are ``depths`` and ``assigned``.
        covariances: Shape (n, 3 M).
        positions: Shape (n, 2).
    """
    trees = forest.trees
    for n in range(parents.shape[0]):
        node = first + n
        if trees.depth[row, node] >= 0:
            continue
        trees.depth[row, node] = depths[n]
        trees.parent[row, node] = parents[n]
        for c in range(covariances.shape[1]):
            trees.covariance[row, node, c] = covariances[n, c]
        trees.assigned[row, node, 0] = assigned[n]
        forest.position[row, node, 0] = positions[n, 0]
        forest.position[row, node, 1] = positions[n, 1]
        forest.uncertainty[row, node] = log_determinant(covariances[n])
        if parents[n] >= 0:
            link_child(trees.first_child[row], trees.next_sibling[row], parents[n], node)
