"""The inner loops that read an eliminated graph; imported on first use only, as numba is slow.

Arrays are those of SquareRootFactor: block rows [R S] by place in the elimination order, row-major
of shape (d, d + separator). Plain Python over arrays: the same numbers with NUMBA_DISABLE_JIT=1.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.typing import FloatArray, IntArray


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


@njit(cache=True)
def null_direction(
    dims: IntArray,
    separator_start: IntArray,
    separators: IntArray,
    value_start: IntArray,
    values: FloatArray,
    position: int,
    scalar: int,
) -> FloatArray:
    """Solve R n = 0 but for the pivot of one scalar, where n is 1; later variables stay at 0."""
    count = dims.size
    scalar_start = np.zeros(count + 1, np.int64)
    for place in range(count):
        scalar_start[place + 1] = scalar_start[place] + dims[place]
    direction = np.zeros(scalar_start[count])
    direction[scalar_start[position] + scalar] = 1.0
    for place in range(position, -1, -1):
        dim = dims[place]
        width = (value_start[place + 1] - value_start[place]) // max(dim, 1)
        for row in range(dim - 1, -1, -1):
            if place == position and row >= scalar:
                continue
            base = value_start[place] + row * width
            if values[base + row] == 0.0:
                continue
            total = 0.0
            for column in range(row + 1, dim):
                total += values[base + column] * direction[scalar_start[place] + column]
            column = dim
            for inner in range(separator_start[place], separator_start[place + 1]):
                other = separators[inner]
                for step in range(dims[other]):
                    total += values[base + column] * direction[scalar_start[other] + step]
                    column += 1
            direction[scalar_start[place] + row] = -total / values[base + row]
    return direction
