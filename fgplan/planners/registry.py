"""Planners by name; a user's own as ``module:object``.

Nothing is imported before it is asked for. A name stands for a class (made without arguments) or
an object with ``name`` and ``plan``.
"""

import inspect
from collections.abc import Callable

from fgplan.errors import InvalidInputError
from fgplan.evaluation.registry import find_object
from fgplan.planners.plan import Plan
from fgplan.planners.planner import AbstractPlanner

_PLAN = "plan(mission, generator, progress)"

PLANNERS: dict[str, str] = {
    "impacted_paths": "fgplan.planners.impacted_paths.planner:ImpactedPathsPlanner",
    "exhaustive": "fgplan.planners.exhaustive.planner:ExhaustivePlanner",
    "aia": "fgplan.planners.aia.planner:AiaPlanner",
    "distributed_aia": "fgplan.planners.distributed_aia.planner:DistributedAiaPlanner",
    "greedy": "fgplan.planners.greedy.planner:PLANNER",
    "biased_greedy": "fgplan.planners.biased_greedy.planner:PLANNER",
    "fvi": "fgplan.planners.fvi.planner:PLANNER",
    "rig_tree": "fgplan.planners.rig_tree.planner:PLANNER",
    "dec_mcts": "fgplan.planners.dec_mcts.planner:PLANNER",
    "intermittent": "fgplan.planners.intermittent.planner:IntermittentPlanner",
}
"""Name to ``module:object``; more are added by ``register_planner``."""


def register_planner(name: str, target: str, *, replace: bool = False) -> None:
    """Add a planner to the registry; the same one again is no error.

    Args:
        name: Name in scenario files.
        target: ``module:object``.
        replace: Whether it may take the place of another planner of that name.

    Raises:
        InvalidInputError: If the name is taken, or the target has another form.
    """
    if not replace and PLANNERS.get(name, target) != target:
        raise InvalidInputError(
            f"planner {name!r}: the name is taken by {PLANNERS[name]!r}; choose another or pass "
            "replace=True"
        )
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
        InvalidInputError: If the object is no planner, or its ``plan`` takes other arguments.
    """
    found = find_object(name, PLANNERS, "planner")
    if isinstance(found, type) and not _takes(found, 0):
        raise InvalidInputError(
            f"planner {name!r}: expected a class made without arguments, got "
            f"{found.__name__}{inspect.signature(found)}; give each argument a default"
        )
    planner = found() if isinstance(found, type) else found
    if not isinstance(planner, AbstractPlanner):
        raise InvalidInputError(
            f"planner {name!r}: expected an object with name and plan(mission, generator, "
            f"progress), got {type(planner).__name__}"
        )
    if not callable(planner.plan) or not _takes(planner.plan, 3):
        have = f"plan{inspect.signature(planner.plan)}" if callable(planner.plan) else "no method"
        raise InvalidInputError(
            f"planner {name!r}: expected {_PLAN}, called with these three in this order, got {have}"
        )
    return planner


def check_plan(plan: object, planner: str) -> Plan:
    """Check what a planner, perhaps a user's own, came to.

    Args:
        plan: What its ``plan`` returned.
        planner: Its name, for the message.

    Returns:
        The plan.

    Raises:
        InvalidInputError: If it is none.
    """
    if not isinstance(plan, Plan):
        raise InvalidInputError(
            f"planner {planner!r}: expected {_PLAN} to return a fgplan.Plan, got "
            f"{'None' if plan is None else type(plan).__name__}"
        )
    return plan


def _takes(call: Callable[..., object], positional: int) -> bool:
    """Whether something can be called with so many arguments; true where Python cannot tell."""
    try:
        inspect.signature(call).bind(*[None] * positional)
    except ValueError:  # no signature, as of compiled classes
        return True
    except TypeError:
        return False
    return True
