"""Hidden states: block and dense forms agree, samples follow N(A x + d, Q)."""

import numpy as np
import pytest
from scipy.stats import chi2

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.models.hidden_state import (
    HiddenBlock,
    HiddenState,
    coupled,
    independent_targets,
    square_root,
)


def three_targets():
    """A drifting target, two coupled ones, and one in space that turns."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    field = np.array([[0.9, 0.1, 0.0], [0.05, 0.9, 0.05], [0.0, 0.2, 0.8]])
    spread = np.array([[0.4, 0.1, 0.0], [0.1, 0.3, 0.05], [0.0, 0.05, 0.2]])
    return HiddenState(
        (
            HiddenBlock(targets=("a",), transition=np.eye(2), drift=[0.1, -0.2]),
            HiddenBlock(targets=("b", "c"), sizes=(2, 1), transition=field, process=spread),
            HiddenBlock(targets=("d",), transition=turn, process=0.01 * np.eye(3)),
        )
    )


def test_layout_of_the_stack():
    state = three_targets()
    assert state.targets == ("a", "b", "c", "d")
    assert state.sizes == (2, 2, 1, 3)
    assert state.size == 8
    assert not state.independent
    assert state.slice_of("c") == slice(4, 5)
    with pytest.raises(UnknownNameError, match="'e' is not one of: a, b, c, d"):
        state.slice_of("e")


def test_predicted_means_equal_the_dense_recursion():
    state = three_targets()
    mean = np.arange(8.0)
    means = state.predicted_means(mean, 5)
    for step in range(5):
        transition, drift, _ = state.dense(step)
        mean = transition @ mean + drift
        np.testing.assert_allclose(means[step + 1], mean, rtol=1e-12)
    assert not means.flags.writeable


def test_a_target_on_a_circle_comes_back():
    centre = np.array([3.0, 1.0])
    angle = 2 * np.pi / 12
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    block = HiddenBlock(targets=("a",), transition=turn, drift=centre - turn @ centre)
    means = HiddenState((block,)).predicted_means([5.0, 1.0], 12)
    np.testing.assert_allclose(np.linalg.norm(means - centre, axis=1), 2.0, rtol=1e-12)
    np.testing.assert_allclose(means[-1], means[0], rtol=1e-12)


def test_series_over_time_hold_their_last_entry():
    drift = np.array([[1.0, 0.0], [0.0, 2.0]])
    state = HiddenState((HiddenBlock(targets=("a",), transition=np.eye(2), drift=drift),))
    np.testing.assert_array_equal(
        state.predicted_means([0, 0], 3), [[0, 0], [1, 0], [1, 2], [1, 4]]
    )
    np.testing.assert_array_equal(state.predicted_means([0, 0], 1, time=1)[-1], [0, 2])


def test_the_dense_form_is_the_same_dynamics():
    drift = np.array([[1.0, 0.0], [0.0, 2.0], [3.0, 3.0]])
    blocks = (
        *three_targets().blocks,
        HiddenBlock(targets=("e",), transition=np.eye(2), drift=drift),
    )
    state = HiddenState(blocks)
    dense = coupled(state)
    assert len(dense.blocks) == 1
    assert dense.targets == state.targets
    for time in range(5):
        for one, other in zip(state.dense(time), dense.dense(time), strict=True):
            np.testing.assert_array_equal(one, other)
    assert coupled(three_targets()).blocks[0].transition.shape == (8, 8)


def test_samples_follow_mean_and_covariance():
    state, generator = three_targets(), np.random.default_rng(7)
    x = np.arange(8.0)
    transition, drift, process = state.dense(0)
    samples = np.array([state.sample(x, 0, generator) for _ in range(3000)])
    residual = samples - (transition @ x + drift)
    np.testing.assert_allclose(residual[:, :2], 0.0, atol=1e-15)
    noisy = process[2:, 2:]
    squared = np.einsum("ti,ij,tj->t", residual[:, 2:], np.linalg.inv(noisy), residual[:, 2:])
    low, high = chi2.ppf([0.001, 0.999], 6 * 3000)
    assert low < squared.sum() < high
    np.testing.assert_allclose(np.cov(residual[:, 2:].T), noisy, atol=0.03)


def test_samples_repeat_and_take_the_same_numbers_whatever_the_noise():
    quiet = independent_targets(("a", "b"), np.zeros((2, 2)), np.zeros((2, 2)))
    loud = independent_targets(("a", "b"), np.zeros((2, 2)), np.eye(2))
    generators = [np.random.default_rng(1) for _ in range(3)]
    x = np.zeros(4)
    first, again = (loud.sample(x, 0, one) for one in generators[:2])
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(quiet.sample(x, 0, generators[2]), x)
    assert generators[2].random() == generators[0].random()
    assert quiet.independent


def test_square_root_of_a_singular_covariance():
    covariance = np.array([[4.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    root = square_root(covariance)
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-14)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"transition": np.ones((2, 3))}, "transition of shape"),
        ({"targets": ()}, "at least one target"),
        ({"sizes": (1, 1)}, "one size a target with sum 2"),
        ({"sizes": (3,)}, "one size a target with sum 2"),
        ({"drift": np.zeros(3)}, "drift: expected shape"),
        ({"transition": np.full((2, 2), np.nan)}, "transition: expected finite"),
        ({"process": [[1.0, 0.5], [0.0, 1.0]]}, "symmetric"),
        ({"process": [[1.0, 0.0], [0.0, -1.0]]}, "positive semidefinite"),
        ({"process": np.zeros((0, 2, 2)) + 1, "drift": np.zeros((0, 2))}, None),
    ],
)
def test_bad_blocks(change, message):
    given = {"targets": ("a",), "transition": np.eye(2)} | change
    if message is None:
        # Empty series mean that nothing was given: zero drift and no noise.
        assert HiddenBlock(**given).drift.tolist() == [0.0, 0.0]
        return
    with pytest.raises(InvalidInputError, match=message):
        HiddenBlock(**given)


def test_an_empty_series_of_transitions():
    with pytest.raises(InvalidInputError, match="transition of shape"):
        HiddenBlock(targets=("a",), transition=np.zeros((0, 2, 2)))


def test_bad_states():
    block = HiddenBlock(targets=("a",), transition=np.eye(2))
    with pytest.raises(InvalidInputError, match="'a' twice"):
        HiddenState((block, block))
    state = HiddenState((block,))
    with pytest.raises(InvalidInputError, match="hidden state mean: expected shape"):
        state.predicted_means([0.0], 1)
    with pytest.raises(InvalidInputError, match="zero or more, got -1"):
        state.predicted_means([0.0, 0.0], -1)
    with pytest.raises(InvalidInputError, match="hidden state: expected shape"):
        state.sample([0.0], 0, np.random.default_rng(0))
    with pytest.raises(InvalidInputError, match="target drifts"):
        independent_targets(("a",), np.zeros((2, 2)), np.eye(2))
