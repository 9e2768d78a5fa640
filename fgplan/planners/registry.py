"""Planners by name; a user's own as ``module:object``.

Nothing is imported before it is asked for. A name stands for a class (made without arguments) or
an object with ``name`` and ``plan``.
"""

import importlib
from typing import Any

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.planners.planner import AbstractPlanner

PLANNERS: dict[str, str] = {
    "impacted_paths": "fgplan.planners.impacted_paths.planner:ImpactedPathsPlanner",
    "exhaustive": "fgplan.planners.exhaustive.planner:ExhaustivePlanner",
}
"""Name to ``module:object``; more are added by ``register_planner``."""


def register_planner(name: str, target: str) -> None:
    """Add a planner to the registry.

    Args:
        name: Name in scenario files.
        target: ``module:object``.

    Raises:
        InvalidInputError: If the name is taken, or the target has another form.
    """
    if name in PLANNERS:
        raise InvalidInputError(f"planner {name!r}: the name is taken; choose another")
    if ":" not in target:
        raise InvalidInputError(f"planner {name!r}: expected 'module:object', got {target!r}")
    PLANNERS[name] = target


def find_planner(name: str) -> AbstractPlanner:
    """Find a planner.

    Args:
        name: A registered name, or ``module:object`` of a user's own.

    Returns:
        The planner.

    Raises:
        UnknownNameError: If there is none; lists those that are.
        InvalidInputError: If the object is no planner.
    """
    found = find_object(name, PLANNERS, "planner")
    planner = found() if isinstance(found, type) else found
    if not isinstance(planner, AbstractPlanner):
        raise InvalidInputError(
            f"planner {name!r}: expected an object with name and plan(mission, generator, "
            f"progress), got {type(planner).__name__}"
        )
    return planner


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
    names = ", ".join(sorted(known))
    if not colon:
        raise UnknownNameError(
            f"{what} {name!r}: expected one of {names}, or your own as 'module:object'"
        )
    try:
        found: Any = importlib.import_module(module_name)
        for part in attribute.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError, ValueError) as error:
        raise UnknownNameError(
            f"{what} {name!r}: cannot import {target!r}: {error}; expected one of {names}, or "
            "your own as 'module:object' on the import path"
        ) from error
    return found
