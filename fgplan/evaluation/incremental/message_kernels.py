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

import numpy as np

from fgplan.compiling import njit
from fgplan.evaluation.incremental.candidate_table import MotionBlocks
from fgplan.evaluation.incremental.cholesky_kernels import cholesky_skyline, inverse_skyline
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.interface_kernels import (
    CANCELLATION_LIMIT,
    gather_factors,
    interface_room,
    measure_variables,
    split_slot,
)
from fgplan.evaluation.incremental.message_pool import MessagePool
from fgplan.evaluation.incremental.segment_pool import CandidateSegments, SegmentPool
from fgplan.typing import BoolArray, FloatArray, IntArray


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
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


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def _add_motion(
    late: FloatArray, cross: FloatArray, early: FloatArray, begin: int, psi: FloatArray
) -> None:
    """Put the motion factors into the steps from ``begin`` on into Psi, lower triangle."""
    d = late.shape[1]
    for i in range(begin, psi.shape[0] // d):
        for a in range(d):
            for b in range(d):
                psi[i * d + a, i * d + b] += late[i, a, b]
                if i > 0:
                    psi[(i - 1) * d + a, (i - 1) * d + b] += early[i, a, b]
                    psi[i * d + a, (i - 1) * d + b] = cross[i, a, b]


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def _add_segment(
    segments: SegmentPool,
    k: int,
    begin: int,
    psi: FloatArray,
    lost: FloatArray,
    first: IntArray,
    merged_rows: FloatArray,
    square: BoolArray,
    slots: int,
    rows: int,
    pool: MessagePool,
    n: int,
) -> tuple[int, int]:
    """Put segment k, whose first state has place ``begin``, into message n; slots and rows."""
    d = pool.slot_c.shape[1]
    q, width = psi.shape[0], (segments.steps[k] + 1) * d
    offset = (begin - 1) * d  # the pose before it has place 0 in the segment
    skipped = 0 if begin > 0 else d  # that pose is x_k
    row = segments.row_pointer[k]
    for i in range(skipped, width):
        source = segments.square_pointer[k] + i * width
        target = psi[offset + i]
        for j in range(max(skipped, segments.first[row + i]), i + 1):
            target[offset + j] += segments.information[source + j]
        lost[offset + i] += segments.lost[row + i]
        first[offset + i] = min(first[offset + i], offset + max(skipped, segments.first[row + i]))
    for s in range(segments.slot_pointer[k], segments.slot_pointer[k + 1]):
        place = pool.slot_pointer[n] + slots
        rank = segments.slot_rank[s]
        pool.slot_variable[place] = segments.slot_variable[s]
        pool.slot_row[place] = rows
        pool.slot_rank[place] = rank
        for a in range(d):
            for b in range(d):
                pool.slot_c[place, a, b] = segments.slot_c[s, a, b]
        square[slots] = segments.slot_square[s]
        source = segments.merged_pointer[k] + (s - segments.slot_pointer[k]) * d * width
        for r in range(rank):
            merged_rows[rows + r, :q] = 0.0
            for j in range(d, width):
                merged_rows[rows + r, offset + j] = segments.merged[source + r * width + j]
        slots += 1
        rows += rank
    return slots, rows


@njit(cache=True, fastmath={"reassoc", "contract"})
def build_messages(
    lengths: IntArray,
    states: IntArray,
    motion: MotionBlocks,
    fixed: FactorBlocks,
    moving: FactorBlocks,
    consists_of: CandidateSegments,
    segments: SegmentPool,
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
        consists_of: Segments of each candidate, from its first state on; perhaps not all of it.
        segments: What those say; the rest is taken from ``motion`` and ``fixed``.
        column: Shape (V,), first scalar of each variable in S or -1 where the cut leaves it out.
        width: Shape (V,), tangent dimension of each variable.
        read_steps: Shape (n, p), steps (1 and up) of own poses that are read.
        pool: In: candidates and pointers. Out: all the rest.
    """
    d = motion.late.shape[2]
    longest, most = np.int64(0), np.int64(1)
    for n in range(lengths.shape[0]):
        longest = max(longest, lengths[n])
        most = max(most, pool.slot_pointer[n + 1] - pool.slot_pointer[n])
    found = interface_room(column.shape[0], most, longest, d)
    merged_rows = np.empty((most * d, longest * d))
    square = np.empty(most, np.bool_)
    for n in range(lengths.shape[0]):
        c = pool.candidates[n]
        length = lengths[n]
        q = length * d
        psi = np.zeros((q, q))
        before = np.zeros(q)
        first = np.empty(q, np.int64)
        for i in range(q):
            first[i] = max((i // d - 1) * d, 0)
        good = True
        begin = slots = total = np.int64(0)  # see interface_kernels
        for g in range(consists_of.pointer[c], consists_of.pointer[c + 1]):
            if consists_of.end[g] > length:
                break
            k = consists_of.number[g]
            slots, total = _add_segment(
                segments, k, begin, psi, before, first, merged_rows, square, slots, total, pool, n
            )
            good = good and segments.sound[k] == 1
            begin = consists_of.end[g]
        _add_motion(motion.late[c], motion.cross[c], motion.early[c], begin, psi)
        count = np.int64(0)
        for i in range(length):
            if i >= begin:
                count = gather_factors(fixed, states[c, i], i, column, found, count, psi)
            count = gather_factors(moving, states[c, i], i, column, found, count, psi)
        for i in range(q):
            before[i] += psi[i, i]
        own = total
        for slot in range(count):
            lo, hi = found.low[slot] * d, found.high[slot] * d
            for i in range(lo, hi):
                first[i] = min(first[i], lo)
            place = pool.slot_pointer[n] + slots
            rank, square[slots], fine = split_slot(
                found, slot, width, pool.slot_c[place], merged_rows[total : total + d, :q]
            )
            good = good and fine
            pool.slot_variable[place] = found.variable[slot]
            pool.slot_row[place] = total
            pool.slot_rank[place] = rank
            found.slot_of[found.variable[slot]] = -1
            slots += 1
            total += rank
        pool.row_count[n] = total
        merged = merged_rows[:total, :q].copy()
        _subtract_square(psi, merged[own:], first)
        pool.sound[n] = 0
        if not cholesky_skyline(psi, first):
            continue
        for j in range(q):
            if psi[j, j] * psi[j, j] < CANCELLATION_LIMIT * before[j]:
                good = False
        pool.sound[n] = 1 if good else 0
        inverse = inverse_skyline(psi, first)
        z = np.dot(merged, inverse.T)
        for slot in range(slots):
            place = pool.slot_pointer[n] + slot
            measure_variables(
                pool.slot_c[place],
                pool.slot_row[place],
                pool.slot_rank[place],
                square[slot],
                z,
                pool.noise,
                pool.noise_pointer[n],
            )
        _write_message(n, inverse, motion.cross[c, 0], read_steps[n], z, pool)


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
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
