"""Compiled: the tree of Algorithms 1-3 and 6 in the joint space of a team.

A node is a position and an arrival time of every body (a robot, or a formation that moves as one).
Times are steps: a body moves at most ``step_m`` a step, in a straight line at constant speed over
a whole number of steps n >= |v - v'| / step_m, so a position at a step is a position on the path.
The delay of a node is max t - min t over its bodies.

    strict      every body arrives as soon as it can: t_child = t_parent + ceil(|v - v'| / step_m)
    slowdown    bodies that move all arrive when the last of them can, the others move slower
    relaxed     as strict, but no node need be simultaneous (section III-E)

Steering is Algorithm 6: the body that is earliest takes a step of s, whole steps of time; the
others what is left of it after their lead; a body with more lead than that stays where it is.
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.obstacle_kernels import Obstacles, motion_free
from fgplan.planners.intermittent.filter_kernels import Targets, copy_matrix, follow_places
from fgplan.typing import BoolArray, FloatArray, IntArray

STRICT, SLOWDOWN, RELAXED = 0, 1, 2
_HAIR = 1e-9


class Tree(NamedTuple):
    """Nodes as arrays with room for more; the root is node 0.

    Attributes:
        position: Shape (capacity, B, 2), metres.
        time: Arrival of every body, steps, shape (capacity, B).
        parent: Shape (capacity,), -1 for the root.
        cost: Sum of uncertainty from the root's to the node's earliest arrival, (capacity,).
        covariance: At the earliest arrival, shape (capacity, M, s, s).
        travelled: Metres of every body since the root, shape (capacity, B).
    """

    position: FloatArray
    time: IntArray
    parent: IntArray
    cost: FloatArray
    covariance: FloatArray
    travelled: FloatArray


class Space(NamedTuple):
    """Where bodies move, and what rides on them.

    Attributes:
        step_m: Longest way of a step.
        body: Body of every carrier of sensors, shape (K,).
        offset: Of every carrier from its body, shape (K, 2), metres.
        tracks: Known positions before the root's arrival times from time ``base``, (H, B, 2).
        base: Time of the first row of ``tracks`` and of the predicted means.
        mode: ``STRICT``, ``SLOWDOWN`` or ``RELAXED``.
    """

    step_m: float
    body: IntArray
    offset: FloatArray
    tracks: FloatArray
    base: int
    mode: int


@njit(**UNCOUNTED)
def nearest_node(tree: Tree, count: int, wanted: FloatArray) -> int:
    """The node nearest to a joint position, shape (B, 2); the first of equals."""
    best, chosen = np.inf, 0
    for v in range(count):
        total = 0.0
        for j in range(wanted.shape[0]):
            dx = tree.position[v, j, 0] - wanted[j, 0]
            dy = tree.position[v, j, 1] - wanted[j, 1]
            total += dx * dx + dy * dy
        if total < best:
            best, chosen = total, v
    return chosen


@njit(**UNCOUNTED)
def steer(
    tree: Tree,
    space: Space,
    origin: int,
    wanted: FloatArray,
    longest: int,
    position: FloatArray,
) -> bool:
    """Algorithm 6: where to go from a node towards a joint position; False for nowhere.

    Where:
        longest: Most steps of the earliest body: epsilon over ``step_m``.
        position: Written, shape (B, 2).
    """
    bodies = wanted.shape[0]
    least, greatest = np.inf, 0.0
    earliest = tree.time[origin, 0]
    for j in range(bodies):
        dx = wanted[j, 0] - tree.position[origin, j, 0]
        dy = wanted[j, 1] - tree.position[origin, j, 1]
        distance = np.sqrt(dx * dx + dy * dy)
        least, greatest = min(least, distance), max(greatest, distance)
        earliest = min(earliest, tree.time[origin, j])
    if space.mode == SLOWDOWN:
        # Bodies that are near their samples slow down, so the farthest decides on the time.
        steps = int(min(np.ceil(greatest / space.step_m - _HAIR), float(longest)))
    else:
        steps = int(min(np.floor(least / space.step_m + _HAIR), float(longest)))
    if steps < 1:
        return False
    moved = False
    for j in range(bodies):
        own = steps - (tree.time[origin, j] - earliest)
        dx = wanted[j, 0] - tree.position[origin, j, 0]
        dy = wanted[j, 1] - tree.position[origin, j, 1]
        distance = np.sqrt(dx * dx + dy * dy)
        if own <= 0 or distance == 0.0:
            position[j, 0] = tree.position[origin, j, 0]
            position[j, 1] = tree.position[origin, j, 1]
            continue
        moved = True
        if own * space.step_m >= distance - _HAIR * space.step_m:
            position[j, 0] = wanted[j, 0]
            position[j, 1] = wanted[j, 1]
        else:
            share = own * space.step_m / distance
            position[j, 0] = tree.position[origin, j, 0] + share * dx
            position[j, 1] = tree.position[origin, j, 1] + share * dy
    return moved


@njit(**UNCOUNTED)
def arrive(tree: Tree, space: Space, parent: int, position: FloatArray, time: IntArray) -> None:
    """Arrival times at a joint position from a node, written to ``time``, shape (B,)."""
    bodies = position.shape[0]
    last = -1
    for j in range(bodies):
        dx = position[j, 0] - tree.position[parent, j, 0]
        dy = position[j, 1] - tree.position[parent, j, 1]
        distance = np.sqrt(dx * dx + dy * dy)
        steps = int(np.ceil(distance / space.step_m - _HAIR))
        if distance > 0.0 and steps < 1:
            steps = 1
        time[j] = tree.time[parent, j] + steps
        if distance > 0.0:
            last = max(last, time[j])
    if space.mode == SLOWDOWN:
        for j in range(bodies):
            time[j] = max(time[j], last)


@njit(**UNCOUNTED)
def is_way_free(obstacles: Obstacles, space: Space, start: FloatArray, end: FloatArray) -> bool:
    """Whether all carriers move freely between two joint positions, shape (B, 2)."""
    for k in range(space.body.shape[0]):
        j = space.body[k]
        ox, oy = space.offset[k, 0], space.offset[k, 1]
        if not motion_free(
            obstacles, start[j, 0] + ox, start[j, 1] + oy, end[j, 0] + ox, end[j, 1] + oy
        ):
            return False
    return True


@njit(inner=True, **UNCOUNTED)
def is_way_some(start: FloatArray, end: FloatArray) -> bool:
    """Whether some body moves at all between two joint positions."""
    moved = False
    for j in range(start.shape[0]):
        moved = moved or start[j, 0] != end[j, 0] or start[j, 1] != end[j, 1]
    return moved


@njit(**UNCOUNTED)
def delay(time: IntArray) -> int:
    """Latest arrival less the earliest."""
    low, high = time[0], time[0]
    for j in range(time.shape[0]):
        low, high = min(low, time[j]), max(high, time[j])
    return high - low


@njit(**UNCOUNTED)
def near_nodes(tree: Tree, count: int, wanted: FloatArray, radius_m: float, out: IntArray) -> int:
    """Nodes within a distance in joint space, ascending; returns how many."""
    found = 0
    square = radius_m * radius_m
    for v in range(count):
        total = 0.0
        for j in range(wanted.shape[0]):
            dx = tree.position[v, j, 0] - wanted[j, 0]
            dy = tree.position[v, j, 1] - wanted[j, 1]
            total += dx * dx + dy * dy
        if total <= square:
            out[found] = v
            found += 1
    return found


@njit(**UNCOUNTED)
def place_carriers(
    tree: Tree,
    space: Space,
    parent: int,
    position: FloatArray,
    time: IntArray,
    start: int,
    end: int,
    places: FloatArray,
    there: BoolArray,
) -> None:
    """Where carriers are after ``start`` until ``end`` on the way to a child of a node.

    A body that reached the parent later than its fellows is still on an earlier edge, or, before
    the root, on its known track; once it has arrived at the child it waits there.
    """
    for k in range(space.body.shape[0]):
        j = space.body[k]
        for t in range(start + 1, end + 1):
            row = t - start - 1
            there[row, k] = True
            if t > tree.time[parent, j]:
                before, after = tree.time[parent, j], time[j]
                share = 1.0 if t >= after else (t - before) / (after - before)
                for c in range(2):
                    a = tree.position[parent, j, c]
                    places[row, k, c] = a + share * (position[j, c] - a) + space.offset[k, c]
                continue
            v = parent
            while tree.parent[v] >= 0 and tree.time[tree.parent[v], j] >= t:
                v = tree.parent[v]
            if tree.parent[v] < 0:
                place = t - space.base
                if place >= space.tracks.shape[0]:
                    there[row, k] = False
                    continue
                for c in range(2):
                    places[row, k, c] = space.tracks[place, j, c] + space.offset[k, c]
                continue
            u = tree.parent[v]
            before, after = tree.time[u, j], tree.time[v, j]
            share = (t - before) / (after - before)
            for c in range(2):
                a = tree.position[u, j, c]
                places[row, k, c] = a + share * (tree.position[v, j, c] - a) + space.offset[k, c]


@njit(**UNCOUNTED)
def cost_pairs(
    tree: Tree,
    space: Space,
    targets: Targets,
    sensors: FloatArray,
    obstacles: Obstacles,
    means: FloatArray,
    every: int,
    metric: int,
    parents: IntArray,
    positions: FloatArray,
    times: IntArray,
    limits: FloatArray,
    falling: bool,
    costs: FloatArray,
    covariances: FloatArray,
    places: FloatArray,
    there: BoolArray,
    work: FloatArray,
) -> None:
    """Cost(child) by Algorithm 4 for pairs of a parent and a child's position and times.

    Where:
        parents, positions, times: Shapes (n,), (n, B, 2), (n, B).
        limits: A cost that is not below it is given as infinite, shape (n,).
        falling: Whether each cost found becomes the limit of the pairs after it.
        costs, covariances: Written, shapes (n,) and (n, M, s, s).
    """
    best = np.inf
    for n in range(parents.shape[0]):
        parent = parents[n]
        start, end = tree.time[parent, 0], times[n, 0]
        for j in range(times.shape[1]):
            start, end = min(start, tree.time[parent, j]), min(end, times[n, j])
        limit = min(limits[n], best) if falling else limits[n]
        costs[n] = np.inf
        if tree.cost[parent] >= limit or end - space.base >= means.shape[0]:
            continue
        place_carriers(tree, space, parent, positions[n], times[n], start, end, places, there)
        for i in range(covariances.shape[1]):
            copy_matrix(tree.covariance[parent, i], covariances[n, i])
        added = follow_places(
            targets, sensors, obstacles, means, space.base, every, metric, start, end,
            places, there, limit - tree.cost[parent], covariances[n], work,
        )  # fmt: skip
        costs[n] = tree.cost[parent] + added
        best = min(best, costs[n])


@njit(**UNCOUNTED)
def open_ways(
    tree: Tree,
    space: Space,
    obstacles: Obstacles,
    rows: IntArray,
    node: int,
    to_node: bool,
    times: IntArray,
    is_open: BoolArray,
) -> None:
    """Ways between other nodes and one node: arrival times, and whether they are free.

    Where:
        rows: The other nodes, shape (n,).
        to_node: Whether the ways lead to ``node``; else from it to the others.
        times, is_open: Written, shapes (n, B) and (n,).
    """
    for n in range(rows.shape[0]):
        start = rows[n] if to_node else node
        end = node if to_node else rows[n]
        arrive(tree, space, start, tree.position[end], times[n])
        is_open[n] = is_way_some(tree.position[start], tree.position[end]) and is_way_free(
            obstacles, space, tree.position[start], tree.position[end]
        )
