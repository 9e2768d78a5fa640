"""Candidates from session to session: where a path is entered, what is kept, what is blocked."""

import closed_loop_worlds as worlds
import numpy as np
import pytest

from fgplan.closed_loop.candidates import Leg, kept_candidates, new_candidates
from fgplan.closed_loop.free_place import nearest_free_place
from fgplan.closed_loop.mission import LoopRobot
from fgplan.closed_loop.roadmap import build_team_roadmap
from fgplan.errors import NoCandidatePathError
from fgplan.planners.impacted_paths.options import CandidateOptions
from roadmaps import VertexPath, Workspace

SPACING_M, STEP_S = 10.0, 1.0
FIELD = Workspace(lower=np.zeros(2), upper=np.array([100.0, 100.0]))
ROBOT = LoopRobot(
    name="ann", goals=[[80.0, 0.0]], motion=worlds.motion(), start_covariance=np.eye(3)
)
WAYS = {
    "straight": [(0, 0), (80, 0)],
    "late turn": [(0, 0), (40, 0), (40, 30), (80, 0)],
    "apart": [(0, 0), (0, 20), (80, 20), (80, 0)],
}


def leg_of(*names, chosen=0, taken=0, spatial=False):
    ways = [VertexPath(tuple(range(len(WAYS[n]))), np.array(WAYS[n], float), 0.0) for n in names]
    robot, start = ROBOT, np.zeros(3)
    if spatial:
        robot = LoopRobot(
            name="ann",
            goals=[[80.0, 0.0, 5.0]],
            motion=worlds.motion(spatial=True),
            start_covariance=np.eye(6),
        )
        start = worlds.pose_at((0.0, 0.0, 0.0), True)
    paths = new_candidates(robot, start, ways, SPACING_M, STEP_S)
    return Leg(robot="ann", goal=0, candidates=paths, chosen=chosen, taken=taken), robot


def keep(leg, estimate, workspace=FIELD, robot=ROBOT):
    return kept_candidates(leg, np.asarray(estimate), robot.motion, workspace, SPACING_M, STEP_S)


def test_new_candidates_take_one_step_a_pose():
    leg, _ = leg_of("straight", "late turn")
    straight, turned = leg.candidates
    assert straight.steps == 8
    assert turned.steps == 4 + 3 + 5
    np.testing.assert_array_equal(turned.times_s, np.arange(13.0))
    assert leg.path is straight
    assert not leg.arrived
    np.testing.assert_array_equal(leg.target, straight.poses[1])


def test_path_that_was_followed_is_joined_at_the_next_step():
    leg, _ = leg_of("straight", "late turn", taken=3)
    estimate = [30.5, 0.4, 0.1]
    kept, blocked = keep(leg, estimate)
    assert blocked == 0
    for path, old in zip(kept, leg.candidates, strict=True):
        np.testing.assert_array_equal(path.poses[0], estimate)
        assert path.poses[1:].tobytes() == old.poses[4:].tobytes()
        assert path.motion_covariances[1:].tobytes() == old.motion_covariances[4:].tobytes()
        assert path.vertices[1:] == old.vertices[4:]
        np.testing.assert_array_equal(path.times_s, np.arange(len(path.poses)))


def test_path_that_was_departed_from_is_entered_behind_its_nearest_pose():
    leg, _ = leg_of("straight", "apart", taken=3)
    kept, _ = keep(leg, [30.0, 1.0, 0.0])
    joined, old = kept[1], leg.candidates[1]
    # Nearest is (30, 20), the fifth pose after the start; entered at (40, 20).
    assert old.poses[5][:2].tolist() == [30.0, 20.0]
    assert joined.poses[-len(old.poses) + 6 :].tobytes() == old.poses[6:].tobytes()
    head = joined.poses[: len(joined.poses) - len(old.poses[6:]) + 1, :2]
    lengths = np.linalg.norm(np.diff(head, axis=0), axis=1)
    assert len(lengths) == 3  # 21.5 m in steps of at most ten
    assert lengths.max() <= SPACING_M
    np.testing.assert_allclose(lengths, lengths[0])


def test_chosen_path_comes_first_and_equal_ones_are_kept_once():
    leg, _ = leg_of("apart", "straight", "straight", chosen=1, taken=2)
    kept, blocked = keep(leg, [20.0, 0.0, 0.0])
    assert blocked == 0
    assert len(kept) == 2
    assert kept[0].poses[1:].tobytes() == leg.candidates[1].poses[3:].tobytes()


