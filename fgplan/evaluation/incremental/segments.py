"""Segments of candidate paths by content, and their messages carried from session to session.

Between two planning sessions the robots move and the prior grows. A candidate that is kept has
another first motion and then the states that it had, at other steps and times. Its message is
composed of the messages of its segments (see ``segment_kernels``), and those whose content is the
same to the last bit are taken over.

The content of a step is the pose before it, the pose after it, the noise of the motion, and for
each factor with a landmark or past pose the variable's key and the whitened blocks, which hold the
noise and the linearisation point. A landmark whose estimate moved gives other blocks, so the
segments that see it are built anew. Steps, times and numbers of variables are no part of it.

A path is cut wherever no landmark or past pose is touched from both sides: a rule that looks at
the path alone, so the tail of a path is cut as it was. Segments with a factor with an announced
pose, and those that lie between two factors with one announced pose, are built anew: what is
announced changes from session to session. Segments that follow on each other and have to be built
are built as one.
"""

from dataclasses import dataclass
from hashlib import blake2b
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fgplan.evaluation.incremental.candidate_table import CandidateTable, MotionBlocks
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks, no_blocks
from fgplan.evaluation.incremental.message_pool import MessagePool
from fgplan.evaluation.incremental.messages import Chains, build, empty_pool
from fgplan.evaluation.incremental.numbering import Numbering
from fgplan.evaluation.incremental.universe import Universe
from fgplan.typing import BoolArray, IntArray, Key

