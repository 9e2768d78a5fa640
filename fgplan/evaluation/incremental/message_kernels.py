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

C may have fewer columns than rows (range-only, bearing-only): pivoted Cholesky gives it. Nothing
here is subtracted that was added, except Y'Y inside Psi; where that cancels, the message is
flagged and the path is evaluated by QR.
"""

import numpy as np
from numba import njit

from fgplan.evaluation.incremental.cholesky_kernels import cholesky
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
    psi = np.empty((longest * d, longest * d))
    before = np.empty(longest * d)
    tk = np.empty((longest * d, d))
    w = np.empty((longest * d, p * d))
    for n in range(candidates.shape[0]):
        c = candidates[n]
        length = lengths[n]
        q = length * d
        psi[:q, :q] = 0.0
        for i in range(length):
            for a in range(d):
                for b in range(d):
                    psi[i * d + a, i * d + b] = motion_late[c, i, a, b]
                    if i + 1 < length:
                        psi[i * d + a, i * d + b] += motion_early[c, i + 1, a, b]
                    if i > 0:
                        psi[i * d + a, (i - 1) * d + b] = motion_cross[c, i, a, b]
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
        total_rows = 0
        for slot in range(count):
            lo, hi = low[slot] * d, high[slot] * d
            place = slot_pointer[n] + slot
            zt[total_rows : total_rows + d, :q] = 0.0
            slot_c[place, :, :] = 0.0
            rank, fine = _split(
                big[slot], y, slot * d, width[touched[slot]], rows[slot], lo, hi,
                slot_c[place], zt, total_rows,
            )  # fmt: skip
            good = good and fine
            slot_variable[place] = touched[slot]
            slot_row[place] = total_rows
            slot_rank[place] = rank
            for r in range(total_rows, total_rows + rank):
                row = zt[r]
                for i in range(lo, hi):
                    value = row[i]
                    if value != 0.0:
                        target = psi[i]
                        for j in range(lo, i + 1):
                            target[j] -= value * row[j]
            slot_of[touched[slot]] = -1
            low[slot] = total_rows
            high[slot] = lo
            total_rows += rank
        row_count[n] = total_rows
        if not cholesky(psi, q):
            sound[n] = 0
            continue
        for j in range(q):
            if psi[j, j] * psi[j, j] < CANCELLATION_LIMIT * before[j]:
                good = False
        sound[n] = 1 if good else 0
        for slot in range(count):
            lo = high[slot]
            stop = low[slot + 1] if slot + 1 < count else total_rows
            for r in range(low[slot], stop):
                row = zt[r]
                for i in range(lo, q):
                    factor = psi[i]
                    total = row[i]
                    for j in range(lo, i):
                        total -= factor[j] * row[j]
                    row[i] = total / factor[i]
        for b in range(d):
            for i in range(q):
                total = motion_cross[c, 0, i, b] if i < d else 0.0
                for j in range(i):
                    total -= psi[i, j] * tk[j, b]
                tk[i, b] = total / psi[i, i]
        for k in range(p):
            base = (read_steps[n, k] - 1) * d
            for b in range(d):
                column_w = k * d + b
                for i in range(base):
                    w[i, column_w] = 0.0
                for i in range(base, q):
                    total = 1.0 if i == base + b else 0.0
                    for j in range(base, i):
                        total -= psi[i, j] * w[j, column_w]
                    w[i, column_w] = total / psi[i, i]
        z = zt[:total_rows, :q].copy()
        offset = noise_pointer[n]
        if total_rows > 24:
            product = np.dot(z, z.T)
            for a in range(total_rows):
                for b in range(a + 1):
                    noise[offset + a * total_rows + b] = product[a, b]
                noise[offset + a * total_rows + a] += 1.0
        else:
            for a in range(total_rows):
                for b in range(a + 1):
                    total = 1.0 if a == b else 0.0
                    for j in range(q):
                        total += z[a, j] * z[b, j]
                    noise[offset + a * total_rows + b] = total
        base = row_pointer[n]
        for a in range(total_rows):
            for b in range(d):
                total = 0.0
                for j in range(q):
                    total -= z[a, j] * tk[j, b]
                response[base + a, b] = total
            for b in range(p * d):
                total = 0.0
                for j in range(q):
                    total += z[a, j] * w[j, b]
                read_noise[base + a, b] = total
        for a in range(p * d):
            for b in range(d):
                total = 0.0
                for j in range(q):
                    total -= w[j, a] * tk[j, b]
                read_response[n, a, b] = total
            for b in range(p * d):
                total = 0.0
                for j in range(q):
                    total += w[j, a] * w[j, b]
                read_covariance[n, a, b] = total
