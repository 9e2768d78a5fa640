"""Compiled: Cholesky factors in place, by rows; blocked with matrix products where it pays."""

import numpy as np
from numba import njit

from fgplan.typing import FloatArray

BLOCK = 32
"""Rows of one block; below twice this many rows the plain loop is as fast."""


@njit(cache=True, fastmath={"reassoc", "contract"})
def cholesky_rows(matrix: FloatArray, start: int, stop: int, first: int) -> bool:
    """Factor rows ``start`` to ``stop`` of a lower triangle in place, columns from ``first``.

    Columns before ``first`` have been accounted for. False where a pivot is not positive.
    """
    for j in range(start, stop):
        row_j = matrix[j]
        for i in range(first, j):
            row_i = matrix[i]
            total = row_j[i]
            for k in range(first, i):
                total -= row_j[k] * row_i[k]
            row_j[i] = total / row_i[i]
        total = row_j[j]
        for k in range(first, j):
            total -= row_j[k] * row_j[k]
        if not total > 0.0:
            return False
        row_j[j] = np.sqrt(total)
    return True


@njit(cache=True, fastmath={"reassoc", "contract"})
def cholesky(matrix: FloatArray, size: int) -> bool:
    """Cholesky factor of the leading ``size`` rows, lower triangle in place.

    Args:
        matrix: Shape (n, n), symmetric, n >= size; only the lower triangle is read and written.
        size: Rows to factor.

    Returns:
        False where a pivot is not positive; the matrix is then of no use.
    """
    if size < 2 * BLOCK:
        return cholesky_rows(matrix, 0, size, 0)
    begin = 0
    while begin < size:
        end = min(begin + BLOCK, size)
        if not cholesky_rows(matrix, begin, end, begin):
            return False
        if end < size:
            panel = np.empty((size - end, end - begin))
            for r in range(end, size):
                row = matrix[r]
                for i in range(begin, end):
                    total = row[i]
                    row_i = matrix[i]
                    for k in range(begin, i):
                        total -= row[k] * row_i[k]
                    row[i] = total / row_i[i]
                    panel[r - end, i - begin] = row[i]
            update = np.dot(panel, panel.T)
            for r in range(end, size):
                row = matrix[r]
                for c in range(end, r + 1):
                    row[c] -= update[r - end, c - end]
        begin = end
    return True
