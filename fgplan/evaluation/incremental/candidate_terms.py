"""Objective terms of some candidates, from messages and others' belief."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fgplan.evaluation.incremental.memory import Memory
from fgplan.evaluation.incremental.message_pool import MessagePool
from fgplan.evaluation.incremental.messages import build, solve
from fgplan.evaluation.incremental.segments import Segments, hold_segments
from fgplan.evaluation.incremental.turn import Turn, reads_only_the_end
from fgplan.evaluation.incremental.universe import widths
from fgplan.evaluation.incremental.whitened_rows import posterior_by_qr
from fgplan.evaluation.objective import UncertaintyTerm
from fgplan.evaluation.term_values import (
    CutReadings,
    PoseAt,
    VariableRef,
    objective_readings,
    path_steps,
    path_values,
    uncertainty_values,
)
from fgplan.typing import FloatArray, IntArray

SCALE_LIMIT = 1e13
"""Largest ratio of a current pose's variance to that of one motion step in the fast form: beyond
it, the chain's response to the current pose has too few digits left of the step's."""


class Work:
    """Counts of one evaluation."""

    def __init__(self) -> None:
        """Start from nothing."""
        self.reused = self.rebuilt = self.solves = self.fallbacks = 0
        self.segments_reused = self.segments_rebuilt = 0


def others_path_terms(memory: Memory) -> FloatArray:
    """Terms of the others' announced paths, shape (T,)."""
    others = [r for r in memory.problem.robots if r != memory.robot]
    return path_values(memory.problem, memory.announced, others)


def candidate_terms(turn: Turn, subset: IntArray, work: Work) -> FloatArray:
    """Unweighted terms of some candidates.

    Args:
        turn: The turn; its memory keeps the messages that are built.
        subset: Shape (n,), indices of candidates, increasing.
        work: Counts, added to.

    Returns:
        Shape (n, T).
    """
    memory = turn.memory
    values = memory.path_terms[subset] + others_path_terms(memory)
    if not len(subset):
        return values
    steps = path_steps(memory.announced)
    lengths = memory.table.lengths[subset]
    if reads_only_the_end(memory.problem, memory.robot):
        if any(isinstance(term, UncertaintyTerm) for term in memory.problem.objective.terms):
            cut = turn.end_readings()
            covariance = _at_the_end(turn, cut, subset, work)
            values += uncertainty_values(memory.problem, cut, covariance, memory.prior_blocks)
        return values
    for length in np.unique(lengths).tolist():
        members = np.flatnonzero(lengths == length)
        for cut in objective_readings(memory.problem, {**steps, memory.robot: length}):
            covariance = _at_a_cut(turn, cut, subset[members], min(length, cut.cut), work)
            values[members] += uncertainty_values(
                memory.problem, cut, covariance, memory.prior_blocks
            )
    return values


def constant_terms(turn: Turn, robots: frozenset[str]) -> tuple[IntArray, FloatArray]:
    """Terms of other robots as they are without any candidate.

    Args:
        turn: The turn.
        robots: Robots whose terms are wanted.

    Returns:
        Shape (T,) whether each term is one of theirs, and shape (T,) their values.
    """
    memory = turn.memory
    problem = memory.problem
    terms = problem.objective.terms
    values = others_path_terms(memory)
    wanted = np.zeros(len(terms), bool)
    for place, term in enumerate(terms):
        if isinstance(term, UncertaintyTerm):
            of = term.of.robot if hasattr(term.of, "robot") else term.of.robots[0]  # type: ignore[union-attr]
            wanted[place] = of in robots and of != memory.robot
        else:
            wanted[place] = term.robot != memory.robot
    steps = {**path_steps(memory.announced), memory.robot: int(memory.table.lengths.max())}
    for cut in objective_readings(problem, steps):
        inside = tuple(reading for reading in cut.readings if wanted[reading.term])
        if not inside:
            continue
        universe = turn.universe(None if cut.final else cut.cut)
        size = int(cut.dims.sum())
        covariance = np.zeros((1, size, size))
        outside = [ref for ref in cut.variables if not _is_own(ref, memory.robot)]
        columns = _columns(turn, outside, None if cut.final else cut.cut)
        rows = _rows_of(cut, [not _is_own(ref, memory.robot) for ref in cut.variables])
        covariance[0][np.ix_(rows, rows)] = universe.covariance[np.ix_(columns, columns)]
        found = uncertainty_values(
            problem, replace(cut, readings=inside), covariance, memory.prior_blocks
        )
        values += found[0]
    return wanted, values


