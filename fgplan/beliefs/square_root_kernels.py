"""The inner loops of square-root elimination; imported on first use only, because numba is slow.

Every function is plain Python over arrays and gives the same numbers with NUMBA_DISABLE_JIT=1.
Arrays are copied element by element: assigning one to a slice of another takes seconds to compile,
for the text of its error. Positions are places in the elimination order; a *front* is the dense
matrix of one variable: its d columns first, then the columns of its separator (the later variables
that its rows touch).
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.typing import FloatArray, IntArray


@njit(cache=True)
def find_separators(
    row_start: IntArray, entry_start: IntArray, entry_position: IntArray, count: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Symbolic elimination: parent, start and positions of every separator, in no order.

    Rows ``row_start[p]:row_start[p + 1]`` are those whose first variable is p; row r touches the
    positions ``entry_position[entry_start[r]:entry_start[r + 1]]``.
    """
    parent = np.full(count, -1, np.int64)
    first_child = np.full(count, -1, np.int64)
    next_sibling = np.full(count, -1, np.int64)
    mark = np.full(count, -1, np.int64)
    start = np.zeros(count + 1, np.int64)
    found = np.empty(4 * count + 16, np.int64)
    size = 0
    for position in range(count):
        begin = size
        above = count
        mark[position] = position
        if size + count > found.size:
            grown = np.empty(2 * found.size + count, np.int64)
            for place in range(size):
                grown[place] = found[place]
            found = grown
        for entry in range(entry_start[row_start[position]], entry_start[row_start[position + 1]]):
            other = entry_position[entry]
            if mark[other] != position:
                mark[other] = position
                found[size] = other
                size += 1
                above = min(above, other)
        child = first_child[position]
        while child >= 0:
            for place in range(start[child], start[child + 1]):
                other = found[place]
                if mark[other] != position:
                    mark[other] = position
                    found[size] = other
                    size += 1
                    above = min(above, other)
            child = next_sibling[child]
        start[position + 1] = size
        if size > begin:
            parent[position] = above
            next_sibling[position] = first_child[above]
            first_child[above] = position
    return parent, start, found[:size].copy()


@njit(cache=True, fastmath={"contract"})
def triangularise(work: FloatArray, tolerance: FloatArray) -> IntArray:
    """Reflect a dense matrix to upper triangular in place; row of each column's pivot, or -1.

    In each column only the rows that begin there are reflected, so zeros below a staircase cost
    nothing. The row with the largest entry leads the reflection (then |u| <= 1/2 for the others
    and small rows only ever have small multiples subtracted). A column whose norm falls below
    ``tolerance`` has no pivot: what is left in it is rounding and is set to zero.
    """
    height, width = work.shape
    pivot = np.full(width, -1, np.int64)
    head = np.full(width + 1, -1, np.int64)
    following = np.full(height, -1, np.int64)
    weights = np.empty(width)
    for row in range(height - 1, -1, -1):
        lead = 0
        while lead < width and work[row, lead] == 0.0:
            lead += 1
        following[row] = head[lead]
        head[lead] = row
    for column in range(width):
        best, largest = -1, 0.0
        row = head[column]
        while row >= 0:
            size = abs(work[row, column])
            if size > largest:
                best, largest = row, size
            row = following[row]
        if best < 0:
            continue
        total = 0.0
        row = head[column]
        while row >= 0:
            ratio = work[row, column] / largest
            total += ratio * ratio
            row = following[row]
        norm = largest * np.sqrt(total)
        has_pivot = norm > tolerance[column]
        row = head[column]
        if has_pivot and following[row] >= 0:
            alpha = -norm if work[best, column] > 0.0 else norm
            leading = work[best, column] - alpha
            gain = 1.0 - work[best, column] / alpha
            for other in range(column + 1, width):
                weights[other] = work[best, other]
            while row >= 0:
                if row != best:
                    values = work[row]
                    share = values[column] / leading
                    for other in range(column + 1, width):
                        weights[other] += share * values[other]
                row = following[row]
            values = work[best]
            for other in range(column + 1, width):
                weights[other] *= gain
                values[other] -= weights[other]
            row = head[column]
            while row >= 0:
                if row != best:
                    values = work[row]
                    share = values[column] / leading
                    for other in range(column + 1, width):
                        values[other] -= share * weights[other]
                row = following[row]
            work[best, column] = alpha
        row = head[column]
        while row >= 0:
            after = following[row]
            if not has_pivot or row != best:
                work[row, column] = 0.0
                lead = column + 1
                while lead < width and work[row, lead] == 0.0:
                    lead += 1
                following[row] = head[lead]
                head[lead] = row
            row = after
        if has_pivot:
            pivot[column] = best
            if work[best, column] < 0.0:
                for other in range(column, width):
                    work[best, other] = -work[best, other]
    return pivot


