"""Where the messages of segments live: flat arrays, one segment after the other.

A segment is a piece of a candidate path: some states, the motion into each of them, and their
factors with landmarks and past poses. Its poses all stay in its message, because any of them may
meet an announced pose; with Y, C and D = C C' as in ``message_kernels``, what a segment says is

    e_v = C' x_v + Y x + n for each variable v that it touches, and the information
    J = motion + sum A_i'A_i - Y'Y  on x = (pose before the segment, its poses).
"""

from typing import NamedTuple

import numpy as np

from fgplan.typing import BoolArray, FloatArray, IntArray


class SegmentPool(NamedTuple):
    """Messages of M segments; a tuple, because compiled code takes it as it is.

    Attributes:
        steps: Shape (M,), states of each; its size is q = (steps + 1) d.
        sound: Shape (M,), 1 where no digits were lost.
        square_pointer: Shape (M + 1,), where J of each begins.
        row_pointer: Shape (M + 1,), where its q rows begin.
        slot_pointer: Shape (M + 1,), where its slots begin.
        merged_pointer: Shape (M + 1,), where Y of its slots begins.
        information: J of each as (q, q), lower triangle.
        lost: Diagonal of Y'Y.
        first: First column of each row of J that may be other than zero.
        slot_variable: Variable of each slot.
        slot_rank: Its rows.
        slot_square: Whether its C is a well-conditioned triangle.
        slot_c: C, shape (d, d) each.
        merged: Y of each slot as (d, q), of which the first rows are used.
    """

    steps: IntArray
    sound: IntArray
    square_pointer: IntArray
    row_pointer: IntArray
    slot_pointer: IntArray
    merged_pointer: IntArray
    information: FloatArray
    lost: FloatArray
    first: IntArray
    slot_variable: IntArray
    slot_rank: IntArray
    slot_square: BoolArray
    slot_c: FloatArray
    merged: FloatArray

    @property
    def bytes(self) -> int:
        """Memory held."""
        return sum(int(array.nbytes) for array in self)

    def bytes_each(self) -> IntArray:
        """Memory of each message, shape (M,)."""
        slots = np.diff(self.slot_pointer)
        of_slot = 17 + 8 * self.slot_c[:1].size
        flat = np.diff(self.square_pointer) + np.diff(self.merged_pointer)
        return 8 * (flat + 2 * np.diff(self.row_pointer) + 6) + of_slot * slots


class CandidateSegments(NamedTuple):
    """Segments that each candidate consists of, in order.

    Attributes:
        pointer: Shape (N + 1,), where the segments of each candidate begin.
        end: Shape (S,), one beyond the place of its last state within the candidate, from 0.
        number: Shape (S,), place of its message in the pool.
    """

    pointer: IntArray
    end: IntArray
    number: IntArray


def segment_room(steps: IntArray, slots: IntArray, dim: int) -> SegmentPool:
    """Room for messages.

    Args:
        steps: Shape (M,), states of each segment.
        slots: Shape (M,), variables that each touches.
        dim: Tangent dimension d of a pose.

    Returns:
        A pool whose pointers are set.
    """
    size = (steps + 1) * dim
    square_pointer, row_pointer, slot_pointer, merged_pointer = (
        np.append(0, np.cumsum(lengths)) for lengths in (size**2, size, slots, slots * dim * size)
    )
    rows, all_slots = int(row_pointer[-1]), int(slot_pointer[-1])
    return SegmentPool(
        steps,
        np.zeros(len(steps), np.int64),
        square_pointer,
        row_pointer,
        slot_pointer,
        merged_pointer,
        np.zeros(int(square_pointer[-1])),
        np.zeros(rows),
        np.zeros(rows, np.int64),
        np.zeros(all_slots, np.int64),
        np.zeros(all_slots, np.int64),
        np.zeros(all_slots, np.bool_),
        np.zeros((all_slots, dim, dim)),
        np.zeros(int(merged_pointer[-1])),
    )


def no_segments(candidates: int, dim: int) -> tuple[CandidateSegments, SegmentPool]:
    """Candidates of which nothing is kept as a segment."""
    none = np.zeros(0, np.int64)
    which = CandidateSegments(np.zeros(candidates + 1, np.int64), none, none)
    return which, segment_room(none, none, dim)


def take_segments(pool: SegmentPool, places: IntArray) -> SegmentPool:
    """Some of the messages, in a given order.

    Args:
        pool: Messages.
        places: Shape (n,), places of those wanted.

    Returns:
        A pool of n messages.
    """
    pointers, inside = [], []
    for pointer in pool[2:6]:
        length = np.diff(pointer)[places]
        fresh = np.append(0, np.cumsum(length))
        pointers.append(fresh)
        inside.append(np.repeat(pointer[places] - fresh[:-1], length) + np.arange(fresh[-1]))
    squares, rows, slots, merged = inside
    return SegmentPool(
        pool.steps[places],
        pool.sound[places],
        pointers[0],
        pointers[1],
        pointers[2],
        pointers[3],
        pool.information[squares],
        pool.lost[rows],
        pool.first[rows],
        pool.slot_variable[slots],
        pool.slot_rank[slots],
        pool.slot_square[slots],
        pool.slot_c[slots],
        pool.merged[merged],
    )


def join_segments(first: SegmentPool, second: SegmentPool) -> SegmentPool:
    """Messages of two pools, one after the other."""
    pointers = [np.append(a[:-1], a[-1] + b) for a, b in zip(first[2:6], second[2:6], strict=True)]
    rest = [np.concatenate([a, b]) for a, b in zip(first[6:], second[6:], strict=True)]
    ends = [np.concatenate([a, b]) for a, b in zip(first[:2], second[:2], strict=True)]
    return SegmentPool(*ends, *pointers, *rest)
