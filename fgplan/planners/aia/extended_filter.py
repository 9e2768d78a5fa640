"""An extended Kalman filter of second order for one target in the plane.

A range bends within the spread of an estimate near by, and a filter of first order then believes
what is not so. With H_a the Hessian of measurement a by the target and P the spread,

    expected_a = h_a(mu) + tr(H_a P) / 2,    noise_ab = R_ab + tr(H_a P H_b P) / 2

Both are the exact moments of a measurement that is quadratic in a Gaussian target. What bends
repeats itself where measurements are taken from nearly the same place, and noise does not: a
``bend_weight`` above one counts the second term of the noise so often. The sensor's noise depends
on where the target is, which is what is looked for: R is averaged over the spread.
"""

import numpy as np
from numpy.typing import NDArray

from fgplan.models.sensor import AbstractSensor
from fgplan.riccati.gaussian import update
from fgplan.typing import Covariance, FloatArray, Pose

_DIFFERENCE = 1e-5
"""Step of the differences that give second derivatives, metres."""


def update_target(
    sensor: AbstractSensor,
    pose: Pose,
    mean: FloatArray,
    spread: Covariance,
    value: FloatArray,
    bend_weight: float = 1.0,
) -> tuple[FloatArray, Covariance, float]:
    """Update a target's belief by one measurement.

    Args:
        sensor: What measured.
        pose: From where, world frame.
        mean: Mean of the target, shape (n,), metres.
        spread: Its covariance P, shape (n, n), square metres.
        value: The measurement, shape (m,).
        bend_weight: How often the noise of the bend counts.

    Returns:
        Mean and covariance after the measurement, and its log-likelihood but for a constant.
    """
    _, rows = sensor.jacobians(pose, mean)
    moved = [
        sensor.jacobians(pose, mean + sign * _DIFFERENCE * unit)[1]
        for unit in np.eye(len(mean))
        for sign in (1.0, -1.0)
    ]
    pairs = [moved[i] - moved[i + 1] for i in range(0, len(moved), 2)]
    bent = np.stack(pairs, axis=2) / (2.0 * _DIFFERENCE) @ spread
    noise = spread_noise(sensor, pose, mean, spread)
    noise = noise + 0.5 * bend_weight * np.einsum("aij,bji->ab", bent, bent)
    expected = sensor.predict(pose, mean) + 0.5 * np.trace(bent, axis1=1, axis2=2)
    innovation: NDArray[np.float64] = sensor.difference(np.array(value), expected)
    after_mean, after = update(mean, spread, rows, noise, innovation)
    total = rows @ spread @ rows.T + noise
    distance = float(innovation @ np.linalg.solve(total, innovation))
    return after_mean, after, -0.5 * (distance + float(np.linalg.slogdet(total)[1]))


def spread_noise(
    sensor: AbstractSensor, pose: Pose, mean: FloatArray, spread: Covariance
) -> Covariance:
    """The sensor's noise averaged over where the target may be: over its sigma points.

    Args:
        sensor: What measures.
        pose: From where, world frame.
        mean: Mean of the target, shape (n,), metres.
        spread: Its covariance, shape (n, n), square metres.

    Returns:
        R, shape (m, m).
    """
    edges = np.sqrt(len(mean)) * np.linalg.cholesky(spread).T
    drawn = [sensor.noise(pose, mean + sign * edge) for edge in edges for sign in (1.0, -1.0)]
    return np.asarray(np.mean(drawn, axis=0))
