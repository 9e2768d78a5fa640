"""Compiled: the message of a candidate path.

What a path says about the rest of the world does not depend on anybody else's belief. Write the
chain x_c = (poses 1..L), the robot's current pose x_k, and the variables x_v outside the path that
its factors touch (the interface). Factors that meet in one x_v are merged: with rows A_v x_v + A_i
x_i let D = sum A_v'A_v = C C' and sum A_v'A_i = C Y_i. Then all of them together are the
measurements

    e_v = C' x_v + Y x_c + n,   n ~ N(0, I)      and information  sum A_i'A_i - Y'Y  on the chain,

and the chain itself, hanging on x_k by its motion factors, is x_c = Theta x_k + noise(Psi^-1) with

    Psi = motion + sum A_i'A_i - Y'Y = L L',   Theta = -Psi^-1 Psi_ck.

With Z = L^-1 Y', t = L^-1 Psi_ck, w = L^-1 e_s for a pose s that is read, the message is

    N = I + Z'Z         covariance of the measurements e, x_k and x_v fixed
    T = -Z't            how e moves with x_k
    Theta_s = -w't,  G_s = w'Z,  E_ss = w'w      the same for the pose that is read.

C may have fewer columns than rows (range-only, bearing-only): pivoted Cholesky gives it. Where it
is a well-conditioned triangle, e_v is multiplied by C'^-1 - then it measures x_v itself, N holds
D^-1 in place of I, and nobody who uses the message has to multiply S by C. Nothing here is
subtracted that was added, except Y'Y inside Psi; where that cancels, the message is flagged and the
path is evaluated by QR.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from fgplan.evaluation.incremental.candidate_table import MotionBlocks
from fgplan.evaluation.incremental.cholesky_kernels import cholesky_skyline, inverse_skyline
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.message_pool import MessagePool
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


@njit(cache=True, fastmath={"reassoc", "contract"})
def _gather(
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


@njit(cache=True, fastmath={"reassoc", "contract"})
def _split_full(
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


@njit(cache=True, fastmath={"reassoc", "contract"})
def _split_pivoted(
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


@njit(cache=True, fastmath={"reassoc", "contract"})
def _subtract_square(psi: FloatArray, merged: FloatArray, first: IntArray) -> None:
    """Psi -= Y'Y, lower triangle, from the first column of each row on."""
    total = merged.shape[0]
    if total == 0:
        return
    if total > 24:
        square = np.dot(merged.T, merged)
        for i in range(psi.shape[0]):
            for j in range(first[i], i + 1):
                psi[i, j] -= square[i, j]
        return
    for r in range(total):
        row = merged[r]
        for i in range(psi.shape[0]):
            value = row[i]
            if value != 0.0:
                target = psi[i]
                for j in range(first[i], i + 1):
                    target[j] -= value * row[j]


@njit(cache=True, fastmath={"reassoc", "contract"})
def _motion_information(
    late: FloatArray, cross: FloatArray, early: FloatArray, length: int
) -> FloatArray:
    """Psi of the motion factors alone: block tridiagonal, lower triangle."""
    d = late.shape[1]
    psi = np.zeros((length * d, length * d))
    for i in range(length):
        for a in range(d):
            for b in range(d):
                psi[i * d + a, i * d + b] = late[i, a, b]
                if i + 1 < length:
                    psi[i * d + a, i * d + b] += early[i + 1, a, b]
                if i > 0:
                    psi[i * d + a, (i - 1) * d + b] = cross[i, a, b]
    return psi


