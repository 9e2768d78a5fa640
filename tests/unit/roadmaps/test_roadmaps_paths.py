import itertools

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import yen

from roadmaps import (
    NoCandidatePathError,
    ParameterError,
    UnknownVertexError,
    UnreachableError,
    VertexPath,
    build_roadmap,
    find_candidate_paths,
    find_k_shortest_paths,
    find_penalty_paths,
    find_perturbed_paths,
    find_shortest_path,
    read_roadmap,
)


def find(method, roadmap, start, goal, count, seed=0):
    rng = np.random.default_rng(seed)
    return find_candidate_paths(roadmap, start, goal, count, method=method, rng=rng)


METHODS = ["penalty", "perturbed", "shortest"]


@st.composite
def small_roadmaps(draw):
    """A connected graph: a random tree and some more edges."""
    size = draw(st.integers(2, 9))
    rng = np.random.default_rng(draw(st.integers(0, 100_000)))
    edges = {(int(rng.integers(0, vertex)), vertex) for vertex in range(1, size)}
    others = [pair for pair in itertools.combinations(range(size), 2) if pair not in edges]
    edges |= {pair for pair in others if rng.random() < 0.4}
    return build_roadmap(rng.uniform(0, 10, (size, 2)), sorted(edges))


def assert_candidates(paths, roadmap, start, goal):
    assert len({path.vertices for path in paths}) == len(paths)
    assert [path.length_m for path in paths] == sorted(path.length_m for path in paths)
    for path in paths:
        assert path.vertices[0] == start
        assert path.vertices[-1] == goal
        assert len(set(path.vertices)) == len(path.vertices)
        walked = [roadmap.edges[edge]["length"] for edge in itertools.pairwise(path.vertices)]
        np.testing.assert_allclose(path.length_m, sum(walked))
        for vertex, position in zip(path.vertices, path.positions, strict=True):
            np.testing.assert_array_equal(position, roadmap.nodes[vertex]["position"])


@given(small_roadmaps(), st.sampled_from(METHODS), st.integers(1, 12))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_candidates_start_and_end_right_and_walk_edges_only(roadmap, method, count):
    goal = len(roadmap) - 1
    paths = find(method, roadmap, 0, goal, count)
    assert 1 <= len(paths) <= count
    assert_candidates(paths, roadmap, 0, goal)
    shortest = nx.shortest_path_length(roadmap, 0, goal, weight="length")
    np.testing.assert_allclose(paths[0].length_m, shortest)


@given(small_roadmaps(), st.integers(1, 40))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_yen_equals_networkx(roadmap, count):
    goal = len(roadmap) - 1
    paths = find_k_shortest_paths(roadmap, 0, goal, count)
    expected = list(
        itertools.islice(nx.shortest_simple_paths(roadmap, 0, goal, weight="length"), count)
    )
    lengths = [nx.path_weight(roadmap, path, "length") for path in expected]
    np.testing.assert_allclose([path.length_m for path in paths], lengths)
    if count > 1 and len(expected) < count:  # all there are: the same set
        assert {path.vertices for path in paths} == {tuple(path) for path in expected}


