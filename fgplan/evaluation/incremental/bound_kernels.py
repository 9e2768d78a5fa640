"""Compiled: a lower bound on the covariances after following a candidate, without its message.

Posterior covariances grow with the prior covariance, and a Schur complement takes away:

    S_Z = S[:, z] S[z, z]^-1 S[z, :] <= S,

so every covariance computed with S_Z is a lower bound. In words: pretend that the others'
deviations are determined by their deviations at the variables z that are read. With
B = S[:, z] L_z^-T, S[z, z] = L_z L_z', all of the universe is x = B v with v ~ N(0, I), k numbers,
and the chain's factors give

    I_v = I + sum_j B_j'D_j B_j + B_k'A1'A1 B_k - Y'Y,    Psi' = motion + sum A_i'A_i = L L',
    Y = L^-1 (sum A_i'A_j B_j, first pose + A2'A1 B_k)

where Psi' is block tridiagonal because nothing outside the chain is eliminated. Own pose:
w'w + (w'Y) I_v^-1 (w'Y)', any other variable g: B_g I_v^-1 B_g'.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.evaluation.incremental.candidate_table import MotionBlocks
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.typing import FloatArray, IntArray

LOSS_LIMIT = 1e5
"""Largest ratio of the terms of a diagonal entry of I_v to its pivot; beyond it, no bound."""


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def _add_planar(
    cross: FloatArray, root: FloatArray, from_b: FloatArray, right: FloatArray, rows: FloatArray
) -> None:
    """Add A_i'A_v B to the right-hand side and sqrt(D)' B to the rows, for two planar poses."""
    c00, c01, c02 = cross[0, 0], cross[0, 1], cross[0, 2]
    c10, c11, c12 = cross[1, 0], cross[1, 1], cross[1, 2]
    c20, c21, c22 = cross[2, 0], cross[2, 1], cross[2, 2]
    r00, r10, r11 = root[0, 0], root[1, 0], root[1, 1]
    r20, r21, r22 = root[2, 0], root[2, 1], root[2, 2]
    for j in range(from_b.shape[1]):
        b0, b1, b2 = from_b[0, j], from_b[1, j], from_b[2, j]
        right[0, j] += c00 * b0 + c10 * b1 + c20 * b2
        right[1, j] += c01 * b0 + c11 * b1 + c21 * b2
        right[2, j] += c02 * b0 + c12 * b1 + c22 * b2
        rows[0, j] = r00 * b0 + r10 * b1 + r20 * b2
        rows[1, j] = r11 * b1 + r21 * b2
        rows[2, j] = r22 * b2


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def _add_state(
    factors: FactorBlocks,
    s: int,
    column: IntArray,
    width: IntArray,
    columns_b: FloatArray,
    diagonal: FloatArray,
    right: FloatArray,
    rows: FloatArray,
    used: int,
    root: FloatArray,
) -> int:
    """Add one state's factors; returns the number of rows of sqrt(D) B used so far."""
    d = diagonal.shape[0]
    k = columns_b.shape[1]
    for m in range(factors.pointer[s], factors.pointer[s + 1]):
        v = factors.variable[m]
        col = column[v]
        if col < 0:
            continue
        size = width[v]
        for a in range(d):
            for b in range(d):
                diagonal[a, b] += factors.own[m, a, b]
        for a in range(size):
            for b in range(a + 1):
                total = factors.other[m, a, b]
                for t in range(b):
                    total -= root[a, t] * root[b, t]
                if a == b:
                    root[a, a] = np.sqrt(total) if total > 1e-13 * factors.other[m, a, a] else 0.0
                else:
                    root[a, b] = total / root[b, b] if root[b, b] > 0.0 else 0.0
        if size == 3 and d == 3:  # one pass over j: short loops cost more than their work
            _add_planar(factors.cross[m], root, columns_b[col : col + 3], right, rows[used:])
            used += 3
            continue
        for a in range(size):
            from_b = columns_b[col + a]
            for i in range(d):
                weight = factors.cross[m, a, i]
                target = right[i]
                for j in range(k):
                    target[j] += weight * from_b[j]
        for a in range(size):
            target = rows[used + a]
            for j in range(k):
                target[j] = 0.0
            for t in range(a, size):
                weight = root[t, a]
                from_b = columns_b[col + t]
                for j in range(k):
                    target[j] += weight * from_b[j]
        used += size
    return used


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def _forward(
    i: int, carry: FloatArray, lower: FloatArray, right: FloatArray, chain_y: FloatArray
) -> None:
    """Rows of Y of pose i: L_ii^-1 (right - L_i,i-1 Y_i-1)."""
    d, k = right.shape
    if d == 3:  # one pass over j: short loops cost more than their work
        c00, c01, c02 = carry[0, 0], carry[0, 1], carry[0, 2]
        c10, c11, c12 = carry[1, 0], carry[1, 1], carry[1, 2]
        c20, c21, c22 = carry[2, 0], carry[2, 1], carry[2, 2]
        l10, l20, l21 = lower[1, 0], lower[2, 0], lower[2, 1]
        s0, s1, s2 = 1.0 / lower[0, 0], 1.0 / lower[1, 1], 1.0 / lower[2, 2]
        for j in range(k):
            y0, y1, y2 = right[0, j], right[1, j], right[2, j]
            if i > 0:
                b0, b1, b2 = chain_y[3 * i - 3, j], chain_y[3 * i - 2, j], chain_y[3 * i - 1, j]
                y0 -= c00 * b0 + c01 * b1 + c02 * b2
                y1 -= c10 * b0 + c11 * b1 + c12 * b2
                y2 -= c20 * b0 + c21 * b1 + c22 * b2
            y0 *= s0
            y1 = (y1 - l10 * y0) * s1
            y2 = (y2 - l20 * y0 - l21 * y1) * s2
            chain_y[3 * i, j], chain_y[3 * i + 1, j], chain_y[3 * i + 2, j] = y0, y1, y2
        return
    for a in range(d):
        for j in range(k):
            total = right[a, j]
            if i > 0:
                for t in range(d):
                    total -= carry[a, t] * chain_y[(i - 1) * d + t, j]
            for t in range(a):
                total -= lower[a, t] * chain_y[i * d + t, j]
            chain_y[i * d + a, j] = total / lower[a, a]


