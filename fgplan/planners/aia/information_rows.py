"""What robots would learn of all targets at once, in numpy: ``information_kernels`` uncompiled.

The formulas are the kernels', pair by pair in the same order of operations; lines of sight are
asked of the workspace together.
"""

import numpy as np

from fgplan.planners.aia.information_kernels import (
    BEARING,
    BEARING_SIGMA,
    CODE,
    FIELD_OF_VIEW,
    FLOOR,
    MAX_RANGE,
    NEAREST,
    POSITION,
    RANGE,
    SIGMA,
    SLOPE,
    Sight,
)
from fgplan.typing import BoolArray, FloatArray, IntArray
from roadmaps import Workspace


def information_rows(
    sight: Sight, workspace: Workspace, poses: FloatArray, kinds: IntArray, t: int
) -> FloatArray:
    """Information of single robots about all targets at a time.

    Args:
        sight: Sensors and what they look at.
        workspace: What blocks sight.
        poses: Shape (n, 3), world frame.
        kinds: Kind of robot at each pose, shape (n,).
        t: When.

    Returns:
        (J_xx, J_xy, J_yy) of each target, shape (n, 3 M), one over square metres.
    """
    places = sight.places[min(t, len(sight.places) - 1)]
    ox = places[None, :, 0] - poses[:, 0, None]
    oy = places[None, :, 1] - poses[:, 1, None]
    square = ox * ox + oy * oy
    length = np.sqrt(square)
    columns = range(sight.sensors.shape[1])
    sensors = [sight.sensors[kinds, c].T[:, :, None] for c in columns]  # (7, n, 1) each
    looks = [_in_view(sensor, poses, ox, oy, length) for sensor in sensors]
    robot, target = np.nonzero(np.logical_or.reduce(looks))
    hidden = ~workspace.has_line_of_sight(poses[robot, :2], places[target])
    out = np.zeros((len(poses), len(places), 3))
    for sensor, look in zip(sensors, looks, strict=True):
        look[robot[hidden], target[hidden]] = False
        j, i = np.nonzero(look)
        out[j, i] += _gained(sensor[:, j, 0], ox[j, i], oy[j, i], square[j, i], length[j, i])
    return out.reshape(len(poses), -1)


def _in_view(
    sensor: FloatArray, poses: FloatArray, ox: FloatArray, oy: FloatArray, length: FloatArray
) -> BoolArray:
    """Pairs within range and field of view of one sensor of each robot, shape (n, M)."""
    view = (sensor[CODE] != 0.0) & (length > NEAREST) & (length <= sensor[MAX_RANGE])
    narrow = sensor[FIELD_OF_VIEW] < 2.0 * np.pi
    if (view & narrow).any():
        cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
        ahead = (cos * ox + sin * oy) / np.where(view, length, 1.0)
        angle = np.arccos(np.clip(ahead, -1.0, 1.0))
        view &= ~narrow | (angle <= 0.5 * sensor[FIELD_OF_VIEW])
    return view


def _gained(
    sensor: FloatArray, ox: FloatArray, oy: FloatArray, square: FloatArray, length: FloatArray
) -> FloatArray:
    """Information of pairs that see each other, shape (p, 3); sensors of shape (7, p)."""
    code = sensor[CODE]
    sigma = np.maximum(sensor[FLOOR], sensor[SIGMA] + sensor[SLOPE] * length)
    out = np.zeros((len(ox), 3))
    with np.errstate(divide="ignore"):  # a bearing has no sigma of its range, and the reverse
        whole = np.where(code == POSITION, 1.0 / (sigma * sigma), 0.0)
        ranged = (code != POSITION) & (code != BEARING)
        along = np.where(ranged, 1.0 / (square * sigma * sigma), 0.0)
        turned = (code != POSITION) & (code != RANGE)
        sigma = sensor[BEARING_SIGMA]
        across = np.where(turned, 1.0 / (square * square * sigma * sigma), 0.0)
    out[:, 0] = whole + along * ox * ox + across * oy * oy
    out[:, 1] = along * ox * oy - across * ox * oy
    out[:, 2] = whole + along * oy * oy + across * ox * ox
    return out