def _at_the_end(turn: Turn, cut: CutReadings, subset: IntArray, work: Work) -> FloatArray:
    """Joint covariances at the end of all paths; messages are kept for the next turn."""
    memory, table = turn.memory, turn.memory.table
    own = [ref for ref in cut.variables if _is_own(ref, memory.robot)]
    columns = _columns(turn, [ref for ref in cut.variables if ref not in own], None)
    reads = table.lengths[:, None] if own else np.zeros((len(table.lengths), 0), np.int64)
    missing = np.ones(len(table.lengths), bool)
    for pool in memory.pools:
        missing[pool.candidates[pool.live]] = False
    fresh = subset[missing[subset]]
    pools = memory.pools
    if len(fresh):
        pool = build(
            table,
            memory.fixed,
            memory.moving,
            _segments(turn, fresh, work),
            turn.universe(None),
            fresh,
            table.lengths[fresh],
            reads[fresh],
        )
        pools = (*pools, pool)
        turn.memory = replace(turn.memory, pools=pools)
    work.rebuilt += len(fresh)
    work.reused += len(subset) - len(fresh)
    size = int(cut.dims.sum())
    covariance = np.empty((len(subset), size, size))
    for pool in pools:
        place = np.full(len(table.lengths), -1, np.int64)
        place[pool.candidates[pool.live]] = np.flatnonzero(pool.live)
        places = place[subset]
        inside = places >= 0
        if inside.any():
            covariance[inside] = _solved(turn, None, pool, places[inside], columns, reads, work)
    return _reorder(covariance, cut, memory.robot)


def _segments(turn: Turn, subset: IntArray, work: Work) -> Segments | None:
    """Segments of candidates whose messages are built for the first time in a session."""
    memory = turn.memory
    first = subset[~memory.told[subset]]
    if memory.carried is None or not len(first):
        return None
    told = memory.told.copy()
    told[first] = True
    turn.memory = replace(memory, told=told)
    found = hold_segments(
        memory.table,
        memory.fixed,
        memory.numbering,
        widths(memory.problem.dim, memory.numbering, memory.prior),
        memory.carried,
        first,
    )
    work.segments_reused += found.reused
    work.segments_rebuilt += len(found.names) - found.reused
    return found


def _at_a_cut(
    turn: Turn, cut: CutReadings, subset: IntArray, length: int, work: Work
) -> FloatArray:
    """Joint covariances at one look-ahead step, candidates of one length."""
    memory, table = turn.memory, turn.memory.table
    level = None if cut.final else cut.cut
    universe = turn.universe(level)
    if length == 0:
        columns = _columns(turn, list(cut.variables), level)
        block = universe.covariance[np.ix_(columns, columns)]
        return np.broadcast_to(block, (len(subset), *block.shape))
    steps = [ref.step for ref in cut.variables if _is_own(ref, memory.robot)]  # type: ignore[union-attr]
    outside = [ref for ref in cut.variables if not _is_own(ref, memory.robot)]
    columns = _columns(turn, outside, level)
    reads = np.zeros((len(table.lengths), len(steps)), np.int64)
    reads[:] = steps
    lengths = np.full(len(subset), length, np.int64)
    pool = build(
        table,
        memory.fixed,
        memory.moving,
        _segments(turn, subset, work),
        universe,
        subset,
        lengths,
        reads[subset],
    )
    work.rebuilt += len(subset)
    covariance = _solved(turn, level, pool, np.arange(len(subset)), columns, reads, work, length)
    return _reorder(covariance, cut, memory.robot)


