"""Compiled: lines 6 to 17 of Algorithm 1, a group extended to a new configuration.

Nothing is allocated here, see ``compilation``.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.assignment_kernels import assign_targets
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.covariance_kernels import (
    is_below,
    propagate_row,
    read_numbers,
    shortfall_of,
    total_of,
)
from fgplan.planners.aia.information_kernels import sum_remembered, team_information
from fgplan.planners.aia.pose_kernels import Poses
from fgplan.planners.aia.sampling_kernels import draw_member
from fgplan.planners.aia.tree_kernels import (
    BOUNDED,
    COST,
    DOMINATED,
    NODES,
    REPEATED,
    Scratch,
    Setting,
    Settings,
    Tree,
    at_goal,
    find_group,
    link_node,
    note_node,
    repeats,
)
from fgplan.typing import FloatArray, IntArray


@njit(inner=True, **UNCOUNTED)
def is_dominated(
    head: int,
    next_in_group: IntArray,
    costs: FloatArray,
    depths: IntArray,
    covariances: FloatArray,
    any_time: bool,
    cost: float,
    depth: int,
    covariance: FloatArray,
) -> bool:
    """Whether a group, from its first node on, holds one that is as good in every respect."""
    node = head
    while node >= 0:
        comparable = costs[node] <= cost and (any_time or depths[node] == depth)
        if comparable and is_below(covariances[node], covariance):
            return True
        node = next_in_group[node]
    return False


@njit(**UNCOUNTED)
def append_node(
    setting: Setting,
    settings: Settings,
    poses: Poses,
    tree: Tree,
    scratch: Scratch,
    parent: int,
    k: int,
    place: int,
    rows: IntArray,
    cost: float,
) -> int:
    """Append the node whose covariance is in its row already: links, goal test, Algorithm 2.

    Where:
        scratch: Its ``numbers`` are the objective's of that covariance.
        k: Its group, or -1 where it is the first of a new one, which goes to ``place``.

    Returns:
        Its group.
    """
    criteria, fields = setting.criteria, setting.fields
    satisfied, assigned = scratch.satisfied, scratch.assigned
    node = tree.counts[NODES]
    k = link_node(tree, parent, k, place, rows, cost)
    numbers = scratch.numbers
    if criteria.terminal != criteria.objective:
        read_numbers(tree.covariance[node], criteria.terminal, numbers)
    shortfall = shortfall_of(numbers, criteria, satisfied)
    is_goal = shortfall <= 1.0 and at_goal(setting.goal, poses.pose, rows)
    note_node(tree.counts, tree.best, node, cost, shortfall, is_goal)
    for j in range(rows.shape[0]):
        assigned[j] = 0 if parent < 0 else tree.assigned[parent, j]
    if settings.assign or parent < 0:
        t = min(int(tree.depth[node]), fields.of_target.shape[0] - 1)
        assign_targets(
            fields.distance_m,
            fields.of_target[t],
            poses.cell,
            rows,
            satisfied,
            assigned,
            parent < 0,
            scratch.holders,
            scratch.open_targets,
        )
    for j in range(rows.shape[0]):
        tree.assigned[node, j] = assigned[j]
    return k


@njit(inner=True, **UNCOUNTED)
def extend_group(
    setting: Setting,
    settings: Settings,
    poses: Poses,
    tree: Tree,
    scratch: Scratch,
    k: int,
    rng: np.random.Generator,
) -> None:
    """Extend a group to the configuration ``tree.drawn``.

    Where:
        k: The group; the nodes that it holds on entry are extended, or one of them.
    """
    criteria, dynamics, counts = setting.criteria, setting.dynamics, tree.counts
    rows, information = tree.drawn, scratch.information
    costs, depths, covariances = tree.cost, tree.depth, tree.covariance
    remembers = setting.sight.fixed and poses.successors.shape[0] > 0
    new, place = find_group(tree.slots, tree.configuration, rows)
    node, last = int(tree.head[k]), int(tree.tail[k])
    if settings.one_node:
        size = int(tree.size[k])
        node = draw_member(node, last, size, tree.next_in_group, settings.p_group, rng)
        last = node
    seen_from = scratch.rows
    for j in range(rows.shape[0]):
        seen_from[j] = rows[j] if settings.at_child else tree.configuration[k, j]
    known = -1  # time of the information at hand: the same for all times where targets stay
    while True:
        t = int(depths[node])
        following = int(tree.next_in_group[node])
        skip, child = repeats(tree.first_child, tree.next_sibling, tree.group, node, new)
        if settings.bound and costs[node] >= tree.best[COST]:
            counts[BOUNDED] += 1
        elif skip and new >= 0:
            counts[REPEATED] += 1
        else:
            covariance = covariances[counts[NODES]]  # the caller has made room
            if child >= 0 and not settings.at_child:
                for c in range(covariance.shape[0]):  # the same for all children
                    covariance[c] = covariances[child, c]
            else:
                if known != (0 if setting.sight.fixed else t):
                    there = t + 1 if settings.at_child else t
                    if not remembers or not sum_remembered(
                        seen_from,
                        poses.first,
                        poses.entries,
                        poses.target,
                        poses.information,
                        information,
                    ):
                        team_information(
                            setting.sight, setting.obstacles, poses, seen_from, there, information
                        )
                    known = 0 if setting.sight.fixed else t
                for c in range(covariance.shape[0]):
                    covariance[c] = covariances[node, c]
                propagate_row(
                    covariance,
                    information,
                    dynamics.still,
                    dynamics.identity,
                    dynamics.transition,
                    dynamics.process,
                    t,
                    settings.at_child,
                )
            read_numbers(covariance, criteria.objective, scratch.numbers)
            cost = costs[node] + total_of(scratch.numbers, criteria)
            if settings.bound and cost >= tree.best[COST]:
                counts[BOUNDED] += 1
            elif (
                settings.dominance > 0
                and new >= 0
                and is_dominated(
                    int(tree.head[new]),
                    tree.next_in_group,
                    costs,
                    depths,
                    covariances,
                    settings.dominance == 2,
                    cost,
                    t + 1,
                    covariance,
                )
            ):
                counts[DOMINATED] += 1
            else:
                from_node = np.int64(node)  # as from Python: compiled once
                new = append_node(
                    setting, settings, poses, tree, scratch, from_node, new, place, rows, cost
                )
        if node == last:
            break
        node = following