TOKEN_BYTES = 16
"""Length of the digest that stands for a step's content."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Carried:
    """Segment messages that outlive a planning session; content finds them, nothing else.

    Attributes:
        places: Place in the pool by the segment's content.
        keys: Prior variables; the pool's slots name them by index.
        pool: The messages, each reading the last pose of its segment.
    """

    places: dict[bytes, int]
    keys: tuple[Key, ...]
    pool: MessagePool

    @property
    def bytes(self) -> int:
        """Memory held."""
        return self.pool.bytes + sum(map(len, self.places))


class Segments(NamedTuple):
    """Segments of all candidates, candidate by candidate.

    Attributes:
        candidate: Shape (S,), whose it is.
        begin: Shape (S,), place of its first state within the candidate, from 0.
        end: Shape (S,), one beyond the last.
        number: Shape (S,), number of its content, by first occurrence.
        names: Content of each number, M in all.
        place: Shape (M,), place of its message in what was carried, or -1.
    """

    candidate: IntArray
    begin: IntArray
    end: IntArray
    number: IntArray
    names: tuple[bytes, ...]
    place: IntArray


def find_segments(
    table: CandidateTable, fixed: FactorBlocks, numbering: Numbering, carried: Carried | None
) -> Segments:
    """Cut candidates into segments and look them up.

    Args:
        table: The candidates.
        fixed: Factors of the own states with landmarks and past poses.
        numbering: Numbers of variables.
        carried: Messages of an earlier session, or None.

    Returns:
        The segments.
    """
    from fgplan.evaluation.incremental.segment_kernels import boundaries

    size = len(numbering.robots) * numbering.capacity + len(numbering.prior_keys)
    everyone = np.arange(len(table.paths))
    _, crossed = boundaries(everyone, table.lengths, table.states, fixed, size)
    tokens, step_token = _steps(table, fixed, numbering)
    places = {} if carried is None else carried.places
    candidate, begin, end, number = [], [], [], []
    known: dict[tuple[int, ...], int] = {}
    for c, length in enumerate(table.lengths.tolist()):
        row = tokens[c].tolist()
        cuts = [*np.flatnonzero(~crossed[c, :length]).tolist(), length]
        for first, last in pairwise(cuts):
            candidate.append(c)
            begin.append(first)
            end.append(last)
            number.append(known.setdefault(tuple(row[first:last]), len(known)))
    names = tuple(b"".join([step_token[k] for k in content]) for content in known)
    return Segments(
        candidate=np.array(candidate, np.int64),
        begin=np.array(begin, np.int64),
        end=np.array(end, np.int64),
        number=np.array(number, np.int64),
        names=names,
        place=np.array([places.get(name, -1) for name in names], np.int64),
    )


def _steps(
    table: CandidateTable, fixed: FactorBlocks, numbering: Numbering
) -> tuple[IntArray, list[bytes]]:
    """Number of the content of each step, shape (N, Lmax), and the digest of each number."""
    from fgplan.evaluation.incremental.distinct_kernels import distinct_rows

    inside = np.arange(table.states.shape[1]) < table.lengths[:, None]
    base = len(numbering.robots) * numbering.capacity
    prior_keys = np.array(numbering.prior_keys, np.uint64)
    marks = np.zeros(len(table.poses))
    contents: dict[bytes, int] = {b"": 0}
    for state in np.flatnonzero(np.diff(fixed.pointer)).tolist():
        here = slice(fixed.pointer[state], fixed.pointer[state + 1])
        blocks = (fixed.rank[here], fixed.own[here], fixed.cross[here], fixed.other[here])
        content = prior_keys[fixed.variable[here] - base].tobytes()
        content += b"".join([block.tobytes() for block in blocks])
        marks[state] = contents.setdefault(content, len(contents))
    mark = marks[table.states[inside]]
    size = len(mark)
    rows = np.column_stack(
        [
            mark,
            np.concatenate([path.poses[:-1] for path in table.paths]).reshape(size, -1),
            np.concatenate([path.poses[1:] for path in table.paths]).reshape(size, -1),
            np.concatenate([path.motion_covariances for path in table.paths]).reshape(size, -1),
        ]
    )
    flat, first = distinct_rows(rows.view(np.int64))
    tokens = np.zeros(table.states.shape, np.int64)
    tokens[inside] = flat
    seen = [blake2b(content, digest_size=TOKEN_BYTES).digest() for content in contents]
    digests = [
        blake2b(row.tobytes() + seen[int(at)], digest_size=TOKEN_BYTES).digest()
        for row, at in zip(rows[first, 1:], mark[first].tolist(), strict=True)
    ]
    return tokens, digests


def assemble(
    table: CandidateTable,
    fixed: FactorBlocks,
    moving: FactorBlocks,
    numbering: Numbering,
    universe: Universe,
    carried: Carried,
    segments: Segments,
    fresh: IntArray,
    read_own: bool,
) -> tuple[tuple[MessagePool, ...], IntArray, IntArray]:
    """Messages of some candidates, of carried segments where there are any.

    Args:
        table: The candidates.
        fixed: Factors of the own states with landmarks and past poses.
        moving: Factors of the own states with announced poses.
        numbering: Numbers of variables.
        universe: Others' belief, not cut.
        carried: Segment messages of an earlier session.
        segments: Segments of all candidates.
        fresh: Shape (n,), indices of candidates, increasing.
        read_own: Whether the last own pose is read.

    Returns:
        Pools that hold one message of each candidate, and the numbers of the segments taken from
        ``carried`` and of those built.
    """
    from fgplan.evaluation.incremental.segment_kernels import boundaries, compose_messages

    column, width = universe.column, universe.width
    row_of = np.full(len(table.paths), -1, np.int64)
    row_of[fresh] = np.arange(len(fresh))
    mine = np.flatnonzero(row_of[segments.candidate] >= 0)
    row, begin, end = row_of[segments.candidate[mine]], segments.begin[mine], segments.end[mine]
    holds, crossed = boundaries(fresh, table.lengths[fresh], table.states, moving, len(column))
    before = np.zeros((len(fresh), holds.shape[1] + 1), np.int64)
    np.cumsum(holds, axis=1, out=before[:, 1:])
    number = segments.number[mine]
    kept = (segments.place[number] >= 0) & (before[row, begin] == before[row, end])
    kept &= ~crossed[row, begin]
    any_kept = np.zeros(len(fresh), bool)
    any_kept[row[kept]] = True
    pools = []
    whole = fresh[~any_kept]
    if len(whole):
        lengths = table.lengths[whole]
        reads = lengths[:, None] if read_own else np.zeros((len(whole), 0), np.int64)
        chains = Chains(table.states, table.motion)
        pools.append(build(chains, fixed, moving, column, width, whole, lengths, reads))
    if any_kept.any():
        opens = kept | np.append(True, kept[:-1] | (row[1:] != row[:-1]))
        opens &= any_kept[row]
        part_of = np.cumsum(opens) - 1
        inside = any_kept[row]
        first = np.flatnonzero(opens)
        last = np.zeros(len(first), np.int64)
        last[part_of[inside]] = end[inside]  # of several the last, in increasing order
        taken = kept[first]
        place = segments.place[number[first]]
        to_build = np.flatnonzero(~taken)
        place[to_build] = np.arange(len(to_build))
        pieces = segments.candidate[mine][first], begin[first], last
        built = build_pieces(table, fixed, moving, column, width, *(p[to_build] for p in pieces))
        pointer = np.append(np.flatnonzero(np.diff(row[first], prepend=-1)), len(first))
        old = renumbered(carried, numbering)
        candidates, dim = fresh[any_kept], table.motion.late.shape[2]
        pool = _room(candidates, pointer, taken, place, old, built, dim if read_own else 0)
        compose_messages(pointer, taken, place, old, built, pool)
        pools.append(pool)
    return tuple(pools), np.unique(number[kept]), np.unique(number[~kept])


def carry_segments(
    table: CandidateTable,
    fixed: FactorBlocks,
    numbering: Numbering,
    width: IntArray,
    carried: Carried | None,
    segments: Segments,
    memory_bytes: int,
) -> Carried:
    """Messages of the distinct segments of all candidates, for a later session.

    Args:
        table: The candidates.
        fixed: Factors of the own states with landmarks and past poses.
        numbering: Numbers of variables.
        width: Shape (V,), tangent dimension of each variable.
        carried: Segment messages of an earlier session, or None.
        segments: Segments of all candidates, looked up in ``carried``.
        memory_bytes: Most memory of the messages; the first ones are kept.

    Returns:
        The messages, without those that lost digits.
    """
    from fgplan.evaluation.incremental.segment_kernels import compose_messages

    base = len(numbering.robots) * numbering.capacity
    column, dim = np.zeros(len(width), np.int64), table.motion.late.shape[2]
    moving = no_blocks(len(table.poses), dim)
    _, first = np.unique(segments.number, return_index=True)
    pieces = segments.candidate[first], segments.begin[first], segments.end[first]
    place = segments.place.copy()
    taken = place >= 0
    to_build = np.flatnonzero(~taken)
    place[to_build] = np.arange(len(to_build))
    built = build_pieces(table, fixed, moving, column, width, *(p[to_build] for p in pieces))
    old = built if carried is None else renumbered(carried, numbering)
    sound = np.where(taken, True, _of(built.sound, place) == 1)
    slots, rows = _sizes(taken, place, old, built)
    held = 8 * (rows * (rows + 2 * dim) + slots * (3 + dim**2) + 2 * dim**2 + 7)
    held += np.array([len(name) for name in segments.names])
    chosen = np.flatnonzero(sound & (np.cumsum(np.where(sound, held, 0)) <= memory_bytes))
    one_each = np.arange(len(chosen) + 1)
    pool = _room(one_each[:-1], one_each, taken[chosen], place[chosen], old, built, dim)
    compose_messages(one_each, taken[chosen], place[chosen], old, built, pool)
    pool = pool._replace(slot_variable=pool.slot_variable - base)
    names = {segments.names[k]: at for at, k in enumerate(chosen.tolist())}
    return Carried(places=names, keys=numbering.prior_keys, pool=pool)


def build_pieces(
    table: CandidateTable,
    fixed: FactorBlocks,
    moving: FactorBlocks,
    column: IntArray,
    width: IntArray,
    candidate: IntArray,
    begin: IntArray,
    end: IntArray,
) -> MessagePool:
    """Messages of pieces of candidates, each reading its last pose.

    Args:
        table: The candidates.
        fixed: Factors of the own states with landmarks and past poses.
        moving: Factors of the own states with announced poses.
        column: Shape (V,), -1 for variables that do not take part.
        width: Shape (V,), tangent dimension of each variable.
        candidate: Shape (n,), whose piece it is.
        begin: Shape (n,), place of its first state, from 0.
        end: Shape (n,), one beyond the last.

    Returns:
        The messages.
    """
    lengths = end - begin
    longest = int(lengths.max(initial=1))
    at = np.minimum(begin[:, None] + np.arange(longest), table.states.shape[1] - 1)
    motion = MotionBlocks(*(blocks[candidate[:, None], at] for blocks in table.motion))
    chains = Chains(table.states[candidate[:, None], at], motion)
    everyone = np.arange(len(lengths))
    return build(chains, fixed, moving, column, width, everyone, lengths, lengths[:, None])


def renumbered(carried: Carried, numbering: Numbering) -> MessagePool:
    """Carried messages with this session's numbers; -1 for variables that it does not know."""
    base = len(numbering.robots) * numbering.capacity
    place = {key: base + index for index, key in enumerate(numbering.prior_keys)}
    numbers = np.array([place.get(key, -1) for key in carried.keys], np.int64)
    return carried.pool._replace(slot_variable=numbers[carried.pool.slot_variable])


