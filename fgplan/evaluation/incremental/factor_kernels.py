"""Compiled: which planar states are near each other, and the blocks of relative poses.

For h = x1^-1 x2 with whitened rows A1 = -W Ad(h^-1), A2 = W and W'W = Omega the blocks are

    A2'A2 = Omega,   A2'A1 = -Omega Ad,   A1'A1 = Ad' Omega Ad,   Ad = Ad(h^-1).
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.typing import FloatArray, IntArray


@njit(cache=True, inner=True)
def _differ(own: int, other: int, each_once: bool) -> bool:
    """Whether two robots make a pair."""
    return other < own if each_once else other != own


@njit(cache=True)
def near_pairs(
    own: FloatArray,
    own_place: IntArray,
    other: FloatArray,
    other_place: IntArray,
    distance_m: float,
    each_once: bool,
) -> tuple[IntArray, IntArray]:
    """Pairs of planar poses of different robots nearer than a distance, ordered by own state.

    Args:
        own: Shape (A, 3), world frame.
        own_place: Shape (A,), place of each one's robot in the team.
        other: Shape (B, 3), world frame.
        other_place: Shape (B,), likewise.
        distance_m: Largest distance, metres.
        each_once: Both sides are the same states: take each pair from its later robot only.

    Returns:
        Row pointer of shape (A + 1,) and indices into ``other``, shape (M,).
    """
    pointer = np.zeros(own.shape[0] + 1, np.int64)
    for a in range(own.shape[0]):
        count = 0
        for b in range(other.shape[0]):
            x = own[a, 0] - other[b, 0]
            y = own[a, 1] - other[b, 1]
            if np.sqrt(x * x + y * y) < distance_m and _differ(
                own_place[a], other_place[b], each_once
            ):
                count += 1
        pointer[a + 1] = pointer[a] + count
    found = np.empty(pointer[-1], np.int64)
    m = 0
    for a in range(own.shape[0]):
        if pointer[a + 1] == pointer[a]:
            continue
        for b in range(other.shape[0]):
            x = own[a, 0] - other[b, 0]
            y = own[a, 1] - other[b, 1]
            if np.sqrt(x * x + y * y) < distance_m and _differ(
                own_place[a], other_place[b], each_once
            ):
                found[m] = b
                m += 1
    return pointer, found


@njit(cache=True)
def relative_pose_blocks(
    own: FloatArray,
    other: FloatArray,
    pointer: IntArray,
    found: IntArray,
    own_place: IntArray,
    other_place: IntArray,
    omega: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Information blocks of relative-pose factors between planar poses.

    Args:
        own: Shape (A, 3), world frame.
        other: Shape (B, 3), world frame.
        pointer: Row pointer, shape (A + 1,).
        found: Indices into ``other``, shape (M,).
        own_place: Shape (A,), place of each one's robot in the team; the earlier is the first.
        other_place: Shape (B,), likewise.
        omega: Information, shape (3, 3), tangent of the second pose.

    Returns:
        Blocks (own, own), (other, own) and (other, other), each of shape (M, 3, 3).
    """
    size = found.shape[0]
    own_block = np.empty((size, 3, 3))
    cross = np.empty((size, 3, 3))
    other_block = np.empty((size, 3, 3))
    adjoint = np.zeros((3, 3))
    adjoint[2, 2] = 1.0
    product = np.empty((3, 3))
    for a in range(own.shape[0]):
        for m in range(pointer[a], pointer[a + 1]):
            b = found[m]
            if other_place[b] < own_place[a]:
                x1, y1, t1 = other[b, 0], other[b, 1], other[b, 2]
                x2, y2, t2 = own[a, 0], own[a, 1], own[a, 2]
            else:
                x1, y1, t1 = own[a, 0], own[a, 1], own[a, 2]
                x2, y2, t2 = other[b, 0], other[b, 1], other[b, 2]
            cos2, sin2 = np.cos(t2), np.sin(t2)
            px = cos2 * (x1 - x2) + sin2 * (y1 - y2)
            py = -sin2 * (x1 - x2) + cos2 * (y1 - y2)
            cos, sin = np.cos(t1 - t2), np.sin(t1 - t2)
            adjoint[0, 0] = cos
            adjoint[0, 1] = -sin
            adjoint[0, 2] = py
            adjoint[1, 0] = sin
            adjoint[1, 1] = cos
            adjoint[1, 2] = -px
            for i in range(3):
                for j in range(3):
                    total = 0.0
                    for k in range(3):
                        total += omega[i, k] * adjoint[k, j]
                    product[i, j] = total
            for i in range(3):
                for j in range(3):
                    total = 0.0
                    for k in range(3):
                        total += adjoint[k, i] * product[k, j]
                    if other_place[b] < own_place[a]:
                        own_block[m, i, j] = omega[i, j]
                        cross[m, i, j] = -product[j, i]
                        other_block[m, i, j] = total
                    else:
                        own_block[m, i, j] = total
                        cross[m, i, j] = -product[i, j]
                        other_block[m, i, j] = omega[i, j]
    return own_block, cross, other_block


