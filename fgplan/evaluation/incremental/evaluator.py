"""The incremental evaluator: exact values, and only the work that an announcement asks for.

Once a prior: one elimination of the history. Once a robot: its candidates as arrays. Once an
announcement: S, factors with announced poses, and the messages of candidates whose factors
changed. Once a candidate: one Cholesky factor of a small joint covariance. Candidates that the
announcement does not reach keep their own term and get the others' as a constant. ``choose``
evaluates exactly only the candidates that a lower bound cannot exclude. From one planning session
to the next, ``carry`` takes along what segments of the candidates say.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.evaluation.evaluations import (
    Evaluations,
    ReevaluationReport,
    select,
    weigh,
)
from fgplan.evaluation.incremental.candidate_terms import (
    Work,
    candidate_terms,
    constant_terms,
    lower_bounds,
)
from fgplan.evaluation.incremental.memory import Memory
from fgplan.evaluation.incremental.preparation import carry, exchange, prepare
from fgplan.evaluation.incremental.segments import Carried
from fgplan.evaluation.incremental.turn import (
    Turn,
    begin_turn,
    reads_only_the_end,
    separable,
)
from fgplan.evaluation.objective import UncertaintyTerm
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath
from fgplan.threads import one_blas_thread
from fgplan.typing import BoolArray, FloatArray

FIRST_BATCH = 3
"""Candidates evaluated exactly before the bound is used; later batches are twice as large."""

CHEAP_BATCH = 8
"""The same where candidates are cheap: this many over the number of other robots."""

BOUND_MARGIN = 1e-7
"""Relative distance by which a bound must exceed the best value: ties, and digits that the bound
loses where a loose prior meets a tight factor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The best candidate, found without evaluating all.

    Attributes:
        index: Best candidate; of equal ones the lowest index.
        value: Its objective value.
        incumbent_value: Value of the candidate asked about, or None.
        report: Account of the work; ``skipped`` are the candidates never evaluated.
    """

    index: int
    value: float
    incumbent_value: float | None
    report: ReevaluationReport


@dataclass(frozen=True, slots=True, kw_only=True)
class Incremental:
    """Exact re-evaluation of only what changed.

    Attributes:
        memory_bytes: Most memory that one robot's messages may hold between evaluations.
        name: Name in scenarios and reports.
    """

    memory_bytes: int = 32_000_000
    name: str = "incremental"

    @one_blas_thread()
    def start(
        self,
        problem: PlanningProblem,
        robot: str,
        candidates: Sequence[CandidatePath],
        carried: Carried | None = None,
    ) -> Memory:
        """Prepare what depends on the prior and the candidates alone.

        Args:
            problem: Prior, team, objective and models.
            robot: Whose candidates these are.
            candidates: At least one path of the robot.
            carried: What ``carry`` gave after an earlier session, under whatever prior; None for
                the first.

        Returns:
            Memory for ``evaluate`` and ``choose``.

        Raises:
            NoCandidatePathError: If there is no candidate.
            InvalidInputError: If a candidate is another robot's or does not fit the prior.
            IllPosedBeliefError: If the prior has no finite covariance.
        """
        return prepare(problem, robot, candidates, carried, self.memory_bytes)

    @one_blas_thread()
    def carry(self, memory: Memory) -> Carried:
        """What the next planning session can use of this one: see ``Carried``.

        It depends on prior and candidates alone: what a session has evaluated makes no difference.
        There is time for it while the robots move.

        Args:
            memory: Memory of the last evaluation, or of ``start``.

        Returns:
            Messages of the candidates' segments and linearised observations, found again by their
            content; at most ``memory_bytes``.
        """
        return carry(memory, self.memory_bytes)

    @one_blas_thread()
    def add_candidates(self, memory: Memory, candidates: Sequence[CandidatePath]) -> Memory:
        """Append candidates; announcements, messages and values of the old ones stay.

        Args:
            memory: Memory of the last evaluation.
            candidates: New paths, appended after the old ones.

        Returns:
            Memory for all candidates; those of the new ones are computed at the next call.

        Raises:
            InvalidInputError: If a candidate is another robot's or does not fit the prior.
        """
        return exchange(memory, range(len(memory.table.paths)), candidates, self.memory_bytes)

    @one_blas_thread()
    def replace_candidates(
        self, memory: Memory, kept: Sequence[int], candidates: Sequence[CandidatePath]
    ) -> Memory:
        """Keep some candidates and append new ones, under the same prior.

        For an obstacle that is seen during a session: the candidates that it blocks go, and
        announcements, messages and values of the others stay.

        Args:
            memory: Memory of the last evaluation.
            kept: Indices of the candidates to keep, increasing; they come first, in this order.
            candidates: New paths, appended after them.

        Returns:
            Memory for these candidates; those of the new ones are computed at the next call.

        Raises:
            NoCandidatePathError: If no candidate is left.
            InvalidInputError: If indices are not increasing or out of range, or a candidate is
                another robot's or does not fit the prior.
        """
        return exchange(memory, kept, candidates, self.memory_bytes)

    @one_blas_thread()
    def evaluate(
        self, memory: Memory, announced: Mapping[str, CandidatePath]
    ) -> tuple[Memory, Evaluations]:
        """Evaluate every candidate under the others' announced paths.

        Args:
            memory: Memory of the last evaluation.
            announced: Announced paths by robot; the robot's own is not read.

        Returns:
            New memory, and exact values of all candidates.

        Raises:
            InvalidInputError: If an announced path does not fit the problem.
        """
        turn = begin_turn(memory, announced)
        work = Work()
        terms, known = _carried_over(turn)
        _drop_stale_pools(turn)
        missing = np.flatnonzero(~known)
        terms[missing] = candidate_terms(turn, missing, work)
        after = self._remember(turn, terms)
        report = _report(turn, after, work, known, ())
        values = weigh(memory.problem, terms)
        return after, Evaluations(robot=memory.robot, values=values, terms=terms, report=report)

    @one_blas_thread()
    def choose(
        self,
        memory: Memory,
        announced: Mapping[str, CandidatePath],
        incumbent: int | None = None,
    ) -> tuple[Memory, Choice]:
        """Find the best candidate; lower bounds exclude the rest.

        The same decision and tie-break as evaluating all. With a term that is not monotone, a
        negative weight, or a term that reads before the end, everything is evaluated.

        Args:
            memory: Memory of the last evaluation.
            announced: Announced paths by robot; the robot's own is not read.
            incumbent: Candidate whose exact value is wanted as well, or None.

        Returns:
            New memory, and the choice.

        Raises:
            InvalidInputError: If an announced path does not fit the problem, or there is no such
                incumbent.
        """
        problem = memory.problem
        uncertain = any(isinstance(t, UncertaintyTerm) for t in problem.objective.terms)
        if not (
            uncertain and problem.objective.bounded and reads_only_the_end(problem, memory.robot)
        ):
            after, found = self.evaluate(memory, announced)
            note = (
                "no bound: there is no uncertainty term, or one is not monotone, has a negative "
                "weight, reads before the end or reads a whole path of the robot itself"
            )
            report = replace(found.report, notes=(note,))
            return after, _choice(found.values, memory.robot, incumbent, report)
        count = len(memory.table.paths)
        if incumbent is not None and not 0 <= incumbent < count:
            raise InvalidInputError(
                f"incumbent of robot {memory.robot!r}: expected a candidate from 0 to {count - 1}, "
                f"got {incumbent}"
            )
        turn = begin_turn(memory, announced)
        work = Work()
        terms, known = _carried_over(turn)
        _drop_stale_pools(turn)
        carried = known.copy()
        values = np.where(known, weigh(problem, np.where(known[:, None], terms, 0.0)), np.inf)
        rest = np.flatnonzero(~known)
        bounds = np.full(len(values), np.inf)
        if len(rest):
            lower = lower_bounds(turn, rest)
            usable = np.isfinite(lower).all(axis=1)
            bounds[rest] = -np.inf  # no bound excludes nothing
            bounds[rest[usable]] = weigh(problem, lower[usable])
        queue = rest[np.argsort(bounds[rest], kind="stable")]
        others = max(1, len(memory.problem.robots) - 1)
        first = set(queue[: max(FIRST_BATCH, CHEAP_BATCH // others)].tolist())
        if incumbent is not None and not known[incumbent]:
            first.add(incumbent)
        batch = np.array(sorted(first), np.int64)
        size = 4 * FIRST_BATCH
        while len(batch):
            terms[batch] = candidate_terms(turn, batch, work)
            values[batch] = weigh(problem, terms[batch])
            known[batch] = True
            best = float(values.min())
            limit = best + BOUND_MARGIN * abs(best)
            open_ = [c for c in queue.tolist() if not known[c] and bounds[c] <= limit]
            batch = np.array(sorted(open_[:size]), np.int64)
            size *= 2
        after = self._remember(turn, np.where(known[:, None], terms, np.nan))
        skipped = tuple(np.flatnonzero(~known).tolist())
        report = _report(turn, after, work, carried, skipped)
        return after, _choice(values, memory.robot, incumbent, report)

    def _remember(self, turn: Turn, terms: FloatArray) -> Memory:
        """Memory for the next call, within its bound."""
        pools, held = [], 0
        for pool in turn.memory.pools:
            if held + pool.bytes <= self.memory_bytes:
                pools.append(pool)
                held += pool.bytes
        return replace(turn.memory, pools=tuple(pools), terms=terms)


def _carried_over(turn: Turn) -> tuple[FloatArray, BoolArray]:
    """Terms of the candidates that the change does not reach, and which those are."""
    memory = turn.memory
    shape = (len(memory.table.paths), len(memory.problem.objective.terms))
    if memory.terms is None or (turn.changed and not separable(memory.problem)):
        return np.full(shape, np.nan), np.zeros(shape[0], bool)
    terms = memory.terms.copy()
    known: BoolArray = np.logical_and(~turn.impacted, np.all(np.isfinite(terms), axis=1))
    if turn.changed and known.any():
        wanted, constants = constant_terms(turn, turn.changed_robots)
        terms[np.ix_(known, wanted)] = constants[wanted]
    return terms, known


def _drop_stale_pools(turn: Turn) -> None:
    """Drop messages whose factors changed, and pools of which little is left."""
    pools = []
    for pool in turn.memory.pools:
        live: BoolArray = pool.live & ~turn.dirty[pool.candidates]
        if 2 * int(live.sum()) >= len(live):
            pools.append(pool._replace(live=live))
    turn.memory = replace(turn.memory, pools=tuple(pools))


def _report(
    turn: Turn, after: Memory, work: Work, known: BoolArray, skipped: tuple[int, ...]
) -> ReevaluationReport:
    """Account of an evaluation."""
    vertices = np.unique(after.table.vertices[turn.change.involved])
    vertices = vertices[vertices >= 0]  # -1 stands for no vertex
    return ReevaluationReport(
        factors_added=turn.change.added,
        factors_removed=turn.change.removed,
        factors_kept=turn.change.kept,
        involved_vertices=tuple(vertices.tolist()),
        impacted=tuple(np.flatnonzero(turn.impacted).tolist()),
        untouched=tuple(np.flatnonzero(~turn.impacted).tolist()),
        messages_reused=work.reused + int(known.sum()),
        messages_rebuilt=work.rebuilt,
        solves=work.solves,
        skipped=skipped,
        segments_reused=work.segments_reused,
        segments_rebuilt=work.segments_rebuilt,
        fallbacks=work.fallbacks + int(any(u.by_qr for u in turn.universes.values())),
        bytes_held=after.bytes,
    )


def _choice(
    values: FloatArray, robot: str, incumbent: int | None, report: ReevaluationReport
) -> Choice:
    """The best of the evaluated candidates."""
    index = select(values, robot)
    return Choice(
        index=index,
        value=float(values[index]),
        incumbent_value=None if incumbent is None else float(values[incumbent]),
        report=report,
    )
