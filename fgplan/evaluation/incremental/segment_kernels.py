"""Compiled: where candidate paths are cut into segments, and the messages of those.

What such a message is, ``segment_pool`` says. A path is cut only where no landmark or past pose is
touched from both sides, so every variable is merged within one segment, and a path put together
from its segments has the rows of a path built whole.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.evaluation.incremental.candidate_table import MotionBlocks
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.interface_kernels import (
    Interface,
    gather_factors,
    interface_room,
    split_slot,
)
from fgplan.evaluation.incremental.segment_pool import SegmentPool
from fgplan.typing import BoolArray, IntArray


@njit(cache=True)
def crossed_boundaries(
    lengths: IntArray, states: IntArray, factors: FactorBlocks, size: int
) -> BoolArray:
    """Where a path must not be cut.

    Args:
        lengths: Shape (N,), steps of each candidate.
        states: Shape (N, Lmax), own state of each candidate and step.
        factors: Factors of the own states that do not depend on announcements.
        size: Number of variables V.

    Returns:
        Shape (N, Lmax), whether a variable is touched both before each state and from it on.
    """
    crossed = np.zeros(states.shape, np.bool_)
    met_by = np.full(size, -1, np.int64)
    low, high, met = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    for n in range(lengths.shape[0]):
        found = 0
        for i in range(lengths[n]):
            s = states[n, i]
            for m in range(factors.pointer[s], factors.pointer[s + 1]):
                v = factors.variable[m]
                if met_by[v] != n:
                    met_by[v] = n
                    low[v] = i
                    met[found] = v
                    found += 1
                high[v] = i
        for k in range(found):
            for i in range(low[met[k]] + 1, high[met[k]] + 1):
                crossed[n, i] = True
    return crossed


@njit(cache=True)
def count_slots(
    candidate: IntArray,
    begin: IntArray,
    end: IntArray,
    states: IntArray,
    factors: FactorBlocks,
    size: int,
) -> IntArray:
    """Distinct variables that each segment touches, shape (M,); arguments as below."""
    seen = np.full(size, -1, np.int64)
    counts = np.zeros(candidate.shape[0], np.int64)
    for k in range(candidate.shape[0]):
        for i in range(begin[k], end[k]):
            s = states[candidate[k], i]
            for m in range(factors.pointer[s], factors.pointer[s + 1]):
                if seen[factors.variable[m]] != k:
                    seen[factors.variable[m]] = k
                    counts[k] += 1
    return counts


@njit(cache=True, fastmath={"reassoc", "contract"})
def build_segments(
    candidate: IntArray,
    begin: IntArray,
    end: IntArray,
    states: IntArray,
    motion: MotionBlocks,
    factors: FactorBlocks,
    width: IntArray,
    pool: SegmentPool,
) -> None:
    """Build the messages of some segments into a pool whose pointers are set.

    Args:
        candidate: Shape (M,), a candidate that each segment is part of.
        begin: Shape (M,), place of its first state, from 0.
        end: Shape (M,), one beyond the last.
        states: Shape (N, Lmax), own state of each candidate and step.
        motion: Blocks of the motion factors, by candidate and step.
        factors: Factors of the own states that do not depend on announcements.
        width: Shape (V,), tangent dimension of each variable.
        pool: In: steps and pointers. Out: all the rest.
    """
    d = motion.late.shape[2]
    longest, most = np.int64(0), np.int64(1)  # see interface_kernels
    for k in range(candidate.shape[0]):
        longest = max(longest, pool.steps[k] + 1)
        most = max(most, pool.slot_pointer[k + 1] - pool.slot_pointer[k])
    found = interface_room(width.shape[0], most, longest, d)
    for k in range(candidate.shape[0]):
        _build_segment(
            k, candidate[k], begin[k], end[k], states, motion, factors, width, found, pool
        )


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def _build_segment(
    k: int,
    c: int,
    begin: int,
    end: int,
    states: IntArray,
    motion: MotionBlocks,
    factors: FactorBlocks,
    width: IntArray,
    found: Interface,
    pool: SegmentPool,
) -> None:
    """Build one message; the pose before the segment has place 0."""
    d = motion.late.shape[2]
    q = (end - begin + 1) * d
    at = pool.square_pointer[k]
    psi = pool.information[at : at + q * q].reshape((q, q))
    first = pool.first[pool.row_pointer[k] : pool.row_pointer[k] + q]
    lost = pool.lost[pool.row_pointer[k] : pool.row_pointer[k] + q]
    count = np.int64(0)
    for i in range(1, end - begin + 1):
        step = begin + i - 1
        for a in range(d):
            for b in range(d):
                psi[(i - 1) * d + a, (i - 1) * d + b] += motion.early[c, step, a, b]
                psi[i * d + a, (i - 1) * d + b] = motion.cross[c, step, a, b]
                psi[i * d + a, i * d + b] += motion.late[c, step, a, b]
            first[i * d + a] = (i - 1) * d
        # landmarks and past poses are in every belief: their widths stand for their columns
        count = gather_factors(factors, states[c, step], i, width, found, count, psi)
    pool.sound[k] = 1
    for slot in range(count):
        lo, hi = found.low[slot] * d, found.high[slot] * d
        place = pool.slot_pointer[k] + slot
        at = pool.merged_pointer[k] + slot * d * q
        merged = pool.merged[at : at + d * q].reshape((d, q))
        rank, square, fine = split_slot(found, slot, width, pool.slot_c[place], merged)
        pool.slot_variable[place] = found.variable[slot]
        pool.slot_rank[place] = rank
        pool.slot_square[place] = square
        found.slot_of[found.variable[slot]] = -1
        if not fine:
            pool.sound[k] = 0
        for i in range(lo, hi):
            first[i] = min(first[i], lo)
        for r in range(rank):
            row = merged[r]
            for i in range(lo, hi):
                value = row[i]
                lost[i] += value * value
                for j in range(lo, i + 1):
                    psi[i, j] -= value * row[j]
