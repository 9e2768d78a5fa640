"""Compiled: the extended Kalman filter of Algorithm 4 for independent targets.

Each target is a block of its own: predictions and measurements touch one block each, so the joint
covariance stays block-diagonal exactly and is never made dense. Measurements of the same step are
linearised at the same predicted state, which equals stacking them in one update: their order
changes nothing but the last digit.
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.aia.obstacle_kernels import Obstacles
from fgplan.planners.intermittent.measurement_kernels import (
    DETERMINANT,
    LARGEST_EIGENVALUE,
    block_uncertainty,
    is_angle,
    is_visible,
    measurement_row,
    predict_block,
    row_count,
    update_block,
)
from fgplan.typing import BoolArray, FloatArray, IntArray


class Targets(NamedTuple):
    """Dynamics of independent targets; a leading axis of one stands for constant.

    Attributes:
        transition: A, shape (T or 1, M, s, s).
        drift: d, shape (T or 1, M, s).
        process: Q, shape (T or 1, M, s, s).
    """

    transition: FloatArray
    drift: FloatArray
    process: FloatArray


class Readings(NamedTuple):
    """Measurements in order of time, then of robot, then of what was measured.

    Attributes:
        time: Shape (R,).
        sensor: Row of ``sensors`` (carrier, place), shape (R, 2).
        target: Shape (R,).
        position: Of the robot, shape (R, 2), metres.
        value: Shape (R, 3), as many numbers as the sensor has rows.
    """

    time: IntArray
    sensor: IntArray
    target: IntArray
    position: FloatArray
    value: FloatArray


@njit(inner=True, **UNCOUNTED)
def copy_matrix(source: FloatArray, out: FloatArray) -> None:
    """Element by element: a slice would be copied through memory of its own."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            out[i, j] = source[i, j]


@njit(inner=True, **UNCOUNTED)
def total_uncertainty(covariance: FloatArray, metric: int) -> float:
    """Uncertainty of the block-diagonal covariance of all targets, shape (M, s, s)."""
    total = 1.0 if metric == DETERMINANT else 0.0
    for i in range(covariance.shape[0]):
        value = block_uncertainty(covariance[i], metric)
        if metric == LARGEST_EIGENVALUE:
            total = max(total, value)
        elif metric == DETERMINANT:
            total *= value
        else:
            total += value
    return total


@njit(inner=True, **UNCOUNTED)
def predict_targets(
    targets: Targets, time: int, covariance: FloatArray, mean: FloatArray, work: FloatArray
) -> None:
    """One step of all targets from ``time`` to ``time + 1``, in place; ``work`` is (s + 1, s)."""
    size = covariance.shape[1]
    a = min(time, targets.transition.shape[0] - 1)
    d = min(time, targets.drift.shape[0] - 1)
    q = min(time, targets.process.shape[0] - 1)
    for i in range(covariance.shape[0]):
        predict_block(covariance[i], targets.transition[a, i], targets.process[q, i], work[:size])
        for r in range(size):
            total = targets.drift[d, i, r]
            for c in range(size):
                total += targets.transition[a, i, r, c] * mean[i, c]
            work[size, r] = total
        for r in range(size):
            mean[i, r] = work[size, r]


