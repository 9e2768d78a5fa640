"""Other ways of planning the same session, timed beside the one that is executed.

Every contestant gets the same problem, candidates and digest, and a prior in which nothing has been
eliminated yet, so that each pays for its own preparation.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fgplan.closed_loop.records import EvaluatorRecord
from fgplan.evaluation.evaluations import AbstractEvaluator
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath
from fgplan.team.agreement import Agreement
from fgplan.team.coordination import coordinate
from fgplan.team.options import CoordinationOptions

Candidates = Mapping[str, tuple[CandidatePath, ...]]


@dataclass(frozen=True, slots=True)
class Contestant:
    """One way of planning a session.

    Attributes:
        evaluator: How candidates are evaluated.
        choose: Whether the best is found by lower bounds.
        exact: Whether its values are exact; the objective then never rises.
        repeats: How often the session is planned; the median time counts.
        carries: Whether it takes what earlier sessions left.
    """

    evaluator: AbstractEvaluator
    choose: bool = False
    exact: bool = True
    repeats: int = 1
    carries: bool = False


EXECUTED = "incremental_choose"
"""The contestant whose choice is executed."""

OURS: Mapping[str, Contestant] = {
    EXECUTED: Contestant(Incremental(), choose=True, repeats=1, carries=True),
}

EVERYBODY: Mapping[str, Contestant] = {
    EXECUTED: Contestant(Incremental(), choose=True, repeats=3, carries=True),
    "incremental": Contestant(Incremental(), repeats=3, carries=True),
    "from_scratch": Contestant(FromScratch(elimination="marginals")),
    "from_scratch_fastest": Contestant(FromScratch(elimination="fastest")),
}
"""Ours by bounds and evaluating all, and two opponents from scratch."""


def plan_as(
    contestant: Contestant,
    problem: PlanningProblem,
    candidates: Candidates,
    options: CoordinationOptions,
    digest: str,
    carried: Mapping[str, Any],
) -> tuple[EvaluatorRecord, Agreement]:
    """Plan one session by one contestant.

    Args:
        contestant: How.
        problem: Prior, team, objective and models.
        candidates: Candidate paths of each robot.
        options: How the team comes to agree.
        digest: Digest of the prior, computed once for all.
        carried: By robot, what its evaluator carried over from earlier sessions.

    Returns:
        The record, and the agreement of the last repeat.
    """
    seconds = []
    chosen = replace(options, choose=contestant.choose, check_values=contestant.exact)
    for _ in range(contestant.repeats):
        problem.prior.eliminations.clear()
        began = time.perf_counter()
        agreement = coordinate(
            problem,
            candidates,
            contestant.evaluator,
            options=chosen,
            prior_digest=digest,
            carried=carried if contestant.carries else None,
        )
        seconds.append(time.perf_counter() - began)
    return (
        EvaluatorRecord(
            seconds=float(np.median(seconds)),
            chosen=dict(agreement.chosen),
            objective=agreement.value,
            turns=agreement.turns,
            impacted_share=impacted_share(agreement, candidates),
        ),
        agreement,
    )


def impacted_share(agreement: Agreement, candidates: Candidates) -> float | None:
    """Mean share of a robot's candidates that an announcement impacted, its first look left out."""
    seen: set[str] = set()
    shares = []
    for record in agreement.records:
        if record.decision is None:
            continue
        if record.robot in seen and candidates[record.robot]:
            size = len(candidates[record.robot])
            shares.append(len(record.decision.report.impacted) / size)
        seen.add(record.robot)
    return float(np.mean(shares)) if shares else None


def largest_difference(
    problem: PlanningProblem,
    candidates: Candidates,
    announced: Mapping[str, CandidatePath],
    carried: Mapping[str, Any],
) -> float:
    """Largest relative difference of any term of any candidate: ours against from scratch by QR.

    Args:
        problem: Prior, team, objective and models.
        candidates: Candidate paths of each robot.
        announced: Paths under which all candidates are compared.
        carried: By robot, what its evaluator carried over from earlier sessions.

    Returns:
        Largest |a - b| / |b|.
    """
    worst = 0.0
    oracle, ours = FromScratch(elimination="qr"), Incremental()
    for robot, paths in candidates.items():
        if not paths:
            continue
        others = {name: path for name, path in announced.items() if name != robot}
        _, want = oracle.evaluate(oracle.start(problem, robot, paths), others)
        memory = ours.start(problem, robot, paths, carried=carried.get(robot))
        _, got = ours.evaluate(memory, others)
        scale = np.maximum(np.abs(want.terms), 1e-300)
        worst = max(worst, float(np.max(np.abs(got.terms - want.terms) / scale)))
    return worst