def test_path_that_ended_is_entered_at_its_goal():
    leg, _ = leg_of("late turn", "straight", taken=9)
    kept, _ = keep(leg, [48.0, 24.0, 0.0])
    assert kept[1].poses[-1].tobytes() == leg.candidates[1].poses[-1].tobytes()
    assert kept[1].steps >= 1


def test_blocked_candidates_are_given_up():
    leg, _ = leg_of("straight", "late turn", "apart", taken=2)
    wall = np.array([(55.0, -1.0), (60.0, -1.0), (60.0, 8.0), (55.0, 8.0)])
    kept, blocked = keep(leg, [20.0, 0.0, 0.0], Workspace(**bounds(), obstacles=(wall,)))
    assert blocked == 1
    assert [path.poses[-1].tobytes() for path in kept] == [
        leg.candidates[i].poses[-1].tobytes() for i in (1, 2)
    ]


def bounds():
    return {"lower": np.full(2, -5.0), "upper": np.array([100.0, 100.0])}


def test_estimate_in_a_margin_leaves_it_on_its_own_side():
    """The robot stands by a thin wall, its estimate is in the wall's margin."""
    wall = np.array([(-5.0, 4.0), (70.0, 4.0), (70.0, 4.5), (-5.0, 4.5)])
    workspace = Workspace(**bounds(), obstacles=(wall,), robot_radius_m=1.0)
    leg, _ = leg_of("straight", "apart", taken=2)
    kept, blocked = keep(leg, [20.0, 3.5, 0.0], workspace)
    assert blocked == 1  # apart is behind the wall
    [path] = kept
    places = path.poses[:, :2]
    assert 3.5 - 0.55 < places[1][1] <= 3.0  # straight out of the margin
    assert abs(places[1][0] - 20.0) < 0.1
    assert workspace.are_motions_valid(places[1:-1], places[2:]).all()


def test_estimate_from_which_no_place_is_free_keeps_nothing():
    block = np.array([(-5.0, -5.0), (60.0, -5.0), (60.0, 100.0), (-5.0, 100.0)])
    leg, _ = leg_of("straight", taken=2)
    assert keep(leg, [20.0, 50.0, 0.0], Workspace(**bounds(), obstacles=(block,))) == ((), 1)


def test_robots_in_space_keep_their_height_and_turn_upright():
    leg, robot = leg_of("straight", "apart", taken=3, spatial=True)
    estimate = worlds.pose_at((30.0, 1.0, 0.3), True)
    estimate[2, 3] = 5.4
    kept, _ = keep(leg, estimate, robot=robot)
    joined = kept[1].poses
    np.testing.assert_array_equal(joined[0], estimate)
    assert (joined[1:, 2, 3] == 5.0).all()
    np.testing.assert_array_equal(joined[1:, 2, :3], np.tile([0.0, 0.0, 1.0], (len(joined) - 1, 1)))
    ahead = joined[2, :2, 3] - joined[1, :2, 3]
    np.testing.assert_allclose(joined[2, :2, 0], ahead / np.linalg.norm(ahead), atol=1e-12)
    for rotation in joined[:, :3, :3]:
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


def test_nearest_free_place_is_the_place_itself_where_it_is_free():
    place = np.array([3.0, 4.0])
    assert nearest_free_place(FIELD, place) is place


@pytest.mark.parametrize("place", [(-3.0, 50.0), (50.0, 104.0), (-2.0, -1.0)])
def test_nearest_free_place_to_one_out_of_bounds_is_on_the_border(place):
    found = nearest_free_place(FIELD, np.array(place))
    np.testing.assert_array_equal(found, np.clip(place, 0.0, 100.0))


def test_nearest_free_place_is_near():
    disc = np.stack([50 + 8 * np.cos(np.arange(60) / 60 * 2 * np.pi),
                     50 + 8 * np.sin(np.arange(60) / 60 * 2 * np.pi)], axis=1)  # fmt: skip
    workspace = Workspace(lower=np.zeros(2), upper=np.full(2, 100.0), obstacles=(disc,))
    found = nearest_free_place(workspace, np.array([53.0, 50.0]))
    assert workspace.are_positions_valid(found)[0]
    assert 4.95 < np.linalg.norm(found - [53.0, 50.0]) < 1.1 * 5.05
    assert nearest_free_place(workspace, np.array([180.0, 50.0])) is None


