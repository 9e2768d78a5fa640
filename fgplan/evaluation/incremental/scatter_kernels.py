"""Compiled: information blocks added into one matrix."""

from fgplan.compiling import njit
from fgplan.typing import FloatArray, IntArray


@njit(cache=True)
def scatter(
    information: FloatArray,
    row_variable: IntArray,
    column_variable: IntArray,
    needed: IntArray,
    blocks: FloatArray,
    column: IntArray,
    width: IntArray,
) -> None:
    """Add blocks to the lower and upper triangle of an information matrix.

    Args:
        information: Shape (s, s), in and out.
        row_variable: Shape (B,), variable of each block's rows.
        column_variable: Shape (B,), variable of its columns; the same for a diagonal block.
        needed: Shape (B,), a third variable of the factor; the block is left out with it.
        blocks: Shape (B, d, d), rows and columns beyond a variable's dimension are not read.
        column: Shape (V,), first scalar of each variable, or -1 where it is left out.
        width: Shape (V,), dimension of each variable.
    """
    for b in range(blocks.shape[0]):
        r, c = column[row_variable[b]], column[column_variable[b]]
        if r < 0 or c < 0 or column[needed[b]] < 0:
            continue
        for i in range(width[row_variable[b]]):
            for j in range(width[column_variable[b]]):
                value = blocks[b, i, j]
                information[r + i, c + j] += value
                if r != c:
                    information[c + j, r + i] += value


@njit(cache=True)
def mirror_upper(matrix: FloatArray) -> None:
    """Copy the upper triangle of a square matrix to the lower, in place, tile by tile."""
    size = matrix.shape[0]
    tile = 32
    for top in range(0, size, tile):
        for left in range(top, size, tile):
            for i in range(top, min(top + tile, size)):
                for j in range(max(left, i + 1), min(left + tile, size)):
                    matrix[j, i] = matrix[i, j]
