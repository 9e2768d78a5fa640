"""Sensors as the numbers that the compiled filter works on."""

import numpy as np

from fgplan.models.clamped_range import ClampedRangeSensor
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.planners.intermittent.measurement_kernels import (
    BEARING,
    BEARING_RANGE,
    COLUMNS,
    POSITION,
    RANGE,
)
from fgplan.typing import FloatArray


def sensor_rows(carried: list[tuple[AbstractSensor, ...]]) -> FloatArray | None:
    """Sensors as the kernels read them.

    Args:
        carried: Sensors of each carrier.

    Returns:
        Shape (K, C, 8), code 0 where there is none; None if the kernels do not know a sensor: a
        user's own, subclasses included.
    """
    most = max(1, *(len(sensors) for sensors in carried)) if carried else 1
    table = np.zeros((len(carried), most, COLUMNS))
    for k, sensors in enumerate(carried):
        for c, sensor in enumerate(sensors):
            row = _sensor_row(sensor)
            if row is None:
                return None
            table[k, c] = row
    return table


def _sensor_row(sensor: AbstractSensor) -> tuple[float, ...] | None:
    """Code, range, sigma, slope, floor, ceiling, bearing sigma, rows of a built-in sensor."""
    inf, reach = np.inf, sensor.max_range_m
    if type(sensor) is ClampedRangeSensor:
        noise = (sensor.sigma_m, sensor.slope, sensor.floor_m, sensor.ceiling_m)
        return (RANGE, reach, *noise, 0.0, 1)
    if type(sensor) is ProportionalRangeSensor:
        return (RANGE, reach, sensor.sigma_m, sensor.slope, sensor.floor_m, inf, 0.0, 1)
    if type(sensor) is RangeSensor:
        return (RANGE, reach, sensor.sigma_m, sensor.sigma_per_metre, 0.0, inf, 0.0, 1)
    if type(sensor) is BearingSensor:
        return (BEARING, reach, 0.0, 0.0, 0.0, inf, sensor.sigma_rad, 1)
    if type(sensor) is BearingRangeSensor:
        noise2 = (sensor.range_sigma_m, sensor.range_sigma_per_metre, 0.0, inf)
        return (BEARING_RANGE, reach, *noise2, sensor.bearing_sigma_rad, 2)
    if type(sensor) is PositionSensor:
        return (POSITION, reach, sensor.sigma_m, sensor.sigma_per_metre, 0.0, inf, 0.0, 0)
    return None
