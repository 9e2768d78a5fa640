"""Algorithm 4: compiled blocks, dense numpy, information form, users' own models."""

import numpy as np
import pytest
from intermittent_scenes import (
    block_model,
    dense_estimate,
    dense_model,
    drawn_records,
    estimate_of,
    room,
)
from scipy.linalg import block_diag

from fgplan.errors import InvalidInputError
from fgplan.models.clamped_range import ClampedRangeSensor
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.sensor_check import check_sensor
from fgplan.planners.intermittent.block_model import BlockModel
from fgplan.planners.intermittent.dense_model import DenseModel
from fgplan.planners.intermittent.ekf import stored_bytes, update_state
from fgplan.planners.intermittent.estimate import Estimate, Record
from fgplan.planners.intermittent.measurement_kernels import block_uncertainty
from fgplan.planners.intermittent.state_model import AbstractObservation, AbstractProcess

SENSORS = {
    "clamped_range": ClampedRangeSensor(),
    "proportional_range": ProportionalRangeSensor(slope=0.1, max_range_m=8.0),
    "range": RangeSensor(sigma_m=0.05, sigma_per_metre=0.01),
    "bearing": BearingSensor(sigma_rad=0.05),
    "bearing_range": BearingRangeSensor(bearing_sigma_rad=0.03, range_sigma_m=0.1),
    "position": PositionSensor(sigma_m=0.2, sigma_per_metre=0.02, max_range_m=6.0),
}


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("kind", SENSORS)
def test_compiled_blocks_equal_the_dense_filter(kind, size):
    blocks = block_model(2, size, (SENSORS[kind],))
    records = drawn_records(blocks, 30, np.random.default_rng(3))
    assert sum(len(record.readings) for _, record in records) > 40
    start = estimate_of(size)
    ours = blocks.run(start, 30, records)
    for form in ("covariance", "information"):
        dense = dense_model(blocks, form)
        theirs = dense.run(dense_estimate(start), 30, records)
        # Thirty nonlinear updates feed each other; the information form inverts twice a step.
        np.testing.assert_allclose(ours.means, theirs.means, rtol=1e-9, atol=1e-9)
        joint = block_diag(*ours.estimate.covariance)
        np.testing.assert_allclose(joint, theirs.estimate.covariance[0], rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(ours.uncertainty, theirs.uncertainty, rtol=1e-8)
        np.testing.assert_allclose(
            blocks.uncertainties(ours.estimate.covariance),
            dense.uncertainties(theirs.estimate.covariance),
            rtol=1e-8,
        )


def test_predicted_means_are_those_of_the_hidden_state():
    for size in (2, 3):
        blocks, start = block_model(1, size), estimate_of(size, time=25)
        expected = blocks.hidden.predicted_means(start.mean, 30, 25)
        np.testing.assert_allclose(blocks.predicted_means(start, 30), expected, rtol=1e-13)


def test_a_filter_may_be_interrupted_anywhere():
    blocks = block_model(2)
    records = drawn_records(blocks, 20, np.random.default_rng(5))
    whole = blocks.run(estimate_of(3), 20, records)
    half = blocks.run(estimate_of(3), 9, records)
    rest = blocks.run(half.estimate, 20, records)
    np.testing.assert_array_equal(whole.estimate.mean, rest.estimate.mean)
    np.testing.assert_array_equal(whole.estimate.covariance, rest.estimate.covariance)


def test_noise_of_the_paper_is_continuous_and_as_printed():
    sensor, origin = ClampedRangeSensor(), np.zeros(3)
    for distance, sigma in ((0.5, 0.01), (1.0, 0.01), (2.0, 0.055), (3.0, 0.1), (4.9, 0.1)):
        noise = sensor.noise(origin, np.array([distance, 0.0, 0.0]))
        np.testing.assert_allclose(noise, [[sigma**2]], rtol=1e-12)
    assert not sensor.visible(origin, np.array([3.0, 4.1, 0.0]))
    assert sensor.visible(origin, np.array([3.0, 3.9, 0.0]))
    check_sensor(sensor, origin, np.array([1.5, 0.7, 0.4]))
    with pytest.raises(InvalidInputError, match="ceiling_m"):
        ClampedRangeSensor(floor_m=0.2)


@pytest.mark.parametrize("size", [2, 3])
def test_uncertainty_of_a_block_is_that_of_numpy(size):
    generator = np.random.default_rng(1)
    for _ in range(50):
        root = generator.standard_normal((size, size)) * generator.uniform(0.01, 2.0, size)
        block = root @ root.T
        # The closed form loses half the digits only where eigenvalues meet; none do here.
        np.testing.assert_allclose(
            block_uncertainty(block, 1), np.linalg.eigvalsh(block)[-1], rtol=1e-9
        )
        np.testing.assert_allclose(block_uncertainty(block, 2), np.trace(block), rtol=1e-12)
        np.testing.assert_allclose(
            block_uncertainty(block, 3), np.linalg.det(block), rtol=1e-6, atol=1e-15
        )
    np.testing.assert_allclose(block_uncertainty(0.25 * np.eye(size), 1), 0.25, rtol=1e-15)


class Pendulum(AbstractProcess):
    """x = (angle, rate); process noise enters through the rate alone, scaled by the angle."""

    size = 2

    def advance(self, state, time):
        return np.array([state[0] + 0.1 * state[1], state[1] - 0.2 * np.sin(state[0])])

    def jacobians(self, state, time):
        by_state = np.array([[1.0, 0.1], [-0.2 * np.cos(state[0]), 1.0]])
        return by_state, np.array([[0.0], [1.0 + 0.1 * state[0]]])

    def noise(self, time):
        return np.array([[0.01]])


class Tilt(AbstractObservation):
    """The sine of the angle, seen within 4 m of a post; noise grows with distance through M."""

    post = np.array([8.0, 8.0])

    def visible(self, state, position, world):
        return bool(np.linalg.norm(position - self.post) < 4.0)

    def predict(self, state, position):
        return np.array([np.sin(state[0])])

    def jacobians(self, state, position):
        far = 1.0 + np.linalg.norm(position - self.post)
        return np.array([[np.cos(state[0]), 0.0]]), np.array([[far, 0.5]])

    def noise(self, state, position):
        return np.diag([0.04, 0.01])


def test_own_nonlinear_model_with_noise_jacobians_by_hand():
    model = DenseModel(Pendulum(), ((Tilt(),),), room())
    start = Estimate(0, np.array([0.3, 0.0]), np.diag([0.2, 0.1])[None])
    where = (7.0, 8.0)
    found = model.run(start, 1, [(0, Record(1, where, ((0, (0.4,)),)))]).estimate
    mean = np.array([0.3, -0.2 * np.sin(0.3)])
    by_state = np.array([[1.0, 0.1], [-0.2 * np.cos(0.3), 1.0]])
    by_noise = np.array([[0.0], [1.03]])
    spread = by_state @ np.diag([0.2, 0.1]) @ by_state.T + 0.01 * by_noise @ by_noise.T
    row = np.array([[np.cos(0.3), 0.0]])
    noise = 2.0**2 * 0.04 + 0.5**2 * 0.01  # M R M'
    innovation_spread = (row @ spread @ row.T).item() + noise
    gain = (spread @ row.T)[:, 0] / innovation_spread
    np.testing.assert_allclose(found.mean, mean + gain * (0.4 - np.sin(0.3)), rtol=1e-12)
    np.testing.assert_allclose(
        found.covariance[0], (np.eye(2) - np.outer(gain, row)) @ spread, rtol=1e-12
    )


def test_bytes_stored_by_each_form():
    records = [
        Record(1, (0.0, 0.0), ((0, (1.0,)), (3, (2.0,)))),
        Record(2, (0.0, 0.0), ((1, (1.0, 2.0)),)),
    ]
    # Remark III.4: 1 + d + m numbers a measurement against n.
    assert stored_bytes(records, 24) == {
        "covariance": 8 * (2 * 4 + 5),
        "information": 8 * 3 * 24,
    }


def test_models_refuse_what_they_cannot_do():
    class Own(RangeSensor):
        """A user's own sensor."""

    with pytest.raises(InvalidInputError, match="dense model"):
        BlockModel(block_model(1).hidden, ((Own(sigma_m=0.1),),), room())
    with pytest.raises(InvalidInputError, match="positive"):
        DenseModel(Pendulum(), ((Tilt(),),), room(), metric="log_determinant")
    with pytest.raises(InvalidInputError, match="form"):
        update_state(np.zeros(2), np.eye(2), [], "square_root")