def roadmap_of(workspace, goals, **options):
    chosen = CandidateOptions(
        **{"candidates": 4, "spacing_m": 10.0, "vertices": 80, "neighbours": 6, **options}
    )
    return build_team_roadmap(workspace, goals, chosen, np.random.default_rng(0))


def test_goals_are_vertices_and_shared_ones_are_one():
    goals = {"ann": np.array([[10.0, 10.0], [90.0, 90.0]]), "bob": np.array([[90.0, 90.0, 4.0]])}
    roadmap = roadmap_of(FIELD, goals)
    assert roadmap.goal_vertices == {"ann": (0, 1), "bob": (1,)}
    np.testing.assert_array_equal(roadmap.graph.nodes[1]["position"], [90.0, 90.0])


def test_obstacle_takes_away_the_edges_that_cross_it_and_no_other():
    roadmap = roadmap_of(FIELD, {"ann": np.array([[90.0, 90.0]])})
    wall = np.array([(40.0, 0.0), (45.0, 0.0), (45.0, 70.0), (40.0, 70.0)])
    after = roadmap.with_obstacles((wall,))
    assert list(after.graph) == list(roadmap.graph)
    walled = Workspace(lower=np.zeros(2), upper=np.full(2, 100.0), obstacles=(wall,))
    for one, other in roadmap.graph.edges:
        ends = [roadmap.graph.nodes[vertex]["position"] for vertex in (one, other)]
        free = walled.are_motions_valid(*ends)[0]
        assert after.graph.has_edge(one, other) == free
    assert after.graph.number_of_edges() < roadmap.graph.number_of_edges()
    again = after.with_obstacles((wall,))
    assert again.graph.number_of_edges() == after.graph.number_of_edges()


def test_roadmap_without_edges_stays_one():
    roadmap = roadmap_of(FIELD, {"ann": np.array([[90.0, 90.0]])}, vertices=1)
    wall = np.array([(40.0, 0.0), (45.0, 0.0), (45.0, 70.0)])
    assert roadmap.with_obstacles((wall,)).graph.number_of_edges() == 0


def test_way_from_a_margin_begins_at_the_nearest_free_place():
    wall = np.array([(0.0, 40.0), (80.0, 40.0), (80.0, 42.0), (0.0, 42.0)])
    workspace = Workspace(
        lower=np.zeros(2), upper=np.full(2, 100.0), obstacles=(wall,), robot_radius_m=2.0
    )
    roadmap = roadmap_of(workspace, {"ann": np.array([[20.0, 90.0]])})
    here = np.array([20.0, 39.0])
    ways = roadmap.paths("ann", here, 0, 4, np.random.default_rng(0))
    for way in ways:
        np.testing.assert_array_equal(way.positions[0], here)
        assert way.positions[1][1] < 38.0  # not through the wall
        assert workspace.are_motions_valid(way.positions[1:-1], way.positions[2:]).all()


def test_ways_longer_than_wished_are_left_out():
    roadmap = roadmap_of(FIELD, {"ann": np.array([[90.0, 90.0]])}, max_length_m=50.0)
    with pytest.raises(NoCandidatePathError, match=r"robot 'ann' at .* its goal 1"):
        roadmap.paths("ann", np.array([5.0, 5.0]), 0, 4, np.random.default_rng(0))


def test_place_with_no_free_one_near_has_no_way():
    block = np.array([(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0)])
    workspace = Workspace(lower=np.zeros(2), upper=np.full(2, 100.0), obstacles=(block,))
    roadmap = roadmap_of(workspace, {"ann": np.array([[90.0, 90.0]])})
    with pytest.raises(NoCandidatePathError, match="its goal 1"):
        roadmap.paths("ann", np.array([20.0, 20.0]), 0, 4, np.random.default_rng(0))


def test_workspace_with_no_free_space_is_refused():
    block = np.array([(-1.0, -1.0), (101.0, -1.0), (101.0, 99.999999), (-1.0, 99.999999)])
    workspace = Workspace(lower=np.zeros(2), upper=np.full(2, 100.0), obstacles=(block,))
    with pytest.raises(NoCandidatePathError, match="roadmap of the team"):
        roadmap_of(workspace, {"ann": np.array([[90.0, 100.0]])})