def test_yen_with_ties_finds_every_path():
    """On a 4 x 4 lattice there are 20 shortest paths from corner to corner."""
    lattice = nx.convert_node_labels_to_integers(nx.grid_2d_graph(4, 4), ordering="sorted")
    positions = [(vertex // 4, vertex % 4) for vertex in range(16)]
    paths = find_k_shortest_paths(build_roadmap(positions, list(lattice.edges)), 0, 15, 21)
    assert [path.length_m for path in paths] == [6.0] * 20 + [8.0]
    assert len({path.vertices for path in paths}) == 21


def test_yen_equals_scipy_on_a_prm(roadmap):
    matrix = read_roadmap(roadmap)
    lengths = yen(matrix.sparse(matrix.lengths), 0, 1, 30, directed=False)
    paths = find_k_shortest_paths(matrix, 0, 1, 30)
    np.testing.assert_allclose([path.length_m for path in paths], lengths)


@pytest.mark.parametrize("method", METHODS)
def test_fifty_candidates_on_a_prm(roadmap, method):
    paths = find(method, roadmap, 0, 1, 50)
    assert len(paths) == 50
    assert_candidates(paths, roadmap, 0, 1)
    assert paths == find(method, roadmap, 0, 1, 50)


def shared_with_best(paths):
    """Mean share of a path's edges that the best path has too."""
    edges = [set(itertools.pairwise(path.vertices)) for path in paths]
    return np.mean([len(each & edges[0]) / len(each) for each in edges[1:]])


def test_penalty_and_perturbed_are_more_diverse_than_the_shortest(roadmap):
    exact = shared_with_best(find("shortest", roadmap, 0, 1, 30))
    assert shared_with_best(find("penalty", roadmap, 0, 1, 30)) < 0.5 * exact
    assert shared_with_best(find("perturbed", roadmap, 0, 1, 30)) < 0.8 * exact


def test_perturbed_paths_depend_on_the_seed_alone(roadmap):
    first, again, other = (find("perturbed", roadmap, 0, 1, 20, seed) for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_jitter_is_seeded(roadmap):
    first, again, other = (
        find_penalty_paths(roadmap, 0, 1, 10, jitter=0.5, rng=np.random.default_rng(seed))
        for seed in (1, 1, 2)
    )
    assert first == again
    assert first != other
    assert_candidates(first, roadmap, 0, 1)


def test_penalty_worked_by_hand():
    """Two ways of 2 and 2.3 m: after one use the first weighs 2.4."""
    ways = build_roadmap([[0, 0], [1, 0], [2, 0], [1, 1]], [[0, 1], [1, 2], [0, 3], [3, 2]])
    nx.set_edge_attributes(ways, {(0, 1): 1.0, (1, 2): 1.0, (0, 3): 1.15, (3, 2): 1.15}, "length")
    paths = find_penalty_paths(ways, 0, 2, 2, max_searches=2)
    assert [path.vertices for path in paths] == [(0, 1, 2), (0, 3, 2)]
    assert len(find_penalty_paths(ways, 0, 2, 2, penalty_factor=1.1, max_searches=2)) == 1


def test_penalties_do_not_overflow():
    line = build_roadmap([[0, 0], [1, 0]], [[0, 1]])
    paths = find_penalty_paths(line, 0, 1, 5, penalty_factor=1e60, max_searches=40)
    assert [path.vertices for path in paths] == [(0, 1)]


def test_start_equal_to_goal_is_a_path_of_one_vertex(roadmap):
    for method in METHODS:
        (path,) = find(method, roadmap, 3, 3, 5)
        assert path.vertices == (3,)
        assert path.length_m == 0.0
    assert find_shortest_path(roadmap, 3, 3).vertices == (3,)


def test_any_hashable_vertex_serves():
    graph = nx.relabel_nodes(build_roadmap([[0, 0], [1, 0]], [[0, 1]]), {0: 10, 1: 7})
    assert find_shortest_path(graph, 7, 10).vertices == (7, 10)


@pytest.mark.parametrize("method", METHODS)
def test_unreachable_and_unknown_vertices_are_refused(method):
    apart = build_roadmap([[0, 0], [1, 0], [5, 5]], [[0, 1]])
    with pytest.raises(UnreachableError, match=r"vertex 0 at \[0.0, 0.0\] to vertex 2 at \[5.0"):
        find(method, apart, 0, 2, 3)
    with pytest.raises(UnknownVertexError, match=r"start: .* got 9"):
        find(method, apart, 9, 2, 3)
    with pytest.raises(UnknownVertexError, match=r"goal: .* got 9"):
        find(method, apart, 0, 9, 3)
    with pytest.raises(ParameterError, match="count"):
        find(method, apart, 0, 1, 0)


def test_longer_paths_are_left_out(roadmap):
    paths = find_candidate_paths(roadmap, 0, 1, 20)
    limit_m = paths[4].length_m
    assert find_candidate_paths(roadmap, 0, 1, 20, max_length_m=limit_m) == paths[:5]
    with pytest.raises(NoCandidatePathError, match=r"at most 1.0 m .* raise max_length_m"):
        find_candidate_paths(roadmap, 0, 1, 20, max_length_m=1.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda r: find_candidate_paths(r, 0, 1, 2, method="perturbed"), "rng: expected"),
        (lambda r: find_candidate_paths(r, 0, 1, 2, method="magic"), "method: expected 'penalty'"),
        (lambda r: find_candidate_paths(r, 0, 1, 2, max_length_m=0), "max_length_m"),
        (lambda r: find_penalty_paths(r, 0, 1, 2, penalty_factor=1.0), "penalty_factor"),
        (lambda r: find_penalty_paths(r, 0, 1, 2, jitter=0.1), "rng: expected"),
        (lambda r: find_penalty_paths(r, 0, 1, 2, jitter=-0.1), "jitter"),
        (lambda r: find_penalty_paths(r, 0, 1, 2, max_searches=0), "max_searches"),
        (
            lambda r: find_perturbed_paths(r, 0, 1, 2, np.random.default_rng(0), spread=-1),
            "spread",
        ),
    ],
)
def test_wrong_arguments_are_refused_by_name(roadmap, call, words):
    with pytest.raises(ParameterError, match=words):
        call(roadmap)


def test_vertex_path_is_a_value():
    path = VertexPath((3, 4), [[0, 0], [1, 0]], 1.0)
    same = VertexPath((3, 4), np.array([[0.0, 0.0], [1.0, 0.0]]), 1.0)
    assert path == same
    assert hash(path) == hash(same)
    assert path != VertexPath((3, 4), [[0, 0], [2, 0]], 2.0)
    assert path != (3, 4)
    with pytest.raises(ValueError, match="read-only"):
        path.positions[0, 0] = 9.0
    with pytest.raises(AttributeError):
        path.length_m = 2.0


@pytest.mark.parametrize(("vertices", "positions"), [((), []), ((1, 2), [[0, 0]])])
def test_vertex_path_needs_a_position_a_vertex(vertices, positions):
    with pytest.raises(ParameterError, match="one row a vertex"):
        VertexPath(vertices, positions, 0.0)
