"""Which landmarks a path would see: order, sensors, what is refused."""

import numpy as np
import pytest

from fgplan.errors import InvalidInputError
from fgplan.models.range_bearing import BearingRangeSensor, RangeSensor
from fgplan.paths.planned_observations import planned_observations

NEAR = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.1, max_range_m=5.0)
FAR = RangeSensor(sigma_m=0.1)
SENSORS = {"far": FAR, "near": NEAR}
LANDMARKS = {7: [4.0, 0.0], 3: [0.0, 9.0]}
PATH = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [20.0, 0.0, 0.0]])


def test_order_is_step_then_sensor_then_landmark():
    (found, none) = planned_observations([PATH, PATH[:1]], SENSORS, LANDMARKS)
    assert [(one.step, one.sensor, one.landmark) for one in found] == [
        (1, "far", 7),
        (1, "far", 3),
        (1, "near", 7),
        (2, "far", 7),
        (2, "far", 3),
    ]
    assert found[0].covariance == pytest.approx(np.array([[0.01]]), rel=1e-12)
    assert none == ()


@pytest.mark.parametrize("size", [1, 4])
def test_a_landmark_has_two_or_three_coordinates(size):
    with pytest.raises(InvalidInputError, match=f"landmark 5: expected 2 or 3 coord.* got {size}"):
        planned_observations([PATH], SENSORS, {5: np.ones(size)})


def test_what_is_not_finite_is_refused():
    with pytest.raises(InvalidInputError, match="landmark 5: expected finite"):
        planned_observations([PATH], SENSORS, {5: [0.0, np.nan]})
    lost = PATH.copy()
    lost[1, 0] = np.nan
    for sensors in ({"far": FAR}, {"near": NEAR}):
        with pytest.raises(InvalidInputError, match="positions of planned poses: expected finite"):
            planned_observations([lost], sensors, LANDMARKS)
