"""Compiled: what a candidate's factors touch outside it, merged variable by variable.

Factors with rows A_v x_v + A_i x_i that meet in one variable are merged: D = sum A_v'A_v = C C' and
sum A_v'A_i = C Y_i, so that all of them together are C' x_v + Y x_c + n with n ~ N(0, I). What
becomes of them, ``message_kernels`` says.

A counter that is handed to another kernel begins as ``np.int64(0)``: numba compiles that kernel
twice for a plain 0, once for the literal and once for what it becomes.
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.typing import FloatArray, IntArray

RANK_TOLERANCE = 1e-13
"""A pivot of D below this share of its diagonal is rounding: the direction is not measured."""

CANCELLATION_LIMIT = 1e-6
"""A pivot below this share of what it was subtracted from has lost too many digits."""


@njit(cache=True)
def count_interface(
    candidates: IntArray,
    lengths: IntArray,
    states: IntArray,
    fixed: FactorBlocks,
    moving: FactorBlocks,
    column: IntArray,
) -> IntArray:
    """Number of distinct interface variables of each candidate.

    Args:
        candidates: Shape (n,), indices of candidates.
        lengths: Shape (n,), steps of each up to the cut.
        states: Shape (N, Lmax), own state of each candidate and step.
        fixed: Factors of the own states that do not depend on announcements.
        moving: Factors of the own states with announced poses.
        column: Shape (V,), first scalar of each variable in S or -1 where the cut leaves it out.

    Returns:
        Shape (n,).
    """
    seen = np.full(column.shape[0], -1, np.int64)
    counts = np.zeros(candidates.shape[0], np.int64)
    for n in range(candidates.shape[0]):
        for i in range(lengths[n]):
            s = states[candidates[n], i]
            for m in range(fixed.pointer[s], fixed.pointer[s + 1]):
                v = fixed.variable[m]
                if column[v] >= 0 and seen[v] != n:
                    seen[v] = n
                    counts[n] += 1
            for m in range(moving.pointer[s], moving.pointer[s + 1]):
                v = moving.variable[m]
                if column[v] >= 0 and seen[v] != n:
                    seen[v] = n
                    counts[n] += 1
    return counts


class Interface(NamedTuple):
    """Work space: what has been found of one candidate's interface.

    Attributes:
        slot_of: Shape (V,), slot of each variable, -1 for none.
        variable: Shape (slots,), variable of each slot.
        rows: Shape (slots,), rows of all its factors.
        low: Shape (slots,), first step that touches it, from 0.
        high: Shape (slots,), one beyond the last.
        information: Shape (slots, d, d), D.
        cross: Shape (slots d, q), sum of A_v'A_i.
    """

    slot_of: IntArray
    variable: IntArray
    rows: IntArray
    low: IntArray
    high: IntArray
    information: FloatArray
    cross: FloatArray


@njit(cache=True, inner=True)
def interface_room(variables: int, slots: int, steps: int, d: int) -> Interface:
    """Work space for a number of variables, slots and places of a path; ``cross`` is not set."""
    return Interface(
        np.full(variables, -1, np.int64),
        np.empty(slots, np.int64),
        np.empty(slots, np.int64),
        np.empty(slots, np.int64),
        np.empty(slots, np.int64),
        np.empty((slots, d, d)),
        np.empty((slots * d, steps * d)),
    )


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def gather_factors(
    factors: FactorBlocks,
    s: int,
    i: int,
    column: IntArray,
    found: Interface,
    count: int,
    psi: FloatArray,
) -> int:
    """Add the factors of state s at place i to Psi and the interface; returns its slots."""
    d = factors.own.shape[1]
    for m in range(factors.pointer[s], factors.pointer[s + 1]):
        v = factors.variable[m]
        if column[v] < 0:
            continue
        slot = found.slot_of[v]
        if slot < 0:
            slot = count
            count += 1
            found.slot_of[v] = slot
            found.variable[slot] = v
            found.rows[slot] = 0
            found.low[slot] = i
            found.information[slot, :, :] = 0.0
            found.cross[slot * d : slot * d + d, :] = 0.0
        found.rows[slot] += factors.rank[m]
        found.high[slot] = i + 1
        for a in range(d):
            for b in range(d):
                psi[i * d + a, i * d + b] += factors.own[m, a, b]
                found.information[slot, a, b] += factors.other[m, a, b]
                found.cross[slot * d + a, i * d + b] += factors.cross[m, a, b]
    return count


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def split_full(
    big: FloatArray,
    cross: FloatArray,
    size: int,
    lo: int,
    hi: int,
    c_out: FloatArray,
    y_out: FloatArray,
) -> bool:
    """D = C C' with C a lower triangle, and Y; False where D is not well conditioned enough."""
    for a in range(size):
        for b in range(a + 1):
            total = big[a, b]
            for k in range(b):
                total -= c_out[a, k] * c_out[b, k]
            if a > b:
                c_out[a, b] = total / c_out[b, b]
            elif total > CANCELLATION_LIMIT * big[a, a]:
                c_out[a, a] = np.sqrt(total)
            else:
                return False
    for a in range(size):
        row = y_out[a]
        for j in range(lo, hi):
            row[j] = cross[a, j]
        for k in range(a):
            weight = c_out[a, k]
            above = y_out[k]
            for j in range(lo, hi):
                row[j] -= weight * above[j]
        scale = 1.0 / c_out[a, a]
        for j in range(lo, hi):
            row[j] *= scale
    return True


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def split_pivoted(
    big: FloatArray,
    cross: FloatArray,
    size: int,
    rows: int,
    lo: int,
    hi: int,
    c_out: FloatArray,
    y_out: FloatArray,
) -> tuple[int, bool]:
    """D = C C' by pivoted Cholesky and Y by substitution; returns (rank, no digits lost)."""
    c_out[:, :] = 0.0
    done = np.zeros(size, np.int64)
    remaining = np.empty(size)
    for a in range(size):
        remaining[a] = big[a, a]
    rank = 0
    sound = True
    while rank < min(size, rows):
        best, share = -1, 0.0
        for a in range(size):
            if done[a] == 0 and big[a, a] > 0.0 and remaining[a] / big[a, a] > share:
                best, share = a, remaining[a] / big[a, a]
        if best < 0 or share < RANK_TOLERANCE:
            break
        if share < CANCELLATION_LIMIT:
            sound = False
        p = best
        root = np.sqrt(remaining[p])
        for a in range(size):
            if done[a] == 1:
                c_out[a, rank] = 0.0
                continue
            total = big[a, p]
            for k in range(rank):
                total -= c_out[a, k] * c_out[p, k]
            c_out[a, rank] = total / root
        for j in range(lo, hi):
            total = cross[p, j]
            for k in range(rank):
                total -= c_out[p, k] * y_out[k, j]
            y_out[rank, j] = total / root
        done[p] = 1
        for a in range(size):
            if done[a] == 0:
                remaining[a] -= c_out[a, rank] * c_out[a, rank]
        rank += 1
    return rank, sound


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def split_slot(
    found: Interface, slot: int, width: IntArray, c_out: FloatArray, y_out: FloatArray
) -> tuple[int, bool, bool]:
    """D = C C' and Y of one slot; returns (rank, C is a good triangle, no digits lost)."""
    d = found.information.shape[1]
    lo, hi = found.low[slot] * d, found.high[slot] * d
    y_out[:, :] = 0.0
    c_out[:, :] = 0.0
    size = width[found.variable[slot]]
    cross = found.cross[slot * d : slot * d + d]
    information = found.information[slot]
    if found.rows[slot] >= size and split_full(information, cross, size, lo, hi, c_out, y_out):
        return size, True, True
    rank, fine = split_pivoted(information, cross, size, found.rows[slot], lo, hi, c_out, y_out)
    return rank, False, fine and rank < size  # full rank, but no well-conditioned triangle


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def measure_variables(
    c: FloatArray,
    first: int,
    rank: int,
    square: bool,
    z: FloatArray,
    noise: FloatArray,
    offset: int,
) -> None:
    """Put a slot's own noise into N; where C is a triangle, multiply its rows by C'^-1 first."""
    total = z.shape[0]
    for r in range(first, first + rank):
        noise[offset + r * total : offset + r * total + r + 1] = 0.0
        noise[offset + r * total + r] = 1.0
    if not square:
        return
    inverse = np.zeros((rank, rank))
    for a in range(rank):
        inverse[a, a] = 1.0 / c[a, a]
        for b in range(a):
            entry = 0.0
            for k in range(b, a):
                entry -= c[a, k] * inverse[k, b]
            inverse[a, b] = entry * inverse[a, a]
    for a in range(rank):
        row = z[first + a]
        for j in range(z.shape[1]):
            row[j] *= inverse[a, a]
        for b in range(a + 1, rank):
            weight = inverse[b, a]
            below = z[first + b]
            for j in range(z.shape[1]):
                row[j] += weight * below[j]
    for a in range(rank):
        for b in range(a + 1):
            entry = 0.0
            for k in range(a, rank):
                entry += inverse[k, a] * inverse[k, b]
            noise[offset + (first + a) * total + first + b] = entry
    c[:, :] = 0.0
    for a in range(rank):
        c[a, a] = 1.0
