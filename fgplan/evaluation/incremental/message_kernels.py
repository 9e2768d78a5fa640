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
is square, e_v is multiplied by C'^-1 - then it measures x_v itself, N holds D^-1 in place of I, and
nobody who uses the message has to multiply S by C. Nothing here is subtracted that was added,
except Y'Y inside Psi; where that cancels, the message is flagged and the path is evaluated by QR.
"""

import numpy as np
from numba import njit

from fgplan.evaluation.incremental.cholesky_kernels import cholesky_skyline, inverse_skyline
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
    fixed_pointer: IntArray,
    fixed_variable: IntArray,
    moving_pointer: IntArray,
    moving_variable: IntArray,
    column: IntArray,
) -> IntArray:
    """Number of distinct interface variables of each candidate, shape (n,)."""
    seen = np.full(column.shape[0], -1, np.int64)
    counts = np.zeros(candidates.shape[0], np.int64)
    for n in range(candidates.shape[0]):
        c = candidates[n]
        for i in range(lengths[n]):
            s = states[c, i]
            for m in range(fixed_pointer[s], fixed_pointer[s + 1]):
                v = fixed_variable[m]
                if column[v] >= 0 and seen[v] != n:
                    seen[v] = n
                    counts[n] += 1
            for m in range(moving_pointer[s], moving_pointer[s + 1]):
                v = moving_variable[m]
                if column[v] >= 0 and seen[v] != n:
                    seen[v] = n
                    counts[n] += 1
    return counts


@njit(cache=True, fastmath={"reassoc", "contract"})
def _gather(
    pointer, variable, rank, own, cross, other, s, i, d, column, slot_of, touched, count,
    psi, y, big, rows, low, high,
):  # fmt: skip
    """Add the factors of one state: Psi, C-to-be (big) and Y-to-be (y); returns the slot count."""
    for m in range(pointer[s], pointer[s + 1]):
        v = variable[m]
        if column[v] < 0:
            continue
        slot = slot_of[v]
        if slot < 0:
            slot = count
            count += 1
            slot_of[v] = slot
            touched[slot] = v
            rows[slot] = 0
            low[slot] = i
            big[slot, :, :] = 0.0
            y[slot * d : slot * d + d, :] = 0.0
        rows[slot] += rank[m]
        high[slot] = i + 1
        for a in range(d):
            for b in range(d):
                psi[i * d + a, i * d + b] += own[m, a, b]
                big[slot, a, b] += other[m, a, b]
                y[slot * d + a, i * d + b] += cross[m, a, b]
    return count


@njit(cache=True, fastmath={"reassoc", "contract"})
def _split(big, y, y_row, size, rows, lo, hi, c_out, z_out, z_row):
    """D = C C' by pivoted Cholesky and Y by substitution; returns (rank, sound)."""
    done = np.zeros(size, np.int64)
    remaining = np.empty(size)
    for a in range(size):
        remaining[a] = big[a, a]
    rank = 0
    sound = True
    pivots = np.empty(size, np.int64)
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
            total = y[y_row + p, j]
            for k in range(rank):
                total -= c_out[p, k] * z_out[z_row + k, j]
            z_out[z_row + rank, j] = total / root
        done[p] = 1
        pivots[rank] = p
        for a in range(size):
            if done[a] == 0:
                remaining[a] -= c_out[a, rank] * c_out[a, rank]
        rank += 1
    return rank, sound


