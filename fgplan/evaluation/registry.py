"""Evaluators by name; a user's own as ``module:object``.

Nothing is imported before it is asked for. A name stands for a class (made without arguments) or
an object.
"""

import importlib
from typing import Any

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.evaluation.evaluations import AbstractEvaluator

EVALUATORS: dict[str, str] = {
    "incremental": "fgplan.evaluation.incremental.evaluator:Incremental",
    "from_scratch": "fgplan.evaluation.from_scratch:FromScratch",
    "isam2": "fgplan.evaluation.isam2:Isam2",
    "as_published": "fgplan.evaluation.as_published:AsPublished",
}

INEXACT = ("as_published",)
"""Evaluators whose objective may rise although each robot found a fall."""


def find_evaluator(evaluator: str | AbstractEvaluator) -> AbstractEvaluator:
    """Find an evaluator.

    Args:
        evaluator: A registered name, ``module:object`` of a user's own, or an evaluator itself.

    Returns:
        The evaluator.

    Raises:
        UnknownNameError: If there is none of that name; lists those that are.
        InvalidInputError: If the object is no evaluator, or is the class of one.

    Example:
        >>> find_evaluator("from_scratch")
        FromScratch(elimination='marginals', name='from_scratch')
    """
    found: Any = evaluator
    if isinstance(evaluator, str):
        found = find_object(evaluator, EVALUATORS, "evaluator")
        found = found() if isinstance(found, type) else found
    elif isinstance(evaluator, type):
        raise InvalidInputError(
            f"evaluator: expected an evaluator, got the class {evaluator.__name__}; make one: "
            f"{evaluator.__name__}()"
        )
    if not all(hasattr(found, part) for part in ("name", "start", "evaluate")):
        raise InvalidInputError(
            f"evaluator {evaluator!r}: expected an object with name, start and evaluate, got "
            f"{type(found).__name__}"
        )
    checked: AbstractEvaluator = found
    return checked


def find_object(name: str, known: dict[str, str], what: str) -> Any:  # noqa: ANN401
    """Import the object that a registered name or ``module:object`` stands for.

    Args:
        name: The name.
        known: Registered names and what they stand for.
        what: What it is, for the message.

    Returns:
        The object.

    Raises:
        UnknownNameError: If it is not known or cannot be imported; lists the known names.
    """
    target = known.get(name, name)
    module_name, colon, attribute = target.partition(":")
    names = f"one of {', '.join(sorted(known))}, or your own" if known else "your own"
    if not colon:
        raise UnknownNameError(f"{what} {name!r}: expected {names} as 'module:object'")
    try:
        found: Any = importlib.import_module(module_name)
        for part in attribute.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError, ValueError) as error:
        raise UnknownNameError(
            f"{what} {name!r}: cannot import {target!r}: {error}; expected {names} as "
            "'module:object' on the import path"
        ) from error
    return found
