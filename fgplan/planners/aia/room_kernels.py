"""Compiled: hash tables filled anew after their arrays have grown."""

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.pose_kernels import POSE_COUNT, Poses, place_of
from fgplan.planners.aia.tree_kernels import GROUPS, Tree, find_group


@njit(cache=True)
def enter_rows(poses: Poses) -> None:
    """Enter every pose into the empty hash table of its table."""
    mask = poses.slots.shape[0] - 1
    for row in range(poses.counts[POSE_COUNT]):
        place = place_of(poses.pose[row], poses.kind[row]) & mask
        while poses.slots[place] >= 0:
            place = (place + 1) & mask
        poses.slots[place] = row


@njit(cache=True)
def enter_groups(tree: Tree) -> None:
    """Enter every group into the empty hash table of its tree."""
    rows = np.empty(tree.configuration.shape[1], np.int64)
    for k in range(tree.counts[GROUPS]):
        rows[:] = tree.configuration[k]
        _, place = find_group(tree.slots, tree.configuration, rows)
        tree.slots[place] = k
