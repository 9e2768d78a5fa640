"""Who hears whom, step by step: an undirected graph over the robots of a team.

    links(t) = schedule[(t // period) mod T]  and  distance <= range_m

The schedule is a cycle of T sets of edges, each of which holds for ``period`` steps; the range
leaves of them those whose robots are near enough at the step. A graph that never changes is a
schedule of one without a range, so one question answers all. Tzes et al. 2021, section II-B, has
graphs that do not change (section VI: all-to-all, random connected with a stated average degree, no
communication); links that come and go are its future work (section VII).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import networkx as nx
import numpy as np

from fgplan.checks import check_finite, check_generator, check_not_negative
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.typing import ArrayLike, BoolArray

Edge = tuple[str, str]
MOST_STEPS = 2**62
"""Latest step and longest period; what 64 bits hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommunicationGraph:
    """Links between robots, constant or by step.

    Attributes:
        robots: Unique names, in the order of the team.
        schedule: Sets of edges by the names of two robots, at least one set.
        period: Steps for which each set holds.
        range_m: Largest distance of a link, metres; infinite: any.

    Example:
        >>> graph = CommunicationGraph.of_edges(("ann", "bob", "carl"), [("carl", "ann")])
        >>> graph.schedule, graph.ever(2), graph.is_connected()
        (((('ann', 'carl'),),), (0,), False)
    """

    robots: tuple[str, ...]
    schedule: tuple[tuple[Edge, ...], ...]
    period: int = 1
    range_m: float = math.inf
    _links: BoolArray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check names and numbers; edges come into the order of the team."""
        robots = tuple(self.robots)
        if not robots or len(set(robots)) != len(robots):
            raise InvalidInputError(
                f"communication graph: expected unique robots, at least one, got {list(robots)}"
            )
        _check_steps("period", self.period, least=1)
        if self.range_m != math.inf:
            check_not_negative(self.range_m, "communication graph range_m")
        if len(self.schedule) == 0:
            raise InvalidInputError(
                "communication graph schedule: expected at least one set of edges, got none"
            )
        schedule = tuple(_ordered(edges, robots) for edges in self.schedule)
        index = {robot: i for i, robot in enumerate(robots)}
        links = np.zeros((len(schedule), len(robots), len(robots)), dtype=np.bool_)
        for t, edges in enumerate(schedule):
            for first, second in edges:
                links[t, index[first], index[second]] = links[t, index[second], index[first]] = True
        links.setflags(write=False)
        for name, value in (("robots", robots), ("schedule", schedule), ("_links", links)):
            object.__setattr__(self, name, value)

    @classmethod
    def of_edges(cls, robots: Sequence[str], edges: Sequence[Edge]) -> "CommunicationGraph":
        """A constant graph.

        Args:
            robots: In the order of the team.
            edges: Names of two robots each.

        Raises:
            InvalidInputError: If an edge is no pair, joins a robot to itself or is there twice.
            UnknownNameError: If an edge names a robot that is not in the team.
        """
        return cls(robots=tuple(robots), schedule=(tuple(edges),))

    @classmethod
    def complete(cls, robots: Sequence[str]) -> "CommunicationGraph":
        """All-to-all."""
        return cls.of_edges(robots, _pairs(robots))

    @classmethod
    def none(cls, robots: Sequence[str]) -> "CommunicationGraph":
        """No communication."""
        return cls.of_edges(robots, ())

    @classmethod
    def random_connected(
        cls, robots: Sequence[str], average_degree: float, generator: np.random.Generator
    ) -> "CommunicationGraph":
        """A connected graph with as many edges as come nearest to an average degree.

        A spanning tree, uniform over all trees of the robots (a random Prüfer sequence), and other
        edges, uniform over those that are left.

        Args:
            robots: In the order of the team.
            average_degree: Mean number of neighbours, 2 edges / robots.
            generator: Source of the draws.

        Raises:
            InvalidInputError: If the nearest number of edges connects no team of that size, or is
                more than all-to-all has; names the least and largest degree.
        """
        check_generator(generator, "communication graph")
        count, all_pairs = len(robots), _pairs(robots)
        degree = check_not_negative(average_degree, "communication graph average_degree")
        edges = round(0.5 * count * degree)
        if not count - 1 <= edges <= len(all_pairs):
            raise InvalidInputError(
                f"communication graph average_degree: expected {2 * max(count - 1, 0) / count:g} "
                f"(a tree) to {count - 1:g} (all-to-all) for a connected graph of {count} robots, "
                f"got {degree:g}"
            )
        tree: list[Edge] = []
        if count > 1:
            sequence = generator.integers(count, size=count - 2).tolist()
            tree = [(robots[i], robots[j]) for i, j in nx.from_prufer_sequence(sequence).edges]
        taken = {frozenset(edge) for edge in tree}
        left = [pair for pair in all_pairs if frozenset(pair) not in taken]
        more = generator.permutation(len(left))[: edges - len(tree)]
        return cls.of_edges(robots, [*tree, *(left[i] for i in more)])

    @classmethod
    def on_schedule(
        cls, graphs: Sequence["CommunicationGraph"], period: int = 1
    ) -> "CommunicationGraph":
        """Graphs that take turns; after the last comes the first again.

        Args:
            graphs: Constant graphs of the same robots, at least one.
            period: Steps for which each holds.

        Raises:
            InvalidInputError: If there is no graph, the robots differ, one is not constant, or the
                period is not a positive number of steps.
        """
        if len(graphs) == 0:
            raise InvalidInputError("communication schedule: expected at least one graph, got none")
        for index, graph in enumerate(graphs):
            if graph.robots != graphs[0].robots:
                raise InvalidInputError(
                    f"communication schedule: expected the same robots in every graph, got "
                    f"{', '.join(graph.robots)} in graph {index} and "
                    f"{', '.join(graphs[0].robots)} in graph 0"
                )
            if len(graph.schedule) > 1 or graph.range_m != math.inf:
                raise InvalidInputError(
                    f"communication schedule: expected constant graphs, got a schedule or a range "
                    f"in graph {index}"
                )
        schedule = tuple(graph.schedule[0] for graph in graphs)
        return cls(robots=graphs[0].robots, schedule=schedule, period=period)

    @classmethod
    def within_range(cls, robots: Sequence[str], range_m: float) -> "CommunicationGraph":
        """Two robots are linked while they are near enough.

        Args:
            robots: In the order of the team.
            range_m: Largest distance, metres, inclusive.

        Raises:
            InvalidInputError: If the range is not a finite number, zero or more.
        """
        check_not_negative(range_m, "communication graph range_m")
        return cls(robots=tuple(robots), schedule=(tuple(_pairs(robots)),), range_m=range_m)

    @classmethod
    def from_networkx(
        cls, graph: nx.Graph, robots: Sequence[str] | None = None
    ) -> "CommunicationGraph":
        """A constant graph.

        Args:
            graph: Undirected; its nodes are names of robots. Attributes are not read.
            robots: In the order of the team; the order of the nodes if left out.

        Raises:
            InvalidInputError: If the graph is directed, or has another number of nodes than robots.
            UnknownNameError: If a node is not a robot of the team.
        """
        if graph.is_directed():
            raise InvalidInputError(
                "communication graph: expected an undirected graph, got a directed one; take "
                "graph.to_undirected()"
            )
        names = tuple(graph.nodes) if robots is None else tuple(robots)
        for node in graph.nodes:
            _check_robot(node, names)
        if len(graph) != len(names):
            raise InvalidInputError(
                f"communication graph: expected one node a robot ({', '.join(names)}), got "
                f"{', '.join(map(str, graph.nodes))}"
            )
        return cls.of_edges(names, [edge[:2] for edge in graph.edges])

    @property
    def needs_positions(self) -> bool:
        """Whether links depend on where the robots are."""
        return self.range_m != math.inf

    @property
    def scheduled(self) -> BoolArray:
        """Links of each set of the schedule, the range not applied, shape (T, N, N), read-only."""
        return self._links

    def links(self, step: int = 0, positions: ArrayLike | None = None) -> BoolArray:
        """Who hears whom at a step.

        Args:
            step: 0 or more.
            positions: Of every robot at the step, shape (N, 2) or (N, 3), metres, without heading;
                needed where there is a range.

        Returns:
            Shape (N, N), symmetric, diagonal false, read-only.

        Raises:
            InvalidInputError: If the step is no such number, or positions are missing or malformed.
        """
        _check_steps("step", step, least=0)
        scheduled: BoolArray = self._links[step // self.period % len(self._links)]
        if not self.needs_positions:
            return scheduled
        if positions is None:
            raise InvalidInputError(
                f"communication graph: expected the positions of the robots at step {step}, got "
                f"none; links depend on them (range_m = {self.range_m:g})"
            )
        at = check_finite(
            positions, f"positions of {len(self.robots)} robots", (len(self.robots), None)
        )
        if at.shape[1] not in (2, 3):
            raise InvalidInputError(
                f"positions: expected 2 or 3 coordinates a robot, got {at.shape[1]}"
            )
        distances = np.linalg.norm(at[:, None] - at[None, :], axis=-1)
        near: BoolArray = scheduled & (distances <= self.range_m)
        near.setflags(write=False)
        return near

    def ever(self, robot: int) -> tuple[int, ...]:
        """Neighbours that a robot may have at some step.

        Args:
            robot: Its number in the order of the team.

        Returns:
            Numbers, ascending; a range excludes none.

        Raises:
            UnknownNameError: If there is no robot of that number.
        """
        if not 0 <= robot < len(self.robots):
            raise UnknownNameError(
                f"communication graph: robot number {robot} is not one of 0..{len(self.robots) - 1}"
            )
        return tuple(np.flatnonzero(self._links[:, robot].any(axis=0)).tolist())

    def average_degree(self, step: int = 0, positions: ArrayLike | None = None) -> float:
        """Mean number of neighbours at a step.

        Args:
            step: As for ``links``.
            positions: As for ``links``.

        Returns:
            2 edges / robots.
        """
        return float(self.links(step, positions).sum() / len(self.robots))

    def is_connected(self, step: int = 0, positions: ArrayLike | None = None) -> bool:
        """Whether a message gets from every robot to every other over the links of one step.

        Args:
            step: As for ``links``.
            positions: As for ``links``.

        Returns:
            True for a robot alone.
        """
        return bool(nx.is_connected(self.to_networkx(step, positions)))

    def to_networkx(self, step: int = 0, positions: ArrayLike | None = None) -> nx.Graph:
        """The links of a step; nodes are names in the order of the team.

        Args:
            step: As for ``links``.
            positions: As for ``links``.

        Returns:
            A new graph.
        """
        graph = nx.Graph()
        graph.add_nodes_from(self.robots)
        for i, j in np.argwhere(np.triu(self.links(step, positions))):
            graph.add_edge(self.robots[i], self.robots[j])
        return graph


def _pairs(robots: Sequence[str]) -> list[Edge]:
    """Every pair of robots in the order of the team."""
    return [(first, second) for i, first in enumerate(robots) for second in robots[i + 1 :]]


def _ordered(edges: Sequence[Edge], robots: tuple[str, ...]) -> tuple[Edge, ...]:
    """Edges with the robot that is earlier in the team first, sorted, each checked."""
    index = {robot: i for i, robot in enumerate(robots)}
    seen: set[tuple[int, int]] = set()
    for edge in edges:
        if isinstance(edge, str) or not isinstance(edge, Sequence) or len(edge) != 2:
            raise InvalidInputError(
                f"communication graph edge: expected the names of two robots, got {edge!r}"
            )
        for robot in edge:
            _check_robot(robot, robots)
        low, high = sorted(index[robot] for robot in edge)
        if low == high:
            raise InvalidInputError(
                f"communication graph edge: expected two robots, got {edge[0]!r} twice; a robot "
                "knows itself anyhow"
            )
        if (low, high) in seen:
            raise InvalidInputError(
                f"communication graph edge: expected {robots[low]!r} - {robots[high]!r} once, got "
                "it twice; edges have no direction"
            )
        seen.add((low, high))
    return tuple((robots[low], robots[high]) for low, high in sorted(seen))


def _check_robot(robot: object, robots: Sequence[str]) -> None:
    """Refuse a robot that is not in the team."""
    if robot not in robots:
        raise UnknownNameError(
            f"communication graph: robot {robot!r} is not one of {', '.join(map(str, robots))}"
        )


def _check_steps(name: str, value: object, *, least: int) -> None:
    """Refuse what is no whole number of steps."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InvalidInputError(
            f"communication graph {name}: expected a whole number of steps, {least} or more, got "
            f"{value!r}"
        )
    if value > MOST_STEPS:
        raise InvalidInputError(
            f"communication graph {name}: expected at most {MOST_STEPS} steps, got {value}"
        )
