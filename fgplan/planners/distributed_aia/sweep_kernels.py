"""Compiled: sweeps of Algorithm 1 of Tzes et al. 2021; in a sweep every robot does one iteration.

What a robot reads of others is what they had made when the sweep began, so neither the order of
the robots nor that in which their messages arrive within a sweep changes anything.

What is called in one place is inlined: LLVM optimises every level of calls anew, which took half as
long again to compile.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.assignment_kernels import Fields
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.pose_kernels import ENTRY_COUNT, POSE_COUNT, Poses
from fgplan.planners.aia.sampling_kernels import draw_controls, draw_group
from fgplan.planners.aia.tree_kernels import (
    DEPTH,
    DONE,
    DRAWN,
    FEASIBLE,
    GOALS,
    ITERATIONS,
    NEED_NODES,
    NEED_POSES,
    NEED_TIME,
    NODE_LIMIT,
    NODES,
    PENDING,
    REJECTED,
    Scratch,
    Setting,
    Settings,
    Tree,
)
from fgplan.planners.distributed_aia.candidate_kernels import CATCH_UP
from fgplan.planners.distributed_aia.extension_kernels import Heard, extend_robot
from fgplan.planners.distributed_aia.forest_kernels import (
    NEED_NUMBERS,
    SWEEP,
    TURN,
    Forest,
    Links,
)
from fgplan.planners.distributed_aia.stream import RESERVE, Stream
from fgplan.typing import FloatArray, IntArray

FULL = 2
"""In ``counts[PENDING]``: the robot's node budget is spent; it makes no more nodes."""


@njit(inner=True, inline="always", **UNCOUNTED)
def iterate(
    setting: Setting,
    settings: Settings,
    links: Links,
    poses: Poses,
    tree: Tree,
    scratch: Scratch,
    forest: Forest,
    heard: Heard,
    r: int,
    ends: FloatArray,
    cells: IntArray,
    found: IntArray,
    stream: Stream,
) -> int:
    """One iteration of row r: ``DONE``, or what room is needed for to do it."""
    counts, used = tree.counts, poses.counts
    if counts[PENDING] == FULL:
        return DONE
    most, targets = setting.motions.relative.shape[1], setting.sight.places.shape[1]
    if (
        used[POSE_COUNT] + most > poses.pose.shape[0]
        or used[ENTRY_COUNT] + 2 * targets > poses.target.shape[0]
    ):
        return NEED_POSES
    times = setting.fields.of_target.shape[0]
    if times > 1 and counts[DEPTH] + 3 > times:
        return NEED_TIME
    left = stream.numbers.shape[0] - stream.place[0]
    if counts[PENDING] == 0:
        if left < RESERVE:
            return NEED_NUMBERS
        uniform = counts[ITERATIONS] >= settings.uniform_from or (
            settings.uniform_after_goal and not settings.stop_at_goal and counts[GOALS] > 0
        )
        k = draw_group(counts, tree.deepest, tree.stamp, settings.p_group, uniform, stream)
        begin = np.int64(0)  # a literal would have draw_remembered compiled twice
        if not draw_controls(
            setting, settings, poses, tree, k, uniform, False, begin, ends, cells, found, stream
        ):
            counts[REJECTED] += 1
            counts[ITERATIONS] += 1
            return DONE
        counts[DRAWN] = k
        left = stream.numbers.shape[0] - stream.place[0]
    k = counts[DRAWN]
    more = 1 if settings.one_node else int(tree.size[k])
    if counts[NODES] + more > settings.node_limit:
        counts[PENDING] = FULL
        return DONE
    counts[PENDING] = 1
    if counts[NODES] + more > tree.parent.shape[0]:
        return NEED_NODES
    if left < 2 + more * CATCH_UP * heard.node.shape[0]:
        return NEED_NUMBERS
    counts[PENDING] = 0
    counts[ITERATIONS] += 1
    extend_robot(setting, settings, links, poses, tree, scratch, forest, heard, r, k, stream)
    return DONE


@njit(**UNCOUNTED)
def grow_forest(
    setting: Setting,
    settings: Settings,
    links: Links,
    poses: Poses,
    forest: Forest,
    scratch: Scratch,
    heard: Heard,
    ends: FloatArray,
    cells: IntArray,
    found: IntArray,
    numbers: FloatArray,
    place: IntArray,
    sweeps: int,
) -> int:
    """Sweeps of all rows that grow here.

    Where:
        setting: Of the whole team; kind of robot j is j.
        settings: Of all robots, but for the mass functions, which ``links`` has by row.
        numbers: Random numbers of each row, shape (R, B), and the next one's ``place``, (R, 1).
        sweeps: How many more at most.

    Returns:
        ``DONE``, ``FEASIBLE`` after a sweep in which a goal node was made, ``NODE_LIMIT`` once no
        row may make more nodes, or what more room is needed for: then call again, nothing is lost.
    """
    rows, clock, trees = links.robot.shape[0], forest.clock, forest.trees
    last = clock[SWEEP] + sweeps
    while clock[SWEEP] < last:
        if clock[TURN] == 0:
            for r in range(rows):
                if links.grows[r]:
                    forest.known[r] = trees.counts[r, NODES]
        while clock[TURN] < rows:
            r = clock[TURN]
            if links.grows[r]:
                j = links.robot[r]
                own = Setting(
                    setting.obstacles,
                    setting.motions,
                    setting.sight,
                    setting.dynamics,
                    setting.criteria,
                    Fields(
                        setting.fields.frame,
                        setting.fields.distance_m,
                        setting.fields.of_target,
                        setting.fields.of_goal[j : j + 1],
                    ),
                    setting.kind[j : j + 1],
                    setting.near_m[j : j + 1],
                    setting.goal[j : j + 1],
                )
                masses = Settings(
                    settings.at_child,
                    settings.bound,
                    settings.dominance,
                    settings.assign,
                    settings.one_node,
                    settings.reject_jointly,
                    settings.circle,
                    settings.stop_at_goal,
                    settings.uniform_after_goal,
                    settings.uniform_from,
                    links.p_group[r],
                    links.p_control[r],
                    settings.node_limit,
                )
                tree = Tree(
                    trees.parent[r],
                    trees.first_child[r],
                    trees.next_sibling[r],
                    trees.group[r],
                    trees.next_in_group[r],
                    trees.depth[r],
                    trees.cost[r],
                    trees.covariance[r],
                    trees.assigned[r],
                    trees.configuration[r],
                    trees.head[r],
                    trees.tail[r],
                    trees.size[r],
                    trees.stamp[r],
                    trees.deepest[r],
                    trees.slots[r],
                    trees.counts[r],
                    trees.best[r],
                    trees.drawn[r],
                )
                ended = iterate(
                    own,
                    masses,
                    links,
                    poses,
                    tree,
                    scratch,
                    forest,
                    heard,
                    r,
                    ends,
                    cells,
                    found,
                    Stream(numbers[r], place[r]),
                )
                if ended != DONE:
                    return int(ended)
            clock[TURN] += 1
        clock[TURN] = 0
        clock[SWEEP] += 1
        if settings.stop_at_goal:
            for r in range(rows):
                if links.grows[r] and trees.counts[r, GOALS] > forest.goals[r]:
                    return FEASIBLE
        full = True
        for r in range(rows):
            full = full and (not links.grows[r] or trees.counts[r, PENDING] == FULL)
        if full:
            return NODE_LIMIT
    return DONE
