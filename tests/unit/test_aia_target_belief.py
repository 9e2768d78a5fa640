"""The bank of filters of one target: moments, weights, and the two places that ranges leave."""

import dataclasses

import numpy as np
import pytest
from aia_scenes import lattice_problem

from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.models.measurement import Measurement
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.planners.aia import adaptive
from fgplan.planners.aia.adaptive import track
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.search import SearchResult
from fgplan.planners.aia.target_belief import (
    miss_belief,
    predict_belief,
    split_prior,
    update_belief,
)
from fgplan.riccati.gaussian import predict, update
from fgplan.riccati.information import from_information, to_information

MEAN = np.array([1.0, 2.0])
PRIOR = np.array([[0.3, 0.1], [0.1, 0.2]])


def reading(value, sigma):
    size = len(value)
    return Measurement(
        robot="r",
        sensor="s",
        kind="target",
        target="t",
        value=np.array(value),
        covariance=sigma**2 * np.eye(size),
    )


@pytest.mark.parametrize("per_axis", [1, 2, 7])
def test_splitting_keeps_mean_and_covariance(per_axis):
    belief = split_prior(MEAN, PRIOR, per_axis)
    assert len(belief.weights) == per_axis**2
    np.testing.assert_allclose(belief.mean, MEAN, rtol=1e-12)
    np.testing.assert_allclose(belief.covariance, PRIOR, rtol=1e-12)
    step = (np.array([[1.0, 0.2], [0.0, 0.9]]), np.array([0.1, -0.2]), 0.01 * np.eye(2))
    after = predict_belief(belief, *step)
    mean, covariance = predict(MEAN, PRIOR, *step)
    np.testing.assert_allclose(after.mean, mean, rtol=1e-12)
    np.testing.assert_allclose(after.covariance, covariance, rtol=1e-12)


def test_a_single_filter_of_a_linear_sensor_is_kalman_s():
    belief = split_prior(MEAN, PRIOR, 1)
    sensor = PositionSensor(sigma_m=0.2)
    pose = np.zeros(3)
    after = update_belief(belief, sensor, pose, reading([1.3, 1.8], 9.0), None)
    # 9.0, the noise that the reading was drawn with, is the truth's and must not be looked at.
    rows = sensor.jacobians(pose, MEAN)[1]
    expected = update(MEAN, PRIOR, rows, 0.04 * np.eye(2), np.array([0.3, -0.2]))
    np.testing.assert_allclose(after.mean, expected[0], rtol=1e-6)  # differences of second order
    np.testing.assert_allclose(after.covariance, expected[1], rtol=1e-6)
    assert miss_belief(after, sensor, pose, None) is after


def test_weights_are_the_likelihood_of_the_reading():
    """Against the posterior by numbers on a fine grid of places."""
    sensor = ProportionalRangeSensor(slope=0.05, max_range_m=9.0)
    belief = split_prior(MEAN, PRIOR, 9)
    axis = np.linspace(-2.5, 2.5, 201)
    places = MEAN + np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    offset = places - MEAN
    density = np.exp(-0.5 * np.einsum("ki,ij,kj->k", offset, np.linalg.inv(PRIOR), offset))
    for x, y, value in ((0.0, 0.0, 2.14), (2.0, 0.5, 1.39)):
        pose = np.array([x, y, 0.0])
        belief = update_belief(belief, sensor, pose, reading([value], 1.0), None)
        far = np.linalg.norm(places - pose[:2], axis=1)
        sigma = np.maximum(0.01, 0.05 * far)
        density *= np.exp(-0.5 * ((value - far) / sigma) ** 2) / sigma
    density /= density.sum()
    mean = density @ places
    covariance = np.einsum("k,ki,kj->ij", density, places - mean, places - mean)
    # A Gaussian mixture of components 0.2 m wide is near, not equal.
    assert np.linalg.norm(belief.mean - mean) < 0.03
    np.testing.assert_allclose(belief.covariance, covariance, atol=0.3 * np.abs(covariance).max())


