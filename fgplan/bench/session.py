"""Timing whole planning sessions: from the first evaluation to agreement, everything included."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.bench.open_world import OpenWorld
from fgplan.closed_loop.comparison import Contestant
from fgplan.closed_loop.comparison import largest_difference as compare_candidates
from fgplan.evaluation.as_published import AsPublished
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.isam2 import Isam2
from fgplan.team.agreement import Agreement
from fgplan.team.coordination import coordinate
from fgplan.team.options import CoordinationOptions

EXACT_TURNS = 10_000
INEXACT_TURNS = 15
"""Turns a robot after which a session with inexact values is given up."""

CONTESTANTS: Mapping[str, Contestant] = {
    "from_scratch": Contestant(FromScratch(elimination="marginals")),
    "from_scratch_fastest": Contestant(FromScratch(elimination="fastest")),
    "as_published": Contestant(AsPublished(), exact=False),
    "isam2": Contestant(Isam2()),
    "incremental": Contestant(Incremental()),
    "incremental_choose": Contestant(Incremental(), choose=True),
}
"""Contestants by name: two opponents from scratch, the published algorithms, iSAM2, and ours."""


def plan_session(world: OpenWorld, contestant: Contestant, digest: str) -> tuple[float, Agreement]:
    """Let the team of a world agree.

    Args:
        world: The world.
        contestant: How to plan.
        digest: Digest of the prior, computed once for all contestants.

    Returns:
        Seconds from the first evaluation to agreement with all preparation, and the agreement.
    """
    # the published algorithms may announce the same paths again and again: values that are not
    # exact need not fall
    turns = INEXACT_TURNS * len(world.candidates)
    options = CoordinationOptions(
        choose=contestant.choose,
        check_values=contestant.exact,
        max_turns=EXACT_TURNS if contestant.exact else turns,
    )
    began = time.perf_counter()
    agreement = coordinate(
        world.problem, world.candidates, contestant.evaluator, options=options, prior_digest=digest
    )
    return time.perf_counter() - began, agreement


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluationCounts:
    """The counts of equation (40) and the work behind them, over one session.

    Attributes:
        candidates: M of (40) times robots: candidates of the whole team.
        iterations: T: evaluations of all candidates of one robot.
        not_impacted: m summed over the evaluations after each robot's first.
        solves: Final solves or eliminations done.
        skipped: Candidates excluded by a lower bound.
        messages_reused: Messages taken over.
        fallbacks: Solves done again by QR.
    """

    candidates: int
    iterations: int
    not_impacted: int
    solves: int
    skipped: int
    messages_reused: int
    fallbacks: int


def count_evaluations(world: OpenWorld, agreement: Agreement) -> EvaluationCounts:
    """Add up the reports of a session."""
    reports = [r.decision.report for r in agreement.records if r.decision is not None]
    later = reports[len(world.candidates) :]
    return EvaluationCounts(
        candidates=sum(len(paths) for paths in world.candidates.values()),
        iterations=len(reports),
        not_impacted=sum(len(report.untouched) for report in later),
        solves=sum(report.solves for report in reports),
        skipped=sum(len(report.skipped) for report in reports),
        messages_reused=sum(report.messages_reused for report in reports),
        fallbacks=sum(report.fallbacks for report in reports),
    )


def impacted_share(sessions: Sequence[tuple[OpenWorld, Agreement]]) -> float:
    """Mean share of a robot's candidates that an announcement impacts.

    Args:
        sessions: Worlds and what was agreed in them.

    Returns:
        Mean over all evaluations but each robot's first; NaN where no robot evaluated twice.
    """
    shares = []
    for world, agreement in sessions:
        size = len(next(iter(world.candidates.values())))
        reports = [r.decision.report for r in agreement.records if r.decision is not None]
        shares += [len(report.impacted) / size for report in reports[len(world.candidates) :]]
    return float(np.mean(shares)) if shares else float("nan")


def largest_difference(world: OpenWorld, agreement: Agreement) -> float:
    """Largest relative difference of any term, incremental against from scratch by QR.

    Args:
        world: The world.
        agreement: Its announced paths are those under which all candidates are compared.

    Returns:
        Largest |a - b| / |b| over robots, candidates and terms.
    """
    return compare_candidates(world.problem, world.candidates, agreement.paths, {})
