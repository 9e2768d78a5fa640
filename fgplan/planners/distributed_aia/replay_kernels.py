"""Compiled: the distributed Kalman filter along a team's path, every robot's covariances.

Nothing is taken from the trees: at step t each robot fuses the covariances that the linked robots
have at t, and none lags.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.covariance_kernels import (
    predict_row,
    read_numbers,
    shortfall_of,
    total_of,
)
from fgplan.planners.aia.information_kernels import pair_information
from fgplan.planners.aia.tree_kernels import Setting
from fgplan.planners.distributed_aia.forest_kernels import Links
from fgplan.planners.distributed_aia.fusion_kernels import fuse_rows, is_near
from fgplan.typing import FloatArray


@njit(cache=True)
def replay_path(
    setting: Setting, links: Links, root: FloatArray, poses: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Covariances before measuring, objective and shortfall of each robot along a path.

    Where:
        setting: Of the whole team; kind of robot j is j, targets predicted for all steps.
        root: Prior of every robot, shape (3 M,).
        poses: Shape (F + 1, N, 3), world frame.

    Returns:
        Shapes (F + 1, N, 3 M), (F + 1, N) and (F + 1, N).
    """
    steps, robots = poses.shape[0], poses.shape[1]
    criteria, dynamics, sight = setting.criteria, setting.dynamics, setting.sight
    targets = sight.places.shape[1]
    covariance = np.empty((steps, robots, root.shape[0]))
    terms, shortfalls = np.empty((steps, robots)), np.empty((steps, robots))
    numbers, satisfied = np.empty(targets), np.empty(targets, np.bool_)
    information = np.empty(root.shape[0])
    heard = np.empty((max(robots - 1, 1), root.shape[0]))
    late = np.zeros(heard.shape[0], np.bool_)
    width = root.shape[0]
    for t in range(steps):
        for i in range(robots):
            row = covariance[t, i]
            for c in range(width):  # by element: assigning arrays costs seconds of compiling
                row[c] = root[c] if t == 0 else covariance[t - 1, i, c]
                information[c] = 0.0
            if t > 0:
                step = (t - 1) // links.period % links.linked.shape[0]
                places = sight.places[min(t - 1, sight.places.shape[0] - 1)]
                count = 0
                for j in range(robots):
                    if links.linked[step, i, j] and is_near(
                        poses[t - 1, i, 0],
                        poses[t - 1, i, 1],
                        poses[t - 1, j, 0],
                        poses[t - 1, j, 1],
                        links.range_m,
                    ):
                        for c in range(width):
                            heard[count, c] = covariance[t - 1, j, c]
                        count += 1
                for k in range(targets):
                    learns, xx, xy, yy = pair_information(
                        sight, setting.obstacles, poses[t - 1, i], setting.kind[i], places[k]
                    )
                    if learns:
                        information[3 * k] = xx
                        information[3 * k + 1] = xy
                        information[3 * k + 2] = yy
                fuse_rows(row, heard, late, count, information, links.kappa)
                if not dynamics.still:
                    predict_row(
                        row, dynamics.identity, dynamics.transition, dynamics.process, t - 1
                    )
            read_numbers(row, criteria.objective, numbers)
            terms[t, i] = total_of(numbers, criteria)
            read_numbers(row, criteria.terminal, numbers)
            shortfalls[t, i] = shortfall_of(numbers, criteria, satisfied)
    return covariance, terms, shortfalls
