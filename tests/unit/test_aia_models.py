"""Control sets, and the sensors that information gathering needs."""

import numpy as np
import pytest

from fgplan.errors import InvalidInputError
from fgplan.models.linear_observation import AbstractLinearObservation, FieldSensor
from fgplan.models.motion_primitives import MotionPrimitives, differential_drive, first_order
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.models.sensor_check import check_sensor

POSE = np.array([1.0, 2.0, 0.4])


def test_first_order_has_the_paper_s_eight_controls_and_never_stays():
    ends = first_order(0.2).successors(POSE) - POSE
    expected = {(0, 0.2), (0, -0.2), (0.2, 0), (-0.2, 0)}
    expected |= {(x, y) for x in (0.2, -0.2) for y in (0.2, -0.2)}
    assert {(round(x, 9), round(y, 9)) for x, y, _ in ends} == expected
    assert np.all(ends[:, 2] == 0.0)
    assert len(first_order(0.2, stay=True)) == 9


def test_differential_drive_follows_the_exact_arc():
    primitives = differential_drive((0.0, 0.2), step_s=1.0)
    assert len(primitives) == 18
    for speed in (0.0, 0.2):
        for turn in (0.0, np.pi / 4, -np.pi / 2, 3 * np.pi / 4, np.pi):
            fine = np.array(POSE)
            for _ in range(20000):  # Euler's midpoint rule
                half = fine[2] + turn / 40000
                fine += np.array([speed * np.cos(half), speed * np.sin(half), turn]) / 20000
            gap = primitives.successors(POSE) - fine
            gap[:, 2] = np.sin(0.5 * gap[:, 2])
            assert np.abs(gap).max(axis=1).min() < 1e-8


def test_waypoints_of_an_arc_lie_on_it_and_end_at_its_end():
    primitives = differential_drive((1.0,), (np.pi / 2,), spacing_m=0.01)
    radius = 2.0 / np.pi
    offset = primitives.waypoints[0] - (0.0, radius)
    assert np.abs(np.linalg.norm(offset, axis=1) - radius).max() < 1e-12
    np.testing.assert_allclose(primitives.waypoints[0, -1], primitives.relative[0, :2])
    assert primitives.waypoints.shape[1] >= 100


def test_headings_stay_in_one_turn():
    primitives = MotionPrimitives(relative=np.array([[0.0, 0.0, np.pi], [0.0, 0.0, -np.pi]]))
    assert np.allclose(primitives.successors([0.0, 0.0, 0.0])[:, 2], np.pi)


@pytest.mark.parametrize(
    "sensor",
    [
        ProportionalRangeSensor(),
        ProportionalRangeSensor(slope=0.1, sigma_m=0.2, floor_m=0.05),
        PositionSensor(sigma_m=0.1, sigma_per_metre=0.3),
    ],
)
def test_jacobians_equal_differences(sensor):
    assert check_sensor(sensor, POSE, [4.0, 6.0]) < 1e-7
    assert check_sensor(sensor, np.eye(4), [4.0, 6.0, 1.0]) < 1e-7


def test_proportional_noise_has_a_floor():
    sensor = ProportionalRangeSensor(slope=0.25, floor_m=0.01)
    assert sensor.noise(POSE, POSE[:2] + np.array([0.0, 2.0]))[0, 0] == pytest.approx(0.25)
    assert sensor.noise(POSE, POSE[:2] + np.array([0.0, 0.02]))[0, 0] == pytest.approx(1e-4)


def test_a_field_sensor_weighs_near_cells_and_sees_none_far_away():
    cells = np.array([[0.0, 0.0], [1.0, 0.0], [9.0, 0.0]])
    sensor = FieldSensor(cells=cells, width_m=1.0, sigma=0.5)
    rows = sensor.rows(np.zeros(3), 3)
    weights = np.array([1.0, np.exp(-0.5), 0.0])
    np.testing.assert_allclose(rows, (weights / weights.sum() / 0.5)[None], rtol=1e-12)
    assert sensor.rows(np.array([50.0, 0.0, 0.0]), 3).shape == (0, 3)


class Wrong(AbstractLinearObservation):
    def matrix(self, pose, world=None):
        return np.ones((1, 2))

    def noise(self, pose):
        return np.array([[-1.0]])


def test_bad_models_are_refused():
    with pytest.raises(InvalidInputError, match="empty set"):
        MotionPrimitives(relative=np.zeros((0, 3)))
    with pytest.raises(InvalidInputError, match="'world' or 'body'"):
        MotionPrimitives(relative=np.zeros((1, 3)), frame="robot")
    with pytest.raises(InvalidInputError, match="last waypoint"):
        MotionPrimitives(relative=np.zeros((1, 3)), waypoints=np.ones((1, 2, 2)))
    with pytest.raises(InvalidInputError, match="at least one speed"):
        differential_drive(())
    with pytest.raises(InvalidInputError, match="step_m"):
        first_order(0.0)
    with pytest.raises(InvalidInputError, match="floor_m"):
        ProportionalRangeSensor(floor_m=0.0)
    with pytest.raises(InvalidInputError, match="position sigma_m"):
        PositionSensor(sigma_m=-1.0)
    with pytest.raises(InvalidInputError, match="at least one cell"):
        FieldSensor(cells=np.zeros((0, 2)), width_m=1.0, sigma=1.0)
    with pytest.raises(InvalidInputError, match="positive definite"):
        Wrong().rows(POSE, 2)
    with pytest.raises(InvalidInputError, match="shape"):
        Wrong().rows(POSE, 3)