def test_ranges_from_a_line_leave_both_sides_and_one_from_beside_decides():
    sensor = ProportionalRangeSensor(slope=0.05, max_range_m=9.0)
    truth = np.array([2.0, -0.6])
    bank, single = split_prior(np.array([2.0, 0.2]), 0.3 * np.eye(2), 7), None
    single = split_prior(np.array([2.0, 0.2]), 0.3 * np.eye(2), 1)
    ways = [np.array([x, 0.0, 0.0]) for x in np.linspace(0.0, 4.0, 9)]
    for pose in ways:
        value = [float(np.linalg.norm(truth - pose[:2]))]
        bank = update_belief(bank, sensor, pose, reading(value, 0.1), None)
        single = update_belief(single, sensor, pose, reading(value, 0.1), None)
    below = bank.weights[bank.means[:, 1] < 0.0].sum()
    assert 0.05 < below < 0.95
    beside = np.array([2.0, 1.0, 0.0])
    for _ in range(3):
        bank = update_belief(bank, sensor, beside, reading([1.6], 0.1), None)
    assert np.linalg.norm(bank.mean - truth) < 0.1
    offset = bank.mean - truth
    assert offset @ np.linalg.solve(bank.covariance, offset) < 9.0


def test_a_reading_that_does_not_come_moves_the_weight_away():
    sensor = ProportionalRangeSensor(max_range_m=1.0)
    belief = split_prior(np.zeros(2), 0.5 * np.eye(2), 7)
    for _ in range(3):
        belief = miss_belief(belief, sensor, np.array([0.5, 0.0, 0.0]), None)
    assert belief.mean[0] < -0.3
    far = miss_belief(belief, sensor, np.array([50.0, 0.0, 0.0]), None)
    assert far is belief


def test_dynamics_of_a_later_time():
    generator = np.random.default_rng(0)
    block = HiddenBlock(
        targets=("a",),
        transition=generator.standard_normal((4, 2, 2)),
        drift=generator.standard_normal((6, 2)),
        process=0.1 * np.eye(2),
    )
    state = HiddenState((block,))
    for time in (0, 3, 5, 9):
        later = state.later(time)
        for step in range(8):
            pairs = zip(later.dense(step), state.dense(time + step), strict=True)
            for one, other in pairs:
                np.testing.assert_array_equal(one, other)


def test_a_new_plan_begins_with_what_is_not_yet_counted(monkeypatch):
    """Its Sigma(1) is the filter's covariance after the measurements at hand, predicted."""
    problems = []

    def remembered(problem, *args, **kwargs):
        problems.append(problem)
        nothing = dict.fromkeys(("plan", "closest"))
        return SearchResult(
            ending="iterations",
            shortfall=2.0,
            nodes=1,
            counts={},
            bytes_per_node=0.0,
            seconds={},
            **nothing,
        )

    monkeypatch.setattr(adaptive, "search", remembered)
    process = np.concatenate([np.tile(1e-3 * np.eye(2), (3, 1, 1)), 1e-2 * np.eye(2)[None]])
    base = lattice_problem([(0.0, 0.0)], [(1.0, 1.5)], sensor=PositionSensor(sigma_m=0.2))
    blocks = tuple(dataclasses.replace(b, process=process) for b in base.hidden.blocks)
    base = dataclasses.replace(base, hidden=HiddenState(blocks))
    run = track(
        base,
        tree_options("pruned"),
        np.random.default_rng(0),
        steps=4,
        replan_every=2,
        hypotheses=1,
    )
    assert len(problems) == 2
    np.testing.assert_array_equal(problems[0].priors[0], base.priors[0])
    vector, matrix = to_information(problems[1].mean, problems[1].priors[0])
    _, once = from_information(vector, matrix + np.eye(2) / 0.04)
    np.testing.assert_allclose(once, run.covariances[2, 0], rtol=1e-6)
    for step in range(3):
        np.testing.assert_array_equal(
            problems[1].hidden.blocks[0].at(step)[2], process[min(2 + step, 3)]
        )
