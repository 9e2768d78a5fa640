import sys

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from roadmaps import MissingDependencyError, Workspace, WorkspaceError
from roadmaps.polygon_tree import build_polygon_tree, has_shapely
from roadmaps.polygons import build_polygon_set

SQUARE = [(4, 4), (6, 4), (6, 6), (4, 6)]
coordinates = st.floats(0.0, 30.0, allow_nan=False, width=32)


@st.composite
def worlds(draw):
    """Star polygons and segments from a seed, so that shapes shrink to few."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    polygons = []
    for _ in range(draw(st.integers(1, 6))):
        # Gaps below pi keep the star's centre inside, so it is simple.
        angles = np.linspace(0, 2 * np.pi, int(rng.integers(4, 9)), endpoint=False)
        angles += rng.uniform(0, 0.5, len(angles))
        radii = rng.uniform(0.5, 6.0, len(angles))
        center = rng.uniform(0, 30, 2)
        polygons.append(center + radii[:, None] * np.c_[np.cos(angles), np.sin(angles)])
    count = draw(st.integers(1, 60))
    return polygons, rng.uniform(-2, 32, (count, 2)), rng.uniform(-2, 32, (count, 2))


@given(worlds(), st.sampled_from([0.0, 0.4, 3.0]))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_numpy_and_shapely_agree(world, clearance_m):
    polygons, starts, ends = world
    flat = build_polygon_set(polygons)
    tree = build_polygon_tree(flat)
    np.testing.assert_array_equal(
        flat.touch_segments(starts, ends, clearance_m),
        tree.touch_segments(starts, ends, clearance_m),
    )
    np.testing.assert_array_equal(
        flat.touch_points(starts, clearance_m), tree.touch_points(starts, clearance_m)
    )


@given(
    st.lists(st.tuples(*[st.integers(0, 10)] * 4), min_size=1, max_size=30),
    st.sampled_from([0.0, 1.0]),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_numpy_and_shapely_agree_on_grazing_contacts(segments, clearance_m):
    """Integer ends meet corners, run along edges and have no length; obstacles are closed."""
    flat = build_polygon_set([SQUARE, [(0, 0), (3, 0), (0, 3)]])
    tree = build_polygon_tree(flat)
    ends = np.array(segments, dtype=float)
    first = flat.touch_segments(ends[:, :2], ends[:, 2:], clearance_m)
    second = tree.touch_segments(ends[:, :2], ends[:, 2:], clearance_m)
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("engine", ["numpy", "shapely"])
def test_contacts_worked_by_hand(engine):
    world = Workspace(lower=[0, 0], upper=[10, 10], obstacles=[SQUARE], polygon_engine=engine)
    # inside, on an edge, at a corner, free
    valid = world.are_positions_valid([(5, 5), (4, 5), (6, 6), (3.9, 5)])
    np.testing.assert_array_equal(valid, [False, False, False, True])
    starts = [(0, 5), (0, 4), (0, 0), (5, 5), (0, 3.9)]
    ends = [(10, 5), (10, 4), (4, 4), (5.5, 5), (10, 3.9)]
    # across, along an edge, to a corner, wholly inside, past
    valid = world.are_motions_valid(starts, ends)
    np.testing.assert_array_equal(valid, [False, False, False, False, True])


@pytest.mark.parametrize("engine", ["numpy", "shapely"])
def test_robot_radius_keeps_away_round_corners(engine):
    world = Workspace(
        lower=[0, 0], upper=[10, 10], obstacles=[SQUARE], robot_radius_m=1, polygon_engine=engine
    )
    # 0.8 from the corner on both axes is 1.13 m away; 0.7 is 0.99 m
    valid = world.are_positions_valid([(3.2, 3.2), (3.3, 3.3), (2.9, 5), (3.1, 5)])
    np.testing.assert_array_equal(valid, [True, False, True, False])
    # the middle of the segment comes near though both ends are free
    assert not world.are_motions_valid((0, 6.5), (10, 6.5))[0]
    assert world.are_motions_valid((0, 7.1), (10, 7.1))[0]


def test_large_batches_are_cut_into_chunks(monkeypatch):
    monkeypatch.setattr("roadmaps.polygons._PAIRS_A_CHUNK", 7)
    rng = np.random.default_rng(0)
    starts, ends = rng.uniform(0, 10, (40, 2)), rng.uniform(0, 10, (40, 2))
    flat = build_polygon_set([SQUARE, [(0, 0), (3, 0), (0, 3)]])
    np.testing.assert_array_equal(
        flat.touch_segments(starts, ends, 0.2),
        build_polygon_tree(flat).touch_segments(starts, ends, 0.2),
    )


def test_orientation_and_repeated_last_corner_do_not_matter():
    points = np.random.default_rng(1).uniform(0, 10, (200, 2))
    one = build_polygon_set([SQUARE]).touch_points(points, 0.0)
    other = build_polygon_set([[*SQUARE[::-1], SQUARE[-1]]]).touch_points(points, 0.0)
    np.testing.assert_array_equal(one, other)
    assert one.any()
    assert not build_polygon_set([]).touch_points(points, 1.0).any()


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ([(0, 0), (1, 0)], r"obstacles\[1\]: expected at least 3 different corners, got 2"),
        ([(0, 0), (1, 0), (1, 0), (0, 1)], r"obstacles\[1\]: .* corner 1 at .* is repeated"),
        ([(0, 0), (2, 2), (2, 0), (0, 2)], r"obstacles\[1\]: expected a simple polygon"),
        ([(0, 0), (1, 0), (2, 0)], r"obstacles\[1\]: expected a simple polygon"),
        ([(0, 0), (1, np.inf), (2, 0)], r"obstacles\[1\]: expected finite coordinates"),
    ],
)
def test_wrong_polygons_are_refused_by_index(corners, words):
    with pytest.raises(WorkspaceError, match=words):
        build_polygon_set([SQUARE, corners])


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=3, max_size=6))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_a_polygon_is_accepted_exactly_if_shapely_calls_it_valid(corners):
    if any(one == other for one, other in zip(corners, corners[1:] + corners[:1], strict=True)):
        return  # repeated corners have their own message
    try:
        build_polygon_set([corners])
        accepted = True
    except WorkspaceError:
        accepted = False
    assert accepted == shapely.Polygon(corners).is_valid


def test_without_shapely_auto_uses_numpy_and_shapely_is_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, "shapely", None)
    assert not has_shapely()
    world = Workspace(lower=[0, 0], upper=[10, 10], obstacles=[SQUARE])
    assert not world.are_positions_valid([5, 5])[0]
    with pytest.raises(MissingDependencyError, match="geo"):
        Workspace(lower=[0, 0], upper=[10, 10], obstacles=[SQUARE], polygon_engine="shapely")
