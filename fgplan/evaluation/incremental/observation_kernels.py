"""Compiled: information blocks of planar range, bearing and bearing-range observations.

With offset o = landmark - position, l = |o|, R the rotation of the heading, tangents on the right:

    range     A_i = [-o'R / l,  0]           A_v = o' / l
    bearing   A_i = [-a'R,     -1]           A_v = a',   a = (-o_y, o_x) / l^2

bearing rows first, and the blocks are A_i'W A_i, A_v'W A_i, A_v'W A_v with W the inverse of the
noise: the same rows as fgplan.models.range_bearing.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.typing import BoolArray, FloatArray


@njit(cache=True)
def observation_information(
    poses: FloatArray,
    landmarks: FloatArray,
    with_bearing: BoolArray,
    with_range: BoolArray,
    noise: FloatArray,
    own: FloatArray,
    cross: FloatArray,
    other: FloatArray,
) -> int:
    """Blocks of M observations.

    Args:
        poses: Shape (M, 3), pose that each is made from, world frame.
        landmarks: Shape (M, 2), metres, world frame.
        with_bearing: Shape (M,), whether it has a row of bearing.
        with_range: Shape (M,), whether it has a row of range.
        noise: Shape (M, 2, 2), covariance; an observation of one row has it at [0, 0].
        own: Out: A_i'W A_i, shape (M, 3, 3).
        cross: Out: A_v'W A_i, shape (M, 3, 3), last row zero.
        other: Out: A_v'W A_v, shape (M, 3, 3), last row and column zero.

    Returns:
        The first observation whose noise is not positive definite and finite, or whose landmark
        is at the pose; -1 where there is none.
    """
    rows_i = np.zeros((2, 3))
    rows_v = np.zeros((2, 2))
    weight = np.zeros((2, 2))
    for m in range(len(poses)):
        x = landmarks[m, 0] - poses[m, 0]
        y = landmarks[m, 1] - poses[m, 1]
        cosine, sine = np.cos(poses[m, 2]), np.sin(poses[m, 2])
        square = x * x + y * y
        first, mixed, second = noise[m, 0, 0], noise[m, 1, 0], noise[m, 1, 1]
        both = with_bearing[m] and with_range[m]
        determinant = first * second - mixed * mixed if both else first
        if not (square > 0.0 and np.isfinite(square) and first > 0.0):
            return m
        if not (determinant > 0.0 and np.isfinite(determinant)):
            return m
        count = 0
        if with_bearing[m]:
            rows_v[0, 0], rows_v[0, 1] = -y / square, x / square
            rows_i[0, 2] = -1.0
            count = 1
        if with_range[m]:
            length = np.sqrt(square)
            rows_v[count, 0], rows_v[count, 1] = x / length, y / length
            rows_i[count, 2] = 0.0
            count += 1
        for r in range(count):
            rows_i[r, 0] = -(rows_v[r, 0] * cosine + rows_v[r, 1] * sine)
            rows_i[r, 1] = rows_v[r, 0] * sine - rows_v[r, 1] * cosine
        if both:
            weight[0, 0], weight[1, 1] = second / determinant, first / determinant
            weight[0, 1] = weight[1, 0] = -mixed / determinant
        else:
            weight[0, 0] = 1.0 / first
        for a in range(3):
            for b in range(3):
                total = 0.0
                for r in range(count):
                    for s in range(count):
                        total += rows_i[r, a] * weight[r, s] * rows_i[s, b]
                own[m, a, b] = total
        for a in range(2):
            for b in range(3):
                total = 0.0
                for r in range(count):
                    for s in range(count):
                        total += rows_v[r, a] * weight[r, s] * rows_i[s, b]
                cross[m, a, b] = total
            for b in range(2):
                total = 0.0
                for r in range(count):
                    for s in range(count):
                        total += rows_v[r, a] * weight[r, s] * rows_v[s, b]
                other[m, a, b] = total
    return -1
