"""Communication graphs: who hears whom at a step, random graphs, and reading from plain data."""

from collections import Counter
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.communication_table import read_communication_graph

ROBOTS = ("ann", "bob", "carl", "dora")


def team(count):
    return tuple(f"r{i}" for i in range(count))


def chain(*names):
    return CommunicationGraph.of_edges(ROBOTS, list(pairwise(names)))


def test_given_edges_come_into_the_order_of_the_team():
    graph = CommunicationGraph.of_edges(ROBOTS, [("dora", "bob"), ("bob", "ann")])
    expected = np.zeros((4, 4), dtype=bool)
    for i, j in ((0, 1), (1, 3)):
        expected[i, j] = expected[j, i] = True
    np.testing.assert_array_equal(graph.links(), expected)
    np.testing.assert_array_equal(graph.links(17), expected)
    assert graph.links().dtype == np.bool_
    assert not graph.links().flags.writeable
    assert graph == CommunicationGraph.of_edges(ROBOTS, [("ann", "bob"), ("bob", "dora")])
    assert graph.schedule == ((("ann", "bob"), ("bob", "dora")),)
    assert graph.ever(1) == (0, 3)
    assert graph.ever(2) == ()
    assert graph.average_degree() == 1.0
    assert not graph.is_connected()
    assert not graph.needs_positions


def test_complete_and_none():
    complete, none = CommunicationGraph.complete(ROBOTS), CommunicationGraph.none(ROBOTS)
    np.testing.assert_array_equal(complete.links(), ~np.eye(4, dtype=bool))
    assert complete.average_degree() == 3.0
    assert complete.is_connected()
    assert not none.links().any()
    assert none.average_degree() == 0.0
    assert not none.is_connected()
    alone = CommunicationGraph.none(["ann"])
    assert alone.is_connected()
    assert alone == CommunicationGraph.complete(["ann"])


@pytest.mark.parametrize(
    ("robots", "degree", "edges"),
    [(10, 5.6, 28), (15, 8.1, 61), (20, 11.1, 111), (30, 17.0, 255), (10, 1.8, 9), (10, 9.0, 45)],
)
def test_random_graph_has_the_nearest_degree_and_is_connected(robots, degree, edges):
    for seed in range(20):
        generator = np.random.default_rng(seed)
        graph = CommunicationGraph.random_connected(team(robots), degree, generator)
        links = graph.links()
        assert links.sum() == 2 * edges
        assert abs(graph.average_degree() - degree) <= 1.0 / robots
        assert graph.is_connected()
        np.testing.assert_array_equal(links, links.T)
        assert not links.diagonal().any()


def test_random_graph_is_a_function_of_the_seed():
    draw = [
        CommunicationGraph.random_connected(team(12), 4.0, np.random.default_rng(seed))
        for seed in (1, 1, 2)
    ]
    assert draw[0] == draw[1]
    assert draw[0] != draw[2]


def test_small_random_graphs():
    generator = np.random.default_rng(0)
    assert CommunicationGraph.random_connected(["a"], 0.0, generator).links().shape == (1, 1)
    pair = CommunicationGraph.random_connected(["a", "b"], 1.0, generator)
    assert pair == CommunicationGraph.complete(["a", "b"])


def test_every_tree_and_every_other_edge_is_as_likely():
    """16 labelled trees of four robots; a tree and one edge makes 4-cycles and triangles."""
    generator = np.random.default_rng(3)
    trees = Counter(
        CommunicationGraph.random_connected(ROBOTS, 1.5, generator).schedule for _ in range(1600)
    )
    assert len(trees) == 16
    # chi2 of 15 degrees of freedom: above 37.7 once in 1000.
    assert sum((count - 100) ** 2 / 100 for count in trees.values()) < 37.7
    more = Counter(
        CommunicationGraph.random_connected(ROBOTS, 2.0, generator).schedule for _ in range(1500)
    )
    # A 4-cycle (3 of them) holds 4 of the 16 trees, a triangle with a tail (12) holds 3; a tree
    # leaves 3 edges: probabilities 4 / 48 and 3 / 48.
    cycles = {key: nx.cycle_basis(nx.Graph(key[0])) for key in more}
    expected = {key: 1500 * len(cycle[0]) / 48 for key, cycle in cycles.items()}
    assert len(more) == 15
    assert sum(expected.values()) == pytest.approx(1500)
    # chi2 of 14 degrees of freedom: above 36.1 once in 1000.
    assert sum((more[key] - expected[key]) ** 2 / expected[key] for key in more) < 36.1


