"""Square-root elimination against exact rational arithmetic, with sigmas from 1e-6 to 1e3."""

import os
import subprocess
import sys
from fractions import Fraction

import gtsam
import numpy as np
import pytest

from fgplan.beliefs.elimination import eliminate, eliminate_graph, elimination_order
from fgplan.beliefs.marginals import marginal_covariances
from fgplan.beliefs.square_root import triangular
from fgplan.beliefs.whitened_rows import WhitenedRows, whitened_rows
from fgplan.errors import IllPosedBeliefError, InvalidInputError, UnknownNameError


def unit(dim):
    return gtsam.noiseModel.Unit.Create(dim)


def linear_graph(seed, sigmas=(1.0,), count=5, dim=2):
    """A connected random graph: priors on the first variable, pairs of neighbours and loops."""
    rng = np.random.default_rng(seed)
    graph = gtsam.GaussianFactorGraph()
    pairs = [(i, i + 1) for i in range(count - 1)] + [(0, count - 1), (1, count - 1)]
    graph.add(0, rng.normal(size=(dim, dim)) / rng.choice(sigmas), np.zeros(dim), unit(dim))
    for first, second in pairs:
        sigma = rng.choice(sigmas)
        blocks = rng.normal(size=(2, dim, dim)) / sigma
        graph.add(first, blocks[0], second, blocks[1], rng.normal(size=dim), unit(dim))
    return graph


def exact_inverse(information):
    """Gauss-Jordan on fractions: no rounding at all."""
    size = len(information)
    rows = [
        [*row, *(Fraction(int(i == j)) for j in range(size))] for i, row in enumerate(information)
    ]
    for column in range(size):
        lead = next(row for row in range(column, size) if rows[row][column] != 0)
        rows[column], rows[lead] = rows[lead], rows[column]
        scale = rows[column][column]
        rows[column] = [entry / scale for entry in rows[column]]
        for row in range(size):
            if row != column and rows[row][column] != 0:
                factor = rows[row][column]
                rows[row] = [a - factor * b for a, b in zip(rows[row], rows[column], strict=True)]
    return np.array([[float(entry) for entry in row[size:]] for row in rows])


def exact_covariance(graph):
    """Covariance of all keys, ascending, from the rows' exact values."""
    rows = whitened_rows(graph)
    size = int(rows.dims.sum())
    information = [[Fraction(0)] * size for _ in range(size)]
    for row in range(rows.row_start.size - 1):
        span = slice(rows.row_start[row], rows.row_start[row + 1])
        terms = [
            (int(c), Fraction(float(e)))
            for c, e in zip(rows.columns[span], rows.entries[span], strict=True)
        ]
        for i, a in terms:
            for j, b in terms:
                information[i][j] += a * b
    return exact_inverse(information)


def worst(have, want):
    return float(np.abs(have - want).max() / np.abs(want).max())


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("sigmas", [(1.0,), (1e-6, 1.0), (1e-6, 1e-3, 1.0, 1e3)])
def test_covariances_equal_exact_arithmetic(seed, sigmas):
    # Random blocks have condition numbers of hundreds; 1e-9 is the promise, 1e-12 is usual.
    graph = linear_graph(seed, sigmas)
    want = exact_covariance(graph)
    factor = eliminate_graph(graph)
    together = marginal_covariances(factor)
    for key in range(5):
        block = slice(2 * key, 2 * key + 2)
        assert worst(factor.covariance([key]), want[block, block]) < 1e-9
        assert worst(together[key], want[block, block]) < 1e-9
    everything = factor.covariance(range(5))
    assert worst(everything, want) < 1e-9
    assert (everything == everything.T).all()
    assert worst(factor.covariance([3, 0]), want[np.ix_([6, 7, 0, 1], [6, 7, 0, 1])]) < 1e-9
    assert worst(factor.covariance([4], [1, 2]), want[8:10, 2:6]) < 1e-9


@pytest.mark.parametrize("kept", [(3, 0), (0, 3), (4,), (2, 1, 0)])
@pytest.mark.parametrize("sigmas", [(1.0,), (1e-6, 1e-3, 1.0, 1e3)])
def test_information_rows_are_the_square_root_of_the_joint_marginal(kept, sigmas):
    graph = linear_graph(11, sigmas)
    scalars = [2 * key + i for key in kept for i in range(2)]
    want = exact_covariance(graph)[np.ix_(scalars, scalars)]
    rows, dims = eliminate_graph(graph, kept).information_rows()
    assert dims.tolist() == [2] * len(kept)
    assert (np.tril(rows, -1) == 0).all()
    assert (np.diag(rows) > 0).all()
    assert worst(np.linalg.inv(rows) @ np.linalg.inv(rows).T, want) < 1e-9