@njit(cache=True, fastmath={"reassoc", "contract"})
def _measure_variables(
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


@njit(cache=True, fastmath={"reassoc", "contract"})
def build_messages(
    lengths: IntArray,
    states: IntArray,
    motion: MotionBlocks,
    fixed: FactorBlocks,
    moving: FactorBlocks,
    column: IntArray,
    width: IntArray,
    read_steps: IntArray,
    pool: MessagePool,
) -> None:
    """Build the messages of some candidates into a pool whose pointers are set.

    Args:
        lengths: Shape (n,), steps of each candidate, cut where the belief is cut.
        states: Shape (N, Lmax), own state of each candidate and step.
        motion: Blocks of the motion factors, by candidate and step.
        fixed: Factors of the own states that do not depend on announcements.
        moving: Factors of the own states with announced poses.
        column: Shape (V,), first scalar of each variable in S or -1 where the cut leaves it out.
        width: Shape (V,), tangent dimension of each variable.
        read_steps: Shape (n, p), steps (1 and up) of own poses that are read.
        pool: In: candidates and pointers. Out: all the rest.
    """
    d = motion.late.shape[2]
    longest = 0
    most = 1
    for n in range(lengths.shape[0]):
        longest = max(longest, lengths[n])
        most = max(most, pool.slot_pointer[n + 1] - pool.slot_pointer[n])
    found = Interface(
        np.full(column.shape[0], -1, np.int64),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty((most, d, d)),
        np.empty((most * d, longest * d)),
    )
    merged_rows = np.empty((most * d, longest * d))
    square = np.empty(most, np.bool_)
    for n in range(lengths.shape[0]):
        c = pool.candidates[n]
        length = lengths[n]
        q = length * d
        psi = _motion_information(motion.late[c], motion.cross[c], motion.early[c], length)
        count = 0
        for i in range(length):
            count = _gather(fixed, states[c, i], i, column, found, count, psi)
            count = _gather(moving, states[c, i], i, column, found, count, psi)
        before = np.empty(q)
        first = np.empty(q, np.int64)
        for i in range(q):
            before[i] = psi[i, i]
            first[i] = max((i // d - 1) * d, 0)
        good = True
        total = 0
        for slot in range(count):
            lo, hi = found.low[slot] * d, found.high[slot] * d
            for i in range(lo, hi):
                first[i] = min(first[i], lo)
            place = pool.slot_pointer[n] + slot
            merged_rows[total : total + d, :q] = 0.0
            pool.slot_c[place, :, :] = 0.0
            size = width[found.variable[slot]]
            rank, fine = size, True
            square[slot] = found.rows[slot] >= size and _split_full(
                found.information[slot],
                found.cross[slot * d : slot * d + d],
                size,
                lo,
                hi,
                pool.slot_c[place],
                merged_rows[total : total + d],
            )
            if not square[slot]:
                rank, fine = _split_pivoted(
                    found.information[slot],
                    found.cross[slot * d : slot * d + d],
                    size,
                    found.rows[slot],
                    lo,
                    hi,
                    pool.slot_c[place],
                    merged_rows[total : total + d],
                )
                fine = fine and rank < size  # full rank, but no well-conditioned triangle
            good = good and fine
            pool.slot_variable[place] = found.variable[slot]
            pool.slot_row[place] = total
            pool.slot_rank[place] = rank
            found.slot_of[found.variable[slot]] = -1
            total += rank
        pool.row_count[n] = total
        merged = merged_rows[:total, :q].copy()
        _subtract_square(psi, merged, first)
        pool.sound[n] = 0
        if not cholesky_skyline(psi, first):
            continue
        for j in range(q):
            if psi[j, j] * psi[j, j] < CANCELLATION_LIMIT * before[j]:
                good = False
        pool.sound[n] = 1 if good else 0
        inverse = inverse_skyline(psi, first)
        z = np.dot(merged, inverse.T)
        for slot in range(count):
            place = pool.slot_pointer[n] + slot
            _measure_variables(
                pool.slot_c[place],
                pool.slot_row[place],
                pool.slot_rank[place],
                square[slot],
                z,
                pool.noise,
                pool.noise_pointer[n],
            )
        _write_message(n, inverse, motion.cross[c, 0], read_steps[n], z, pool)


@njit(cache=True, fastmath={"reassoc", "contract"})
def _write_message(
    n: int,
    inverse: FloatArray,
    first_cross: FloatArray,
    read_steps: IntArray,
    z: FloatArray,
    pool: MessagePool,
) -> None:
    """N, T, G, Theta and E from Z, t and w; t and w are columns of L^-1, combined or picked."""
    q, d, p, total = inverse.shape[0], first_cross.shape[0], read_steps.shape[0], z.shape[0]
    reads = np.empty((q, d + p * d))
    for i in range(q):
        for b in range(d):
            entry = 0.0
            for j in range(min(i + 1, d)):
                entry -= inverse[i, j] * first_cross[j, b]
            reads[i, b] = entry
        for k in range(p):
            for b in range(d):
                reads[i, d + k * d + b] = inverse[i, (read_steps[k] - 1) * d + b]
    offset = pool.noise_pointer[n]
    product = np.dot(z, z.T)
    for a in range(total):
        for b in range(a + 1):
            pool.noise[offset + a * total + b] += product[a, b]
    seen = np.dot(z, reads)
    base = pool.row_pointer[n]
    for a in range(total):
        for b in range(d):
            pool.response[base + a, b] = seen[a, b]
        for b in range(p * d):
            pool.read_noise[base + a, b] = seen[a, d + b]
    met = np.dot(reads.T, reads)
    for a in range(p * d):
        for b in range(d):
            pool.read_response[n, a, b] = met[d + a, b]
        for b in range(p * d):
            pool.read_covariance[n, a, b] = met[d + a, d + b]
