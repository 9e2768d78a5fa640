"""Compiled: which rows of a table are the same."""

import numpy as np

from fgplan.compiling import njit
from fgplan.typing import IntArray


@njit(cache=True)
def distinct_rows(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Number the distinct rows of a table in the order in which they first occur.

    Args:
        rows: Shape (M, w), bits of the entries; rows are the same if all bits are.

    Returns:
        Number of each row, shape (M,), and place of the first of each number, shape (A,).
    """
    size = rows.shape[0]
    slots = 16
    while slots < 2 * size:
        slots *= 2
    table = np.full(slots, -1, np.int64)
    number = np.empty(size, np.int64)
    first = np.empty(size, np.int64)
    count = 0
    for m in range(size):
        mixed = np.uint64(14695981039346656037)
        for c in range(rows.shape[1]):
            mixed = (mixed ^ np.uint64(rows[m, c])) * np.uint64(1099511628211)
            mixed ^= mixed >> np.uint64(29)
        place = np.int64(mixed & np.uint64(slots - 1))
        while True:
            known = table[place]
            if known < 0:
                table[place] = count
                first[count] = m
                number[m] = count
                count += 1
                break
            same = True
            for c in range(rows.shape[1]):
                if rows[first[known], c] != rows[m, c]:
                    same = False
                    break
            if same:
                number[m] = known
                break
            place = (place + 1) & (slots - 1)
    return number, first[:count].copy()
