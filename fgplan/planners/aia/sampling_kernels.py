"""Compiled: the densities f_V (8) and f_U (9) of Kantaros et al. 2019.

f_V draws one of the groups with a node of greatest depth with probability p_V, else one of the
others (where there are no others, one of the former). f_U is a product over robots: with u* the
control whose end is nearest to the robot's assigned target by geodesic distance, and d the straight
distance of that end to the target,

    d > near    u* with probability p_U, otherwise uniform over the robot's controls
    d <= near   uniform

which is (9) with its probabilities made to sum to one; the paper's ``near`` is the sensing range.
Assignment and time are those of the group's node inserted last. One uniform number is drawn for
each robot, two or more for the group.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.covariance_kernels import read_numbers, shortfall_of
from fgplan.planners.aia.pose_kernels import (
    Poses,
    enter_pose,
    find_cell,
    follow_controls,
    remember_successors,
)
from fgplan.planners.aia.tree_kernels import (
    DEEPEST,
    DEPTH,
    GROUPS,
    Scratch,
    Setting,
    Settings,
    Tree,
)
from fgplan.typing import FloatArray, IntArray

AHEAD = 1e-3
"""Weight of the distance that a heading leads to: it decides between equal ends."""
MOST_TRIES = 64
"""Rejections after which a group that is not of the deepest is found by counting."""


@njit(**UNCOUNTED)
def draw_group(
    counts: IntArray,
    deepest: IntArray,
    stamp: IntArray,
    p_group: float,
    uniform: bool,
    rng: np.random.Generator,
) -> int:
    """Draw a group by f_V (8)."""
    groups, deep = counts[GROUPS], counts[DEEPEST]
    if uniform:
        return int(rng.random() * groups)
    biased = rng.random() < p_group
    if biased or groups == deep:
        return int(deepest[int(rng.random() * deep)])
    for _ in range(MOST_TRIES):
        k = int(rng.random() * groups)
        if stamp[k] != counts[DEPTH]:
            return k
    place = int(rng.random() * (groups - deep))  # nearly all are deepest: count the others
    for k in range(groups):
        if stamp[k] != counts[DEPTH]:
            if place == 0:
                return k
            place -= 1
    return int(deepest[0])


@njit(**UNCOUNTED)
def draw_member(
    head: int,
    tail: int,
    size: int,
    next_in_group: IntArray,
    p_group: float,
    rng: np.random.Generator,
) -> int:
    """One node of a group: the last one with probability p_V, otherwise any."""
    if rng.random() < p_group:
        return tail
    node = head
    for _ in range(int(rng.random() * size)):
        node = int(next_in_group[node])
    return node


@njit(inner=True, **UNCOUNTED)
def _nearest_end(distances: FloatArray, cells: IntArray, found: IntArray, controls: int) -> int:
    """Free control whose end is nearest by geodesic distance; -1 where none reaches."""
    best = -1
    nearest = np.inf
    for u in range(controls):
        if found[u] != -1 and distances[cells[u]] < nearest:
            nearest = distances[cells[u]]
            best = u
    return best


@njit(inner=True, **UNCOUNTED)
def _nearest_heading(
    distances: FloatArray,
    frame: FloatArray,
    reach_m: float,
    ends: FloatArray,
    cells: IntArray,
    found: IntArray,
    controls: int,
) -> int:
    """As ``_nearest_end``; a thousandth counts where the heading would lead.

    A robot that turns on the spot ends at one distance whichever way it turns, and would stay.
    """
    best = -1
    nearest = np.inf
    for u in range(controls):
        if found[u] == -1:
            continue
        ahead = find_cell(
            frame,
            ends[u, 0] + reach_m * np.cos(ends[u, 2]),
            ends[u, 1] + reach_m * np.sin(ends[u, 2]),
        )
        here = distances[cells[u]]
        score = here + AHEAD * min(distances[ahead], here + 2.0 * reach_m)
        if score < nearest:
            nearest = score
            best = u
    return best


@njit(inner=True, **UNCOUNTED)
def _widest_turn(
    before: FloatArray, ends: FloatArray, found: IntArray, controls: int, target: FloatArray
) -> int:
    """Free control that circles a target by the greatest angle, counterclockwise."""
    best = -1
    widest = -np.inf
    ax, ay = before[0] - target[0], before[1] - target[1]
    for u in range(controls):
        if found[u] == -1:
            continue
        bx, by = ends[u, 0] - target[0], ends[u, 1] - target[1]
        angle = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
        if angle > widest:
            widest = angle
            best = u
    return best


@njit(inner=True, **UNCOUNTED)
def _chosen(
    preferred: int,
    p_control: float,
    jointly: bool,
    found: IntArray,
    controls: int,
    number: float,
) -> int:
    """Control of one uniform number: u* with probability p_U, otherwise uniform."""
    if preferred >= 0:
        if number < p_control:
            return preferred
        number = (number - p_control) / (1.0 - p_control)
    if jointly:
        return int(number * controls)
    free = 0
    for u in range(controls):
        if found[u] != -1:
            free += 1
    place = int(number * free)
    for u in range(controls):
        if found[u] != -1:
            if place == 0:
                return u
            place -= 1
    return -1


@njit(inner=True, **UNCOUNTED)
def is_finished(setting: Setting, tree: Tree, scratch: Scratch, node: int) -> bool:
    """Whether a node satisfies the terminal constraint, wherever the robots are."""
    read_numbers(tree.covariance[node], setting.criteria.terminal, scratch.numbers)
    return shortfall_of(scratch.numbers, setting.criteria, scratch.satisfied) <= 1.0


@njit(inner=True, **UNCOUNTED)
def _fill_controls(
    setting: Setting,
    poses: Poses,
    row: int,
    ends: FloatArray,
    cells: IntArray,
    found: IntArray,
) -> int:
    """Ends, cells and rows of a pose's controls (-1 blocked, -2 not entered); how many."""
    kind = np.int64(poses.kind[row])  # wide integers, so that each kernel is compiled for one type
    controls = setting.motions.controls[kind]
    if poses.successors.shape[0] == 0:
        follow_controls(
            setting.motions,
            setting.obstacles,
            poses.pose[row],
            kind,
            np.int64(poses.cell[row]),
            ends,
            found,
        )
        for u in range(controls):
            cells[u] = find_cell(setting.fields.frame, ends[u, 0], ends[u, 1])
        return int(controls)
    remember_successors(
        poses, setting.motions, setting.obstacles, setting.fields.frame, row, ends, found
    )
    for u in range(controls):
        found[u] = poses.successors[row, u]
        if found[u] >= 0:
            cells[u] = poses.cell[found[u]]
            for c in range(3):
                ends[u, c] = poses.pose[found[u], c]
    return int(controls)


