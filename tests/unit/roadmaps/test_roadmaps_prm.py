import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadmaps import (
    InvalidPositionError,
    KNearest,
    ParameterError,
    SampledChecker,
    SamplingError,
    UnknownVertexError,
    UnreachableError,
    WithinRadius,
    Workspace,
    build_grid_workspace,
    build_prm,
    build_roadmap,
    connect_positions,
    optimal_neighbor_count,
    positions_of,
    read_movingai_map,
    read_roadmap,
    sample_positions,
)
from roadmaps.connection import neighbor_pairs
from roadmaps.sampling import draw_position

WALL = [(4.9, -1), (5.1, -1), (5.1, 11), (4.9, 11)]


def assert_valid_roadmap(roadmap, checker):
    positions = positions_of(roadmap)
    assert checker.are_positions_valid(positions).all()
    edges = np.array(roadmap.edges)
    assert checker.are_motions_valid(positions[edges[:, 0]], positions[edges[:, 1]]).all()
    lengths = [length for _, _, length in roadmap.edges(data="length")]
    np.testing.assert_allclose(
        lengths, np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1)
    )


@given(st.integers(0, 10_000), st.sampled_from([KNearest(6), WithinRadius(12.0)]))
@settings(max_examples=15, deadline=None, derandomize=True)
def test_every_edge_is_valid_and_one_seed_gives_one_roadmap(seed, connection):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0, 40, (8, 1, 2)) + np.array([[0, 0], [5, 0], [5, 5], [0, 5]])
    world = Workspace(lower=[0, 0], upper=[45, 45], obstacles=corners, robot_radius_m=0.4)
    first, second = (
        build_prm(world, 80, np.random.default_rng(seed), connection=connection) for _ in range(2)
    )
    assert_valid_roadmap(first, world)
    assert list(first.edges(data=True)) == list(second.edges(data=True))
    np.testing.assert_array_equal(positions_of(first), positions_of(second))


def test_engines_give_the_same_roadmap(polygons):
    first, second = (
        build_prm(
            Workspace(lower=[0, 0], upper=[100, 100], obstacles=polygons, polygon_engine=engine),
            200,
            np.random.default_rng(5),
        )
        for engine in ("numpy", "shapely")
    )
    assert list(first.edges(data=True)) == list(second.edges(data=True))


def test_on_a_movingai_map(maps):
    world = build_grid_workspace(read_movingai_map(maps / "room-32-32-4.map"), robot_radius_m=0.3)
    roadmap = build_prm(world, 400, np.random.default_rng(0))
    assert_valid_roadmap(roadmap, world)
    assert len(max(nx.connected_components(roadmap), key=len)) > 200


def test_in_three_dimensions():
    ball = SampledChecker(
        lower=[-2] * 3,
        upper=[2] * 3,
        are_valid=lambda p: np.linalg.norm(p, axis=1) > 1.0,
        step_m=0.1,
    )
    roadmap = build_prm(ball, 60, np.random.default_rng(0))
    assert positions_of(roadmap).shape == (60, 3)
    assert_valid_roadmap(roadmap, ball)


def test_required_positions_come_first(field):
    roadmap = build_prm(
        field, 50, np.random.default_rng(0), required_positions=[[2, 2], [98.0, 98.0]]
    )
    np.testing.assert_array_equal(positions_of(roadmap)[:2], [[2, 2], [98, 98]])
    assert list(roadmap) == list(range(50))


def test_required_positions_are_checked(field):
    with pytest.raises(InvalidPositionError, match=r"required_positions\[1\]"):
        build_prm(field, 9, np.random.default_rng(0), required_positions=[[2, 2], [200, 2]])
    with pytest.raises(ParameterError, match="vertex_count: expected an integer of at least 2"):
        build_prm(field, 1, np.random.default_rng(0), required_positions=[[2, 2], [98, 98]])
    with pytest.raises(ParameterError, match="vertex_count"):
        build_prm(field, 0, np.random.default_rng(0))


def test_samples_are_free_uniform_and_of_the_wanted_number(field):
    points = sample_positions(field, 500, np.random.default_rng(0))
    assert points.shape == (500, 2)
    assert field.are_positions_valid(points).all()
    hall = Workspace(lower=[0, 0], upper=[10, 20])
    spread = sample_positions(hall, 4000, np.random.default_rng(0))
    np.testing.assert_allclose(spread.mean(axis=0), [5, 10], atol=0.3)
    assert sample_positions(hall, 0, np.random.default_rng(0)).shape == (0, 2)
    assert draw_position(hall, np.random.default_rng(0)).shape == (2,)


def test_sampling_gives_up_with_a_remedy():
    full = Workspace(lower=[0, 0], upper=[1, 1], obstacles=[[(-1, -1), (3, -1), (3, 3), (-1, 3)]])
    with pytest.raises(SamplingError, match="expected 3 valid positions, found 0 in 30 draws"):
        sample_positions(full, 3, np.random.default_rng(0), max_draws_each=10)