def test_information_rows_of_some_of_the_kept_keys_in_another_order():
    graph = linear_graph(5)
    factor = eliminate_graph(graph, (4, 2, 0))
    want, _ = eliminate_graph(graph, (2, 4)).information_rows()
    rows, dims = factor.information_rows((2, 4))
    np.testing.assert_allclose(rows, want, rtol=0, atol=1e-12 * np.abs(want).max())
    assert dims.tolist() == [2, 2]
    suffix, _ = factor.information_rows((2, 0))
    np.testing.assert_array_equal(suffix, factor.information_rows()[0][2:, 2:])


def test_mixed_dimensions_and_a_forest_keep_the_order_asked():
    graph = gtsam.GaussianFactorGraph()
    graph.add(7, 2.0 * np.eye(3), np.zeros(3), unit(3))
    graph.add(7, np.ones((1, 3)), 9, np.eye(1), np.zeros(1), unit(1))
    graph.add(3, 4.0 * np.eye(2), np.zeros(2), unit(2))
    graph.add(3, np.ones((2, 2)), 5, np.eye(2), np.zeros(2), unit(2))
    factor = eliminate_graph(graph, (5, 9))
    rows, dims = factor.information_rows()
    assert dims.tolist() == [2, 1]
    assert rows[0, 2] == rows[1, 2] == 0.0
    # x9 = -(sum of three with variance 1/4) + unit noise: 3/4 + 1.
    assert factor.covariance([9])[0, 0] == pytest.approx(1.75, rel=1e-14)
    assert factor.covariance([9], [5]).shape == (1, 2)
    assert (factor.covariance([9], [5]) == 0.0).all()
    assert factor.keys[-2:] == (5, 9)


def test_block_row_is_the_conditional_of_its_variable():
    graph = gtsam.GaussianFactorGraph()
    graph.add(1, np.array([[3.0]]), 2, np.array([[4.0]]), np.zeros(1), unit(1))
    graph.add(2, np.array([[5.0]]), np.zeros(1), unit(1))
    row, others = eliminate_graph(graph, (2,)).block_row(1)
    assert others == (2,)
    np.testing.assert_array_equal(row, [[3.0, 4.0]])


def test_a_tight_prior_does_not_drown_a_loose_one():
    # One row of 1e6 through two variables, one of 1e-3 on the first alone.
    graph = gtsam.GaussianFactorGraph()
    graph.add(1, np.array([[1e6]]), 2, np.array([[-1e6]]), np.zeros(1), unit(1))
    graph.add(1, np.array([[1e-3]]), np.zeros(1), unit(1))
    for order in ((1, 2), (2, 1)):
        factor = eliminate(whitened_rows(graph), order)
        assert factor.deficient == ()
        assert factor.covariance([2])[0, 0] == pytest.approx(1e6 + 1e-12, rel=1e-14)


def test_deficiency_is_reported_by_key_and_raised_when_read():
    graph = gtsam.GaussianFactorGraph()
    graph.add(1, np.eye(2), 2, -np.eye(2), np.zeros(2), unit(2))
    graph.add(2, np.array([[1.0, 0.0]]), np.zeros(1), unit(1))
    graph.add(8, np.eye(1), np.zeros(1), unit(1))
    factor = eliminate(whitened_rows(graph), (8, 1, 2))
    assert (factor.deficient, factor.deficiency) == ((2,), 1)
    assert factor.information_rows()[0].shape == (0, 0)
    for read in (lambda: factor.covariance([8]), lambda: marginal_covariances(factor)):
        with pytest.raises(IllPosedBeliefError, match=r"1 direction\(s\) .* found at 2: "):
            read()


def test_deficiency_hidden_in_rounding_is_found():
    # Three variables in a consistent loop, nothing absolute: the last pivots are rounding.
    rng = np.random.default_rng(3)
    turns = [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(3)]
    graph = gtsam.GaussianFactorGraph()
    for first, second in ((0, 1), (1, 2), (0, 2)):
        graph.add(first, -1e3 * turns[first], second, 1e3 * turns[second], np.zeros(3), unit(3))
    factor = eliminate_graph(graph)
    assert factor.deficiency == 3
    assert len(factor.deficient) == 1


def test_information_of_a_kept_key_without_information_is_zero_rows():
    graph = gtsam.GaussianFactorGraph()
    graph.add(1, np.eye(2), 2, -np.eye(2), np.zeros(2), unit(2))
    rows, _ = eliminate_graph(graph, (2,)).information_rows()
    np.testing.assert_array_equal(rows, np.zeros((2, 2)))


