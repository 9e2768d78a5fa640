"""Compiled: the table of single-robot poses that the tree has reached, and where controls lead.

A pose is entered once, whoever reaches it, and is named by its row. Two poses are one where they
differ by less than half a micrometre and half a millionth of a turn: poses on a lattice recur,
although sums of 0.1 differ in the last bit. Robots of one *kind* share motion primitives and
sensors; a row belongs to one kind. Where poses recur, what a row leads to is remembered.
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.obstacle_kernels import Obstacles, motion_free
from fgplan.typing import BoolArray, FloatArray, IntArray

POSE_COUNT, ENTRY_COUNT = 0, 1
"""Places in ``Poses.counts``: rows used, and entries of information used."""

PER_METRE = 1e6
PER_TURN = 1e6


class Motions(NamedTuple):
    """Motion primitives of every kind of robot.

    Attributes:
        relative: Shape (K, U, 3), metres and radians; unused controls repeat the first.
        waypoints: Shape (K, U, W, 2), metres; short ways repeat their end.
        controls: Number of controls of each kind, shape (K,).
        body: Whether controls are composed with the pose, shape (K,).
        reach_m: Longest way of a control of each kind, shape (K,).
        clearance_m: From any position in each geodesic cell, at least so far to the next obstacle
            or bound, shape (cells,): where it exceeds the reach every control is free.
    """

    relative: FloatArray
    waypoints: FloatArray
    controls: IntArray
    body: BoolArray
    reach_m: FloatArray
    clearance_m: FloatArray


class Poses(NamedTuple):
    """Poses reached so far.

    Attributes:
        pose: Shape (S, 3), world frame.
        kind: Kind of robot, shape (S,).
        cell: Geodesic cell of each pose, shape (S,).
        slots: Hash table of row numbers, -1 where free; its length is a power of two, or zero where
            rows are found otherwise.
        successors: Rows that each control leads to, -1 where it is blocked, -2 in the first column
            where not known yet, shape (S, U); shape (0, 0) where poses do not recur.
        free: Number of controls that are not blocked, shape (S,); shape (0,) as ``successors``.
        preferred: u* of equation (9) towards each target that stays: a control, -1 where controls
            are drawn uniformly, -2 where not known yet, shape (S, M); shape (0, 0) where not
            remembered.
        first: First entry of information, -1 where not known yet, shape (S,).
        entries: Number of entries of information, shape (S,).
        target: Target of each entry, shape (I,).
        information: (J_xx, J_xy, J_yy) of each entry, shape (I, 3), 1 / m^2.
        counts: Rows and entries used, shape (2,).
    """

    pose: FloatArray
    kind: IntArray
    cell: IntArray
    slots: IntArray
    successors: IntArray
    free: IntArray
    preferred: IntArray
    first: IntArray
    entries: IntArray
    target: IntArray
    information: FloatArray
    counts: IntArray


@njit(**UNCOUNTED)
def find_cell(frame: FloatArray, x: float, y: float) -> int:
    """Geodesic cell of a position: frame is (x0, y0, side, columns, rows)."""
    column = int(np.floor((x - frame[0]) / frame[2]))
    row = int(np.floor((y - frame[1]) / frame[2]))
    column = min(max(column, 0), int(frame[3]) - 1)
    row = min(max(row, 0), int(frame[4]) - 1)
    return row * int(frame[3]) + column


@njit(inner=True, **UNCOUNTED)
def _digits(x: float, y: float, heading: float) -> tuple[int, int, int]:
    """Whole micrometres and millionths of a turn: poses with the same are one."""
    turns = int(np.floor(heading / (2.0 * np.pi) * PER_TURN + 0.5)) % int(PER_TURN)
    return int(np.floor(x * PER_METRE + 0.5)), int(np.floor(y * PER_METRE + 0.5)), turns


@njit(inner=True, **UNCOUNTED)
def _mixed(kx: int, ky: int, kh: int, kind: int) -> int:
    """Hash of a pose."""
    mixed = (kx * 73856093) ^ (ky * 19349663) ^ (kh * 83492791) ^ (kind * 50331653)
    return mixed ^ (mixed >> 15)


@njit(inner=True, **UNCOUNTED)
def place_of(pose: FloatArray, kind: int) -> int:
    """Hash of a pose in the table."""
    kx, ky, kh = _digits(pose[0], pose[1], pose[2])
    return _mixed(kx, ky, kh, int(kind))


@njit(**UNCOUNTED)
def enter_pose(
    poses: Poses, frame: FloatArray, kind: int, x: float, y: float, heading: float
) -> int:
    """Row of a pose, entered if it is new; the caller has made room."""
    kx, ky, kh = _digits(x, y, heading)
    mask = poses.slots.shape[0] - 1
    place = _mixed(kx, ky, kh, int(kind)) & mask
    while True:
        row = poses.slots[place]
        if row < 0:
            break
        known = poses.pose[row]
        if poses.kind[row] == kind and _digits(known[0], known[1], known[2]) == (kx, ky, kh):
            return int(row)
        place = (place + 1) & mask
    row = poses.counts[POSE_COUNT]
    poses.slots[place] = row
    poses.pose[row, 0] = x
    poses.pose[row, 1] = y
    poses.pose[row, 2] = heading
    poses.kind[row] = kind
    poses.cell[row] = find_cell(frame, x, y)
    poses.first[row] = -1
    if poses.successors.shape[0] > 0:
        poses.successors[row, 0] = -2
    if poses.preferred.shape[0] > 0:
        for i in range(poses.preferred.shape[1]):
            poses.preferred[row, i] = -2
    poses.counts[POSE_COUNT] = row + 1
    return int(row)


@njit(**UNCOUNTED)
def follow_controls(
    motions: Motions,
    obstacles: Obstacles,
    pose: FloatArray,
    kind: int,
    cell: int,
    ends: FloatArray,
    found: IntArray,
) -> None:
    """Poses after each control, written to ``ends``, (U, 3); ``found`` is -2, or -1 blocked."""
    x, y, heading = pose[0], pose[1], pose[2]
    relative, waypoints = motions.relative[kind], motions.waypoints[kind]
    cos, sin = 1.0, 0.0
    if motions.body[kind]:
        cos, sin = np.cos(heading), np.sin(heading)
    open_space = motions.clearance_m[cell] > motions.reach_m[kind]
    for u in range(motions.controls[kind]):
        ends[u, 0] = x + (cos * relative[u, 0] - sin * relative[u, 1])
        ends[u, 1] = y + (sin * relative[u, 0] + cos * relative[u, 1])
        turned = heading + relative[u, 2]
        if turned > np.pi:
            turned -= 2.0 * np.pi
        elif turned <= -np.pi:
            turned += 2.0 * np.pi
        ends[u, 2] = turned
        found[u] = -2
        if open_space:
            continue
        ax, ay = x, y
        for w in range(waypoints.shape[1]):
            wx, wy = waypoints[u, w, 0], waypoints[u, w, 1]
            bx, by = x + (cos * wx - sin * wy), y + (sin * wx + cos * wy)
            if bx == ax and by == ay:
                continue
            if not motion_free(obstacles, ax, ay, bx, by):
                found[u] = -1
                break
            ax, ay = bx, by


@njit(inner=True, **UNCOUNTED)
def remember_successors(
    poses: Poses,
    motions: Motions,
    obstacles: Obstacles,
    frame: FloatArray,
    row: int,
    ends: FloatArray,
    found: IntArray,
) -> None:
    """Fill in what a row leads to, once; ``ends`` and ``found`` are scratch."""
    if poses.successors[row, 0] != -2:
        return
    kind, cell = np.int64(poses.kind[row]), np.int64(poses.cell[row])  # the one type compiled for
    follow_controls(motions, obstacles, poses.pose[row], kind, cell, ends, found)
    free = 0
    for u in range(motions.controls[kind]):
        after = -1
        if found[u] == -2:
            after = enter_pose(poses, frame, kind, ends[u, 0], ends[u, 1], ends[u, 2])
            free += 1
        poses.successors[row, u] = after
    poses.free[row] = free