@pytest.mark.parametrize(
    ("robots", "degree", "words"),
    [
        (10, 1.6, r"average_degree: expected 1.8 \(a tree\) to 9 \(all-to-all\) .* 10 robots, got"),
        (10, 9.3, "got 9.3"),
        (1, 2.0, r"expected 0 \(a tree\) to 0"),
        (10, -1.0, "average_degree: expected zero or more"),
        (10, np.nan, "average_degree: expected a finite number"),
        (10, "many", "average_degree: expected a finite number"),
        (0, 1.0, "expected unique robots, at least one"),
    ],
)
def test_degrees_that_no_connected_graph_has_are_refused(robots, degree, words):
    with pytest.raises(InvalidInputError, match=words):
        CommunicationGraph.random_connected(team(robots), degree, np.random.default_rng(0))


def test_links_on_a_schedule_take_turns():
    graphs = [chain("ann", "bob"), chain("bob", "carl", "dora"), CommunicationGraph.none(ROBOTS)]
    by_step = CommunicationGraph.on_schedule(graphs)
    for step in range(9):
        np.testing.assert_array_equal(by_step.links(step), graphs[step % 3].links())
    slow = CommunicationGraph.on_schedule(graphs, period=4)
    for step in range(30):
        np.testing.assert_array_equal(slow.links(step), graphs[step // 4 % 3].links())
    assert slow.ever(1) == (0, 2)
    assert slow.ever(3) == (2,)
    assert slow.average_degree(4) == 1.0
    assert [slow.average_degree(step) for step in (3, 11)] == [0.5, 0.0]
    assert CommunicationGraph.on_schedule(graphs[:1], 5).links(7).sum() == 2
    together = CommunicationGraph.on_schedule([CommunicationGraph.complete(ROBOTS), graphs[2]])
    assert together.is_connected(2)
    assert not together.is_connected(3)


def test_links_within_range_follow_the_positions():
    graph = CommunicationGraph.within_range(ROBOTS, 5.0)
    assert graph.needs_positions
    positions = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 9.1], [30.0, 0.0]])
    links = graph.links(2, positions)
    assert np.argwhere(np.triu(links)).tolist() == [[0, 1]]  # 5 m: inclusive
    assert not links.flags.writeable
    positions[2, 1] = 9.0
    assert np.argwhere(np.triu(graph.links(3, positions))).tolist() == [[0, 1], [1, 2]]
    in_space = np.column_stack([positions, [0.0, 0.1, 0.0, 0.0]])
    assert not graph.links(0, in_space).any()
    assert graph.ever(0) == (1, 2, 3)
    assert graph.average_degree(0, positions) == 1.0
    assert not graph.is_connected(0, positions)
    assert graph.is_connected(0, positions / 10.0)
    assert graph.to_networkx(0, positions).number_of_edges() == 2


def test_a_range_and_a_schedule_hold_both():
    graph = CommunicationGraph(
        robots=ROBOTS,
        schedule=((("ann", "bob"), ("carl", "dora")), (("ann", "dora"),)),
        range_m=1.0,
    )
    positions = np.array([[0.0, 0.0], [0.5, 0.0], [9.0, 0.0], [0.0, 0.5]])
    assert np.argwhere(np.triu(graph.links(0, positions))).tolist() == [[0, 1]]
    assert np.argwhere(np.triu(graph.links(1, positions))).tolist() == [[0, 3]]


def test_networkx_in_and_out():
    drawn = nx.path_graph(["dora", "ann", "carl", "bob"])
    graph = CommunicationGraph.from_networkx(drawn, ROBOTS)
    assert graph.robots == ROBOTS
    assert graph.ever(0) == (2, 3)
    assert CommunicationGraph.from_networkx(drawn).robots == ("dora", "ann", "carl", "bob")
    back = graph.to_networkx()
    assert list(back.nodes) == list(ROBOTS)
    assert nx.utils.edges_equal(back.edges, drawn.edges)
    back.remove_node("ann")
    assert graph.is_connected()
    scheduled = CommunicationGraph.on_schedule([graph, CommunicationGraph.none(ROBOTS)])
    assert scheduled.to_networkx(1).number_of_edges() == 0


