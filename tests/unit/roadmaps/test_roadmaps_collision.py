import numpy as np
import pytest

from roadmaps import (
    InvalidPositionError,
    OccupancyGrid,
    ParameterError,
    SampledChecker,
    Workspace,
    WorkspaceError,
    check_position_valid,
)

SQUARE = [(4, 4), (6, 4), (6, 6), (4, 6)]


@pytest.fixture
def room():
    return Workspace(lower=[0, 0], upper=[10, 10], obstacles=[SQUARE], robot_radius_m=0.5)


def test_bounds_hold_the_centre_and_are_included(room):
    valid = room.are_positions_valid([(0, 0), (10, 10), (-1e-9, 5), (5, 10.1)])
    np.testing.assert_array_equal(valid, [True, True, False, False])
    np.testing.assert_array_equal(room.are_motions_valid((1, 1), [(9, 1), (11, 1)]), [True, False])


def test_one_end_serves_many(room):
    ends = [(9, 5), (1, 9), (9, 0)]
    forth, back = room.are_motions_valid((1, 5), ends), room.are_motions_valid(ends, (1, 5))
    np.testing.assert_array_equal(forth, [False, True, True])
    np.testing.assert_array_equal(back, forth)


def test_line_of_sight_ignores_radius_and_bounds(room):
    np.testing.assert_array_equal(
        room.has_line_of_sight([(1, 3.9), (1, 5), (-5, 0)], [(9, 3.9), (9, 5), (15, 0)]),
        [True, False, True],
    )
    assert not room.are_motions_valid((1, 3.9), (9, 3.9))[0]


def test_polygons_and_grid_together():
    grid = OccupancyGrid(
        occupancy=np.array([[0, 100], [0, 0]]), resolution_m=5.0, origin=np.zeros(2)
    )
    world = Workspace(lower=[0, 0], upper=[10, 10], obstacles=[[(0, 6), (1, 6), (0, 7)]], grid=grid)
    valid = world.are_positions_valid([(1, 1), (0.2, 6.2), (7, 2), (7, 7)])
    np.testing.assert_array_equal(valid, [True, False, False, True])
    ends = [(1, 9), (9, 9), (9, 1), (0.1, 9)]
    np.testing.assert_array_equal(
        world.are_motions_valid([(1.5, 1), (1, 9), (1, 1), (0.1, 1)], ends),
        [True, True, False, False],
    )


def test_workspace_is_frozen(room):
    with pytest.raises(AttributeError):
        room.robot_radius_m = 2.0
    with pytest.raises(ValueError, match="read-only"):
        room.lower[0] = -1


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"upper": [0, 10]}, WorkspaceError, "expected lower < upper"),
        ({"lower": [0, 0, 0]}, WorkspaceError, "lower: expected"),
        ({"robot_radius_m": -1.0}, ParameterError, "robot_radius_m"),
        ({"polygon_engine": "cgal"}, ParameterError, "polygon_engine: expected one of auto"),
    ],
)
def test_wrong_workspaces_are_refused(changes, error, words):
    with pytest.raises(error, match=words):
        Workspace(**{"lower": [0, 0], "upper": [10, 10], **changes})


def test_rows_must_match(room):
    with pytest.raises(ParameterError, match="as many rows in both, got 2 and 3"):
        room.are_motions_valid([[0, 0]] * 2, [[1, 1]] * 3)


def test_check_position_valid_says_why(room):
    np.testing.assert_array_equal(check_position_valid(room, (1, 2), "start"), [1.0, 2.0])
    with pytest.raises(InvalidPositionError, match=r"start: expected a position within .*11"):
        check_position_valid(room, (11, 2), "start")
    with pytest.raises(InvalidPositionError, match=r"goal: expected a free position"):
        check_position_valid(room, (5, 5), "goal")


def test_sampled_checker_in_four_dimensions_follows_its_predicate():
    def keep_apart(positions):
        return np.linalg.norm(positions[:, :2] - positions[:, 2:], axis=1) >= 1.0

    team = SampledChecker(lower=[0] * 4, upper=[9] * 4, are_valid=keep_apart, step_m=0.2)
    np.testing.assert_array_equal(
        team.are_positions_valid([[0, 0, 1, 0], [0, 0, 0.9, 0], [0, 0, 9.5, 0]]),
        [True, False, False],
    )
    # side by side; swapping places on one line; standing still
    valid = team.are_motions_valid(
        [[0, 0, 0, 2], [0, 0, 5, 0], [1, 1, 3, 3]], [[5, 0, 5, 2], [5, 0, 0, 0], [1, 1, 3, 3]]
    )
    np.testing.assert_array_equal(valid, [True, False, True])


def test_sampled_checker_refuses_wrong_arguments():
    with pytest.raises(WorkspaceError, match="lower < upper"):
        SampledChecker(lower=[0], upper=[0], are_valid=lambda p: p[:, 0] > 0, step_m=1)
    with pytest.raises(ParameterError, match="step_m"):
        SampledChecker(lower=[0], upper=[1], are_valid=lambda p: p[:, 0] > 0, step_m=0)
    wrong = SampledChecker(lower=[0], upper=[1], are_valid=lambda p: p > 0, step_m=1)
    with pytest.raises(ParameterError, match=r"are_valid: expected booleans of shape \(1,\)"):
        wrong.are_positions_valid([0.5])
