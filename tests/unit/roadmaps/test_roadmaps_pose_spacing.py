import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadmaps import ParameterError, find_shortest_path, headings, space_positions


@given(st.integers(0, 10_000), st.floats(0.05, 20.0))
@settings(max_examples=50, deadline=None, derandomize=True)
def test_spacing_keeps_vertices_and_is_never_exceeded(seed, spacing_m):
    points = np.random.default_rng(seed).uniform(0, 10, (5, 2))
    spaced = space_positions(points, spacing_m)
    gaps = np.linalg.norm(np.diff(spaced, axis=0), axis=1)
    assert gaps.max() <= spacing_m * (1 + 1e-6)
    np.testing.assert_allclose(gaps.sum(), np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    for point in points:
        assert (spaced == point).all(axis=1).any()


def test_an_edge_of_exactly_three_spacings_is_cut_in_three():
    spaced = space_positions([[0.0, 0.0], [0.3, 0.0]], 0.1)  # 0.3 / 0.1 > 3 in floating point
    np.testing.assert_allclose(spaced, [[0, 0], [0.1, 0], [0.2, 0], [0.3, 0]], atol=1e-15)


def test_without_spacing_only_the_vertices(roadmap):
    path = find_shortest_path(roadmap, 0, 1)
    np.testing.assert_array_equal(space_positions(path), path.positions)
    assert len(space_positions(path, 1.0)) > len(path.vertices)
    assert len(headings(path)) == len(path.vertices)
    np.testing.assert_array_equal(space_positions([[1, 2]], 3.0), [[1, 2]])


def test_headings_are_those_of_the_arriving_edge():
    square = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]
    expected = np.array([0, 0, 0.5, 1, -0.5]) * np.pi
    np.testing.assert_allclose(headings(square), expected)
    np.testing.assert_allclose(headings(square, first_heading_rad=2.5), [2.5, *expected[1:]])


def test_waiting_keeps_the_heading():
    waits = [[0, 0], [0, 0], [0, 1], [0, 1], [-1, 1]]
    np.testing.assert_allclose(headings(waits), np.array([0.5, 0.5, 0.5, 0.5, 1]) * np.pi)
    np.testing.assert_allclose(
        headings(waits, first_heading_rad=0.1), [0.1, 0.1, np.pi / 2, np.pi / 2, np.pi]
    )
    np.testing.assert_array_equal(headings([[1, 1]]), [0.0])


def test_spaced_poses_of_an_edge_share_its_heading():
    spaced = space_positions([[0, 0], [2, 2], [2, 0]], 0.5)
    found = headings(spaced)
    assert len(np.unique(np.round(found, 9))) == 2


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: space_positions([[0, 0], [1, 1]], 0.0), "spacing_m"),
        (lambda: space_positions([[0, 0]], -1.0), "spacing_m"),
        (lambda: space_positions([]), "path: expected at least one position"),
        (lambda: headings([[0, 0, 0], [1, 1, 1]]), "path: expected positions in the plane"),
    ],
)
def test_wrong_arguments_are_refused(call, words):
    with pytest.raises(ParameterError, match=words):
        call()
