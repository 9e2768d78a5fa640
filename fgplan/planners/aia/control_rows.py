"""Controls of several robots at once in numpy: where they lead, and u* of equation (9).

For where ``pose_kernels`` and ``sampling_kernels`` are not compiled; the formulas and the choice
among equals (the first) are theirs, ways are asked of the workspace together.
"""

from typing import NamedTuple

import numpy as np

from fgplan.planners.aia.pose_kernels import Motions
from fgplan.planners.aia.sampling_kernels import AHEAD
from fgplan.planners.aia.tree_kernels import Setting
from fgplan.typing import BoolArray, FloatArray, IntArray
from roadmaps import Workspace


class Reach(NamedTuple):
    """Where the controls of n robots lead.

    Attributes:
        ends: Poses after each control, shape (n, U, 3), world frame.
        cells: Geodesic cell of each, shape (n, U).
        free: Whether the control exists and is not blocked, shape (n, U).
    """

    ends: FloatArray
    cells: IntArray
    free: BoolArray


def cells_of(frame: FloatArray, x: FloatArray, y: FloatArray) -> IntArray:
    """Geodesic cells of positions.

    Args:
        frame: (x0, y0, side, columns, rows), metres.
        x: Metres.
        y: Metres, of the same shape.

    Returns:
        Of that shape.
    """
    column = np.clip(np.floor((x - frame[0]) / frame[2]), 0, frame[3] - 1)
    row = np.clip(np.floor((y - frame[1]) / frame[2]), 0, frame[4] - 1)
    return (row * frame[3] + column).astype(np.int64)


def follow(
    setting: Setting, workspace: Workspace, poses: FloatArray, kinds: IntArray, cells: IntArray
) -> Reach:
    """Follow every control.

    Args:
        setting: What is planned for.
        workspace: What blocks ways.
        poses: Shape (n, 3), world frame.
        kinds: Kind of robot at each pose, shape (n,).
        cells: Geodesic cell of each pose, shape (n,).

    Returns:
        Where they lead.
    """
    motions = setting.motions
    relative = motions.relative[kinds]
    body = motions.body[kinds][:, None]
    x, y, heading = (poses[:, c, None] for c in range(3))
    cos, sin = np.where(body, np.cos(heading), 1.0), np.where(body, np.sin(heading), 0.0)
    ends = np.empty_like(relative)
    ends[..., 0] = x + (cos * relative[..., 0] - sin * relative[..., 1])
    ends[..., 1] = y + (sin * relative[..., 0] + cos * relative[..., 1])
    turned = heading + relative[..., 2]
    turned = np.where(turned > np.pi, turned - 2.0 * np.pi, turned)
    ends[..., 2] = np.where(turned <= -np.pi, turned + 2.0 * np.pi, turned)
    free = np.arange(relative.shape[1]) < motions.controls[kinds][:, None]
    tight = np.flatnonzero(motions.clearance_m[cells] <= motions.reach_m[kinds])
    if len(tight):
        turn = (cos[tight], sin[tight])
        free[tight] &= _are_free(workspace, motions, poses[tight], kinds[tight], *turn)
    return Reach(ends, cells_of(setting.fields.frame, ends[..., 0], ends[..., 1]), free)


def _are_free(
    workspace: Workspace,
    motions: Motions,
    poses: FloatArray,
    kinds: IntArray,
    cos: FloatArray,
    sin: FloatArray,
) -> BoolArray:
    """Which ways are free, shape (n, U); to stay at a waypoint always is."""
    waypoints = motions.waypoints[kinds]
    points = np.empty((*waypoints.shape[:2], waypoints.shape[2] + 1, 2))
    points[:, :, 0] = poses[:, None, :2]
    wx, wy, cos, sin = waypoints[..., 0], waypoints[..., 1], cos[..., None], sin[..., None]
    points[:, :, 1:, 0] = poses[:, 0, None, None] + (cos * wx - sin * wy)
    points[:, :, 1:, 1] = poses[:, 1, None, None] + (sin * wx + cos * wy)
    before, after = points[:, :, :-1], points[:, :, 1:]
    free = (before == after).all(axis=-1)
    moves = ~free
    free[moves] = workspace.are_motions_valid(before[moves], after[moves])
    return free.all(axis=2)


def prefer(
    setting: Setting,
    reach: Reach,
    poses: FloatArray,
    robots: IntArray,
    targets: IntArray,
    t: int,
    *,
    to_goal: bool,
    circle: bool,
) -> IntArray:
    """u* of equation (9), or -1 where controls are drawn uniformly.

    Args:
        setting: What is planned for.
        reach: Where the controls lead.
        poses: Shape (n, 3), world frame.
        robots: Shape (n,).
        targets: Target of each, shape (n,).
        t: When they will be there.
        to_goal: Whether robots with a terminal goal prefer that.
        circle: Whether to circle a target that is near.

    Returns:
        Controls, shape (n,).
    """
    fields, lines = setting.fields, np.arange(len(robots))
    field = fields.of_target[min(t, len(fields.of_target) - 1)][targets]
    homeward = np.zeros(len(robots), dtype=np.bool_)
    if to_goal:
        homeward = fields.of_goal[robots] >= 0
        field = np.where(homeward, fields.of_goal[robots], field)
    score = fields.distance_m[field[:, None], reach.cells]
    kinds = setting.kind[robots]
    body = setting.motions.body[kinds]
    if body.any():
        score = np.where(body[:, None], _with_heading(setting, reach, field, kinds), score)
    score = np.where(reach.free, score, np.inf)
    best = score.argmin(axis=1)
    reached = np.isfinite(score[lines, best])
    place = setting.sight.places[min(t, len(setting.sight.places) - 1)][targets]
    dx, dy = (reach.ends[lines, best, c] - place[:, c] for c in range(2))
    far = dx * dx + dy * dy > setting.near_m[robots] * setting.near_m[robots]
    near = reached & ~far & ~homeward
    other = np.full(len(robots), -1)
    if circle and near.any():
        other = _widest_turn(reach, poses, place)
    return np.where(near, other, np.where(reached, best, -1))


def _with_heading(setting: Setting, reach: Reach, field: IntArray, kinds: IntArray) -> FloatArray:
    """Distances, of which a thousandth is that of where the heading would lead, shape (n, U)."""
    fields, reach_m = setting.fields, setting.motions.reach_m[kinds][:, None]
    x, y, heading = (reach.ends[..., c] for c in range(3))
    cells = cells_of(fields.frame, x + reach_m * np.cos(heading), y + reach_m * np.sin(heading))
    here = fields.distance_m[field[:, None], reach.cells].astype(np.float64)
    ahead = fields.distance_m[field[:, None], cells]
    return here + AHEAD * np.minimum(ahead, here + 2.0 * reach_m)


def _widest_turn(reach: Reach, poses: FloatArray, place: FloatArray) -> IntArray:
    """Free controls that circle a target by the greatest angle, counterclockwise, shape (n,)."""
    ax, ay = (poses[:, c, None] - place[:, c, None] for c in range(2))
    bx, by = (reach.ends[..., c] - place[:, c, None] for c in range(2))
    angle = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
    return np.where(reach.free, angle, -np.inf).argmax(axis=1)
