"""An extended Kalman filter of second order for one target in the plane.

A range bends within the spread of an estimate near by, and a filter of first order then believes
what is not so. With H_a the Hessian of measurement a by the target and P the spread,

    expected_a = h_a(mu) + tr(H_a P) / 2,    noise_ab = R_ab + tr(H_a P H_b P) / 2

Both are the exact moments of a measurement that is quadratic in a Gaussian target. What bends
repeats itself where measurements are taken from nearly the same place, and noise does not: a
``bend_weight`` above one counts the second term of the noise so often. The closed loop of planner
``aia`` and the execution of a plan of ``distributed_aia`` use it.
"""

import numpy as np

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
    noise: Covariance,
    bend_weight: float = 1.0,
) -> tuple[FloatArray, Covariance]:
    """Update a target's belief by one measurement.

    Args:
        sensor: What measured.
        pose: From where, world frame.
        mean: Mean of the target, shape (2,), metres.
        spread: Its covariance P, shape (2, 2), square metres.
        value: The measurement, shape (m,).
        noise: R that the sensor reports with its reading, shape (m, m).
        bend_weight: How often the noise of the bend counts.

    Returns:
        Mean and covariance after the measurement.
    """
    _, rows = sensor.jacobians(pose, mean)
    moved = [
        sensor.jacobians(pose, mean + sign * _DIFFERENCE * unit)[1]
        for unit in np.eye(2)
        for sign in (1.0, -1.0)
    ]
    bends = np.stack([moved[0] - moved[1], moved[2] - moved[3]], axis=2) / (2.0 * _DIFFERENCE)
    bent = bends @ spread
    larger = noise + 0.5 * bend_weight * np.einsum("aij,bji->ab", bent, bent)
    expected = sensor.predict(pose, mean) + 0.5 * np.trace(bent, axis1=1, axis2=2)
    innovation = sensor.difference(np.array(value), expected)
    return update(mean, spread, rows, larger, innovation)
