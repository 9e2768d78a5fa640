"""Objective terms as plain data.

A robot announces the terms that concern it, so that a teammate with another objective is found out
at once instead of never agreeing. A user's own function does not travel: its name and weight do.
"""

from typing import Annotated, Literal

import msgspec

from fgplan.errors import InvalidInputError
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
)

Name = Annotated[str, msgspec.Meta(min_length=1, max_length=256)]


class UncertaintyTermData(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="uncertainty", tag_field="kind"
):
    """Data of an ``UncertaintyTerm``; ``of`` names which of robots and keys is meant."""

    of: Literal["poses", "trajectory", "prior_variables"]
    function: Name
    block: Name
    weight: float
    read: Name | tuple[int, ...]
    robots: tuple[Name, ...] = ()
    keys: tuple[int, ...] = ()
    arrival_of: Name | None = None


class PathTermData(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="path", tag_field="kind"
):
    """Data of a term that reads one robot's path."""

    of: Literal["path_length", "travel_time", "path_term"]
    robot: Name
    weight: float
    name: str = ""


TermData = UncertaintyTermData | PathTermData


def term_data(term: Term) -> TermData:
    """Plain data of an objective term."""
    if isinstance(term, PathLengthTerm):
        return PathTermData("path_length", term.robot, float(term.weight))
    if isinstance(term, TravelTimeTerm):
        return PathTermData("travel_time", term.robot, float(term.weight))
    if isinstance(term, PathTerm):
        return PathTermData("path_term", term.robot, float(term.weight), term.name)
    of: Literal["poses", "trajectory", "prior_variables"]
    robots: tuple[str, ...] = ()
    keys: tuple[int, ...] = ()
    if isinstance(term.of, PosesOf):
        of, robots = "poses", tuple(term.of.robots)
    elif isinstance(term.of, Trajectory):
        of, robots = "trajectory", (term.of.robot,)
    else:
        of, keys = "prior_variables", tuple(int(key) for key in term.of.keys)
    return UncertaintyTermData(
        of,
        term.function,
        term.block,
        float(term.weight),
        term.read,
        robots,
        keys,
        term.arrival_of,
    )


def term_of(data: TermData) -> Term:
    """Objective term of plain data.

    Args:
        data: As announced.

    Returns:
        The term.

    Raises:
        InvalidInputError: If it is a user's own function, which does not travel, or not a term.
        UnknownNameError: If its uncertainty function is not registered here.
    """
    if isinstance(data, PathTermData):
        if data.of == "path_length":
            return PathLengthTerm(robot=data.robot, weight=data.weight)
        if data.of == "travel_time":
            return TravelTimeTerm(robot=data.robot, weight=data.weight)
        raise InvalidInputError(
            f"objective term {data.name!r} of robot {data.robot!r}: a user's own function does not "
            "travel; give every robot the same objective"
        )
    of: VariableSet
    if data.of == "poses":
        of = PosesOf(data.robots)
    elif data.of == "trajectory":
        of = Trajectory(data.robots[0] if data.robots else "")
    else:
        of = PriorVariables(data.keys)
    return UncertaintyTerm(
        of=of,
        function=data.function,
        block=data.block,  # type: ignore[arg-type] # checked by the term itself
        weight=data.weight,
        read=data.read,  # type: ignore[arg-type] # checked by the term itself
        arrival_of=data.arrival_of,
    )


def terms_of(objective: Objective, robot: str) -> tuple[TermData, ...]:
    """Terms that concern a robot, in the order of the objective.

    Args:
        objective: The team's.
        robot: Name.

    Returns:
        Data of each term that reads this robot's path or poses, or variables of the prior.
    """
    data = (term_data(term) for term in objective.terms)
    return tuple(term for term in data if _concerns(term, robot))


def _concerns(data: TermData, robot: str) -> bool:
    """Whether a term reads a robot; variables of the prior are everybody's."""
    if isinstance(data, PathTermData):
        return data.robot == robot
    return data.of == "prior_variables" or robot in (*data.robots, data.arrival_of)