def _solved(
    turn: Turn,
    level: int | None,
    pool: MessagePool,
    places: IntArray,
    columns: IntArray,
    reads: IntArray,
    work: Work,
    length: int | None = None,
) -> FloatArray:
    """Solve, and do again by QR where the fast form lost digits."""
    memory, universe = turn.memory, turn.universe(level)
    numbering = memory.numbering
    start = int(universe.column[numbering.prior(memory.problem.start_keys[memory.robot])])
    covariance, sound = solve(pool, places, universe, start, columns)
    work.solves += len(places)
    spread = universe.covariance.diagonal()[start : start + memory.problem.dim]
    if (spread * memory.table.tightest).max() > SCALE_LIMIT:
        sound[:] = False
    for n in np.flatnonzero(~sound).tolist():
        candidate = int(pool.candidates[places[n]])
        path = memory.table.paths[candidate]
        covariance[n] = posterior_by_qr(
            memory.problem,
            numbering,
            turn.universe_rows(level),
            universe.column,
            path,
            path.steps if length is None else length,
            memory.announced,
            reads[candidate].tolist(),
            columns,
        )
        work.fallbacks += 1
    return covariance


def _is_own(ref: VariableRef, robot: str) -> bool:
    """Whether a variable is a future pose of the robot itself."""
    return isinstance(ref, PoseAt) and ref.robot == robot and ref.step > 0


def _columns(turn: Turn, refs: Sequence[VariableRef], level: int | None) -> IntArray:
    """Scalars of variables in S."""
    memory, universe = turn.memory, turn.universe(level)
    numbering = memory.numbering
    found = []
    for ref in refs:
        if not isinstance(ref, PoseAt):
            number = numbering.prior(ref.key)
        elif ref.step == 0:
            number = numbering.prior(memory.problem.start_keys[ref.robot])
        else:
            number = numbering.pose(ref.robot, ref.step)
        found.append(universe.column[number] + np.arange(universe.width[number]))
    return np.concatenate(found) if found else np.zeros(0, np.int64)


def _rows_of(cut: CutReadings, chosen: Sequence[bool]) -> IntArray:
    """Scalars of some of a cut's variables within all of them."""
    return np.flatnonzero(np.repeat(np.array(chosen, bool), cut.dims))


def _reorder(covariance: FloatArray, cut: CutReadings, robot: str) -> FloatArray:
    """From own poses first to the order of the cut's variables."""
    own = [_is_own(ref, robot) for ref in cut.variables]
    order = np.concatenate([_rows_of(cut, own), _rows_of(cut, [not flag for flag in own])])
    if (order == np.arange(len(order))).all():
        return covariance
    back = np.argsort(order)
    return covariance[:, back[:, None], back]


def lower_bounds(turn: Turn, subset: IntArray) -> FloatArray:
    """Lower bounds on the terms of some candidates, shape (n, T); -inf where there is none.

    Only for objectives that read the end, with monotone functions and weights of zero or more.
    """
    from fgplan.evaluation.incremental.bound_kernels import lower_covariances

    memory, table = turn.memory, turn.memory.table
    problem, universe = memory.problem, turn.universe(None)
    cut = turn.end_readings()
    own = [_is_own(ref, memory.robot) for ref in cut.variables]
    outside = [ref for ref, mine in zip(cut.variables, own, strict=True) if not mine]
    columns = _columns(turn, outside, None)
    number = memory.numbering.prior(problem.start_keys[memory.robot])
    start = int(universe.column[number])
    basis = np.unique(np.concatenate([columns, start + np.arange(problem.dim)]))
    try:
        lower = np.linalg.cholesky(universe.covariance[np.ix_(basis, basis)])
    except np.linalg.LinAlgError:  # starts that are tied too closely for Cholesky: no bound
        return np.full((len(subset), len(problem.objective.terms)), -np.inf)
    scaled = np.linalg.solve(lower, universe.covariance[basis]).T
    size = int(cut.dims.sum())
    covariance = np.zeros((len(subset), size, size))
    valid = np.zeros(len(subset), np.int64)
    lower_covariances(
        subset,
        table.lengths[subset],
        table.states,
        table.motion,
        memory.fixed,
        memory.moving,
        universe.column,
        universe.width,
        np.ascontiguousarray(scaled),
        start,
        int(any(own)),
        columns,
        valid,
        covariance,
    )
    good = valid.astype(bool)
    values = np.full((len(subset), len(problem.objective.terms)), -np.inf)
    if good.any():
        ordered = _reorder(covariance[good], cut, memory.robot)
        found = uncertainty_values(problem, cut, ordered, memory.prior_blocks)
        values[good] = found + memory.path_terms[subset[good]] + others_path_terms(memory)
    return values
