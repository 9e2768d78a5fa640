"""Segments of candidate paths, known by their content and carried from session to session.

Between two planning sessions the robots move and the prior grows. A candidate that is kept has
another first motion and then the states that it had, at other steps and times. What is taken over
are the messages of its segments (see ``segment_pool``), if their content is the same to the last
bit: for every step the pose before it, the pose after it, the noise of the motion, and for each
factor with a landmark or past pose the variable's key and the whitened blocks, which hold noise and
linearisation point. A landmark whose estimate moved gives other blocks, so the segments that see it
are built anew. Steps, times and numbers of variables are no part of it, and what is announced is
not either: the poses of a segment stay in its message, and factors with announced poses come on
top.

A path is cut wherever no landmark or past pose is touched from both sides. The rule looks at the
path alone, so the tail of a path is cut as it was.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import blake2b
from itertools import pairwise

import numpy as np

from fgplan.evaluation.incremental.candidate_table import CandidateTable
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.numbering import Numbering
from fgplan.evaluation.incremental.segment_pool import (
    CandidateSegments,
    SegmentPool,
    join_segments,
    segment_room,
    take_segments,
)
from fgplan.typing import IntArray, Key

TOKEN_BYTES = 16
"""Length of the digest that stands for a step's content."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Carried:
    """What outlives a planning session; found by content, so nothing in it can be out of date.

    Attributes:
        places: Place in the pool by the segment's content.
        keys: Prior variables; the pool's slots name them by index.
        pool: Messages of segments.
    """

    places: Mapping[bytes, int]
    keys: tuple[Key, ...]
    pool: SegmentPool

    @property
    def bytes(self) -> int:
        """Memory held."""
        return self.pool.bytes + sum(map(len, self.places))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segments:
    """Segments of some of a robot's candidates.

    Attributes:
        consists_of: Segments of each candidate; none of a candidate that was not asked for.
        names: Content of each distinct segment.
        pool: Its message.
        reused: How many of them were carried over.
    """

    consists_of: CandidateSegments
    names: tuple[bytes, ...]
    pool: SegmentPool
    reused: int


def hold_segments(
    table: CandidateTable,
    fixed: FactorBlocks,
    numbering: Numbering,
    width: IntArray,
    carried: Carried | None,
    candidates: IntArray,
) -> Segments:
    """Cut candidates into segments, take over the messages that are known, build the others.

    Args:
        table: The candidates.
        fixed: Factors of the own states with landmarks and past poses.
        numbering: Numbers of variables.
        width: Shape (V,), tangent dimension of each variable.
        carried: What an earlier session left, or None.
        candidates: Shape (n,), indices of the candidates to cut, increasing.

    Returns:
        Their segments; of the other candidates none.
    """
    from fgplan.evaluation.incremental.segment_kernels import (
        build_segments,
        count_slots,
        crossed_boundaries,
    )

    lengths = table.lengths[candidates]
    crossed = crossed_boundaries(lengths, table.states[candidates], fixed, len(width))
    tokens, digests = _steps(table, fixed, numbering, candidates)
    known: dict[tuple[int, ...], int] = {}
    where: list[tuple[int, int, int]] = []  # candidate, begin and end of each distinct segment
    counts, ends, numbers = np.zeros(len(table.lengths), np.int64), [], []
    for place, (c, length) in enumerate(zip(candidates.tolist(), lengths.tolist(), strict=True)):
        row = tokens[place].tolist()
        cuts = [*np.flatnonzero(~crossed[place, :length]).tolist(), length]
        for begin, end in pairwise(cuts):
            number = known.setdefault(tuple(row[begin:end]), len(known))
            if number == len(where):
                where.append((c, begin, end))
            ends.append(end)
            numbers.append(number)
        counts[c] = len(cuts) - 1
    names = tuple(b"".join([digests[k] for k in content]) for content in known)
    places = {} if carried is None else carried.places
    old = np.array([places.get(name, -1) for name in names], np.int64)
    fresh = np.flatnonzero(old < 0)
    # Contiguous however many there are: kernels are compiled for one layout.
    candidate, begins, beyond = np.ascontiguousarray(np.array(where, np.int64)[fresh].T)
    slots = count_slots(candidate, begins, beyond, table.states, fixed, len(width))
    dim = table.motion.late.shape[2]
    pool = segment_room(beyond - begins, slots, dim)
    build_segments(candidate, begins, beyond, table.states, table.motion, fixed, width, pool)
    if carried is not None and len(fresh) < len(names):
        reused = np.flatnonzero(old >= 0)
        pool = join_segments(pool, take_segments(_renumbered(carried, numbering), old[reused]))
        pool = take_segments(pool, np.argsort(np.concatenate([fresh, reused])))
    return Segments(
        consists_of=CandidateSegments(
            np.append(0, np.cumsum(counts)),
            np.array(ends, np.int64),
            np.array(numbers, np.int64),
        ),
        names=names,
        pool=pool,
        reused=len(names) - len(fresh),
    )


