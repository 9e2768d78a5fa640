"""Compiled: what the robots would learn of each target from where they are.

Linearised about the predicted target (section VI-A of Kantaros et al. 2019), with o the offset from
robot to target and l its length, one measurement of target i adds to its 2 x 2 information

    range      o o' / (l^2 sigma(l)^2),        sigma(l) = max(floor, sigma_0 + slope l)
    bearing    c c' / (l^4 sigma_b^2),         c = (-o_y, o_x)
    position   I / sigma(l)^2

and nothing out of range, field of view or line of sight. Each is the W'W of the sensor's
``linearise``. Targets that do not move are looked up by pose once known.
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.obstacle_kernels import Obstacles, in_sight
from fgplan.planners.aia.pose_kernels import ENTRY_COUNT, Poses
from fgplan.typing import FloatArray, IntArray

RANGE, BEARING, BEARING_RANGE, POSITION = 1, 2, 3, 4
CODE, MAX_RANGE, FIELD_OF_VIEW, SIGMA, SLOPE, FLOOR, BEARING_SIGMA = 0, 1, 2, 3, 4, 5, 6
NEAREST = 1e-9


class Sight(NamedTuple):
    """Sensors and what they look at.

    Attributes:
        sensors: Shape (K, C, 7): code, range, field of view, sigma, slope, floor, bearing sigma of
            each sensor of each kind of robot; code 0 where there is none.
        places: Predicted positions of the targets, shape (T, M, 2), metres; one row if they stay.
        fixed: Whether they stay, so that information is remembered by pose.
    """

    sensors: FloatArray
    places: FloatArray
    fixed: bool


@njit(inner=True, **UNCOUNTED)
def pair_information(
    sight: Sight,
    obstacles: Obstacles,
    pose: FloatArray,
    kind: int,
    target: FloatArray,
) -> tuple[bool, float, float, float]:
    """Whether one robot learns of one target, and its information (J_xx, J_xy, J_yy)."""
    ox, oy = target[0] - pose[0], target[1] - pose[1]
    square = ox * ox + oy * oy
    length = np.sqrt(square)
    jxx, jxy, jyy = 0.0, 0.0, 0.0
    looked = False
    for c in range(sight.sensors.shape[1]):
        sensor = sight.sensors[kind, c]
        if sensor[CODE] == 0.0 or not NEAREST < length <= sensor[MAX_RANGE]:
            continue
        if sensor[FIELD_OF_VIEW] < 2.0 * np.pi:
            ahead = (np.cos(pose[2]) * ox + np.sin(pose[2]) * oy) / length
            if np.arccos(min(max(ahead, -1.0), 1.0)) > 0.5 * sensor[FIELD_OF_VIEW]:
                continue
        if not looked:
            if not in_sight(obstacles, pose[0], pose[1], target[0], target[1]):
                return False, 0.0, 0.0, 0.0
            looked = True
        sigma = max(sensor[FLOOR], sensor[SIGMA] + sensor[SLOPE] * length)
        if sensor[CODE] == POSITION:
            jxx += 1.0 / (sigma * sigma)
            jyy += 1.0 / (sigma * sigma)
            continue
        if sensor[CODE] != BEARING:
            weight = 1.0 / (square * sigma * sigma)
            jxx += weight * ox * ox
            jxy += weight * ox * oy
            jyy += weight * oy * oy
        if sensor[CODE] != RANGE:
            sigma = sensor[BEARING_SIGMA]
            weight = 1.0 / (square * square * sigma * sigma)
            jxx += weight * oy * oy
            jxy -= weight * ox * oy
            jyy += weight * ox * ox
    return looked, jxx, jxy, jyy


@njit(inner=True, **UNCOUNTED)
def remember_information(sight: Sight, obstacles: Obstacles, poses: Poses, row: int) -> None:
    """Enter what is learnt at a pose about targets that stay, once."""
    if poses.first[row] >= 0:
        return
    begin = poses.counts[ENTRY_COUNT]
    place = begin
    for i in range(sight.places.shape[1]):
        kind = poses.kind[row]
        learns, jxx, jxy, jyy = pair_information(
            sight, obstacles, poses.pose[row], kind, sight.places[0, i]
        )
        if learns:
            poses.target[place] = i
            poses.information[place, 0] = jxx
            poses.information[place, 1] = jxy
            poses.information[place, 2] = jyy
            place += 1
    poses.first[row] = begin
    poses.entries[row] = place - begin
    poses.counts[ENTRY_COUNT] = place


@njit(inner=True, **UNCOUNTED)
def sum_remembered(
    rows: IntArray,
    first: IntArray,
    entries: IntArray,
    target: IntArray,
    information: FloatArray,
    out: FloatArray,
) -> bool:
    """Sum what is remembered of a configuration; False where a pose is not known yet."""
    for j in range(rows.shape[0]):
        if first[rows[j]] < 0:
            return False
    for c in range(out.shape[0]):
        out[c] = 0.0
    for j in range(rows.shape[0]):
        begin = first[rows[j]]
        for e in range(begin, begin + entries[rows[j]]):
            o = 3 * target[e]
            out[o] += information[e, 0]
            out[o + 1] += information[e, 1]
            out[o + 2] += information[e, 2]
    return True


@njit(**UNCOUNTED)
def team_information(
    sight: Sight, obstacles: Obstacles, poses: Poses, rows: IntArray, t: int, out: FloatArray
) -> None:
    """Information of a whole team about all targets at a time, written to ``out``, shape (3 M,)."""
    if sight.fixed and poses.successors.shape[0] > 0:
        for j in range(rows.shape[0]):
            remember_information(sight, obstacles, poses, rows[j])
        sum_remembered(rows, poses.first, poses.entries, poses.target, poses.information, out)
        return
    for c in range(out.shape[0]):
        out[c] = 0.0
    places = sight.places[min(t, sight.places.shape[0] - 1)]
    longest = 0.0
    for k in range(sight.sensors.shape[0]):
        for c in range(sight.sensors.shape[1]):
            longest = max(longest, sight.sensors[k, c, MAX_RANGE])
    square = longest * longest
    pose = poses.pose
    for j in range(rows.shape[0]):
        row = rows[j]
        x, y = pose[row, 0], pose[row, 1]
        for i in range(places.shape[0]):
            dx, dy = places[i, 0] - x, places[i, 1] - y
            if dx * dx + dy * dy > square:
                continue
            kind = poses.kind[row]
            learns, jxx, jxy, jyy = pair_information(sight, obstacles, pose[row], kind, places[i])
            if learns:
                out[3 * i] += jxx
                out[3 * i + 1] += jxy
                out[3 * i + 2] += jyy
