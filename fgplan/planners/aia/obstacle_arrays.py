"""A workspace as the flat arrays that the compiled kernels read."""

import numpy as np

from fgplan.planners.aia.obstacle_kernels import Obstacles
from roadmaps import Workspace


def obstacle_arrays(workspace: Workspace) -> Obstacles:
    """A workspace as the kernels read it.

    Args:
        workspace: The workspace.

    Returns:
        Arrays.
    """
    rings = [np.asarray(ring) for ring in workspace.obstacles]
    empty = np.zeros((0, 2))
    blocked = opaque = np.zeros((0, 0), dtype=np.bool_)
    to_cells = np.zeros((2, 3))
    if workspace.grid is not None:
        outside = not workspace.unknown_is_free
        blocked = np.pad(np.asarray(workspace.blocked), 1, constant_values=outside)
        opaque = np.pad(np.asarray(workspace.opaque), 1, constant_values=outside)
        corners = workspace.grid.to_cells(np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]))
        to_cells = np.stack([corners[1] - corners[0], corners[2] - corners[0], corners[0]], axis=1)
    return Obstacles(
        lower=np.array(workspace.lower),
        upper=np.array(workspace.upper),
        radius_m=float(workspace.robot_radius_m),
        starts=np.concatenate([empty, *rings]),
        ends=np.concatenate([empty, *(np.roll(ring, -1, axis=0) for ring in rings)]),
        first_edge=np.cumsum([0, *(len(ring) for ring in rings)]).astype(np.int64),
        box_low=np.array([ring.min(axis=0) for ring in rings]).reshape(-1, 2),
        box_high=np.array([ring.max(axis=0) for ring in rings]).reshape(-1, 2),
        blocked=blocked,
        opaque=opaque,
        to_cells=np.ascontiguousarray(to_cells),
    )
