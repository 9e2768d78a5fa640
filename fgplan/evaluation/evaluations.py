"""What an evaluation returns: a value a candidate, and an account of the work.

The account (the report) is what the paper is about: which factors an announcement added and
removed, which vertices are involved, which candidate paths are impacted, and what was reused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from fgplan.errors import NoCandidatePathError
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import FloatArray

TIE_TOLERANCE = 1e-9
"""Relative difference below which two values are equal; the lower index wins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReevaluationReport:
    """Account of one evaluation of a robot's candidates.

    Attributes:
        factors_added: Distinct multi-robot factors that the change of announcements added.
        factors_removed: Distinct multi-robot factors that it removed.
        factors_kept: Distinct multi-robot factors in both.
        involved_vertices: Roadmap vertices with a multi-robot factor before or after, increasing.
        impacted: Indices of candidates whose own belief may have changed.
        untouched: Indices of candidates that only share a constant of the others' terms.
        messages_reused: Candidate messages taken over from before.
        messages_rebuilt: Candidate messages built anew.
        segments_reused: Distinct segments whose messages were carried over from an earlier planning
            session, of the candidates that were built for the first time in this one.
        segments_rebuilt: Their other segments; 0 where nothing was carried.
        solves: Final solves or eliminations done.
        skipped: Indices excluded by a lower bound without being evaluated.
        fallbacks: Solves that the fast form refused and the reference form or a QR did.
        bytes_held: Memory of what is kept for the next evaluation.
        notes: Plain sentences, for instance why bounds could not be used.
    """

    factors_added: int = 0
    factors_removed: int = 0
    factors_kept: int = 0
    involved_vertices: tuple[int, ...] = ()
    impacted: tuple[int, ...] = ()
    untouched: tuple[int, ...] = ()
    messages_reused: int = 0
    messages_rebuilt: int = 0
    segments_reused: int = 0
    segments_rebuilt: int = 0
    solves: int = 0
    skipped: tuple[int, ...] = ()
    fallbacks: int = 0
    bytes_held: int = 0
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluations:
    """Objective values of all candidates of one robot under the announced paths.

    Attributes:
        robot: Name of the robot.
        values: Shape (N,), objective of the whole team for each candidate; infinite where a
            bound excluded the candidate.
        terms: Shape (N, T), unweighted value of each objective term; NaN where excluded.
        report: Account of the work.
    """

    robot: str
    values: FloatArray
    terms: FloatArray
    report: ReevaluationReport

    @property
    def best(self) -> int:
        """Index of the best candidate; of equal ones the lowest.

        Raises:
            NoCandidatePathError: If there is none.
        """
        return select(self.values, self.robot)


class AbstractEvaluator(Protocol):
    """One way of evaluating candidate paths; the state is a value passed in and out.

    Optional: ``choose`` finds the best candidate without evaluating all, and ``carry`` makes of a
    state what the next planning session may use, which ``start`` then takes as ``carried``.
    """

    @property
    def name(self) -> str:
        """Name in scenarios and reports."""
        ...

    def start(
        self, problem: PlanningProblem, robot: str, candidates: Sequence[CandidatePath]
    ) -> Any:  # noqa: ANN401 - the state is the evaluator's own
        """Prepare what depends on the prior and the candidates alone."""
        ...

    def evaluate(
        self,
        state: Any,  # noqa: ANN401
        announced: Mapping[str, CandidatePath],
    ) -> tuple[Any, Evaluations]:
        """Evaluate every candidate under the others' announced paths."""
        ...


def select(values: FloatArray, robot: str) -> int:
    """Index of the smallest value; values within the tie tolerance count as equal.

    Args:
        values: Shape (N,); infinite for candidates that were excluded.
        robot: Name, for the message.

    Returns:
        The lowest index whose value is within the tolerance of the smallest.

    Raises:
        NoCandidatePathError: If there is no candidate with a finite value.
    """
    if values.size == 0 or not np.isfinite(values).any():
        raise NoCandidatePathError(
            f"robot {robot!r}: expected at least one candidate path with a finite value, got "
            f"{values.size}; check that its goal is reachable"
        )
    smallest = float(values.min())
    return int(np.argmax(values <= smallest + TIE_TOLERANCE * abs(smallest)))


def weigh(problem: PlanningProblem, terms: FloatArray) -> FloatArray:
    """Objective values from unweighted terms: shape (N, T) to (N,)."""
    weights = np.array([term.weight for term in problem.objective.terms])
    return terms @ weights
