"""The inner loops of square-root elimination; imported on first use only, because numba is slow.

Every function is plain Python over arrays and gives the same numbers with NUMBA_DISABLE_JIT=1.
Positions are places in the elimination order; a *front* is the dense matrix of one variable:
its d columns first, then the columns of its separator (the later variables that its rows touch).
"""

import numpy as np
from numba import njit

from fgplan.typing import FloatArray, IntArray


@njit(cache=True)
def find_separators(
    row_start: IntArray, entry_start: IntArray, entry_position: IntArray, count: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Symbolic elimination: parent, start and positions of every separator, ascending.

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
        mark[position] = position
        if size + count > found.size:
            grown = np.empty(2 * found.size + count, np.int64)
            grown[:size] = found[:size]
            found = grown
        for entry in range(entry_start[row_start[position]], entry_start[row_start[position + 1]]):
            other = entry_position[entry]
            if mark[other] != position:
                mark[other] = position
                found[size] = other
                size += 1
        child = first_child[position]
        while child >= 0:
            for place in range(start[child], start[child + 1]):
                other = found[place]
                if mark[other] != position:
                    mark[other] = position
                    found[size] = other
                    size += 1
            child = next_sibling[child]
        found[begin:size] = np.sort(found[begin:size])
        start[position + 1] = size
        if size > begin:
            above = found[begin]
            parent[position] = above
            next_sibling[position] = first_child[above]
            first_child[above] = position
    return parent, start, found[:size].copy()


@njit(cache=True)
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
                    share = work[row, column] / leading
                    for other in range(column + 1, width):
                        weights[other] += share * work[row, other]
                row = following[row]
            for other in range(column + 1, width):
                weights[other] *= gain
                work[best, other] -= weights[other]
            row = head[column]
            while row >= 0:
                if row != best:
                    share = work[row, column] / leading
                    for other in range(column + 1, width):
                        work[row, other] -= share * weights[other]
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
def solve_transposed(
    dims: IntArray,
    parent: IntArray,
    separator_start: IntArray,
    separators: IntArray,
    value_start: IntArray,
    values: FloatArray,
    sources: IntArray,
) -> FloatArray:
    """Y = R^-T E for the columns of the given positions, rows of their ancestors only."""
    count = dims.size
    scalar_start = np.full(count, -1, np.int64)
    for source in sources:
        position = source
        while position >= 0 and scalar_start[position] < 0:
            scalar_start[position] = 0
            position = parent[position]
    height = 0
    path = np.empty(count, np.int64)
    length = 0
    for position in range(count):
        if scalar_start[position] >= 0:
            scalar_start[position] = height
            height += dims[position]
            path[length] = position
            length += 1
    width = 0
    for source in sources:
        width += dims[source]
    solution = np.zeros((height, width))
    first_column = np.full(count, width, np.int64)
    column = 0
    for source in sources:
        for scalar in range(dims[source]):
            solution[scalar_start[source] + scalar, column + scalar] = 1.0
        first_column[source] = min(first_column[source], column)
        column += dims[source]
    for step in range(length):
        position = path[step]
        dim = dims[position]
        block = (value_start[position + 1] - value_start[position]) // max(dim, 1)
        begin = first_column[position]
        base = scalar_start[position]
        for scalar in range(dim):
            diagonal = values[value_start[position] + scalar * block + scalar]
            for column in range(begin, width):
                solution[base + scalar, column] /= diagonal
            for other in range(scalar + 1, dim):
                entry = values[value_start[position] + scalar * block + other]
                for column in range(begin, width):
                    solution[base + other, column] -= entry * solution[base + scalar, column]
        offset = dim
        for place in range(separator_start[position], separator_start[position + 1]):
            other = separators[place]
            first_column[other] = min(first_column[other], begin)
            for inner in range(dims[other]):
                target = scalar_start[other] + inner
                for scalar in range(dim):
                    entry = values[value_start[position] + scalar * block + offset + inner]
                    if entry != 0.0:
                        for column in range(begin, width):
                            solution[target, column] -= entry * solution[base + scalar, column]
            offset += dims[other]
    return solution


@njit(cache=True)
def recover_covariances(
    dims: IntArray,
    separator_start: IntArray,
    separators: IntArray,
    value_start: IntArray,
    values: FloatArray,
) -> FloatArray:
    """Covariance at the places of R's block rows: [cov(p, p), cov(p, separator)] for each p.

    From the last variable to the first, with T = R^-1 S:
    cov(p, s) = -T cov(s, s) and cov(p, p) = R^-1 R^-T + T cov(s, s) T'; only sums of squares.
    """
    count = dims.size
    found = np.zeros_like(values)
    place_of = np.zeros(count, np.int64)
    for position in range(count - 1, -1, -1):
        dim = dims[position]
        begin, end = separator_start[position], separator_start[position + 1]
        width = (value_start[position + 1] - value_start[position]) // max(dim, 1)
        size = width - dim
        around = np.zeros((size, size))
        row = 0
        for place in range(begin, end):
            other = separators[place]
            other_dim = dims[other]
            other_width = (value_start[other + 1] - value_start[other]) // max(other_dim, 1)
            column = other_dim
            place_of[other] = 0
            for inner in range(separator_start[other], separator_start[other + 1]):
                place_of[separators[inner]] = column
                column += dims[separators[inner]]
            target = row
            for inner in range(place, end):
                source = value_start[other] + place_of[separators[inner]]
                for scalar in range(other_dim):
                    for step in range(dims[separators[inner]]):
                        entry = found[source + scalar * other_width + step]
                        around[row + scalar, target + step] = entry
                        around[target + step, row + scalar] = entry
                target += dims[separators[inner]]
            row += other_dim
        base = value_start[position]
        solved = np.zeros((dim, width))
        for scalar in range(dim - 1, -1, -1):
            solved[scalar, scalar] = 1.0
            for column in range(dim, width):
                solved[scalar, column] = values[base + scalar * width + column]
            for lower in range(scalar + 1, dim):
                entry = values[base + scalar * width + lower]
                for column in range(width):
                    solved[scalar, column] -= entry * solved[lower, column]
            for column in range(width):
                solved[scalar, column] /= values[base + scalar * width + scalar]
        for scalar in range(dim):
            for column in range(size):
                total = 0.0
                for inner in range(size):
                    total += solved[scalar, dim + inner] * around[inner, column]
                found[base + scalar * width + dim + column] = -total
        for scalar in range(dim):
            for other in range(scalar, dim):
                total = 0.0
                for inner in range(dim):
                    total += solved[scalar, inner] * solved[other, inner]
                for inner in range(size):
                    total -= found[base + scalar * width + dim + inner] * solved[other, dim + inner]
                found[base + scalar * width + other] = total
                found[base + other * width + scalar] = total
    return found