def test_neighbor_pairs_worked_by_hand():
    line = np.array([[0.0], [1.0], [3.0], [3.0]])
    np.testing.assert_array_equal(neighbor_pairs(line, KNearest(1)), [[0, 1]])
    np.testing.assert_array_equal(neighbor_pairs(line, WithinRadius(2.0)), [[0, 1], [1, 2], [1, 3]])
    np.testing.assert_array_equal(neighbor_pairs(line, KNearest(9), first_new=3), [[0, 3], [1, 3]])
    np.testing.assert_array_equal(neighbor_pairs(line, WithinRadius(9), first_new=3)[:, 1], [3, 3])
    assert neighbor_pairs(line[:1], KNearest(3)).shape == (0, 2)


@pytest.mark.parametrize("wrong", [lambda: KNearest(0), lambda: WithinRadius(-1.0)])
def test_wrong_connections_are_refused(wrong):
    with pytest.raises(ParameterError, match=r"KNearest\.count|WithinRadius\.radius_m"):
        wrong()


def test_optimal_neighbor_count():
    assert optimal_neighbor_count(500, 2) == 26  # e * 1.5 * log 500 = 25.3
    assert optimal_neighbor_count(1, 2) == 1
    with pytest.raises(ParameterError, match="dimension"):
        optimal_neighbor_count(10, 0)


def test_connect_positions_adds_to_a_copy(roadmap, field):
    before = len(roadmap), roadmap.number_of_edges()
    more, ids = connect_positions(roadmap, [[2, 50], [50, 2]], field, connection=KNearest(5))
    assert (len(roadmap), roadmap.number_of_edges()) == before
    assert ids == (300, 301)
    assert len(more) == 302
    assert_valid_roadmap(more, field)
    assert nx.utils.graphs_equal(more.subgraph(range(300)), roadmap)


def test_connect_positions_refuses_what_cannot_be_reached():
    world = Workspace(lower=[0, 0], upper=[10, 10], obstacles=[WALL])
    left = build_roadmap([[1, 1], [2, 5]], [[0, 1]])
    with pytest.raises(UnreachableError, match=r"positions\[1\] at \[9.0, 5.0\].* 7 m away"):
        connect_positions(left, [[1, 9], [9, 5]], world, connection=KNearest(2))
    with pytest.raises(InvalidPositionError, match=r"positions\[0\]: expected a free position"):
        connect_positions(left, [5, 5], world)


def test_build_roadmap_refuses_wrong_edges():
    for edge in ([0, 2], [-1, 0], [1, 1]):
        with pytest.raises(ParameterError, match="edges: expected pairs of different vertices"):
            build_roadmap([[0, 0], [1, 0]], [edge])
    with pytest.raises(ParameterError, match="lengths: expected 1 positive"):
        build_roadmap([[0, 0], [0, 0]], [[0, 1]])
    with pytest.raises(ParameterError, match="lengths: expected 1 positive"):
        build_roadmap([[0, 0], [1, 0]], [[0, 1]], [1.0, 2.0])


def test_positions_in_the_graph_are_read_only(roadmap):
    with pytest.raises(ValueError, match="read-only"):
        roadmap.nodes[0]["position"][0] = 7.0


def test_read_roadmap_keeps_every_edge(roadmap):
    matrix = read_roadmap(roadmap)
    assert read_roadmap(matrix) is matrix
    dense = nx.to_numpy_array(roadmap, weight="length")
    np.testing.assert_array_equal(matrix.sparse(matrix.lengths).toarray(), dense)
    np.testing.assert_array_equal(matrix.lengths[matrix.reverse], matrix.lengths)
    np.testing.assert_array_equal(matrix.reverse[matrix.reverse], np.arange(len(matrix.keys)))
    with pytest.raises(UnknownVertexError, match="goal: expected a vertex of the roadmap, got 999"):
        matrix.row(999, "goal")


def without(attribute):
    graph = build_roadmap([[0, 0], [1, 0]], [[0, 1]])
    (graph.nodes[1] if attribute == "position" else graph.edges[0, 1]).pop(attribute)
    return graph


def with_length(length):
    graph = build_roadmap([[0, 0], [1, 0]], [[0, 1]])
    graph.edges[0, 1]["length"] = length
    return graph


@pytest.mark.parametrize(
    ("graph", "words"),
    [
        (nx.DiGraph(), "undirected networkx.Graph, got DiGraph"),
        (nx.MultiGraph(), "undirected networkx.Graph, got MultiGraph"),
        ([[0, 1]], "undirected networkx.Graph, got list"),
        (nx.Graph(), "at least one vertex"),
        (without("position"), r"vertex 1: expected `position` of shape \(2,\)"),
        (without("length"), r"edge \(0, 1\): .* got length None"),
        (with_length(0.0), r"edge \(0, 1\): .* got length 0.0"),
        (with_length(np.nan), r"edge \(0, 1\): .* got length nan"),
    ],
)
def test_wrong_graphs_are_refused_by_vertex_or_edge(graph, words):
    with pytest.raises(ParameterError, match=words):
        read_roadmap(graph)
