"""Compiled: rows of measurements of one target, and their use in its filter.

With o the offset from robot to target (a ground robot is at height zero), l its length and m its
length seen from above, a measurement is one row h or several, each with variance r:

    range      h = o / l                       r = sigma(l)^2
    bearing    h = (-o_y, o_x, 0) / m^2        r = sigma_b^2
    position   h = e_i                         r = sigma(l)^2

sigma(l) = min(ceiling, max(floor, sigma_0 + slope l)). A row changes a target's covariance by

    C <- C - C h h' C / (h' C h + r)

and rows that are linearised at the same state may come in any order: this equals stacking them.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.obstacle_kernels import Obstacles, in_sight
from fgplan.typing import FloatArray

RANGE, BEARING, BEARING_RANGE, POSITION = 1, 2, 3, 4
CODE, REACH, SIGMA, SLOPE, FLOOR, CEILING, BEARING_SIGMA, ROWS = 0, 1, 2, 3, 4, 5, 6, 7
COLUMNS = 8
NEAREST = 1e-9
LARGEST_EIGENVALUE, TRACE, DETERMINANT = 1, 2, 3


@njit(inner=True, **UNCOUNTED)
def is_visible(
    sensor: FloatArray, obstacles: Obstacles, px: float, py: float, target: FloatArray
) -> bool:
    """Whether a target is within range and line of sight of a sensor."""
    if sensor[CODE] == 0.0:
        return False
    ox, oy = target[0] - px, target[1] - py
    oz = target[2] if target.shape[0] == 3 else 0.0
    length = np.sqrt(ox * ox + oy * oy + oz * oz)
    if not NEAREST < length <= sensor[REACH]:
        return False
    if sensor[CODE] != RANGE and sensor[CODE] != POSITION and ox * ox + oy * oy <= NEAREST**2:
        return False
    return in_sight(obstacles, px, py, target[0], target[1])


@njit(inner=True, **UNCOUNTED)
def row_count(sensor: FloatArray, size: int) -> int:
    """Rows of one measurement."""
    return size if sensor[CODE] == POSITION else int(sensor[ROWS])


@njit(inner=True, **UNCOUNTED)
def measurement_row(
    sensor: FloatArray, k: int, px: float, py: float, target: FloatArray
) -> tuple[float, float, float, float, float]:
    """Row k of a measurement: h (three numbers), its variance, and the predicted value."""
    ox, oy = target[0] - px, target[1] - py
    oz = target[2] if target.shape[0] == 3 else 0.0
    length = np.sqrt(ox * ox + oy * oy + oz * oz)
    sigma = min(max(sensor[SIGMA] + sensor[SLOPE] * length, sensor[FLOOR]), sensor[CEILING])
    if sensor[CODE] == POSITION:
        return (
            1.0 if k == 0 else 0.0,
            1.0 if k == 1 else 0.0,
            1.0 if k == 2 else 0.0,
            sigma * sigma,
            target[k],
        )
    if sensor[CODE] == BEARING or (sensor[CODE] == BEARING_RANGE and k == 0):
        square = ox * ox + oy * oy
        sigma = sensor[BEARING_SIGMA]
        return -oy / square, ox / square, 0.0, sigma * sigma, np.arctan2(oy, ox)
    return ox / length, oy / length, oz / length, sigma * sigma, length


@njit(inner=True, **UNCOUNTED)
def is_angle(sensor: FloatArray, k: int) -> bool:
    """Whether a row measures an angle."""
    return bool(sensor[CODE] == BEARING or (sensor[CODE] == BEARING_RANGE and k == 0))


@njit(inner=True, **UNCOUNTED)
def update_block(
    covariance: FloatArray,
    mean: FloatArray,
    h0: float,
    h1: float,
    h2: float,
    variance: float,
    innovation: float,
) -> None:
    """One row into a target's covariance and mean, in place; size two or three."""
    size = covariance.shape[0]
    g0 = covariance[0, 0] * h0 + covariance[0, 1] * h1
    g1 = covariance[1, 0] * h0 + covariance[1, 1] * h1
    g2 = 0.0
    spread = variance
    if size == 3:
        g0 += covariance[0, 2] * h2
        g1 += covariance[1, 2] * h2
        g2 = covariance[2, 0] * h0 + covariance[2, 1] * h1 + covariance[2, 2] * h2
        spread += h2 * g2
    spread += h0 * g0 + h1 * g1
    share = innovation / spread
    mean[0] += g0 * share
    mean[1] += g1 * share
    covariance[0, 0] -= g0 * g0 / spread
    covariance[0, 1] -= g0 * g1 / spread
    covariance[1, 0] = covariance[0, 1]
    covariance[1, 1] -= g1 * g1 / spread
    if size == 3:
        mean[2] += g2 * share
        covariance[0, 2] -= g0 * g2 / spread
        covariance[2, 0] = covariance[0, 2]
        covariance[1, 2] -= g1 * g2 / spread
        covariance[2, 1] = covariance[1, 2]
        covariance[2, 2] -= g2 * g2 / spread


@njit(inner=True, **UNCOUNTED)
def predict_block(
    covariance: FloatArray, transition: FloatArray, process: FloatArray, work: FloatArray
) -> None:
    """C <- A C A' + Q in place, exactly symmetric; ``work`` has the shape of C."""
    size = covariance.shape[0]
    for i in range(size):
        for j in range(size):
            total = 0.0
            for k in range(size):
                total += transition[i, k] * covariance[k, j]
            work[i, j] = total
    for i in range(size):
        for j in range(i + 1):
            total = 0.0
            for k in range(size):
                total += work[i, k] * transition[j, k]
            covariance[i, j] = total + process[i, j]
            covariance[j, i] = covariance[i, j]


@njit(**UNCOUNTED)
def block_uncertainty(covariance: FloatArray, metric: int) -> float:
    """Largest eigenvalue, trace or determinant of a symmetric block of size two or three."""
    a, b, d = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    if covariance.shape[0] == 2:
        if metric == TRACE:
            return a + d
        if metric == DETERMINANT:
            return a * d - b * b
        return 0.5 * (a + d) + np.sqrt(0.25 * (a - d) ** 2 + b * b)
    c, e, f = covariance[0, 2], covariance[1, 2], covariance[2, 2]
    if metric == TRACE:
        return a + d + f
    if metric == DETERMINANT:
        return a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    middle = (a + d + f) / 3.0
    off = b * b + c * c + e * e
    square = (a - middle) ** 2 + (d - middle) ** 2 + (f - middle) ** 2 + 2.0 * off
    if square <= 0.0:
        return middle
    p = np.sqrt(square / 6.0)
    a, d, f = (a - middle) / p, (d - middle) / p, (f - middle) / p
    b, c, e = b / p, c / p, e / p
    half = 0.5 * (a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d))
    return middle + 2.0 * p * np.cos(np.arccos(min(max(half, -1.0), 1.0)) / 3.0)