@pytest.mark.parametrize(
    ("drawn", "kind", "words"),
    [
        (nx.DiGraph([("ann", "bob")]), InvalidInputError, "expected an undirected graph"),
        (nx.path_graph(["ann", "eve"]), UnknownNameError, "robot 'eve' is not one of ann, bob"),
        (
            nx.path_graph(["ann", "bob"]),
            InvalidInputError,
            r"one node a robot \(.*\), got ann, bob",
        ),
        (nx.Graph([("ann", "ann")]), InvalidInputError, "expected one node a robot"),
    ],
)
def test_networkx_graphs_that_are_not_the_teams_are_refused(drawn, kind, words):
    with pytest.raises(kind, match=words):
        CommunicationGraph.from_networkx(drawn, ROBOTS)


@pytest.mark.parametrize(
    ("edges", "kind", "words"),
    [
        ([("ann", "eve")], UnknownNameError, "robot 'eve' is not one of ann, bob, carl, dora"),
        ([("ann", ["bob"])], UnknownNameError, r"robot \['bob'\] is not one of"),
        ([("bob", "bob")], InvalidInputError, "expected two robots, got 'bob' twice"),
        ([("ann", "bob"), ("bob", "ann")], InvalidInputError, "expected 'ann' - 'bob' once"),
        ([("ann", "bob", "carl")], InvalidInputError, "edge: expected the names of two robots"),
        (["ab"], InvalidInputError, "edge: expected the names of two robots, got 'ab'"),
        ([3], InvalidInputError, "edge: expected the names of two robots, got 3"),
    ],
)
def test_edges_that_cannot_be_are_refused(edges, kind, words):
    with pytest.raises(kind, match=words):
        CommunicationGraph.of_edges(ROBOTS, edges)


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda: CommunicationGraph.none(["a", "a"]), InvalidInputError, "expected unique robots"),
        (lambda: CommunicationGraph.none([]), InvalidInputError, "at least one, got"),
        (
            lambda: CommunicationGraph(robots=ROBOTS, schedule=()),
            InvalidInputError,
            "schedule: expected at least one set of edges",
        ),
        (
            lambda: CommunicationGraph(robots=ROBOTS, schedule=((),), range_m=-1.0),
            InvalidInputError,
            "range_m: expected zero or more",
        ),
        (
            lambda: CommunicationGraph.within_range(ROBOTS, np.inf),
            InvalidInputError,
            "range_m: expected a finite number",
        ),
        (
            lambda: CommunicationGraph.on_schedule([]),
            InvalidInputError,
            "communication schedule: expected at least one graph",
        ),
        (
            lambda: CommunicationGraph.on_schedule([chain("ann", "bob")], 0),
            InvalidInputError,
            "period: expected a whole number of steps, 1 or more, got 0",
        ),
        (
            lambda: CommunicationGraph.on_schedule([chain("ann", "bob")], 1.5),
            InvalidInputError,
            "period: expected a whole number",
        ),
        (
            lambda: CommunicationGraph.on_schedule(
                [chain("ann", "bob"), CommunicationGraph.none(["ann", "bob"])]
            ),
            InvalidInputError,
            "expected the same robots in every graph, got ann, bob in graph 1 and ann, bob, carl",
        ),
        (
            lambda: CommunicationGraph.on_schedule([CommunicationGraph.within_range(ROBOTS, 1.0)]),
            InvalidInputError,
            "expected constant graphs, got a schedule or a range in graph 0",
        ),
        (
            lambda: CommunicationGraph.on_schedule(
                [chain("ann", "bob"), CommunicationGraph.on_schedule([chain("ann", "bob")] * 2)]
            ),
            InvalidInputError,
            "got a schedule or a range in graph 1",
        ),
        (lambda: chain("ann", "bob").links(-1), InvalidInputError, "step: expected a whole number"),
        (lambda: chain("ann", "bob").links(True), InvalidInputError, "step: expected a whole"),
        (lambda: chain("ann", "bob").ever(4), UnknownNameError, r"number 4 is not one of 0\.\.3"),
        (lambda: chain("ann", "bob").ever(-1), UnknownNameError, "number -1 is not one of"),
    ],
)
def test_graphs_and_questions_that_cannot_be_are_refused(call, kind, words):
    with pytest.raises(kind, match=words):
        call()


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        (None, r"expected the positions of the robots at step 6, got none; .* \(range_m = 2\)"),
        (np.zeros((3, 2)), r"positions of 4 robots: expected shape \(4, any\), got \(3, 2\)"),
        (np.zeros((4, 4)), "positions: expected 2 or 3 coordinates a robot, got 4"),
        (np.full((4, 2), np.nan), "positions of 4 robots: expected finite numbers"),
    ],
)
def test_positions_that_are_missing_or_malformed_are_refused(positions, words):
    graph = CommunicationGraph.within_range(ROBOTS, 2.0)
    for ask in (graph.links, graph.average_degree, graph.is_connected, graph.to_networkx):
        with pytest.raises(InvalidInputError, match=words):
            ask(6, positions)