@njit(inner=True, **UNCOUNTED)
def _preferred_control(
    setting: Setting,
    circle: bool,
    pose: FloatArray,
    j: int,
    target: int,
    t: int,
    to_goal: bool,
    ends: FloatArray,
    cells: IntArray,
    found: IntArray,
    controls: int,
) -> int:
    """u* of equation (9), or -1 where controls are drawn uniformly."""
    fields = setting.fields
    field = fields.of_target[min(t, fields.of_target.shape[0] - 1), target]
    if to_goal:
        field = fields.of_goal[j]
    kind = setting.kind[j]
    if setting.motions.body[kind]:
        best = _nearest_heading(
            fields.distance_m[field],
            fields.frame,
            setting.motions.reach_m[kind],
            ends,
            cells,
            found,
            controls,
        )
    else:
        best = _nearest_end(fields.distance_m[field], cells, found, controls)
    if best < 0 or to_goal:
        return best
    place = setting.sight.places[min(t, setting.sight.places.shape[0] - 1), target]
    dx, dy = ends[best, 0] - place[0], ends[best, 1] - place[1]
    if dx * dx + dy * dy > setting.near_m[j] * setting.near_m[j]:
        return best
    if circle:
        return _widest_turn(pose, ends, found, controls, place)
    return -1


@njit(inner=True, **UNCOUNTED)
def draw_remembered(
    begin: int,
    rows: IntArray,
    assigned: IntArray,
    successors: IntArray,
    free: IntArray,
    preferred: IntArray,
    controls: IntArray,
    kind: IntArray,
    p_control: float,
    jointly: bool,
    drawn: IntArray,
    rng: np.random.Generator,
) -> int:
    """Draw for robots from ``begin`` on while their u* is known; the robot at which it is not.

    Marks a robot whose draw is not free by -1 in ``drawn``.
    """
    for j in range(begin, rows.shape[0]):
        row = rows[j]
        best = preferred[row, assigned[j]]
        if best == -2:
            return j
        number = rng.random()
        if best >= 0 and number < p_control:
            drawn[j] = successors[row, best]
            continue
        many = controls[kind[row]]
        all_free = jointly or free[row] == many  # then nothing needs to be counted
        chosen = _chosen(best, p_control, all_free, successors[row], many, number)
        drawn[j] = successors[row, chosen] if chosen >= 0 else -1
    return int(rows.shape[0])


@njit(**UNCOUNTED)
def draw_controls(
    setting: Setting,
    settings: Settings,
    poses: Poses,
    tree: Tree,
    k: int,
    uniform: bool,
    finished: bool,
    begin: int,
    ends: FloatArray,
    cells: IntArray,
    found: IntArray,
    rng: np.random.Generator,
) -> bool:
    """Draw a configuration by f_U (9) into ``tree.drawn``; False where it is not free.

    Where:
        finished: Whether the group's last node has nothing to learn: robots then prefer controls
            towards their terminal goals.
        begin: Robots before this one have been drawn for.
        ends: Scratch, as are ``cells`` and ``found``.
    """
    node = tree.tail[k]
    rows, assigned, drawn = tree.configuration[k], tree.assigned[node], tree.drawn
    t = tree.depth[node] + 1
    robots = rows.shape[0]
    j = begin
    remembered = poses.preferred.shape[0] > 0 and not uniform and not finished
    while j < robots:
        if remembered:
            j = draw_remembered(
                j,
                rows,
                assigned,
                poses.successors,
                poses.free,
                poses.preferred,
                setting.motions.controls,
                poses.kind,
                settings.p_control,
                settings.reject_jointly,
                drawn,
                rng,
            )
            if j == robots:
                break
        row = np.int64(rows[j])
        controls = _fill_controls(setting, poses, row, ends, cells, found)
        preferred = -1
        if not uniform:
            to_goal = finished and setting.fields.of_goal[j] >= 0
            preferred = _preferred_control(
                setting,
                settings.circle,
                poses.pose[row],
                j,
                int(assigned[j]),
                t,
                to_goal,
                ends,
                cells,
                found,
                controls,
            )
        if remembered:
            poses.preferred[row, assigned[j]] = preferred
            continue
        chosen = _chosen(
            preferred, settings.p_control, settings.reject_jointly, found, controls, rng.random()
        )
        drawn[j] = -1
        if chosen >= 0:
            drawn[j] = found[chosen]
            if found[chosen] == -2:
                kind = np.int64(poses.kind[row])
                end = ends[chosen]
                drawn[j] = enter_pose(poses, setting.fields.frame, kind, end[0], end[1], end[2])
        j += 1
    free = True
    for j in range(robots):
        free = free and drawn[j] >= 0
    return free
