"""Compiled: Algorithm 2 of Kantaros et al. 2019, on-the-fly target assignment.

Every set is evaluated at the new node. D holds the robots whose target is satisfied or is shared
with another robot; the targets to assign are those neither assigned nor satisfied, or all that are
unsatisfied where there are none of these, and again whenever they run out. The robots of D pick
the nearest one by geodesic distance in order of index (the paper says "closest"; the choice of the
geodesic distance, and of keeping an assignment where every target is satisfied, are ours).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.typing import BoolArray, FloatArray, IntArray


class Fields(NamedTuple):
    """Geodesic distances.

    Attributes:
        frame: (x0, y0, side, columns, rows) of the cells, metres.
        distance_m: Distance from each source to each cell, shape (F, cells).
        of_target: Field of each target by time, shape (T, M); one row where targets stay.
        of_goal: Field of each robot's terminal goal, -1 for none, shape (N,).
    """

    frame: FloatArray
    distance_m: NDArray[np.float32]
    of_target: IntArray
    of_goal: IntArray


@njit(**UNCOUNTED)
def assign_targets(
    distance_m: NDArray[np.float32],
    fields: IntArray,
    cell: IntArray,
    rows: IntArray,
    satisfied: BoolArray,
    assigned: IntArray,
    everybody: bool,
    holders: IntArray,
    open_targets: BoolArray,
) -> None:
    """Update an assignment in place.

    Where:
        distance_m: Geodesic distance of each field to each cell, shape (F, cells).
        fields: Field of each target at the node's time, shape (M,).
        cell: Cell of each pose.
        rows: Pose of each robot, shape (N,).
        satisfied: Which targets satisfy their limit, shape (M,).
        assigned: Target of each robot, shape (N,): the parent's on entry.
        everybody: At the root: all robots choose, among all targets.
        holders: Scratch, shape (M,), as is ``open_targets``.
    """
    targets = satisfied.shape[0]
    robots = rows.shape[0]
    unsatisfied = 0
    for i in range(targets):
        holders[i] = 0
        if not satisfied[i]:
            unsatisfied += 1
    if unsatisfied == 0 and not everybody:
        return
    for j in range(robots):
        if not everybody:
            holders[assigned[j]] += 1
    left = 0
    for i in range(targets):
        free = everybody or (holders[i] == 0 and not satisfied[i])
        open_targets[i] = free
        if free:
            left += 1
    for j in range(robots):
        held = 0 if everybody else assigned[j]
        if not (everybody or satisfied[held] or holders[held] > 1):
            continue
        if left == 0:
            for i in range(targets):
                open_targets[i] = not satisfied[i] or unsatisfied == 0
            left = targets if unsatisfied == 0 else unsatisfied
        best = -1
        nearest = np.inf
        for i in range(targets):
            if open_targets[i]:
                distance = distance_m[fields[i], cell[rows[j]]]
                if best < 0 or distance < nearest:
                    best = i
                    nearest = distance
        assigned[j] = best
        open_targets[best] = False
        left -= 1
