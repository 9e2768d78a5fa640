"""Compiled: Algorithm 2 of Tzes et al. 2021, one robot's target.

A child inherits its parent's target. Where that is satisfied at the child (or at the root, where
there is none), the robot walks the unsatisfied targets by geodesic distance and takes the first one
that no neighbour goes for; the neighbours' targets are those of their nodes that were fused. The
listing is not in the text at hand: when the walk begins, and that the nearest unsatisfied target
is taken where neighbours go for all of them, are reconstructed.
"""

import numpy as np
from numpy.typing import NDArray

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.typing import BoolArray, IntArray


@njit(**UNCOUNTED)
def assign_robot(
    distance_m: NDArray[np.float32],
    fields: IntArray,
    cell: int,
    satisfied: BoolArray,
    inherited: int,
    taken: BoolArray,
) -> int:
    """The robot's target.

    Where:
        distance_m: Geodesic distance of each field to each cell, shape (F, cells).
        fields: Field of each target at the node's time, shape (M,).
        cell: Cell of the robot's pose.
        satisfied: Which targets satisfy their limit, shape (M,).
        inherited: The parent's target; -1 at the root.
        taken: Targets that neighbours go for, shape (M,).
    """
    if inherited >= 0 and not satisfied[inherited]:
        return inherited
    free, any_open = -1, -1
    nearest_free, nearest_open = np.inf, np.inf
    for i in range(satisfied.shape[0]):
        if satisfied[i]:
            continue
        distance = distance_m[fields[i], cell]
        if any_open < 0 or distance < nearest_open:
            any_open, nearest_open = i, distance
        if not taken[i] and (free < 0 or distance < nearest_free):
            free, nearest_free = i, distance
    if free >= 0:
        return free
    if any_open >= 0:
        return any_open
    return max(inherited, 0)
