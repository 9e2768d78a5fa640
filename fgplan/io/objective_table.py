"""``[objective]`` to an ``Objective``: the preset of equation (41), or a list of terms.

A term without a robot stands for one term a robot, in the order of the team.
"""

from typing import Any

from fgplan.evaluation.objective import (
    Objective,
    PathLengthTerm,
    PathTerm,
    PosesOf,
    PriorVariables,
    Term,
    Trajectory,
    TravelTimeTerm,
    UncertaintyTerm,
    VariableSet,
    length_and_uncertainty,
)
from fgplan.io.key_name import read_key
from fgplan.io.place import Place
from fgplan.io.prior_table import Prior
from fgplan.io.scenario import Scenario, TermTable
from fgplan.io.user_object import load_object
from fgplan.typing import Key

_SELECTORS = ("robot", "robots", "trajectory_of", "landmarks", "keys")
_ONLY_UNCERTAINTY = (
    "robots",
    "trajectory_of",
    "landmarks",
    "keys",
    "block",
    "read",
    "arrival_of",
)


def make_objective(scenario: Scenario, prior: Prior, place: Place) -> Objective:
    """Make the objective of a scenario.

    Args:
        scenario: The scenario.
        prior: Keys of the prior and of the scenario's landmarks.
        place: The whole file, for messages.

    Returns:
        The objective; that of equation (41) with the paper's weights where the file says nothing.

    Raises:
        ScenarioError: If preset and terms are both given, a name is not known, or a field does
            not belong to a term's kind.
    """
    table, where = scenario.objective, place.at("objective")
    robots = tuple(robot.name for robot in scenario.robots)
    if not table.terms:
        weights = {
            name: value
            for name, value in (
                ("path_weight", table.path_weight),
                ("uncertainty_weight", table.uncertainty_weight),
            )
            if value is not None
        }
        with where.checking():
            return length_and_uncertainty(robots, **weights)
    for name in ("preset", "path_weight", "uncertainty_weight"):
        if getattr(table, name) is not None:
            raise where.error(f"expected a preset or terms, one of the two, got {name} and terms")
    terms: list[Term] = []
    for index, term in enumerate(table.terms):
        terms.extend(_make_terms(term, robots, prior, where.at(f"terms[{index}]")))
    return Objective(tuple(terms))


def _make_terms(
    table: TermTable, robots: tuple[str, ...], prior: Prior, place: Place
) -> list[Term]:
    """One term, or one a robot."""
    _check_fields(table, place)
    named = (table.robot, table.trajectory_of, table.arrival_of, *(table.robots or ()))
    for robot in named:
        if robot is not None and robot not in robots:
            raise place.error(f"expected one of the robots {', '.join(robots)}, got {robot!r}")
    each = robots if table.robot is None else (table.robot,)
    with place.checking():
        if table.kind == "path_length":
            return [PathLengthTerm(robot=robot, weight=table.weight) for robot in each]
        if table.kind == "travel_time":
            return [TravelTimeTerm(robot=robot, weight=table.weight) for robot in each]
        if table.kind == "path":
            return _make_path_terms(table, each, place)
        variables = _variables(table, prior, place)
        sets = [PosesOf((robot,)) for robot in each] if variables is None else [variables]
        given: dict[str, Any] = {
            name: getattr(table, name)
            for name in ("function", "block", "read", "arrival_of")
            if getattr(table, name) is not None
        }
        return [UncertaintyTerm(of=of, weight=table.weight, **given) for of in sets]


def _check_fields(table: TermTable, place: Place) -> None:
    """Refuse fields that do not belong to the kind, and two selectors at once."""
    given = [name for name in _SELECTORS if getattr(table, name) is not None]
    if len(given) > 1:
        raise place.error(f"expected one of {', '.join(_SELECTORS)} at most, got {given}")
    if table.kind != "uncertainty":
        foreign = [name for name in _ONLY_UNCERTAINTY if getattr(table, name) is not None]
        if table.kind != "path":
            foreign += [name for name in ("function", "name") if getattr(table, name) is not None]
        if foreign:
            raise place.error(f"expected no {foreign[0]} in a term of kind {table.kind!r}, got one")
    elif table.name is not None:
        raise place.error("expected no name in a term of kind 'uncertainty', got one")


def _make_path_terms(table: TermTable, robots: tuple[str, ...], place: Place) -> list[Term]:
    """A user's own number of a path."""
    if table.function is None:
        raise place.at("function").error(
            "expected 'module:object', called with a path, got nothing"
        )
    function: Any = load_object(table.function, place.at("function"))
    if not callable(function):
        raise place.at("function").error(
            f"expected something to call with a path, got {type(function).__name__}"
        )
    name = table.name or table.function.partition(":")[2]
    return [
        PathTerm(robot=robot, name=name, function=function, weight=table.weight) for robot in robots
    ]


def _variables(table: TermTable, prior: Prior, place: Place) -> VariableSet | None:
    """The variables that are named, or None for each robot's pose in turn."""
    if table.robots is not None:
        return PosesOf(table.robots)
    if table.trajectory_of is not None:
        return Trajectory(table.trajectory_of)
    if table.keys is not None:
        return PriorVariables(tuple(_prior_key(key, prior, place) for key in table.keys))
    if table.landmarks is None:
        return None
    landmark_keys = prior.landmark_keys
    if not landmark_keys:
        raise place.at("landmarks").error("expected [[landmarks]] in the scenario, got none")
    if table.landmarks == "all":
        return PriorVariables(tuple(landmark_keys.values()))
    for name in table.landmarks:
        if name not in landmark_keys:
            known = ", ".join(landmark_keys)
            raise place.at("landmarks").error(f"expected landmarks among {known}, got {name!r}")
    return PriorVariables(tuple(landmark_keys[name] for name in table.landmarks))


def _prior_key(name: str | int, prior: Prior, place: Place) -> Key:
    """A key that the prior has."""
    where = place.at("keys")
    key = read_key(name, where)
    with where.checking():
        prior.belief.dim(key)
    return key
