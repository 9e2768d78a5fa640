"""Sensors as the numbers that the compiled kernels work on."""

import numpy as np

from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.planners.aia.information_kernels import BEARING, BEARING_RANGE, POSITION, RANGE
from fgplan.planners.aia.problem import Observer, SensingRobot
from fgplan.typing import FloatArray


def sensor_arrays(kinds: list[SensingRobot]) -> tuple[FloatArray, bool]:
    """Sensors as the kernels read them.

    Args:
        kinds: One robot of each kind.

    Returns:
        Shape (K, C, 7), and whether the kernels know all sensors.
    """
    most = max(1, *(len(robot.sensors) for robot in kinds))
    table = np.zeros((len(kinds), most, 7))
    known = True
    for k, robot in enumerate(kinds):
        for c, sensor in enumerate(robot.sensors):
            row = _sensor_row(sensor)
            if row is None:
                known = False
            else:
                table[k, c] = row
    return table, known


def _sensor_row(sensor: Observer) -> tuple[float, ...] | None:
    """Numbers of a built-in sensor; None for a user's own, subclasses included."""
    if type(sensor) is ProportionalRangeSensor:
        view = (sensor.max_range_m, sensor.field_of_view_rad)
        return (RANGE, *view, sensor.sigma_m, sensor.slope, sensor.floor_m, 0.0)
    if type(sensor) is RangeSensor:
        view = (sensor.max_range_m, sensor.field_of_view_rad)
        return (RANGE, *view, sensor.sigma_m, sensor.sigma_per_metre, 0.0, 0.0)
    if type(sensor) is BearingSensor:
        view = (sensor.max_range_m, sensor.field_of_view_rad)
        return (BEARING, *view, 0.0, 0.0, 0.0, sensor.sigma_rad)
    if type(sensor) is BearingRangeSensor:
        view = (sensor.max_range_m, sensor.field_of_view_rad)
        noise = (sensor.range_sigma_m, sensor.range_sigma_per_metre, 0.0)
        return (BEARING_RANGE, *view, *noise, sensor.bearing_sigma_rad)
    if type(sensor) is PositionSensor:
        view = (sensor.max_range_m, sensor.field_of_view_rad)
        return (POSITION, *view, sensor.sigma_m, sensor.sigma_per_metre, 0.0, 0.0)
    return None


def sensing_range(sensors: tuple[Observer, ...]) -> float:
    """R_j of a robot: its farthest-reaching sensor; zero where that is not limited.

    Args:
        sensors: What it carries.

    Returns:
        Metres.
    """
    ranges = [float(getattr(sensor, "max_range_m", np.inf)) for sensor in sensors]
    longest = max(ranges, default=np.inf)
    return longest if np.isfinite(longest) else 0.0
