"""Elimination of a linear-Gaussian graph, variable by variable, by Householder QR.

    A = Q R,   information = R'R

A'A is never formed: Cholesky squares the condition, and GTSAM's own elimination is wrong by 1e-4
on a chain of 10,000 poses, where its Marginals throws. For each variable, in the order given: its
rows and what its children in the elimination tree left are stacked into a dense front, the front
is reflected to upper triangular, the first rows [R S] are the variable's conditional, the others
(never more than columns) pass to the first variable of the separator.

Rows of very different scale (sigma 1e-6 m beside 1e3 m): in each column only the rows that begin
there are reflected, and the row with the largest entry leads. The others are changed by at most
half of the leading row's part that they share, so a weak row is not drowned in the rounding of a
strong one; sorting rows once at the start would not survive the mixing of fronts.

Rank. A pivot below ROUNDING_TOLERANCE of the largest entry that the graph has in its column is
rounding: no pivot. Larger pivots may be rounding too, in large graphs with long levers, so every
suspicious one is tested: with R n = 0 but for that pivot, where n = 1, the pivot is |A n|, and

    pivot / | |A| |n| |    (about 3e-16 on Victoria Park without a prior)

is the relative change of the entries of A that would leave n without any information. Below
SINGULAR_DISTANCE the variable counts as not determined, and elimination is repeated with that
column held to have no pivot. Its key is reported.
"""

from collections.abc import Sequence
from typing import NamedTuple

import gtsam
import numpy as np

from fgplan.beliefs.square_root import ROUNDING_TOLERANCE, SINGULAR_DISTANCE, SquareRootFactor
from fgplan.beliefs.whitened_rows import WhitenedRows, whitened_rows
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.factors.boundary import gtsam_boundary
from fgplan.factors.keys import describe_keys
from fgplan.typing import FloatArray, IntArray, Key

_SUSPICIOUS = 1e-5
"""Pivots below this part of their column's largest entry are tested, the smallest first."""

_TESTED = 24
"""At most so many pivots are tested."""


def elimination_order(
    graph: gtsam.GaussianFactorGraph, kept: Sequence[Key] = ()
) -> tuple[Key, ...]:
    """COLAMD order of a linear graph with the kept keys last, in the order given.

    Raises:
        InvalidInputError: If a key is kept twice.
        UnknownNameError: If a kept key is not in the graph.
    """
    if len(set(kept)) != len(kept):
        raise InvalidInputError(f"kept keys: expected distinct keys, got {describe_keys(kept)}")
    present = set(graph.keyVector())
    missing = [key for key in kept if key not in present]
    if missing:
        raise UnknownNameError(f"key {describe_keys(missing)} is not in the graph")
    with gtsam_boundary("ordering the variables"):
        if kept:
            order = gtsam.Ordering.ColamdConstrainedLastGaussianFactorGraph(graph, list(kept))
        else:
            order = gtsam.Ordering.ColamdGaussianFactorGraph(graph)
        keys = [order.at(place) for place in range(order.size())]
    last = set(kept)
    return (*(key for key in keys if key not in last), *kept)


def eliminate_graph(graph: gtsam.GaussianFactorGraph, kept: Sequence[Key] = ()) -> SquareRootFactor:
    """Eliminate a linear graph by QR with some keys last.

    Args:
        graph: The linear graph, noise of any Gaussian kind.
        kept: Keys to eliminate last, in this order.

    Returns:
        The factor R; variables that are not determined are reported in it, not raised.

    Raises:
        InvalidInputError: If a row is not finite or a key is kept twice.
        UnknownNameError: If a kept key is not in the graph.
    """
    return eliminate(whitened_rows(graph), elimination_order(graph, kept), kept)


