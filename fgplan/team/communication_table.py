"""Communication graphs from plain data: a ``kind`` and the fields of that kind."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.team.communication_graph import CommunicationGraph

KINDS: dict[str, tuple[str, ...]] = {
    "complete": (),
    "none": (),
    "random": ("average_degree",),
    "edges": ("edges",),
    "schedule": ("graphs", "period"),
    "range": ("range_m",),
}
"""Kinds of graph in plain data and the fields of each."""


def read_communication_graph(
    given: Mapping[str, Any], robots: Sequence[str], generator: np.random.Generator
) -> CommunicationGraph:
    """A communication graph from plain data, as a scenario gives it.

    Args:
        given: ``kind``, one of ``KINDS``, and the fields of that kind: ``average_degree``;
            ``edges`` as pairs of names; ``graphs`` as mappings like this one, and ``period`` (one
            step if left out); ``range_m`` in metres.
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
    known = KINDS[kind]
    for name in given:
        if name not in ("kind", *known):
            raise UnknownNameError(
                f"communication graph {name}: expected one of {', '.join(('kind', *known))} for "
                f"kind {kind!r}, got {name!r}"
            )
    for name in known:
        if name not in given and name != "period":
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
    entries = given[known[0]]
    if isinstance(entries, str | Mapping) or not isinstance(entries, Sequence):
        raise InvalidInputError(f"communication graph {known[0]}: expected a list, got {entries!r}")
    if kind == "edges":
        return CommunicationGraph.of_edges(robots, entries)
    graphs = [read_communication_graph(entry, robots, generator) for entry in entries]
    return CommunicationGraph.on_schedule(graphs, given.get("period", 1))