@njit(cache=True, fastmath={"reassoc", "contract"})
def lower_covariances(
    candidates: IntArray,
    lengths: IntArray,
    states: IntArray,
    motion: MotionBlocks,
    fixed: FactorBlocks,
    moving: FactorBlocks,
    column: IntArray,
    width: IntArray,
    columns_b: FloatArray,
    start: int,
    read_own: int,
    read_columns: IntArray,
    valid: IntArray,
    out: FloatArray,
) -> None:
    """Lower bounds on the joint covariance of what is read, for some candidates.

    Args:
        candidates: Shape (n,), indices of candidates.
        lengths: Shape (n,), steps of each; the last pose is the own pose that is read.
        states: Shape (N, Lmax), own state of each candidate and step.
        motion: Blocks of the motion factors, by candidate and step.
        fixed: Factors of the own states that do not depend on announcements.
        moving: Factors of the own states with announced poses.
        column: Shape (V,), first scalar of each variable in S, or -1.
        width: Shape (V,), dimension of each variable.
        columns_b: B, shape (U, k).
        start: First scalar of x_k.
        read_own: 1 where the own last pose is read, first; 0 where it is not.
        read_columns: Shape (g,), scalars of the universe that are read after it.
        valid: Out: shape (n,), 1 where the bound may be used.
        out: Out: shape (n, d + g, d + g).
    """
    d = motion.late.shape[2]
    k = columns_b.shape[1]
    own = d * read_own
    read = own + read_columns.shape[0]
    most = 0
    longest = 0
    for n in range(candidates.shape[0]):
        count = 0
        for i in range(lengths[n]):
            s = states[candidates[n], i]
            count += fixed.pointer[s + 1] - fixed.pointer[s]
            count += moving.pointer[s + 1] - moving.pointer[s]
        most = max(most, count)
        longest = max(longest, lengths[n])
    rows = np.empty((most * d + d + 1, k))
    chain_y = np.empty((longest * d, k))
    root = np.empty((d, d))
    diagonal = np.empty((d, d))
    lower = np.empty((d, d))
    carry = np.empty((d, d))
    right = np.empty((d, k))
    information = np.empty((k, k))
    reads = np.empty((read, k))
    for n in range(candidates.shape[0]):
        c = candidates[n]
        length = lengths[n]
        used = np.int64(0)  # see interface_kernels
        good = True
        for i in range(length):
            s = states[c, i]
            for a in range(d):
                for b in range(d):
                    diagonal[a, b] = motion.late[c, i, a, b]
                    if i + 1 < length:
                        diagonal[a, b] += motion.early[c, i + 1, a, b]
                for j in range(k):
                    right[a, j] = 0.0
            if i == 0:
                for a in range(d):
                    for b in range(d):
                        for j in range(k):
                            right[a, j] += motion.cross[c, 0, a, b] * columns_b[start + b, j]
            used = _add_state(fixed, s, column, width, columns_b, diagonal, right, rows, used, root)
            used = _add_state(
                moving, s, column, width, columns_b, diagonal, right, rows, used, root
            )
            if i > 0:
                for a in range(d):
                    for b in range(d):
                        total = motion.cross[c, i, a, b]
                        for t in range(b):
                            total -= carry[a, t] * lower[b, t]
                        carry[a, b] = total / lower[b, b]
                for a in range(d):
                    for b in range(d):
                        total = 0.0
                        for t in range(d):
                            total += carry[a, t] * carry[b, t]
                        diagonal[a, b] -= total
            for a in range(d):
                for b in range(a + 1):
                    total = diagonal[a, b]
                    for t in range(b):
                        total -= lower[a, t] * lower[b, t]
                    if a == b:
                        if not total > 0.0:
                            good = False
                            total = 1.0
                        lower[a, a] = np.sqrt(total)
                    else:
                        lower[a, b] = total / lower[b, b]
            _forward(i, carry, lower, right, chain_y)
        for a in range(d):
            for b in range(a + 1):
                total = motion.early[c, 0, a, b]
                for t in range(b):
                    total -= carry[a, t] * carry[b, t]
                carry[a, b] = np.sqrt(max(total, 0.0)) if a == b else total / carry[b, b]
        for a in range(d):
            for j in range(k):
                total = 0.0
                for t in range(a, d):
                    total += carry[t, a] * columns_b[start + t, j]
                rows[used + a, j] = total
        used += d
        gained = np.dot(rows[:used].T, rows[:used])
        spent = np.dot(chain_y[: length * d].T, chain_y[: length * d])
        for a in range(k):
            for b in range(a + 1):
                total = gained[a, b] - spent[a, b]
                if a == b:
                    total += 1.0
                for t in range(b):
                    total -= information[a, t] * information[b, t]
                if a == b:
                    if not total * LOSS_LIMIT > 1.0 + gained[a, a]:
                        good = False
                        total = 1.0
                    information[a, a] = np.sqrt(total)
                else:
                    information[a, b] = total / information[b, b]
        valid[n] = 1 if good else 0
        if not good:
            continue
        last = (length - 1) * d
        # w = L^-1 e of the last pose: only the last diagonal block of L takes part
        for a in range(own):
            for t in range(d):
                total = 1.0 if t == a else 0.0
                for u in range(t):
                    total -= lower[t, u] * carry[u, a]
                carry[t, a] = total / lower[t, t]
        for a in range(own):
            for j in range(k):
                total = 0.0
                for t in range(d):
                    total -= carry[t, a] * chain_y[last + t, j]
                reads[a, j] = total
        for g in range(read_columns.shape[0]):
            for j in range(k):
                reads[own + g, j] = columns_b[read_columns[g], j]
        for r in range(read):
            row = reads[r]
            for j in range(k):
                total = row[j]
                for t in range(j):
                    total -= information[j, t] * row[t]
                row[j] = total / information[j, j]
        for a in range(read):
            for b in range(a + 1):
                total = 0.0
                for j in range(k):
                    total += reads[a, j] * reads[b, j]
                out[n, a, b] = total
                out[n, b, a] = total
        for a in range(own):
            for b in range(own):
                total = 0.0
                for t in range(d):
                    total += carry[t, a] * carry[t, b]
                out[n, a, b] += total