def eliminate(
    rows: WhitenedRows, order: Sequence[Key], kept: Sequence[Key] = ()
) -> SquareRootFactor:
    """Eliminate whitened rows by QR in a given order.

    Args:
        rows: Whitened rows over n keys.
        order: All n keys; the last are the kept ones.
        kept: The keys at the end of ``order`` whose joint marginal is wanted.

    Returns:
        The factor R; variables that are not determined are reported in it, not raised.

    Raises:
        InvalidInputError: If the order is not one of all keys with the kept ones last.
    """
    order, kept = tuple(order), tuple(kept)
    if sorted(order) != list(rows.keys) or order[len(order) - len(kept) :] != kept:
        raise InvalidInputError(
            f"elimination order: expected each of the {len(rows.keys)} keys once, ending with "
            f"{describe_keys(kept) or 'any'}; got {len(order)} keys"
        )
    from fgplan.beliefs.square_root_kernels import eliminate_rows, find_separators

    position = {key: place for place, key in enumerate(order)}
    place_of = np.array([position[key] for key in rows.keys], dtype=np.int64)
    dims = np.zeros(len(order), dtype=np.int64)
    dims[place_of] = rows.dims
    first_scalar = np.cumsum(rows.dims) - rows.dims
    column_key = np.repeat(np.arange(len(order)), rows.dims)
    offsets = np.arange(int(rows.dims.sum())) - first_scalar[column_key]
    largest = np.zeros(int(rows.dims.sum()))
    np.maximum.at(largest, rows.columns, np.abs(rows.entries))
    scalar_start = np.cumsum(dims) - dims
    place_of_scalar = scalar_start[place_of[column_key]] + offsets
    scale = np.empty_like(largest)
    scale[place_of_scalar] = largest
    tolerance = ROUNDING_TOLERANCE * scale

    # Rows sorted by the first of their variables in the order; rows of zeros say nothing.
    entry_place = place_of[column_key[rows.columns]]
    lengths = np.diff(rows.row_start)
    filled = np.flatnonzero(lengths)
    first = np.zeros(0, dtype=np.int64)
    if filled.size:
        first = np.minimum.reduceat(entry_place, rows.row_start[filled])
    by_first = np.argsort(first, kind="stable")
    filled = filled[by_first]
    row_start = np.searchsorted(first[by_first], np.arange(len(order) + 1)).astype(np.int64)
    entry_start = np.zeros(filled.size + 1, dtype=np.int64)
    np.cumsum(lengths[filled], out=entry_start[1:])
    shift = np.repeat(rows.row_start[filled] - entry_start[:-1], lengths[filled])
    taken = np.arange(int(entry_start[-1])) + shift
    entry_place = entry_place[taken]

    parent, separator_start, separators = find_separators(
        row_start, entry_start, entry_place, len(order)
    )
    owner = np.repeat(np.arange(len(order)), np.diff(separator_start))
    separators = separators[np.lexsort((separators, owner))]
    while True:
        value_start, values, deficient = eliminate_rows(
            dims,
            row_start,
            entry_start,
            entry_place,
            offsets[rows.columns[taken]],
            rows.entries[taken],
            parent,
            separator_start,
            separators,
            tolerance,
        )
        blocks = _Blocks(dims, separator_start, separators, value_start, values)
        free = _first_free_scalar(blocks, scale, rows, place_of_scalar)
        if free is None:
            break
        tolerance[free] = np.inf
    return SquareRootFactor(
        keys=order,
        dims=dims,
        kept=kept,
        deficient=tuple(order[place] for place in np.flatnonzero(deficient)),
        deficiency=int(deficient.sum()),
        parent=parent,
        separator_start=separator_start,
        separators=separators,
        value_start=value_start,
        values=values,
        position=position,
    )


class _Blocks(NamedTuple):
    """Block rows of R as the kernels take them."""

    dims: IntArray
    separator_start: IntArray
    separators: IntArray
    value_start: IntArray
    values: FloatArray


def _first_free_scalar(
    blocks: _Blocks, scale: FloatArray, rows: WhitenedRows, place_of_scalar: IntArray
) -> int | None:
    """First scalar in elimination order whose pivot is indistinguishable from zero."""
    from fgplan.beliefs.marginal_kernels import null_direction

    dims = blocks.dims
    position = np.repeat(np.arange(dims.size), dims)
    scalar = np.arange(position.size) - np.repeat(np.cumsum(dims) - dims, dims)
    width = np.diff(blocks.value_start) // np.maximum(dims, 1)
    pivots = blocks.values[blocks.value_start[position] + scalar * (width[position] + 1)]
    suspicious = np.flatnonzero((pivots > 0.0) & (pivots < _SUSPICIOUS * scale))
    worst = np.argsort(pivots[suspicious] / scale[suspicious], kind="stable")[:_TESTED]
    row_of_entry = np.repeat(np.arange(rows.right_hand_side.size), np.diff(rows.row_start))
    for place in np.sort(suspicious[worst]):
        direction = null_direction(*blocks, position[place], scalar[place])
        terms = np.abs(rows.entries * direction[place_of_scalar[rows.columns]])
        sums = np.bincount(row_of_entry, terms)
        if pivots[place] < SINGULAR_DISTANCE * float(np.linalg.norm(sums)):
            return int(place)
    return None