def test_a_repeated_key_in_one_factor_adds_up():
    rows = WhitenedRows(
        keys=(4,),
        dims=np.array([1]),
        row_start=np.array([0, 2]),
        columns=np.array([0, 0]),
        entries=np.array([1.0, 2.0]),
        right_hand_side=np.zeros(1),
    )
    assert eliminate(rows, (4,)).covariance([4])[0, 0] == pytest.approx(1 / 9, rel=1e-15)


def test_triangular_keeps_the_information():
    rows = np.random.default_rng(0).normal(size=(9, 4)) * np.logspace(-3, 3, 9)[:, None]
    square = triangular(rows)
    want = np.abs(np.linalg.qr(rows, mode="r"))
    np.testing.assert_allclose(np.abs(square), want, rtol=1e-10)
    assert (np.diag(square) > 0).all()
    np.testing.assert_array_equal(triangular(np.zeros((0, 2))), np.zeros((2, 2)))


def test_constant_column_layout_with_and_without_b():
    graph = gtsam.GaussianFactorGraph()
    graph.add(5, np.array([[0.0, 1.0]]), 3, np.array([[2.0]]), np.array([7.0]), unit(1))
    rows = whitened_rows(graph)
    assert rows.keys == (3, 5)
    assert rows.dims.tolist() == [1, 2]
    assert (rows.columns.tolist(), rows.entries.tolist()) == ([0, 2], [2.0, 1.0])
    assert rows.right_hand_side.tolist() == [7.0]
    assert not rows.entries.flags.writeable
    assert whitened_rows(gtsam.GaussianFactorGraph()).keys == ()


def test_unknown_repeated_and_unkept_keys_are_refused():
    graph = linear_graph(1)
    factor = eliminate_graph(graph, (2,))
    with pytest.raises(UnknownNameError, match="key 77 is not in the graph"):
        factor.covariance([77])
    with pytest.raises(UnknownNameError, match="key 77 is not in the graph"):
        marginal_covariances(factor, [0, 77])
    with pytest.raises(UnknownNameError, match="kept were 2: eliminate again"):
        factor.information_rows([0])
    with pytest.raises(UnknownNameError, match="one twice"):
        factor.information_rows([2, 2])
    with pytest.raises(UnknownNameError, match="key 77 is not"):
        elimination_order(graph, (77,))
    with pytest.raises(InvalidInputError, match="distinct"):
        elimination_order(graph, (1, 1))
    with pytest.raises(InvalidInputError, match="elimination order"):
        eliminate(whitened_rows(graph), (0, 1, 2))
    with pytest.raises(InvalidInputError, match="ending with 0"):
        eliminate(whitened_rows(graph), (0, 1, 2, 3, 4), (0,))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"keys": (4, 3)}, "ascending"),
        ({"row_start": np.array([0, 3])}, "do not agree"),
        ({"columns": np.array([0, 5])}, "beyond the last key"),
        ({"entries": np.array([1.0, np.nan])}, "finite"),
    ],
)
def test_malformed_rows_are_refused(change, word):
    fields = {
        "keys": (3, 4),
        "dims": np.array([1, 1]),
        "row_start": np.array([0, 2]),
        "columns": np.array([0, 1]),
        "entries": np.array([1.0, 2.0]),
        "right_hand_side": np.zeros(1),
    }
    with pytest.raises(InvalidInputError, match=word):
        WhitenedRows(**(fields | change))


UNCOMPILED = """
import sys
sys.path[:0] = {path!r}
import numpy as np
from test_beliefs_square_root import linear_graph
from fgplan.beliefs.elimination import eliminate_graph
from fgplan.beliefs.marginals import marginal_covariances
from fgplan.beliefs.square_root_kernels import triangularise
assert not hasattr(triangularise, "py_func"), "still compiled"
factor = eliminate_graph(linear_graph(2), (4, 0))
np.save({file!r}, np.vstack([factor.covariance([4, 0, 2])[:2], factor.information_rows()[0][:, [0,
    1, 2, 3, 0, 1]], np.hstack([marginal_covariances(factor)[3]] * 3)]))
"""


def test_kernels_give_the_same_without_compilation(tmp_path):
    file = str(tmp_path / "uncompiled.npy")
    here = os.path.dirname(__file__)  # noqa: PTH120
    path = [here, os.path.dirname(os.path.dirname(here))]  # noqa: PTH120
    subprocess.run(
        [sys.executable, "-c", UNCOMPILED.format(path=path, file=file)],
        check=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )
    factor = eliminate_graph(linear_graph(2), (4, 0))
    want = np.vstack(
        [
            factor.covariance([4, 0, 2])[:2],
            factor.information_rows()[0][:, [0, 1, 2, 3, 0, 1]],
            np.hstack([marginal_covariances(factor)[3]] * 3),
        ]
    )
    np.testing.assert_allclose(np.load(file), want, rtol=1e-12)