def read(given, seed=0):
    return read_communication_graph(given, ROBOTS, np.random.default_rng(seed))


def test_every_kind_is_read():
    assert read({"kind": "complete"}) == CommunicationGraph.complete(ROBOTS)
    assert read({"kind": "none"}) == CommunicationGraph.none(ROBOTS)
    assert read({"kind": "range", "range_m": 3}) == CommunicationGraph.within_range(ROBOTS, 3.0)
    assert read({"kind": "edges", "edges": [["bob", "ann"]]}) == chain("ann", "bob")
    assert read(
        {"kind": "random", "average_degree": 2.0}, 5
    ) == CommunicationGraph.random_connected(ROBOTS, 2.0, np.random.default_rng(5))
    turns = {"kind": "schedule", "graphs": [{"kind": "complete"}, {"kind": "none"}]}
    graphs = [CommunicationGraph.complete(ROBOTS), CommunicationGraph.none(ROBOTS)]
    assert read(turns) == CommunicationGraph.on_schedule(graphs)
    assert read({**turns, "period": 3}) == CommunicationGraph.on_schedule(graphs, 3)
    random = {"kind": "random", "average_degree": 1.5}
    drawn = read({"kind": "schedule", "graphs": [random] * 3})
    assert len(set(drawn.schedule)) > 1  # each draws anew


@pytest.mark.parametrize(
    ("given", "kind", "words"),
    [
        ("complete", InvalidInputError, "communication graph: expected a table, got 'complete'"),
        ({}, UnknownNameError, "kind: expected one of complete, none, random, edges, .* got None"),
        ({"kind": "star"}, UnknownNameError, "kind: expected one of complete, .* got 'star'"),
        ({"kind": ["none"]}, UnknownNameError, "kind: expected one of"),
        (
            {"kind": "random", "degree": 3},
            UnknownNameError,
            "graph degree: expected one of kind, average_degree for kind 'random', got 'degree'",
        ),
        ({"kind": "none", "edges": []}, UnknownNameError, "edges: expected one of kind for kind"),
        ({"kind": "random"}, InvalidInputError, "average_degree: expected for kind 'random'"),
        ({"kind": "edges"}, InvalidInputError, "edges: expected for kind 'edges', got none"),
        ({"kind": "edges", "edges": "ab"}, InvalidInputError, "edges: expected a list, got 'ab'"),
        ({"kind": "edges", "edges": 3}, InvalidInputError, "edges: expected a list, got 3"),
        ({"kind": "edges", "edges": [["ann", "eve"]]}, UnknownNameError, "robot 'eve'"),
        ({"kind": "schedule", "graphs": []}, InvalidInputError, "expected at least one graph"),
        ({"kind": "schedule", "graphs": {}}, InvalidInputError, "graphs: expected a list"),
        ({"kind": "schedule", "graphs": [1]}, InvalidInputError, "expected a table, got 1"),
        (
            {"kind": "schedule", "graphs": [{"kind": "none"}], "period": 0},
            InvalidInputError,
            "period: expected a whole number of steps",
        ),
        ({"kind": "range", "range_m": "far"}, InvalidInputError, "range_m: .* got 'far'"),
    ],
)
def test_tables_that_cannot_be_are_refused_by_field(given, kind, words):
    with pytest.raises(kind, match=words):
        read(given)