@njit(cache=True, fastmath={"reassoc", "contract"})
def _subtract_square(psi, merged, first):
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
def _motion_information(late, cross, early, length):
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
def _measure_variables(c, first, rank, size, z, noise, offset):
    """Multiply the rows of a slot by C'^-1 where C is square, and add their own noise to N."""
    total = z.shape[0]
    if rank < size:
        for r in range(first, first + rank):
            noise[offset + r * total + r] = 1.0
        return
    # C has the rows of a lower triangle in pivoted order: its inverse by elimination with pivots
    work = np.zeros((size, 2 * size))
    for a in range(size):
        for b in range(size):
            work[a, b] = c[b, a]
        work[a, size + a] = 1.0
    for k in range(size):
        pivot = k
        for a in range(k, size):
            if abs(work[a, k]) > abs(work[pivot, k]):
                pivot = a
        for b in range(2 * size):
            swap = work[k, b]
            work[k, b] = work[pivot, b]
            work[pivot, b] = swap
        scale = 1.0 / work[k, k]
        for b in range(2 * size):
            work[k, b] *= scale
        for a in range(size):
            if a != k:
                weight = work[a, k]
                for b in range(2 * size):
                    work[a, b] -= weight * work[k, b]
    fresh = np.zeros((size, z.shape[1]))
    for a in range(size):
        for b in range(size):
            weight = work[a, size + b]
            for j in range(z.shape[1]):
                fresh[a, j] += weight * z[first + b, j]
    for a in range(size):
        for j in range(z.shape[1]):
            z[first + a, j] = fresh[a, j]
        for b in range(a + 1):
            entry = 0.0
            for k in range(size):
                entry += work[a, size + k] * work[b, size + k]
            noise[offset + (first + a) * total + first + b] = entry
    c[:, :] = 0.0
    for a in range(size):
        c[a, a] = 1.0


