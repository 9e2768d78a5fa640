import networkx as nx
import numpy as np
import pytest

from roadmaps import (
    InvalidPositionError,
    OccupancyGrid,
    ParameterError,
    Workspace,
    build_geodesic_grid,
    build_grid_workspace,
    read_movingai_map,
    read_ros_map,
)


def test_empty_hall_has_octile_distances():
    hall = Workspace(lower=[0, 0], upper=[10, 6])
    field = build_geodesic_grid(hall, resolution_m=1.0).distances_from([0.2, 0.3])
    # 9 columns and 4 rows away: 4 diagonals and 5 straight steps
    np.testing.assert_allclose(field.at([[9.5, 4.5], [0.9, 0.9]]), [5 + 4 * np.sqrt(2), 0.0])
    assert field.distances_m.shape == (6, 10)
    with pytest.raises(ValueError, match="read-only"):
        field.distances_m[0, 0] = 1.0


def test_equals_networkx_on_a_movingai_map(maps):
    grid = read_movingai_map(maps / "random-64-64-20.map")
    free = grid.occupancy == 0
    graph = nx.Graph()
    for row, column in np.argwhere(free).tolist():
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            to = (row + down, column + right)
            if not (to[0] < 64 and 0 <= to[1] < 64 and free[to]):
                continue
            if free[to[0], column] and free[row, to[1]]:  # no corner is cut
                graph.add_edge((row, column), to, weight=np.hypot(down, right))
    expected = nx.single_source_dijkstra_path_length(graph, (63, 0))
    field = build_geodesic_grid(build_grid_workspace(grid)).distances_from([0.5, 63.5])
    assert np.isfinite(field.distances_m).sum() == len(expected)
    rows, columns = np.array(list(expected)).T
    np.testing.assert_allclose(field.distances_m[rows, columns], list(expected.values()))


def test_on_a_ros_map_no_cell_is_nearer_than_the_straight_line(maps):
    world = build_grid_workspace(read_ros_map(maps / "tb3_sandbox.yaml"), robot_radius_m=0.2)
    source = np.array([-2.0, -0.5])
    field = build_geodesic_grid(world).distances_from(source)
    rng = np.random.default_rng(0)
    points = rng.uniform(-3, 3, (200, 2))
    distances = field.at(points)
    reached = np.isfinite(distances)
    straight = np.linalg.norm(points - source, axis=1)
    assert 50 < reached.sum() < 200
    assert (distances[reached] > straight[reached] - 2 * 0.05).all()
    seen = reached & world.are_motions_valid(source, points)
    assert (distances[seen] < 1.083 * straight[seen] + 0.2).all()


def test_thin_walls_between_centres_are_not_crossed():
    wall = [(4.99, -1), (5.01, -1), (5.01, 9.2), (4.99, 9.2)]
    hall = Workspace(lower=[0, 0], upper=[10, 10], obstacles=[wall])
    field = build_geodesic_grid(hall, resolution_m=1.0).distances_from([4.5, 0.5])
    # up to the gap and down again: 9 up, 1 across, 9 down (a diagonal meets the wall)
    np.testing.assert_allclose(field.at([5.5, 0.5]), 19.0)


def test_unreachable_and_outside_are_infinite():
    grid = OccupancyGrid(occupancy=[[0, 100, 0]], resolution_m=1.0, origin=[0, 0])
    field = build_geodesic_grid(build_grid_workspace(grid)).distances_from([0.5, 0.5])
    np.testing.assert_array_equal(
        field.at([[0.5, 0.5], [1.5, 0.5], [2.5, 0.5], [-1, 0]]), [0.0, np.inf, np.inf, np.inf]
    )


def test_yaw_turns_the_field_with_the_map():
    grid = OccupancyGrid(
        occupancy=np.zeros((3, 5)), resolution_m=1.0, origin=[0, 0], yaw_rad=np.pi / 2
    )
    field = build_geodesic_grid(build_grid_workspace(grid)).distances_from([-0.5, 0.5])
    np.testing.assert_allclose(field.at([[-0.5, 4.5], [-2.5, 0.5]]), [4.0, 2.0])


def test_refuses_what_it_cannot_do():
    block = [(0.4, 0.4), (0.6, 0.4), (0.6, 0.6), (0.4, 0.6)]
    hall = Workspace(lower=[0, 0], upper=[4, 4], obstacles=[block])
    with pytest.raises(ParameterError, match="resolution_m: expected metres, for the workspace"):
        build_geodesic_grid(hall)
    with pytest.raises(ParameterError, match="resolution_m"):
        build_geodesic_grid(hall, resolution_m=-1.0)
    with pytest.raises(ParameterError, match="at most 25 million cells"):
        build_geodesic_grid(hall, resolution_m=1e-4)
    cells = build_geodesic_grid(hall, resolution_m=1.0)
    with pytest.raises(InvalidPositionError, match="centre of its cell to be free"):
        cells.distances_from([0.1, 0.1])
    with pytest.raises(InvalidPositionError, match="source: expected a free position"):
        cells.distances_from([0.5, 0.5])
