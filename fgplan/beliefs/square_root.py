"""The square-root factor R of a linear-Gaussian graph, and what is read from it.

    A = Q R,   information = R'R,   covariance = (R'R)^-1

R comes from elimination by QR (fgplan/beliefs/elimination.py); nothing here is inverted.

The covariance of any keys is Y'Y with R'Y = E, E the unit columns of those keys: a forward
substitution that visits only their ancestors in the elimination tree. The joint marginal of keys
that were eliminated last is what R ends with.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fgplan.checks import frozen
from fgplan.errors import IllPosedBeliefError, UnknownNameError
from fgplan.factors.keys import describe_keys
from fgplan.typing import FloatArray, IntArray, Key

ROUNDING_TOLERANCE = 1e-14
"""A pivot below this part of the largest entry of its column in the graph is rounding."""

RANK_TOLERANCE = 1e-11
"""The same for a dense QR that has no second test (fgplan/beliefs/from_scratch.py): cautious."""

SINGULAR_DISTANCE = 1e-13
"""A variable is not determined if changing every entry by this part could make it so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SquareRootFactor:
    """R of an eliminated graph, by block rows in elimination order.

    Attributes:
        keys: Every variable, in elimination order, n of them.
        dims: Tangent dimension of each, same order, shape (n,).
        kept: The last keys of the order: those whose joint marginal R ends with.
        deficient: Keys that elimination found not determined, in elimination order.
        deficiency: How many directions in all are not determined.
        parent: Position of each variable's parent in the elimination tree, -1 for a root.
        separator_start: Shape (n + 1,), into ``separators``.
        separators: Positions of the later variables that a block row touches, ascending.
        value_start: Shape (n + 1,), into ``values``.
        values: Block rows [R S], each row-major of shape (d, d + separator), diagonal >= 0.
        position: Place of each key in the order.
        remembered: Rows that were last asked for, by keys: all robots of a team ask for the same.
            A memory that may be cleared at any time without changing a result.
    """

    keys: tuple[Key, ...]
    dims: IntArray
    kept: tuple[Key, ...]
    deficient: tuple[Key, ...]
    deficiency: int
    parent: IntArray
    separator_start: IntArray
    separators: IntArray
    value_start: IntArray
    values: FloatArray
    position: dict[Key, int]
    remembered: dict[tuple[Key, ...], FloatArray] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for array in (self.dims, self.parent, self.separator_start, self.separators):
            array.setflags(write=False)
        self.value_start.setflags(write=False)
        self.values.setflags(write=False)

    def block_row(self, key: Key) -> tuple[FloatArray, tuple[Key, ...]]:
        """Conditional of one variable: [R S] of shape (d, d + s), and the keys of S in order."""
        place = self._positions([key])[0]
        dim = int(self.dims[place])
        row = self.values[self.value_start[place] : self.value_start[place + 1]].reshape(dim, -1)
        others = self.separators[self.separator_start[place] : self.separator_start[place + 1]]
        return row, tuple(self.keys[other] for other in others)

    def information_rows(self, keys: Sequence[Key] | None = None) -> tuple[FloatArray, IntArray]:
        """Square-root information of the joint marginal of kept keys: what QR left on them.

        Args:
            keys: Kept keys in the order wanted for the columns; None for all, as kept.

        Returns:
            Upper triangular rows of shape (d, d), R'R = the marginal's information, unitless rows
            by tangent units; a direction without information is a row of zeros. And the dimension
            of each key.

        Raises:
            UnknownNameError: If a key was not kept.
        """
        wanted = self.kept if keys is None else tuple(keys)
        if wanted in self.remembered:
            return self.remembered[wanted], self._dims_of(wanted)
        unkept = [key for key in wanted if key not in set(self.kept)]
        if unkept or len(set(wanted)) != len(wanted):
            raise UnknownNameError(
                f"square-root information of {describe_keys(wanted)}: expected distinct kept keys, "
                f"got {describe_keys(unkept) or 'one twice'}; kept were "
                f"{describe_keys(self.kept) or 'none'}: eliminate again with those keys kept"
            )
        rest = [key for key in self.kept if key not in set(wanted)]
        columns = (*rest, *wanted)
        dense = self._kept_rows(columns)
        if columns != self.kept:
            dense = triangular(dense)
        first = int(sum(self._dims_of(rest)))
        self.remembered.clear()
        self.remembered[wanted] = frozen(dense[first:, first:])
        return self.remembered[wanted], self._dims_of(wanted)

    def covariance(self, rows: Sequence[Key], columns: Sequence[Key] | None = None) -> FloatArray:
        """Joint marginal covariance of keys, or the block between two lists of keys.

        Args:
            rows: Keys, in the order wanted; any key of the graph, kept or not.
            columns: Keys of the columns; None for the same as ``rows``.

        Returns:
            Shape (sum of dims of rows, sum of dims of columns), tangent units; symmetric when
            ``columns`` is None.

        Raises:
            UnknownNameError: If a key is not in the graph.
            IllPosedBeliefError: If elimination found a variable that is not determined.
        """
        self.check_determined()
        joint = [*rows, *(() if columns is None else columns)]
        solution = self._solve_transposed(self._positions(joint))
        if columns is None:
            return frozen(solution.T @ solution)
        split = int(sum(self._dims_of(rows)))
        return frozen(solution[:, :split].T @ solution[:, split:])

    def check_determined(self) -> None:
        """Raise if a variable is not determined.

        Raises:
            IllPosedBeliefError: Naming the variables.
        """
        if self.deficient:
            raise IllPosedBeliefError(
                f"{self.deficiency} direction(s) not determined by the factors, found at "
                f"{describe_keys(self.deficient)}: changing every entry of the graph by a part in "
                f"{1 / SINGULAR_DISTANCE:.0e} would make them free; add the missing factor"
            )

    def _positions(self, keys: Sequence[Key]) -> IntArray:
        """Places of keys in the order."""
        missing = [key for key in keys if key not in self.position]
        if missing:
            raise UnknownNameError(f"key {describe_keys(missing)} is not in the graph")
        return np.array([self.position[key] for key in keys], dtype=np.int64)

    def _dims_of(self, keys: Sequence[Key]) -> IntArray:
        """Dimensions of keys."""
        return self.dims[self._positions(keys)]

    def _solve_transposed(self, positions: IntArray) -> FloatArray:
        """R^-T E, rows of ancestors only."""
        from fgplan.beliefs.marginal_kernels import solve_transposed

        return solve_transposed(
            self.dims,
            self.parent,
            self.separator_start,
            self.separators,
            self.value_start,
            self.values,
            positions,
        )

    def _kept_rows(self, columns: Sequence[Key]) -> FloatArray:
        """Dense block rows of the kept keys, columns in the order given."""
        from fgplan.beliefs.square_root_kernels import fill_block_rows

        dims = self._dims_of(columns)
        start = np.full(len(self.keys), -1, np.int64)
        start[self._positions(columns)] = np.cumsum(dims) - dims
        dense = np.zeros((int(dims.sum()), int(dims.sum())))
        fill_block_rows(
            self._positions(self.kept),
            self.dims,
            self.separator_start,
            self.separators,
            self.value_start,
            self.values,
            start,
            dense,
        )
        return dense


def triangular(rows: FloatArray) -> FloatArray:
    """Reflect dense rows, shape (m, n), to square upper triangular (n, n), diagonal >= 0."""
    from fgplan.beliefs.square_root_kernels import triangularise

    work = np.array(rows, dtype=np.float64, order="C")
    limits = ROUNDING_TOLERANCE * np.abs(work).max(axis=0, initial=0.0)
    pivot = triangularise(work, limits)
    square = np.zeros((work.shape[1], work.shape[1]))
    has_pivot = pivot >= 0
    square[has_pivot] = work[pivot[has_pivot]]
    return np.triu(square)