@njit(cache=True, fastmath={"reassoc", "contract"})
def build_messages(
    candidates, lengths, states, motion_late, motion_cross, motion_early,
    fixed_pointer, fixed_variable, fixed_rank, fixed_own, fixed_cross, fixed_other,
    moving_pointer, moving_variable, moving_rank, moving_own, moving_cross, moving_other,
    column, width, read_steps, slot_pointer, noise_pointer, row_pointer,
    slot_variable, slot_row, slot_rank, slot_c, noise, response, read_noise,
    read_response, read_covariance, row_count, sound,
):  # fmt: skip
    """Build the messages of some candidates into preallocated pools.

    Args:
        candidates: Shape (n,), indices of candidates.
        lengths: Shape (n,), steps of each, cut where the belief is cut.
        states: Shape (N, Lmax), own state of each candidate and step.
        motion_late: Shape (N, Lmax, d, d), A2'A2 of the motion into each step.
        motion_cross: The same, A2'A1.
        motion_early: The same, A1'A1.
        fixed_pointer: Factors that do not depend on announcements, by own state; with variable,
            rank and the three blocks.
        moving_pointer: Factors with announced poses, likewise.
        column: Shape (V,), column of each variable in S or -1 where the cut leaves it out.
        width: Shape (V,), tangent dimension of each variable.
        read_steps: Shape (n, p), steps (1 and up) of own poses that are read.
        slot_pointer: Shape (n + 1,), where each candidate's slots go.
        noise_pointer: Shape (n + 1,), where each candidate's N goes.
        row_pointer: Shape (n + 1,), where each candidate's rows of T and G go.
        slot_variable: Out: variable of each slot; slot_row: first row; slot_rank: rows.
        slot_c: Out: shape (slots, d, d), C of each slot.
        noise: Out: N, each as (rows, rows).
        response: Out: T, shape (all rows, d).
        read_noise: Out: G', shape (all rows, p d).
        read_response: Out: Theta_s, shape (n, p d, d).
        read_covariance: Out: E_ss, shape (n, p d, p d).
        row_count: Out: shape (n,), rows of each message.
        sound: Out: shape (n,), 1 where no digits were lost.
    """
    d = motion_late.shape[2]
    longest = 0
    most = 0
    for n in range(candidates.shape[0]):
        longest = max(longest, lengths[n])
        most = max(most, slot_pointer[n + 1] - slot_pointer[n])
    p = read_steps.shape[1]
    slot_of = np.full(column.shape[0], -1, np.int64)
    touched = np.empty(most + 1, np.int64)
    rows = np.empty(most + 1, np.int64)
    low = np.empty(most + 1, np.int64)
    high = np.empty(most + 1, np.int64)
    big = np.empty((most + 1, d, d))
    y = np.empty(((most + 1) * d, longest * d))
    zt = np.empty(((most + 1) * d, longest * d))
    before = np.empty(longest * d)
    first = np.empty(longest * d, np.int64)
    for n in range(candidates.shape[0]):
        c = candidates[n]
        length = lengths[n]
        q = length * d
        psi = _motion_information(motion_late[c], motion_cross[c], motion_early[c], length)
        count = 0
        for i in range(length):
            s = states[c, i]
            count = _gather(
                fixed_pointer, fixed_variable, fixed_rank, fixed_own, fixed_cross, fixed_other,
                s, i, d, column, slot_of, touched, count, psi, y, big, rows, low, high,
            )  # fmt: skip
            count = _gather(
                moving_pointer, moving_variable, moving_rank, moving_own, moving_cross,
                moving_other, s, i, d, column, slot_of, touched, count, psi, y, big, rows, low,
                high,
            )  # fmt: skip
        for j in range(q):
            before[j] = psi[j, j]
        good = True
        total = 0
        for i in range(q):
            first[i] = max((i // d - 1) * d, 0)
        for slot in range(count):
            lo, hi = low[slot] * d, high[slot] * d
            for i in range(lo, hi):
                first[i] = min(first[i], lo)
            place = slot_pointer[n] + slot
            zt[total : total + d, :q] = 0.0
            slot_c[place, :, :] = 0.0
            rank, fine = _split(
                big[slot], y, slot * d, width[touched[slot]], rows[slot], lo, hi,
                slot_c[place], zt, total,
            )  # fmt: skip
            good = good and fine
            slot_variable[place] = touched[slot]
            slot_row[place] = total
            slot_rank[place] = rank
            slot_of[touched[slot]] = -1
            total += rank
        row_count[n] = total
        merged = zt[:total, :q].copy()
        _subtract_square(psi, merged, first)
        sound[n] = 0
        if not cholesky_skyline(psi, first):
            continue
        for j in range(q):
            if psi[j, j] * psi[j, j] < CANCELLATION_LIMIT * before[j]:
                good = False
        sound[n] = 1 if good else 0
        inverse = inverse_skyline(psi, first)
        reads = np.empty((q, d + p * d))
        # t = L^-1 Psi_ck (here with its sign) and w = L^-1 e_s: columns of L^-1, combined or picked
        for i in range(q):
            for b in range(d):
                entry = 0.0
                for j in range(min(i + 1, d)):
                    entry -= inverse[i, j] * motion_cross[c, 0, j, b]
                reads[i, b] = entry
            for k in range(p):
                base = (read_steps[n, k] - 1) * d
                for b in range(d):
                    reads[i, d + k * d + b] = inverse[i, base + b]
        z = np.dot(merged, inverse.T)
        offset = noise_pointer[n]
        noise[offset : offset + total * total] = 0.0
        for slot in range(slot_pointer[n], slot_pointer[n] + count):
            _measure_variables(
                slot_c[slot], slot_row[slot], slot_rank[slot], width[slot_variable[slot]], z,
                noise, offset,
            )  # fmt: skip
        product = np.dot(z, z.T)
        for a in range(total):
            for b in range(a + 1):
                noise[offset + a * total + b] += product[a, b]
        seen = np.dot(z, reads)
        base = row_pointer[n]
        for a in range(total):
            for b in range(d):
                response[base + a, b] = seen[a, b]
            for b in range(p * d):
                read_noise[base + a, b] = seen[a, d + b]
        met = np.dot(reads.T, reads)
        for a in range(p * d):
            for b in range(d):
                read_response[n, a, b] = met[d + a, b]
            for b in range(p * d):
                read_covariance[n, a, b] = met[d + a, d + b]
