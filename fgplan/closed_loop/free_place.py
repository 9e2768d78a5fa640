"""The nearest free place to an estimate that lies where the robot cannot be.

An estimate may be a hair out of bounds or inside an obstacle's margin although the robot is not.
Ways then begin at the nearest free place: looked for on circles about the estimate, so no way leads
through the obstacle beside which the robot is thought to stand.
"""

import numpy as np

from fgplan.typing import FloatArray
from roadmaps import Workspace

_DIRECTIONS = 64
_GROWTH = 1.1
_FIRST, _LAST = 1e-4, 0.1
"""Radius of the first and last circle, in diagonals of the workspace."""


def nearest_free_place(workspace: Workspace, place: FloatArray) -> FloatArray | None:
    """Find where a robot can be that is thought to be at a place.

    Args:
        workspace: Bounds and obstacles.
        place: Shape (2,), metres, world frame.

    Returns:
        The place itself if it is free, otherwise a free one that is at most a tenth farther than
        the nearest, shape (2,); None if there is none within a tenth of the workspace's diagonal.
    """
    if workspace.are_positions_valid(place)[0]:
        return place
    diagonal = float(np.linalg.norm(workspace.upper - workspace.lower))
    count = int(np.ceil(np.log(_LAST / _FIRST) / np.log(_GROWTH)))
    radii = diagonal * _FIRST * _GROWTH ** np.arange(count + 1)
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    around = place + (radii[:, None, None] * circle).reshape(-1, 2)
    around = np.clip(np.concatenate([place[None], around]), workspace.lower, workspace.upper)
    distances = np.linalg.norm(around - place, axis=1)
    free = np.flatnonzero(workspace.are_positions_valid(around) & (distances <= radii[-1]))
    if not len(free):
        return None
    found: FloatArray = around[free[int(np.argmin(distances[free]))]]
    return found