def carry_segments(segments: Segments, numbering: Numbering, memory_bytes: int) -> Carried:
    """What a later session may use.

    Args:
        segments: Segments of the candidates.
        numbering: Numbers of variables.
        memory_bytes: Most memory: the first segments that fit are kept.

    Returns:
        It.
    """
    base = len(numbering.robots) * numbering.capacity
    each = segments.pool.bytes_each() + np.array([len(name) for name in segments.names])
    room = memory_bytes
    chosen = np.arange(int(np.searchsorted(np.cumsum(each), room, side="right")))
    pool = take_segments(segments.pool, chosen)
    used, index = np.unique(pool.slot_variable - base, return_inverse=True)
    return Carried(
        places={segments.names[place]: place for place in chosen.tolist()},
        keys=tuple(numbering.prior_keys[place] for place in used.tolist()),
        pool=pool._replace(slot_variable=index.astype(np.int64)),
    )


def _renumbered(carried: Carried, numbering: Numbering) -> SegmentPool:
    """Carried messages with this session's numbers; -1 for variables that it does not know."""
    base = len(numbering.robots) * numbering.capacity
    place = {key: base + index for index, key in enumerate(numbering.prior_keys)}
    numbers = np.array([place.get(key, -1) for key in carried.keys], np.int64)
    return carried.pool._replace(slot_variable=numbers[carried.pool.slot_variable])


def _steps(
    table: CandidateTable, fixed: FactorBlocks, numbering: Numbering, candidates: IntArray
) -> tuple[IntArray, list[bytes]]:
    """Number of the content of each step, shape (n, Lmax), and the digest of each number."""
    from fgplan.evaluation.incremental.distinct_kernels import distinct_rows

    states, paths = table.states[candidates], [table.paths[c] for c in candidates.tolist()]
    inside = np.arange(states.shape[1]) < table.lengths[candidates, None]
    base = len(numbering.robots) * numbering.capacity
    prior_keys = np.array(numbering.prior_keys, np.uint64)
    marks = np.zeros(len(table.poses))
    contents: dict[bytes, int] = {b"": 0}
    walked = np.unique(states[inside])
    for state in walked[np.diff(fixed.pointer)[walked] > 0].tolist():
        here = slice(fixed.pointer[state], fixed.pointer[state + 1])
        blocks = (fixed.rank[here], fixed.own[here], fixed.cross[here], fixed.other[here])
        content = prior_keys[fixed.variable[here] - base].tobytes()
        content += b"".join([block.tobytes() for block in blocks])
        marks[state] = contents.setdefault(content, len(contents))
    mark = marks[states[inside]]
    size = len(mark)
    rows = np.column_stack(
        [
            mark,
            np.concatenate([path.poses[:-1] for path in paths]).reshape(size, -1),
            np.concatenate([path.poses[1:] for path in paths]).reshape(size, -1),
            np.concatenate([path.motion_covariances for path in paths]).reshape(size, -1),
        ]
    )
    flat, first = distinct_rows(rows.view(np.int64))
    tokens = np.zeros(states.shape, np.int64)
    tokens[inside] = flat
    seen = [blake2b(content, digest_size=TOKEN_BYTES).digest() for content in contents]
    digests = [
        blake2b(row.tobytes() + seen[int(at)], digest_size=TOKEN_BYTES).digest()
        for row, at in zip(rows[first, 1:], mark[first].tolist(), strict=True)
    ]
    return tokens, digests
