"""Evaluators by name; a user's own as ``module:object``."""

from fgplan.errors import InvalidInputError
from fgplan.evaluation.evaluations import AbstractEvaluator
from fgplan.planners.registry import find_object

EVALUATORS: dict[str, str] = {
    "incremental": "fgplan.evaluation.incremental.evaluator:Incremental",
    "from_scratch": "fgplan.evaluation.from_scratch:FromScratch",
    "isam2": "fgplan.evaluation.isam2:Isam2",
    "as_published": "fgplan.evaluation.as_published:AsPublished",
}

INEXACT = ("as_published",)
"""Evaluators whose objective may rise although each robot found a fall."""


def find_evaluator(name: str) -> AbstractEvaluator:
    """Find an evaluator.

    Args:
        name: A registered name, or ``module:object`` of a user's own.

    Returns:
        The evaluator.

    Raises:
        UnknownNameError: If there is none; lists those that are.
        InvalidInputError: If the object is no evaluator.
    """
    found = find_object(name, EVALUATORS, "evaluator")
    evaluator = found() if isinstance(found, type) else found
    if not all(hasattr(evaluator, part) for part in ("name", "start", "evaluate")):
        raise InvalidInputError(
            f"evaluator {name!r}: expected an object with name, start and evaluate, got "
            f"{type(evaluator).__name__}"
        )
    checked: AbstractEvaluator = evaluator
    return checked
