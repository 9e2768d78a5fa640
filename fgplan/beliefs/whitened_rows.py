"""A linear-Gaussian graph as whitened rows: |A x - b|^2 with the noise folded into A.

One sparse matrix by compressed rows; columns are the keys in ascending order, each with its
tangent's dimension. GTSAM hands all rows over in one call (``sparseJacobian_``): 1-based triplets,
columns in ascending order of keys, b last. A column of zeros has no triplet, so dimensions are
asked for separately; entries below 1e-12 are left out by GTSAM itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np

from fgplan.checks import frozen
from fgplan.errors import InvalidInputError
from fgplan.factors.boundary import gtsam_boundary
from fgplan.typing import FloatArray, IntArray, Key


@dataclass(frozen=True, slots=True, kw_only=True)
class WhitenedRows:
    """Rows of a linear-Gaussian graph.

    Attributes:
        keys: Variables in ascending order, n of them.
        dims: Tangent dimension of each, shape (n,).
        row_start: Shape (m + 1,): row r holds the entries row_start[r] to row_start[r + 1].
        columns: Scalar column of each entry, ascending within a row.
        entries: Value of each entry, unitless.
        right_hand_side: b, shape (m,), unitless; covariances do not depend on it.
    """

    keys: tuple[Key, ...]
    dims: IntArray
    row_start: IntArray
    columns: IntArray
    entries: FloatArray
    right_hand_side: FloatArray

    def __post_init__(self) -> None:
        """Check the layout and that every number is finite; hold read-only copies."""
        if list(self.keys) != sorted(set(self.keys)) or len(self.keys) != self.dims.size:
            raise InvalidInputError("whitened rows: expected ascending keys, each with a dimension")
        if self.row_start[-1] != self.entries.size or self.columns.size != self.entries.size:
            raise InvalidInputError("whitened rows: row_start, columns and entries do not agree")
        if self.columns.size and int(self.columns.max()) >= int(self.dims.sum()):
            raise InvalidInputError("whitened rows: a column lies beyond the last key's")
        if not (np.isfinite(self.entries).all() and np.isfinite(self.right_hand_side).all()):
            raise InvalidInputError(
                "whitened rows: expected finite numbers, got NaN or inf; check the noise models "
                "and measurements (fgplan.beliefs.belief.Belief names the factor)"
            )
        for name in ("dims", "row_start", "columns"):
            array = np.array(getattr(self, name), dtype=np.int64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        for name in ("entries", "right_hand_side"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def whitened_rows(
    graph: gtsam.GaussianFactorGraph, dims: Mapping[Key, int] | None = None
) -> WhitenedRows:
    """Take all rows of a linear graph at once.

    Args:
        graph: The linear graph.
        dims: Tangent dimension of every key, if known; else asked of the graph.

    Returns:
        The rows; those that are entirely zero at the end of the graph are left out.

    Raises:
        InvalidInputError: If a row is not finite, or GTSAM refuses the graph.
    """
    with gtsam_boundary("reading the rows of a linear graph"):
        keys = tuple(graph.keyVector())
        if dims is None:
            zero = graph.gradientAtZero()
            dims = {key: zero.at(key).size for key in keys}
        triplets = graph.sparseJacobian_() if keys else np.zeros((3, 0))
    keys = tuple(sorted(keys))
    sizes = np.array([dims[key] for key in keys], dtype=np.int64)
    total = int(sizes.sum())
    rows = triplets[0].astype(np.int64) - 1
    columns = triplets[1].astype(np.int64) - 1
    order = np.lexsort((columns, rows))
    rows, columns, entries = rows[order], columns[order], triplets[2][order]
    height = int(rows[-1]) + 1 if rows.size else 0
    right = columns == total
    right_hand_side = np.zeros(height)
    right_hand_side[rows[right]] = entries[right]
    rows, columns, entries = rows[~right], columns[~right], entries[~right]
    row_start = np.zeros(height + 1, dtype=np.int64)
    np.cumsum(np.bincount(rows, minlength=height), out=row_start[1:])
    return WhitenedRows(
        keys=keys,
        dims=sizes,
        row_start=row_start,
        columns=columns,
        entries=entries,
        right_hand_side=right_hand_side,
    )