@njit(**UNCOUNTED)
def run_filter(
    targets: Targets,
    sensors: FloatArray,
    readings: Readings,
    start: int,
    end: int,
    metric: int,
    mean: FloatArray,
    covariance: FloatArray,
    means: FloatArray,
    uncertainty: FloatArray,
    predicted: FloatArray,
    work: FloatArray,
) -> None:
    """Filter from after ``start`` to ``end``, in place, with the readings of those steps.

    Where:
        mean, covariance: Shapes (M, s) and (M, s, s), at ``start``, then at ``end``.
        means, uncertainty: Written for each step, shapes (end - start, M, s), (end - start,).
        predicted: Work, shape (M, s).
    """
    r = 0
    count = readings.time.shape[0]
    while r < count and readings.time[r] <= start:
        r += 1
    for time in range(start + 1, end + 1):
        predict_targets(targets, time - 1, covariance, mean, work)
        copy_matrix(mean, predicted)
        while r < count and readings.time[r] == time:
            i = readings.target[r]
            sensor = sensors[readings.sensor[r, 0], readings.sensor[r, 1]]
            px, py = readings.position[r, 0], readings.position[r, 1]
            for k in range(row_count(sensor, mean.shape[1])):
                h0, h1, h2, variance, value = measurement_row(sensor, k, px, py, predicted[i])
                innovation = readings.value[r, k] - value
                if is_angle(sensor, k):
                    innovation = np.arctan2(np.sin(innovation), np.cos(innovation))
                innovation -= h0 * (mean[i, 0] - predicted[i, 0])
                innovation -= h1 * (mean[i, 1] - predicted[i, 1])
                if mean.shape[1] == 3:
                    innovation -= h2 * (mean[i, 2] - predicted[i, 2])
                update_block(covariance[i], mean[i], h0, h1, h2, variance, innovation)
            r += 1
        copy_matrix(mean, means[time - start - 1])
        uncertainty[time - start - 1] = total_uncertainty(covariance, metric)


@njit(inner=True, **UNCOUNTED)
def follow_places(
    targets: Targets,
    sensors: FloatArray,
    obstacles: Obstacles,
    means: FloatArray,
    base: int,
    every: int,
    metric: int,
    start: int,
    end: int,
    places: FloatArray,
    there: BoolArray,
    limit: float,
    covariance: FloatArray,
    work: FloatArray,
) -> float:
    """Algorithm 4 along planned places: the sum of uncertainty over the steps, in place.

    Where:
        means: Predicted means from time ``base``, shape (T, M, s).
        places, there: Of every carrier after ``start``, shapes (end - start, K, 2) and
            (end - start, K): whether it takes part.
        limit: Ends early, with infinity, once the sum is not below it.
        covariance: Shape (M, s, s), at ``start``, then at ``end``.
        work: Shape (s + 2, s).
    """
    size = covariance.shape[1]
    total = 0.0
    for time in range(start + 1, end + 1):
        a = min(time - 1, targets.transition.shape[0] - 1)
        q = min(time - 1, targets.process.shape[0] - 1)
        for i in range(covariance.shape[0]):
            predict_block(
                covariance[i], targets.transition[a, i], targets.process[q, i], work[:size]
            )
            if time % every != 0:
                continue
            target = means[time - base, i]
            for j in range(places.shape[1]):
                if not there[time - start - 1, j]:
                    continue
                px, py = places[time - start - 1, j, 0], places[time - start - 1, j, 1]
                for c in range(sensors.shape[1]):
                    sensor = sensors[j, c]
                    if not is_visible(sensor, obstacles, px, py, target):
                        continue
                    for k in range(row_count(sensor, size)):
                        h0, h1, h2, variance, _ = measurement_row(sensor, k, px, py, target)
                        update_block(covariance[i], work[size], h0, h1, h2, variance, 0.0)
        total += total_uncertainty(covariance, metric)
        if total >= limit:
            return np.inf
    return total


@njit(**UNCOUNTED)
def look(
    sensors: FloatArray,
    obstacles: Obstacles,
    px: float,
    py: float,
    targets: FloatArray,
    normals: FloatArray,
    values: FloatArray,
    seen: BoolArray,
) -> None:
    """What one robot measures of the true targets, shape (M, s).

    Where:
        normals: Standard normal numbers, shape (C M, 3).
        values, seen: Written, shapes (C M, 3) and (C M,).
    """
    count, size = targets.shape[0], targets.shape[1]
    for c in range(sensors.shape[0]):
        for i in range(count):
            index = c * count + i
            seen[index] = is_visible(sensors[c], obstacles, px, py, targets[i])
            if not seen[index]:
                continue
            for k in range(row_count(sensors[c], size)):
                _, _, _, variance, value = measurement_row(sensors[c], k, px, py, targets[i])
                values[index, k] = value + np.sqrt(variance) * normals[index, k]