def _of(values: IntArray, place: IntArray) -> IntArray:
    """Values at places of which some are beyond the end, where they do not matter."""
    padded = np.append(values, 0)
    found: IntArray = padded[np.minimum(place, len(values))]
    return found


def _sizes(
    taken: BoolArray, place: IntArray, old: MessagePool, built: MessagePool
) -> tuple[IntArray, IntArray]:
    """Slots and rows of segments in two pools, each of shape (S,)."""
    slots, rows = (
        np.where(taken, _of(in_old, place), _of(in_built, place))
        for in_old, in_built in (
            (np.diff(old.slot_pointer), np.diff(built.slot_pointer)),
            (old.row_count, built.row_count),
        )
    )
    return slots, rows


def _room(
    candidates: IntArray,
    pointer: IntArray,
    taken: BoolArray,
    place: IntArray,
    old: MessagePool,
    built: MessagePool,
    read: int,
) -> MessagePool:
    """A pool with room for composed messages, their row counts set."""
    slots, rows = (_summed(sizes, pointer) for sizes in _sizes(taken, place, old, built))
    pool = empty_pool(candidates, slots, rows, old.response.shape[1], read)
    pool.row_count[:] = rows
    return pool


def _summed(sizes: IntArray, pointer: IntArray) -> IntArray:
    """Sum of the sizes of each message's segments."""
    running = np.append(0, np.cumsum(sizes))
    total: IntArray = running[pointer[1:]] - running[pointer[:-1]]
    return total
