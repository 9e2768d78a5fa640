import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from roadmaps import OccupancyGrid, ParameterError, WorkspaceError, build_grid_workspace
from roadmaps.grid_traversal import points_touch, segments_touch


def make_grid(rows, **changes):
    """A grid drawn with the top row first: . free, # occupied, ? unknown."""
    values = {".": 0, "#": 100, "?": -1}
    cells = np.array([[values[letter] for letter in row] for row in rows])[::-1]
    return OccupancyGrid(
        **{"occupancy": cells, "resolution_m": 1.0, "origin": [0.0, 0.0], **changes}
    )


def boxes(blocked):
    return shapely.union_all([shapely.box(c, r, c + 1, r + 1) for r, c in np.argwhere(blocked)])


@given(st.integers(0, 100_000), st.booleans())
@settings(max_examples=80, deadline=None, derandomize=True)
def test_segments_touch_exactly_the_closed_cells(seed, on_lattice):
    rng = np.random.default_rng(seed)
    blocked = rng.random((6, 9)) < 0.15
    starts, ends = rng.uniform(0, (9, 6), (30, 2)), rng.uniform(0, (9, 6), (30, 2))
    if on_lattice:  # corners, lines and centres of cells
        starts, ends = np.round(2 * starts) / 2, np.round(2 * ends) / 2
    lines = shapely.linestrings(np.stack([starts, ends], axis=1))
    distance = shapely.distance(lines, boxes(blocked))
    still = (starts == ends).all(axis=1)
    distance[still] = shapely.distance(shapely.points(starts[still]), boxes(blocked))
    expected = distance <= 1e-9 if blocked.any() else np.zeros(30, dtype=bool)
    np.testing.assert_array_equal(segments_touch(blocked, starts, ends, False), expected)
    np.testing.assert_array_equal(
        segments_touch(blocked, ends, starts, False), expected, err_msg="not symmetric"
    )


def test_no_squeezing_between_cells_that_meet_at_a_corner():
    grid = make_grid(["#.", ".#"])
    world = build_grid_workspace(grid)
    assert not world.are_motions_valid([0.5, 0.5], [1.5, 1.5])[0]


def test_outside_the_grid_is_unknown():
    blocked = np.zeros((2, 2), dtype=bool)
    starts, ends = np.array([[0.5, 0.5]] * 2), np.array([[1.5, 1.5], [50.5, 0.5]])
    np.testing.assert_array_equal(segments_touch(blocked, starts, ends, True), [False, True])
    np.testing.assert_array_equal(segments_touch(blocked, starts, ends, False), [False, False])
    np.testing.assert_array_equal(points_touch(blocked, ends, True), [False, True])


def test_chunks_do_not_change_the_answer(monkeypatch):
    rng = np.random.default_rng(0)
    blocked = rng.random((20, 20)) < 0.05
    starts, ends = rng.uniform(0, 20, (100, 2)), rng.uniform(0, 20, (100, 2))
    whole = segments_touch(blocked, starts, ends, True)
    monkeypatch.setattr("roadmaps.grid_traversal._CROSSINGS_A_CHUNK", 50)
    np.testing.assert_array_equal(segments_touch(blocked, starts, ends, True), whole)
    assert 0 < whole.sum() < 100
    assert segments_touch(blocked, starts[:0], ends[:0], True).shape == (0,)


@pytest.mark.parametrize("unknown_is_free", [True, False])
def test_unknown_cells_are_free_or_occupied_by_choice(unknown_is_free):
    world = build_grid_workspace(make_grid(["..?"]), unknown_is_free=unknown_is_free)
    assert world.are_positions_valid([[2.5, 0.5]])[0] == unknown_is_free
    assert world.are_motions_valid([0.5, 0.5], [2.5, 0.5])[0] == unknown_is_free
    assert world.has_line_of_sight([0.5, 0.5], [2.5, 0.5])[0] == unknown_is_free


@pytest.mark.parametrize("radius_m", [0.3, 0.5, 0.72, 1.0, 1.6, 2.4])
def test_robot_radius_is_the_distance_from_the_centre_to_the_occupied_square(radius_m):
    rng = np.random.default_rng(5)
    grid = OccupancyGrid(
        occupancy=np.where(rng.random((12, 15)) < 0.04, 100, 0),
        resolution_m=0.5,
        origin=np.zeros(2),
    )
    row, column = np.mgrid[0:12, 0:15]
    centers = shapely.points(column + 0.5, row + 0.5)
    distance_m = 0.5 * shapely.distance(centers, boxes(grid.occupancy == 100))
    np.testing.assert_array_equal(grid.blocked(radius_m, False), distance_m <= radius_m)


def test_robot_of_half_a_corridor_passes():
    grid = make_grid(["###", "...", "###"])
    assert build_grid_workspace(grid, robot_radius_m=0.45).are_motions_valid(
        [0.5, 1.5], [2.5, 1.5]
    )[0]
    assert not build_grid_workspace(grid, robot_radius_m=0.5).are_positions_valid([1.5, 1.5])[0]


def test_line_of_sight_ignores_the_robot_radius():
    grid = make_grid(["#..", "...", "..."])
    world = build_grid_workspace(grid, robot_radius_m=0.8)
    assert not world.are_motions_valid([1.5, 0.5], [1.5, 2.5])[0]
    assert world.has_line_of_sight([1.5, 0.5], [1.5, 2.5])[0]


def test_world_and_cells_with_yaw():
    grid = make_grid(["..#", "..."], origin=[10.0, 20.0], yaw_rad=np.pi / 2, resolution_m=2.0)
    # Turned left: columns run along +y, rows along -x.
    np.testing.assert_allclose(grid.centers([[2, 1]]), [[10.0 - 3.0, 20.0 + 5.0]])
    np.testing.assert_allclose(grid.to_cells([[7.0, 25.0]]), [[2.5, 1.5]])
    lower, upper = grid.bounds
    np.testing.assert_allclose([lower, upper], [[6.0, 20.0], [10.0, 26.0]], atol=1e-12)
    world = build_grid_workspace(grid)
    np.testing.assert_array_equal(
        world.are_positions_valid([[7.0, 25.0], [9.0, 25.0]]), [False, True]
    )


@given(st.floats(-4, 4), st.integers(0, 1000))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_to_world_inverts_to_cells(yaw_rad, seed):
    points = np.random.default_rng(seed).uniform(-50, 50, (5, 2))
    grid = make_grid([".."], origin=[3.0, -2.0], yaw_rad=yaw_rad, resolution_m=0.25)
    np.testing.assert_allclose(grid.to_world(grid.to_cells(points)), points, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"occupancy": np.zeros(3)}, WorkspaceError, r"shape \(rows, columns\)"),
        ({"occupancy": np.array([[0, 50]])}, WorkspaceError, "only 0 .* 100 .* -1"),
        ({"origin": [0, np.nan]}, WorkspaceError, "origin: expected finite"),
        ({"yaw_rad": np.inf}, WorkspaceError, "yaw_rad"),
        ({"resolution_m": 0.0}, ParameterError, "resolution_m"),
    ],
)
def test_wrong_grids_are_refused(changes, error, words):
    with pytest.raises(error, match=words):
        make_grid([".."], **changes)


def test_negative_radius_is_refused_and_cells_are_read_only():
    grid = make_grid([".#"])
    with pytest.raises(ParameterError, match="robot_radius_m"):
        grid.blocked(-0.1, False)
    with pytest.raises(ValueError, match="read-only"):
        grid.occupancy[0, 0] = 100
