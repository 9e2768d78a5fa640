"""Compiled: the loop of Algorithm 1 of Kantaros et al. 2019, lines 2 to 17."""

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.extension_kernels import extend_group
from fgplan.planners.aia.pose_kernels import ENTRY_COUNT, POSE_COUNT, Poses
from fgplan.planners.aia.sampling_kernels import (
    draw_controls,
    draw_group,
    draw_remembered,
    is_finished,
)
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


@njit(cache=True)
def grow(
    setting: Setting,
    settings: Settings,
    poses: Poses,
    tree: Tree,
    scratch: Scratch,
    iterations: int,
    rng: np.random.Generator,
) -> int:
    """Iterations of Algorithm 1, lines 2 to 17.

    Where:
        iterations: How many more at most.

    Returns:
        ``DONE``, ``FEASIBLE``, ``NODE_LIMIT``, or what more room is needed for: then call again,
        nothing is lost.
    """
    most = setting.motions.relative.shape[1]
    ends = np.empty((most, 3))
    cells = np.zeros(most, np.int64)
    found = np.empty(most, np.int64)
    counts, used = tree.counts, poses.counts
    stamp, deepest, size = tree.stamp, tree.deepest, tree.size
    robots, targets = setting.kind.shape[0], setting.sight.places.shape[1]
    new = robots * most if poses.successors.shape[0] > 0 else robots
    room = poses.pose.shape[0] - new
    room_for_entries = poses.target.shape[0] - 2 * robots * targets
    times = setting.fields.of_target.shape[0]
    capacity = tree.parent.shape[0]
    goals = setting.fields.of_goal.max() >= 0
    remembered = poses.preferred.shape[0] > 0
    configuration, assigned, tail, drawn = tree.configuration, tree.assigned, tree.tail, tree.drawn
    successors, preferred, kind = poses.successors, poses.preferred, poses.kind
    unblocked = poses.free
    controls = setting.motions.controls
    last = counts[ITERATIONS] + iterations
    while counts[ITERATIONS] < last:
        if used[POSE_COUNT] > room or used[ENTRY_COUNT] > room_for_entries:
            return NEED_POSES
        if times > 1 and counts[DEPTH] + 3 > times:
            return NEED_TIME
        if counts[PENDING] == 0:
            uniform = counts[ITERATIONS] >= settings.uniform_from or (
                settings.uniform_after_goal and counts[GOALS] > 0
            )
            k = draw_group(counts, deepest, stamp, settings.p_group, uniform, rng)
            finished = goals and is_finished(setting, tree, scratch, tree.tail[k])
            begin = np.int64(0)  # a literal would have draw_remembered compiled twice
            if remembered and not uniform and not finished:
                begin = draw_remembered(
                    begin,
                    configuration[k],
                    assigned[tail[k]],
                    successors,
                    unblocked,
                    preferred,
                    controls,
                    kind,
                    settings.p_control,
                    settings.reject_jointly,
                    drawn,
                    rng,
                )
            free = True
            if begin < robots:
                free = draw_controls(
                    setting,
                    settings,
                    poses,
                    tree,
                    k,
                    uniform,
                    finished,
                    begin,
                    ends,
                    cells,
                    found,
                    rng,
                )
            else:
                for j in range(robots):
                    free = free and drawn[j] >= 0
            if not free:
                counts[REJECTED] += 1
                counts[ITERATIONS] += 1
                continue
            counts[DRAWN] = k
        k = counts[DRAWN]
        more = 1 if settings.one_node else size[k]
        if counts[NODES] + more > settings.node_limit:
            return NODE_LIMIT
        if counts[NODES] + more > capacity:
            counts[PENDING] = 1
            return NEED_NODES
        counts[PENDING] = 0
        counts[ITERATIONS] += 1
        extend_group(setting, settings, poses, tree, scratch, k, rng)
        if settings.stop_at_goal and counts[GOALS] > 0:
            return FEASIBLE
    return DONE
