"""Poses entered many at once and found by a dictionary: ``pose_kernels`` uncompiled."""

import numpy as np

from fgplan.planners.aia.control_rows import cells_of
from fgplan.planners.aia.pose_kernels import PER_METRE, PER_TURN, POSE_COUNT, Poses
from fgplan.typing import FloatArray, IntArray

PoseRows = dict[tuple[int, int, int, int], int]
"""Row of each pose by its whole micrometres, millionths of a turn, and kind of robot."""


def enter_poses(
    poses: Poses, known: PoseRows, frame: FloatArray, kinds: IntArray, ends: FloatArray
) -> list[int]:
    """Rows of poses, entered where they are new; the caller has made room.

    Args:
        poses: The table, written.
        known: Its rows by pose, written.
        frame: (x0, y0, side, columns, rows) of the cells, metres.
        kinds: Kind of robot at each pose, shape (n,).
        ends: The poses, shape (n, 3), world frame.

    Returns:
        A row for each.
    """
    metres = np.floor(ends[:, :2] * PER_METRE + 0.5).astype(np.int64)
    turns = np.floor(ends[:, 2] / (2.0 * np.pi) * PER_TURN + 0.5).astype(np.int64) % int(PER_TURN)
    names = zip(*metres.T.tolist(), turns.tolist(), kinds.tolist(), strict=True)
    begin = count = int(poses.counts[POSE_COUNT])
    rows, new = [], []
    for index, name in enumerate(names):
        row = known.get(name)
        if row is None:
            row = known[name] = count
            count += 1
            new.append(index)
        rows.append(row)
    if new:
        part, entered = slice(begin, count), ends[new]
        poses.pose[part] = entered
        poses.kind[part] = kinds[new]
        poses.cell[part] = cells_of(frame, entered[:, 0], entered[:, 1])
        poses.first[part] = -1
        poses.successors[part, :1] = -2
        poses.preferred[part] = -2
        poses.counts[POSE_COUNT] = count
    return rows
