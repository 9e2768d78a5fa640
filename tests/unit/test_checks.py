"""A stack of covariances is judged as each of its matrices alone is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fgplan.checks import CONDITION_LIMIT, check_covariance, check_covariances
from fgplan.errors import InvalidInputError


def named(row):
    return f"noise {row}"


def draw_stack(rng, count, size):
    root = rng.normal(size=(count, size, size))
    stack = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(size)
    return 0.5 * (stack + np.swapaxes(stack, 1, 2))


def spoil(stack, row, fault):
    """Make one matrix of the stack what the fault says."""
    if fault == "nan":
        stack[row, 0, -1] = stack[row, -1, 0] = np.nan
    elif fault == "infinite":
        stack[row, 0, 0] = np.inf
    elif fault == "asymmetric":
        stack[row, 0, -1] += 1e-3
    elif fault == "zero":
        stack[row] = 0.0
    elif fault == "indefinite":
        stack[row, 0, 0] *= -1.0
    elif fault == "singular":
        stack[row] = np.ones_like(stack[row])
    elif fault == "at the limit":
        stack[row] = np.eye(stack.shape[1])
        stack[row, 0, 1] = stack[row, 1, 0] = 1.0 - 1.0 / CONDITION_LIMIT


FAULTS = ("nan", "infinite", "asymmetric", "zero", "indefinite", "singular", "at the limit")


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(2, 6), st.sampled_from(FAULTS))
def test_one_that_is_none_is_named_as_if_it_came_alone(seed, count, size, fault):
    rng = np.random.default_rng(seed)
    stack = draw_stack(rng, count, size)
    row = int(rng.integers(count))
    spoil(stack, row, fault)
    with pytest.raises(InvalidInputError) as alone:
        check_covariance(stack[row], named(row))
    with pytest.raises(InvalidInputError) as together:
        check_covariances(stack, named)
    assert str(together.value) == str(alone.value)


@given(st.integers(0, 2**32 - 1), st.integers(0, 6), st.integers(1, 6), st.booleans())
def test_covariances_pass_as_they_are(seed, count, size, diagonal):
    stack = draw_stack(np.random.default_rng(seed), count, size)
    if diagonal:
        stack = stack * np.eye(size)
    checked = check_covariances(stack, named)
    assert not checked.flags.writeable
    assert np.array_equal(checked, stack)
    alone = [check_covariance(matrix, named(row)) for row, matrix in enumerate(stack)]
    assert np.array_equal(checked, np.reshape(alone, stack.shape))


def test_rounding_is_symmetrised():
    stack = draw_stack(np.random.default_rng(0), 3, 3)
    stack[1, 0, 2] *= 1.0 + 1e-12
    checked = check_covariances(stack, named)
    assert np.array_equal(checked, np.swapaxes(checked, 1, 2))
    assert np.allclose(checked, stack, rtol=1e-11, atol=0.0)