@njit(cache=True)
def motion_blocks(
    before: FloatArray, after: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Information blocks of motion factors between consecutive planar poses.

    Args:
        before: Shape (M, 3), pose before each step, world frame.
        after: Shape (M, 3), pose after it.
        covariances: Shape (M, 3, 3), noise in the tangent of the pose after.

    Returns:
        Blocks A2'A2, A2'A1 and A1'A1, each of shape (M, 3, 3).
    """
    size = before.shape[0]
    late = np.empty((size, 3, 3))
    cross = np.empty((size, 3, 3))
    early = np.empty((size, 3, 3))
    adjoint = np.zeros((3, 3))
    adjoint[2, 2] = 1.0
    for m in range(size):
        _invert_symmetric(covariances[m], late[m])
        cos2, sin2 = np.cos(after[m, 2]), np.sin(after[m, 2])
        x, y = before[m, 0] - after[m, 0], before[m, 1] - after[m, 1]
        turn = before[m, 2] - after[m, 2]
        adjoint[0, 0] = adjoint[1, 1] = np.cos(turn)
        adjoint[1, 0] = np.sin(turn)
        adjoint[0, 1] = -adjoint[1, 0]
        adjoint[0, 2] = -sin2 * x + cos2 * y
        adjoint[1, 2] = -(cos2 * x + sin2 * y)
        for i in range(3):
            for j in range(3):
                total = 0.0
                for k in range(3):
                    total -= late[m, i, k] * adjoint[k, j]
                cross[m, i, j] = total
        for i in range(3):
            for j in range(3):
                total = 0.0
                for k in range(3):
                    total -= adjoint[k, i] * cross[m, k, j]
                early[m, i, j] = total
    return late, cross, early


@njit(cache=True, inner=True)
def _invert_symmetric(matrix: FloatArray, out: FloatArray) -> None:
    """Inverse of a symmetric positive definite 3 x 3 matrix: M = L D L', then back."""
    d0 = matrix[0, 0]
    l10, l20 = matrix[1, 0] / d0, matrix[2, 0] / d0
    d1 = matrix[1, 1] - l10 * matrix[1, 0]
    l21 = (matrix[2, 1] - l20 * matrix[1, 0]) / d1
    d2 = matrix[2, 2] - l20 * matrix[2, 0] - l21 * l21 * d1
    k10, k21 = -l10, -l21
    k20 = l10 * l21 - l20
    out[2, 2] = 1.0 / d2
    out[2, 1] = out[1, 2] = k21 / d2
    out[2, 0] = out[0, 2] = k20 / d2
    out[1, 1] = 1.0 / d1 + k21 * k21 / d2
    out[1, 0] = out[0, 1] = k10 / d1 + k21 * k20 / d2
    out[0, 0] = 1.0 / d0 + k10 * k10 / d1 + k20 * k20 / d2
