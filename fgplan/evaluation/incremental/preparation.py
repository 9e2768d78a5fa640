"""What is prepared once a prior and once a set of candidates, before any announcement.

Where candidates are exchanged under the same prior - an obstacle is seen, a goal is reached - the
numbers of variables stay, so whatever is known of the candidates that are kept stays as it is:
their messages, their terms, and the blocks of everything announced.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.evaluation.incremental.candidate_table import CandidateTable, tabulate
from fgplan.evaluation.incremental.factor_blocks import no_blocks
from fgplan.evaluation.incremental.memory import Memory
from fgplan.evaluation.incremental.numbering import Numbering
from fgplan.evaluation.incremental.prior_marginal import eliminate_history, numbered_keys, restrict
from fgplan.evaluation.incremental.segments import (
    Carried,
    carry_segments,
    hold_segments,
)
from fgplan.evaluation.incremental.turn import (
    factors_with_announced,
    own_states,
    touched_keys,
    with_keys,
)
from fgplan.evaluation.incremental.universe import fixed_blocks, widths
from fgplan.evaluation.objective import UncertaintyTerm
from fgplan.evaluation.problem import PlanningProblem
from fgplan.evaluation.term_values import prior_covariances
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import FloatArray, Key

FIRST_CAPACITY = 64
"""Steps an announced path may have before variables are numbered anew."""


def prepare(
    problem: PlanningProblem,
    robot: str,
    candidates: Sequence[CandidatePath],
    carried: Carried | None,
    memory_bytes: int,
) -> Memory:
    """Memory before the first announcement, see ``Incremental.start``."""
    table = _tabulated(problem, robot, candidates)
    touched = _touched(problem, table)
    wide = eliminate_history(problem, touched)
    numbering = Numbering(problem.robots, FIRST_CAPACITY, numbered_keys(problem, wide, touched))
    own = own_states(problem, table)
    return Memory(
        problem=problem,
        robot=robot,
        table=table,
        wide=wide,
        numbering=numbering,
        prior=restrict(wide, numbering.prior_keys),
        fixed=fixed_blocks(problem, numbering, own, table.observations),
        prior_blocks=prior_covariances(problem),
        path_terms=_path_terms(problem, robot, candidates),
        moving=no_blocks(len(table.poses), problem.dim),
        carried=None if carried is None or carried.bytes > memory_bytes else carried,
        told=np.zeros(len(candidates), bool),
    )


def carry(memory: Memory, memory_bytes: int) -> Carried:
    """What the next session may use, see ``Incremental.carry``."""
    segments = hold_segments(
        memory.table,
        memory.fixed,
        memory.numbering,
        widths(memory.problem.dim, memory.numbering, memory.prior),
        memory.carried,
        np.arange(len(memory.table.paths)),
    )
    return carry_segments(segments, memory.numbering, memory_bytes)


def exchange(
    memory: Memory, kept: Sequence[int], new: Sequence[CandidatePath], memory_bytes: int
) -> Memory:
    """Memory for other candidates under the same prior, see ``Incremental.replace_candidates``."""
    problem, size = memory.problem, len(memory.table.paths)
    places = np.array(kept, np.int64)
    if len(places) and (places[0] < 0 or places[-1] >= size or (np.diff(places) <= 0).any()):
        raise InvalidInputError(
            f"candidates of robot {memory.robot!r} to keep: expected increasing numbers from 0 to "
            f"{size - 1}, got {list(kept)}"
        )
    candidates = [*(memory.table.paths[place] for place in places.tolist()), *new]
    table = _tabulated(problem, memory.robot, candidates)
    grown = with_keys(memory, _touched(problem, table))
    own = own_states(problem, table)
    after = replace(
        grown,
        table=table,
        fixed=fixed_blocks(problem, grown.numbering, own, table.observations),
        path_terms=_path_terms(problem, memory.robot, candidates),
    )
    number = np.full(size, -1, np.int64)
    number[places] = np.arange(len(places))
    pools = []
    for pool in memory.pools:
        now = number[pool.candidates]
        pools.append(pool._replace(candidates=np.maximum(now, 0), live=pool.live & (now >= 0)))
    terms = None
    if memory.terms is not None:
        terms = np.full((len(candidates), len(problem.objective.terms)), np.nan)
        terms[: len(places)] = memory.terms[places]
    told = np.zeros(len(candidates), bool)
    told[: len(places)] = memory.told[places]
    return replace(
        after,
        carried=None if memory.carried is None else carry(memory, memory_bytes),
        told=told,
        moving=factors_with_announced(after, memory.announced),
        pools=tuple(pools),
        terms=terms,
    )


def _tabulated(
    problem: PlanningProblem, robot: str, candidates: Sequence[CandidatePath]
) -> CandidateTable:
    """Check candidates and turn them into arrays."""
    if not candidates:
        raise NoCandidatePathError(
            f"robot {robot!r}: expected at least one candidate path, got none; check that its "
            "goal is reachable"
        )
    for path in candidates:
        if path.robot != robot:
            raise InvalidInputError(
                f"candidates of robot {robot!r}: expected its own paths, got one of {path.robot!r}"
            )
    problem.check_paths(candidates)
    return tabulate(candidates)


def _touched(problem: PlanningProblem, table: CandidateTable) -> list[Key]:
    """Prior variables that the candidates touch."""
    return touched_keys(problem, own_states(problem, table), table.observations.landmarks())


def _path_terms(
    problem: PlanningProblem, robot: str, candidates: Sequence[CandidatePath]
) -> FloatArray:
    """Terms of the candidates' own paths, shape (N, T)."""
    terms = problem.objective.terms
    values = np.zeros((len(candidates), len(terms)))
    for place, term in enumerate(terms):
        if not isinstance(term, UncertaintyTerm) and term.robot == robot:
            values[:, place] = [term.value(path) for path in candidates]
    return values
