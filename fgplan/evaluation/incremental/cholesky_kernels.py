"""Compiled: Cholesky factors in place, by rows where small and by LAPACK where large."""

import numpy as np
from numba import njit

from fgplan.typing import FloatArray, IntArray

SMALL = 48
"""Up to this many rows the plain loop is as fast as LAPACK."""


@njit(cache=True, fastmath={"reassoc", "contract"})
def cholesky_rows(matrix: FloatArray, size: int) -> bool:
    """Cholesky factor of the leading rows, by rows; see ``cholesky``."""
    for j in range(size):
        row_j = matrix[j]
        for i in range(j):
            row_i = matrix[i]
            total = row_j[i]
            for k in range(i):
                total -= row_j[k] * row_i[k]
            row_j[i] = total / row_i[i]
        total = row_j[j]
        for k in range(j):
            total -= row_j[k] * row_j[k]
        if not total > 0.0:
            return False
        row_j[j] = np.sqrt(total)
    return True


@njit(cache=True, fastmath={"reassoc", "contract"})
def cholesky_skyline(matrix: FloatArray, first: IntArray) -> bool:
    """Cholesky factor, lower triangle in place, of a matrix with zeros before a column in each row.

    Args:
        matrix: Shape (n, n), symmetric; only the lower triangle is read and written.
        first: Shape (n,), first column of each row that may be other than zero.

    Returns:
        False where a pivot is not positive; the matrix is then of no use.
    """
    for j in range(matrix.shape[0]):
        row_j = matrix[j]
        for i in range(first[j], j):
            row_i = matrix[i]
            total = row_j[i]
            for k in range(max(first[i], first[j]), i):
                total -= row_j[k] * row_i[k]
            row_j[i] = total / row_i[i]
        total = row_j[j]
        for k in range(first[j], j):
            total -= row_j[k] * row_j[k]
        if not total > 0.0:
            return False
        row_j[j] = np.sqrt(total)
    return True


@njit(cache=True, fastmath={"reassoc", "contract"})
def inverse_skyline(lower: FloatArray, first: IntArray) -> FloatArray:
    """Inverse of a lower triangle with zeros before a column in each row; shape (n, n)."""
    size = lower.shape[0]
    inverse = np.zeros((size, size))
    for i in range(size):
        row = inverse[i]
        scale = 1.0 / lower[i, i]
        for k in range(first[i], i):
            weight = -lower[i, k] * scale
            above = inverse[k]
            for j in range(k + 1):
                row[j] += weight * above[j]
        row[i] = scale
    return inverse


@njit(cache=True)
def cholesky(matrix: FloatArray, size: int) -> bool:
    """Cholesky factor of the leading ``size`` rows, lower triangle in place.

    Args:
        matrix: Shape (n, n), symmetric, n >= size; only the lower triangle is read and written.
        size: Rows to factor.

    Returns:
        False where a pivot is not positive; the matrix is then of no use.
    """
    if size <= SMALL:
        return cholesky_rows(matrix, size)
    try:
        factor = np.linalg.cholesky(np.ascontiguousarray(matrix[:size, :size]))
    except Exception:  # noqa: BLE001 - compiled code knows no narrower class
        return False
    for i in range(size):
        matrix[i, : i + 1] = factor[i, : i + 1]
    return True
