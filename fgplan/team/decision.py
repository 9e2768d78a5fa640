"""A robot's best response: its best candidate under what the others have announced.

A robot announces another path only if the common objective falls by more than a relative
tolerance (1e-6 by default, far above the 1e-9 to which evaluators agree); otherwise it keeps its
path. So accepted announcements lower the objective each time, and there are finitely many paths.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.evaluation.evaluations import AbstractEvaluator, ReevaluationReport
from fgplan.paths.candidate_path import CandidatePath


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What a robot found on its turn.

    Attributes:
        index: Its best candidate.
        value: Common objective with it.
        incumbent: The candidate that it has announced.
        incumbent_value: Common objective with that.
        improves: Whether the objective falls by more than the tolerance.
        seconds: Time of the evaluation.
        report: Account of the work.
    """

    index: int
    value: float
    incumbent: int
    incumbent_value: float
    improves: bool
    seconds: float
    report: ReevaluationReport


def decide(
    evaluator: AbstractEvaluator,
    state: Any,  # noqa: ANN401 - the evaluator's own
    announced: Mapping[str, CandidatePath],
    incumbent: int,
    *,
    robot: str,
    tolerance: float,
    choose: bool,
) -> tuple[Any, Decision]:
    """Evaluate the candidates and compare the best with the path announced.

    Args:
        evaluator: How to evaluate.
        state: The evaluator's state.
        announced: Paths of the others.
        incumbent: Index of the candidate that this robot has announced.
        robot: Name, for messages.
        tolerance: Relative fall of the objective that is worth an announcement.
        choose: Whether to let the evaluator choose by bounds if it can (it has ``choose``).

    Returns:
        The evaluator's new state and the decision.

    Raises:
        NoCandidatePathError: If no candidate has a finite value.
        InvalidInputError: If the evaluator gives no finite value for the announced path.
    """
    began = time.perf_counter()
    if choose and hasattr(evaluator, "choose"):
        state, choice = evaluator.choose(state, announced, incumbent)
        index, value = int(choice.index), float(choice.value)
        before, report = float(choice.incumbent_value), choice.report
    else:
        state, evaluations = evaluator.evaluate(state, announced)
        index = evaluations.best
        value, before = float(evaluations.values[index]), float(evaluations.values[incumbent])
        report = evaluations.report
    seconds = time.perf_counter() - began
    if not (np.isfinite(before) and np.isfinite(value)):
        raise InvalidInputError(
            f"robot {robot!r}: evaluator {evaluator.name!r}: expected finite values of the best "
            f"and the announced candidate ({index} and {incumbent}), got {value} and {before}"
        )
    return state, Decision(
        index=index,
        value=value,
        incumbent=incumbent,
        incumbent_value=before,
        improves=index != incumbent and value < before - tolerance * abs(before),
        seconds=seconds,
        report=report,
    )
