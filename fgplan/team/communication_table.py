"""Communication graphs from plain data: a ``kind`` and the fields of that kind."""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any

import numpy as np

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.team.communication_graph import CommunicationGraph


@dataclass(frozen=True, slots=True)
class CompleteGraph:
    """Every robot hears every other."""


@dataclass(frozen=True, slots=True)
class EmptyGraph:
    """Nobody hears anybody."""


@dataclass(frozen=True, slots=True)
class RandomGraph:
    """A random connected graph.

    Attributes:
        average_degree: Neighbours of a robot, on average.
    """

    average_degree: float


@dataclass(frozen=True, slots=True)
class EdgesGraph:
    """The pairs that hear each other.

    Attributes:
        edges: Pairs of names of robots.
    """

    edges: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class ScheduleGraph:
    """Graphs in turn, again and again.

    Attributes:
        graphs: Tables like this one, of kinds that stay as they are.
        period: Steps that each one holds.
    """

    graphs: tuple[Mapping[str, Any], ...]
    period: int = 1


@dataclass(frozen=True, slots=True)
class RangeGraph:
    """Robots that are near hear each other.

    Attributes:
        range_m: Greatest distance at which they do, metres.
    """

    range_m: float


KINDS: dict[str, type] = {
    "complete": CompleteGraph,
    "none": EmptyGraph,
    "random": RandomGraph,
    "edges": EdgesGraph,
    "schedule": ScheduleGraph,
    "range": RangeGraph,
}
"""Kinds of graph in plain data, each with a dataclass of its fields."""


def read_communication_graph(
    given: Mapping[str, Any], robots: Sequence[str], generator: np.random.Generator
) -> CommunicationGraph:
    """A communication graph from plain data, as a scenario gives it.

    Args:
        given: ``kind``, one of ``KINDS``, and the fields of that kind.
        robots: In the order of the team.
        generator: Source of random graphs; each one draws from it in the order given.

    Returns:
        The graph.

    Raises:
        UnknownNameError: If the kind, a field or a robot is not known; lists those that are.
        InvalidInputError: If a field is missing or has a value that is not usable.
    """
    if not isinstance(given, Mapping):
        raise InvalidInputError(f"communication graph: expected a table, got {given!r}")
    kind = given.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise UnknownNameError(
            f"communication graph kind: expected one of {', '.join(KINDS)}, got {kind!r}"
        )
    known = {field.name: field.default for field in fields(KINDS[kind])}
    for name in given:
        if name not in ("kind", *known):
            raise UnknownNameError(
                f"communication graph {name}: expected one of {', '.join(('kind', *known))} for "
                f"kind {kind!r}, got {name!r}"
            )
    for name, default in known.items():
        if name not in given and default is MISSING:
            raise InvalidInputError(
                f"communication graph {name}: expected for kind {kind!r}, got none"
            )
    if kind == "complete":
        return CommunicationGraph.complete(robots)
    if kind == "none":
        return CommunicationGraph.none(robots)
    if kind == "random":
        return CommunicationGraph.random_connected(robots, given["average_degree"], generator)
    if kind == "range":
        return CommunicationGraph.within_range(robots, given["range_m"])
    listed = "edges" if kind == "edges" else "graphs"
    entries = given[listed]
    if isinstance(entries, str | Mapping) or not isinstance(entries, Sequence):
        raise InvalidInputError(f"communication graph {listed}: expected a list, got {entries!r}")
    if kind == "edges":
        return CommunicationGraph.of_edges(robots, entries)
    graphs = [read_communication_graph(entry, robots, generator) for entry in entries]
    return CommunicationGraph.on_schedule(graphs, given.get("period", known["period"]))
