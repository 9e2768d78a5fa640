"""Compiled: the distributed Kalman filter (4) on rows of three numbers a target.

    Omega = sum_j w_j Sigma_j^-1 + J_i,    Sigma_i(t + 1) = A Omega^-1 A' + Q

with one weight a robot and target: the most certain robot (least determinant; of equal ones the
robot itself, then the first in the team) has kappa, the others share 1 - kappa. The numbers are
those of ``fgplan.riccati.distributed`` (a test compares them).

A neighbour's covariance that lags is fused for the targets of which it knows more than the robot.
For the others its share would take away, step by step, what the robot knows: a neighbour that is
left behind for good (its node never gets a child) would undo all that the robot learns.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.covariance_kernels import Dynamics, measure_row, predict_row
from fgplan.typing import BoolArray, FloatArray

CLEARLY = 1.0 - 1e-9
"""A determinant below that share of another is less by more than rounding."""


@njit(inner=True, **UNCOUNTED)
def predict_lag(row: FloatArray, dynamics: Dynamics, t: int, lag: int) -> None:
    """Predict a covariance of time t - lag forward to t, in place."""
    if dynamics.still:
        return
    for s in range(t - lag, t):
        predict_row(row, dynamics.identity, dynamics.transition, dynamics.process, s)


@njit(inner=True, **UNCOUNTED)
def fuse_rows(
    row: FloatArray,
    heard: FloatArray,
    late: BoolArray,
    count: int,
    information: FloatArray,
    kappa: float,
) -> None:
    """Own covariance after fusing what was heard and measuring, in place.

    Where:
        row: Own covariance, shape (3 M,).
        heard: Covariances of others in the order of the team, shape (D, 3 M); ``count`` of them.
        late: Which of them lag: these are left out of the targets of which they know less.
        information: J_i, shape (3 M,).
    """
    if count == 0:
        measure_row(row, information)
        return
    for o in range(0, row.shape[0], 3):
        a, b, c = row[o], row[o + 1], row[o + 2]
        own = a * c - b * b
        least = own
        best = -1
        others = 0
        for d in range(count):
            det = heard[d, o] * heard[d, o + 2] - heard[d, o + 1] * heard[d, o + 1]
            if late[d] and not det < own * CLEARLY:
                continue
            others += 1
            if det < least:
                least = det
                best = d
        small = (1.0 - kappa) / max(others, 1)
        weight = kappa if best < 0 else small
        if others == 0:
            weight = 1.0
        xx = weight * c / own + information[o]
        xy = -weight * b / own + information[o + 1]
        yy = weight * a / own + information[o + 2]
        for d in range(count):
            p, q, r = heard[d, o], heard[d, o + 1], heard[d, o + 2]
            det = p * r - q * q
            if late[d] and not det < own * CLEARLY:
                continue
            share = (kappa if d == best else small) / det
            xx += share * r
            xy -= share * q
            yy += share * p
        det = xx * yy - xy * xy
        row[o] = yy / det
        row[o + 1] = -xy / det
        row[o + 2] = xx / det


@njit(inner=True, **UNCOUNTED)
def is_near(ax: float, ay: float, bx: float, by: float, range_m: float) -> bool:
    """Whether two positions are within a distance."""
    if range_m == np.inf:
        return True
    dx, dy = bx - ax, by - ay
    return dx * dx + dy * dy <= range_m * range_m
