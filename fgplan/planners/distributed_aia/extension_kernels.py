"""Compiled: a robot's group extended to a new pose, section III-A2 of Tzes et al. 2021.

For every node of the group: the nodes of the neighbours that are fused, the filter (4), the new
node with its cost (7), its goal test and its target. A node already extended to this pose with the
same nodes of the neighbours is not extended again: V is a set.
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.covariance_kernels import (
    predict_row,
    read_numbers,
    shortfall_of,
    total_of,
)
from fgplan.planners.aia.information_kernels import team_information
from fgplan.planners.aia.pose_kernels import Poses
from fgplan.planners.aia.sampling_kernels import draw_member
from fgplan.planners.aia.tree_kernels import (
    NODES,
    REPEATED,
    Scratch,
    Setting,
    Settings,
    Tree,
    find_group,
    link_node,
    note_node,
)
from fgplan.planners.distributed_aia.assignment_kernels import assign_robot
from fgplan.planners.distributed_aia.candidate_kernels import CATCH_UP, draw_candidate
from fgplan.planners.distributed_aia.forest_kernels import (
    FUSED,
    MEASURED,
    SWEEP,
    Forest,
    Links,
    log_determinant,
)
from fgplan.planners.distributed_aia.fusion_kernels import fuse_rows, is_near, predict_lag
from fgplan.planners.distributed_aia.stream import Stream
from fgplan.typing import BoolArray, FloatArray, IntArray


class Heard(NamedTuple):
    """Room for what one extension hears.

    Attributes:
        covariance: Of the neighbours that are linked, shape (D, 3 M).
        late: Whether each of these lags and is not to be fused as it is, shape (D,).
        node: Node of each neighbour's tree, -1 where nothing is known of it, shape (D,).
        taken: Targets that linked neighbours go for, shape (M,).
    """

    covariance: FloatArray
    late: BoolArray
    node: IntArray
    taken: BoolArray


@njit(inner=True, **UNCOUNTED)
def hear_neighbours(
    setting: Setting,
    links: Links,
    forest: Forest,
    heard: Heard,
    r: int,
    node: int,
    stream: Stream,
) -> int:
    """Draw the nodes of all neighbours for extending a node; how many are linked at its time."""
    covariance, used, taken = heard.covariance, heard.node, heard.taken
    trees = forest.trees
    robot, t = links.robot[r], int(trees.depth[r, node])
    step = t // links.period % links.linked.shape[0]
    count = 0
    for i in range(taken.shape[0]):
        taken[i] = False
    for d in range(used.shape[0]):
        other = links.neighbour[r, d]
        used[d] = -1
        if other < 0:
            continue
        chosen = draw_candidate(
            trees.first_child[other],
            trees.next_sibling[other],
            trees.depth[other],
            forest.uncertainty[other],
            int(forest.source[r, node, d]),
            t,
            forest.known[other],
            links.p_candidate[r],
            stream,
        )
        used[d] = chosen
        if chosen < 0 or not links.linked[step, robot, links.robot[other]]:
            continue
        if not is_near(
            forest.position[r, node, 0],
            forest.position[r, node, 1],
            forest.position[other, chosen, 0],
            forest.position[other, chosen, 1],
            links.range_m,
        ):
            continue
        for c in range(covariance.shape[1]):
            covariance[count, c] = trees.covariance[other, chosen, c]
        lag = t - int(trees.depth[other, chosen])
        heard.late[count] = lag > 0 and not links.literal
        if heard.late[count]:
            predict_lag(covariance[count], setting.dynamics, t, lag)
        if lag <= CATCH_UP or links.literal:  # a robot left behind goes for nothing any more
            taken[trees.assigned[other, chosen, 0]] = True
        count += 1
    return count


@njit(inner=True, **UNCOUNTED)
def is_there(tree: Tree, source: IntArray, node: int, k: int, used: IntArray) -> bool:
    """Whether a node has a child in a group that was made with the same nodes of others."""
    child = tree.first_child[node]
    while child >= 0:
        if tree.group[child] == k:
            same = True
            for d in range(used.shape[0]):
                same = same and source[child, d] == used[d]
            if same:
                return True
        child = tree.next_sibling[child]
    return False


@njit(**UNCOUNTED)
def enter_node(
    setting: Setting,
    settings: Settings,
    poses: Poses,
    tree: Tree,
    scratch: Scratch,
    forest: Forest,
    heard: Heard,
    r: int,
    parent: int,
    k: int,
    place: int,
    cost: float,
) -> int:
    """Append the node whose covariance is in its row and whose objective's numbers in scratch.

    Returns:
        Its group.
    """
    criteria, fields = setting.criteria, setting.fields
    numbers, satisfied = scratch.numbers, scratch.satisfied
    node = tree.counts[NODES]
    k = link_node(tree, parent, k, place, tree.drawn, cost)
    covariance = tree.covariance[node]
    if criteria.terminal != criteria.objective:
        read_numbers(covariance, criteria.terminal, numbers)
    for i in range(numbers.shape[0]):
        numbers[i] /= forest.margin[r]
    shortfall = shortfall_of(numbers, criteria, satisfied)
    is_goal = shortfall <= 1.0
    forest.is_goal[r, node] = is_goal
    note_node(tree.counts, tree.best, node, cost, shortfall, is_goal)
    row = tree.drawn[0]
    inherited = -1 if parent < 0 else int(tree.assigned[parent, 0])
    if settings.assign or parent < 0:
        t = min(int(tree.depth[node]), fields.of_target.shape[0] - 1)
        inherited = assign_robot(
            fields.distance_m,
            fields.of_target[t],
            poses.cell[row],
            satisfied,
            inherited,
            heard.taken,
        )
    tree.assigned[node, 0] = inherited
    forest.uncertainty[r, node] = log_determinant(covariance)
    forest.position[r, node, 0] = poses.pose[row, 0]
    forest.position[r, node, 1] = poses.pose[row, 1]
    forest.born[r, node] = forest.clock[SWEEP]
    for d in range(heard.node.shape[0]):
        forest.source[r, node, d] = heard.node[d]
    return k


@njit(inner=True, inline="always", **UNCOUNTED)
def extend_robot(
    setting: Setting,
    settings: Settings,
    links: Links,
    poses: Poses,
    tree: Tree,
    scratch: Scratch,
    forest: Forest,
    heard: Heard,
    r: int,
    k: int,
    stream: Stream,
) -> None:
    """Extend a group of row r to the pose ``tree.drawn``.

    Where:
        setting: Of this robot alone.
        k: The group; the nodes that it holds on entry are extended, or one of them.
    """
    criteria, dynamics, counts = setting.criteria, setting.dynamics, tree.counts
    information, seen_from = scratch.information, scratch.rows
    new, place = find_group(tree.slots, tree.configuration, tree.drawn)
    node, last = np.int64(tree.head[k]), np.int64(tree.tail[k])
    if settings.one_node:
        size = np.int64(tree.size[k])
        node = draw_member(node, last, size, tree.next_in_group, settings.p_group, stream)
        last = node
    seen_from[0] = tree.configuration[k, 0]
    known = -1  # time of the information at hand: the same for all times where targets stay
    while True:
        following = np.int64(tree.next_in_group[node])
        t = int(tree.depth[node])
        count = hear_neighbours(setting, links, forest, heard, r, node, stream)
        if new >= 0 and is_there(tree, forest.source[r], node, new, heard.node):
            counts[REPEATED] += 1
        else:
            if known != (0 if setting.sight.fixed else t):
                team_information(setting.sight, setting.obstacles, poses, seen_from, t, information)
                known = 0 if setting.sight.fixed else t
            covariance = tree.covariance[counts[NODES]]  # the caller has made room
            for c in range(covariance.shape[0]):
                covariance[c] = tree.covariance[node, c]
            fuse_rows(covariance, heard.covariance, heard.late, count, information, links.kappa)
            if not dynamics.still:
                predict_row(covariance, dynamics.identity, dynamics.transition, dynamics.process, t)
            counts[FUSED] += 1 + count
            counts[MEASURED] += 1
            read_numbers(covariance, criteria.objective, scratch.numbers)
            cost = float(tree.cost[node]) + total_of(scratch.numbers, criteria)
            new = enter_node(
                setting,
                settings,
                poses,
                tree,
                scratch,
                forest,
                heard,
                r,
                node,
                new,
                place,
                cost,
            )
        if node == last:
            break
        node = following