@njit(cache=True)
def eliminate_rows(
    dims: IntArray,
    row_start: IntArray,
    entry_start: IntArray,
    entry_position: IntArray,
    entry_offset: IntArray,
    entry_value: FloatArray,
    parent: IntArray,
    separator_start: IntArray,
    separators: IntArray,
    tolerance: FloatArray,
) -> tuple[IntArray, FloatArray, IntArray]:
    """Numeric elimination: start and values of the block rows [R S], deficient scalars a position.

    ``entry_offset`` is the scalar within the variable; ``tolerance`` is by scalar in elimination
    order.
    """
    count = dims.size
    value_start = np.zeros(count + 1, np.int64)
    scalar_start = np.zeros(count + 1, np.int64)
    for position in range(count):
        width = dims[position]
        for place in range(separator_start[position], separator_start[position + 1]):
            width += dims[separators[place]]
        value_start[position + 1] = value_start[position] + dims[position] * width
        scalar_start[position + 1] = scalar_start[position] + dims[position]
    values = np.zeros(value_start[count])
    deficient = np.zeros(count, np.int64)
    remainders = [np.empty((0, 0)) for _ in range(count)]
    first_child = np.full(count, -1, np.int64)
    next_sibling = np.full(count, -1, np.int64)
    column_of = np.zeros(count, np.int64)
    for position in range(count):
        dim = dims[position]
        width = (value_start[position + 1] - value_start[position]) // max(dim, 1)
        column_of[position] = 0
        column = dim
        for place in range(separator_start[position], separator_start[position + 1]):
            column_of[separators[place]] = column
            column += dims[separators[place]]
        height = row_start[position + 1] - row_start[position]
        child = first_child[position]
        while child >= 0:
            height += remainders[child].shape[0]
            child = next_sibling[child]
        work = np.zeros((height, width))
        filled = 0
        for row in range(row_start[position], row_start[position + 1]):
            for entry in range(entry_start[row], entry_start[row + 1]):
                column = column_of[entry_position[entry]] + entry_offset[entry]
                work[filled, column] += entry_value[entry]
            filled += 1
        child = first_child[position]
        while child >= 0:
            passed = remainders[child]
            for row in range(passed.shape[0]):
                source = 0
                for place in range(separator_start[child], separator_start[child + 1]):
                    target = column_of[separators[place]]
                    for scalar in range(dims[separators[place]]):
                        work[filled, target + scalar] = passed[row, source]
                        source += 1
                filled += 1
            remainders[child] = np.empty((0, 0))
            child = next_sibling[child]
        limits = np.zeros(width)
        for scalar in range(dim):
            limits[scalar] = tolerance[scalar_start[position] + scalar]
        pivot = triangularise(work, limits)
        for scalar in range(dim):
            row = pivot[scalar]
            if row < 0:
                deficient[position] += 1
                continue
            target = value_start[position] + scalar * width
            for column in range(scalar, width):
                values[target + column] = work[row, column]
        kept = 0
        for column in range(dim, width):
            if pivot[column] >= 0:
                kept += 1
        if kept > 0:
            passed = np.zeros((kept, width - dim))
            kept = 0
            for column in range(dim, width):
                row = pivot[column]
                if row >= 0:
                    for other in range(column, width):
                        passed[kept, other - dim] = work[row, other]
                    kept += 1
            remainders[position] = passed
            above = parent[position]
            next_sibling[position] = first_child[above]
            first_child[above] = position
    return value_start, values, deficient


@njit(cache=True)
def fill_block_rows(
    positions: IntArray,
    dims: IntArray,
    separator_start: IntArray,
    separators: IntArray,
    value_start: IntArray,
    values: FloatArray,
    start: IntArray,
    dense: FloatArray,
) -> None:
    """Write the block rows of some variables into a dense matrix, one below the other.

    Args:
        positions: Positions of the variables.
        dims: Tangent dimension of every variable.
        separator_start: Shape (n + 1,), into ``separators``.
        separators: Positions of the later variables that a block row touches.
        value_start: Shape (n + 1,), into ``values``.
        values: Block rows [R S], each row-major.
        start: First column of every variable in the matrix.
        dense: Out: the matrix, zero before.
    """
    filled = 0
    for place in positions:
        dim = dims[place]
        first, last = separator_start[place], separator_start[place + 1]
        width = (value_start[place + 1] - value_start[place]) // dim
        for r in range(dim):
            at = value_start[place] + r * width
            for b in range(dim):
                dense[filled + r, start[place] + b] = values[at]
                at += 1
            for s in range(first, last):
                other = separators[s]
                for b in range(dims[other]):
                    dense[filled + r, start[other] + b] = values[at]
                    at += 1
        filled += dim
