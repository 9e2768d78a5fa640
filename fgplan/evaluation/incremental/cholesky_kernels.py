"""Compiled: Cholesky factors of full matrices and of those with a skyline."""

import numpy as np
from numpy.typing import NDArray

from fgplan.compiling import njit
from fgplan.typing import FloatArray, IntArray


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
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


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
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


@njit(cache=True, inner=True)
def cholesky(matrix: FloatArray) -> tuple[bool, NDArray[np.floating]]:
    """Cholesky factor by LAPACK, which is as fast as a loop where small and faster where large.

    Args:
        matrix: Shape (n, n), symmetric; only the lower triangle is read.

    Returns:
        Whether all pivots are positive, and the lower factor; an empty one where they are not.
    """
    try:
        factor = np.linalg.cholesky(matrix)
    except Exception:  # noqa: BLE001 - compiled code knows no narrower class
        return False, np.zeros((0, 0)).T
    return True, factor
