import networkx as nx
import numpy as np
import pytest

from roadmaps import (
    RRG,
    RRT,
    InvalidPositionError,
    NoCandidatePathError,
    ParameterError,
    RRTStar,
    SampledChecker,
    Steering,
    Tree,
    UnknownVertexError,
    UnreachableError,
    Workspace,
    build_roadmap,
    euclidean_steering,
    grow_candidate_paths,
    positions_of,
    steer_straight,
)

BUILDERS = [RRT, RRTStar, RRG]


def grow(builder, field, seed, samples=300, **changes):
    arguments = {"step_m": 8.0, "goal": [98, 98]} | changes
    return builder(field, [2, 2], np.random.default_rng(seed), **arguments).grow(samples)


def assert_consistent(tree, checker):
    """Costs add up along the tree and every edge is valid."""
    child, parent = np.arange(1, len(tree.parents)), tree.parents[1:]
    edges = np.linalg.norm(tree.positions[child] - tree.positions[parent], axis=1)
    np.testing.assert_allclose(tree.costs[child], tree.costs[parent] + edges, rtol=1e-9)
    assert checker.are_motions_valid(tree.positions[parent], tree.positions[child]).all()


@pytest.mark.parametrize("builder", BUILDERS)
@pytest.mark.parametrize("seed", [0, 1])
def test_trees_are_consistent_and_roadmaps_valid(builder, seed, field):
    growth = grow(builder, field, seed)
    assert_consistent(growth.tree(), field)
    roadmap = growth.roadmap()
    assert nx.is_connected(roadmap)
    assert len(roadmap) == len(growth) > 150
    positions = positions_of(roadmap)
    np.testing.assert_array_equal(positions, growth.positions)
    first, second = np.array(roadmap.edges).T
    assert field.are_motions_valid(positions[first], positions[second]).all()


@pytest.mark.parametrize("builder", BUILDERS)
def test_one_seed_gives_one_product_however_it_is_grown(builder, field):
    whole = grow(builder, field, 4, 250)
    parts = grow(builder, field, 4, 100).grow(sample_count=150)
    np.testing.assert_array_equal(whole.tree().parents, parts.tree().parents)
    assert list(whole.roadmap().edges) == list(parts.roadmap().edges)


@pytest.mark.parametrize("seed", range(5))
def test_same_samples_cost_no_more_in_rrt_star_and_no_more_still_in_rrg(seed, field):
    trees = [grow(builder, field, seed, 500).tree() for builder in BUILDERS]
    for tree in trees[1:]:
        np.testing.assert_array_equal(tree.positions, trees[0].positions)
    assert (trees[1].costs <= trees[0].costs + 1e-9).all()
    assert (trees[2].costs <= trees[1].costs + 1e-9).all()
    assert trees[1].costs.sum() < 0.95 * trees[0].costs.sum()


def test_rrt_is_a_spanning_tree_of_nearest_vertices(field):
    tree = grow(RRT, field, 0).tree()
    assert nx.is_tree(tree.roadmap())
    steps = np.linalg.norm(tree.positions[1:] - tree.positions[tree.parents[1:]], axis=1)
    assert steps.max() <= 8.0 + 1e-9


def test_rrg_contains_the_rrt(field):
    rrg, rrt = grow(RRG, field, 2).roadmap(), grow(RRT, field, 2).roadmap()
    assert set(map(frozenset, rrt.edges)) <= set(map(frozenset, rrg.edges))
    assert rrg.number_of_edges() > 1.5 * rrt.number_of_edges()


@pytest.mark.parametrize("builder", BUILDERS)
def test_path_to_goal_ends_at_the_goal(builder, field):
    growth = grow(builder, field, 1, 600)
    path = growth.path_to_goal()
    np.testing.assert_array_equal(path.positions[[0, -1]], [[2, 2], [98, 98]])
    assert path.vertices[-1] == growth.goal_vertex
    steps = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    np.testing.assert_allclose(path.length_m, steps.sum())
    assert path.length_m >= np.hypot(96, 96)


def test_rrt_star_approaches_the_straight_line():
    hall = Workspace(lower=[0, 0], upper=[10, 10])
    growth = RRTStar(hall, [1, 1], np.random.default_rng(0), step_m=3.0, goal=[9, 9])
    early = growth.grow(100).path_to_goal().length_m
    late = growth.grow(1200).path_to_goal().length_m
    assert np.hypot(8, 8) <= late <= early
    assert late < 1.03 * np.hypot(8, 8)


@pytest.mark.parametrize("builder", BUILDERS)
def test_two_robots_in_their_joint_space(builder):
    """Own distance, cost and steering; the robots must swap ends of a hall and stay apart."""

    def keep_apart(positions):
        return np.linalg.norm(positions[:, :2] - positions[:, 2:], axis=1) >= 1.0

    def furthest(positions, target):
        moved = (positions - target).reshape(-1, 2, 2)
        return np.linalg.norm(moved, axis=2).max(axis=1)

    def both(starts, ends):
        return np.linalg.norm((ends - starts).reshape(-1, 2, 2), axis=2).sum(axis=1)

    team = SampledChecker(lower=[0] * 4, upper=[10] * 4, are_valid=keep_apart, step_m=0.3)
    steering = Steering(
        steer=steer_straight(4.0), distances=furthest, costs=both, near_radius=lambda count: 4.0
    )
    goal = [9, 5, 1, 5]
    growth = builder(
        team, [1, 5, 9, 5], np.random.default_rng(0), steering=steering, goal=goal, goal_bias=0.2
    ).grow(400)
    path = growth.path_to_goal()
    np.testing.assert_array_equal(path.positions[-1], goal)
    assert keep_apart(path.positions).all()
    np.testing.assert_allclose(path.length_m, both(path.positions[:-1], path.positions[1:]).sum())
    assert path.length_m > 16.0


@pytest.mark.parametrize("builder", [RRTStar, RRG])
def test_costs_that_break_the_triangle_inequality_still_add_up(builder):
    """Squared lengths: a descendant may gain more through its own parent than directly."""

    def squared(starts, ends):
        return ((ends - starts) ** 2).sum(axis=1)

    hall = Workspace(lower=[0, 0], upper=[10, 10])
    steering = Steering(
        steer=steer_straight(3.0),
        distances=lambda positions, target: np.linalg.norm(positions - target, axis=1),
        costs=squared,
        near_radius=lambda count: 3.0,
    )
    growth = builder(hall, [1, 1], np.random.default_rng(0), steering=steering).grow(300)
    tree = growth.tree()
    edges = squared(tree.positions[tree.parents[1:]], tree.positions[1:])
    np.testing.assert_allclose(tree.costs[1:], tree.costs[tree.parents[1:]] + edges)


def test_growing_while_time_lasts(field):
    growth = RRG(field, [2, 2], np.random.default_rng(0), step_m=8.0)
    assert len(growth.grow(time_limit_s=0.02)) > 1
    assert len(growth.roadmap()) == len(growth)


def test_a_single_vertex_is_a_product():
    hall = Workspace(lower=[0, 0], upper=[1, 1])
    for builder in BUILDERS:
        growth = builder(hall, [0.5, 0.5], np.random.default_rng(0), step_m=1, goal=[0.5, 0.5])
        assert growth.path_to_goal().vertices == (0,)
        assert list(growth.roadmap()) == [0]


def test_steps_of_no_length_and_into_obstacles_add_nothing():
    wall = [(0.6, -1), (0.7, -1), (0.7, 2), (0.6, 2)]
    hall = Workspace(lower=[0, 0], upper=[1, 1], obstacles=[wall])
    for target in ([0.5, 0.5], [0.9, 0.5]):
        growth = RRT(
            hall,
            [0.5, 0.5],
            np.random.default_rng(0),
            step_m=1,
            sampler=lambda checker, rng, target=target: np.array(target),
        )
        assert growth.extend() is None
        assert len(growth) == 1


def test_candidates_from_a_growing_graph_get_no_worse(field):
    growth = RRG(field, [2, 2], np.random.default_rng(3), step_m=10.0, goal=[98, 98])
    rounds = list(grow_candidate_paths(growth, 10, samples_a_round=150, sample_limit=700))
    lengths = [paths[0].length_m for paths in rounds]
    assert len(rounds) >= 2
    assert lengths == sorted(lengths, reverse=True)
    roadmap = growth.roadmap()
    for path in rounds[-1]:
        assert nx.is_path(roadmap, path.vertices)
        np.testing.assert_array_equal(path.positions[-1], [98, 98])
    assert len(rounds[-1]) == 10


def test_candidates_while_time_lasts(field):
    growth = grow(RRG, field, 3, 600)
    sets = list(
        grow_candidate_paths(
            growth,
            5,
            time_limit_s=0.05,
            samples_a_round=20,
            method="perturbed",
            rng=np.random.default_rng(0),
        )
    )
    assert sets
    assert all(len(paths) == 5 for paths in sets)


def test_an_unreached_goal_is_an_error():
    wall = [(4.9, -1), (5.1, -1), (5.1, 11), (4.9, 11)]
    hall = Workspace(lower=[0, 0], upper=[10, 10], obstacles=[wall])
    growth = RRG(hall, [1, 1], np.random.default_rng(0), step_m=2.0, goal=[9, 9])
    with pytest.raises(NoCandidatePathError, match=r"goal \[9.0, 9.0\] to be reached, but 60"):
        list(grow_candidate_paths(growth, 3, samples_a_round=25, sample_limit=60))
    with pytest.raises(UnreachableError, match=r"goal \[9.0, 9.0\] has not been reached"):
        growth.path_to_goal()


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"step_m": None}, ParameterError, "one of step_m and steering"),
        ({"step_m": -1.0}, ParameterError, "step_m"),
        ({"goal_bias": 1.0}, ParameterError, "goal_bias"),
        ({"goal": [200, 2]}, InvalidPositionError, "goal: expected a position within"),
        (
            {"steering": euclidean_steering(1.0, [0, 0], [1, 1])},
            ParameterError,
            "one of step_m and steering",
        ),
    ],
)
def test_wrong_builders_are_refused(field, changes, error, words):
    with pytest.raises(error, match=words):
        grow(RRT, field, 0, **changes)


def test_wrong_calls_are_refused(field):
    growth = RRT(field, [2, 2], np.random.default_rng(0), step_m=1.0)
    with pytest.raises(InvalidPositionError, match="start"):
        RRT(field, [200, 2], np.random.default_rng(0), step_m=1.0)
    with pytest.raises(ParameterError, match="sample_count or time_limit_s, got neither"):
        growth.grow()
    with pytest.raises(ParameterError, match="sample_count"):
        growth.grow(-1)
    with pytest.raises(ParameterError, match="time_limit_s"):
        growth.grow(time_limit_s=0)
    with pytest.raises(ParameterError, match="goal: expected one at construction"):
        growth.path_to_goal()
    with pytest.raises(ParameterError, match="builder with a goal"):
        next(grow_candidate_paths(growth, 3, sample_limit=5))
    aimed = RRT(field, [2, 2], np.random.default_rng(0), step_m=1.0, goal=[3, 3])
    with pytest.raises(ParameterError, match="sample_limit or time_limit_s"):
        next(grow_candidate_paths(aimed, 3))
    with pytest.raises(ParameterError, match="samples_a_round"):
        next(grow_candidate_paths(aimed, 3, samples_a_round=0, sample_limit=1))


def test_near_radius_shrinks_and_is_capped_by_the_step():
    steering = euclidean_steering(2.0, [0, 0], [10, 10], gamma=10.0)
    assert steering.near_radius(1) == 2.0
    assert steering.near_radius(10) == 2.0
    expected = 10.0 * np.sqrt(np.log(1000.0) / 1000.0)
    np.testing.assert_allclose(steering.near_radius(1000), expected, rtol=1e-12)
    gamma = 1.001 * 2.0 * np.sqrt(1.5) * np.sqrt(100.0 / np.pi)
    default = euclidean_steering(99.0, [0, 0], [10, 10]).near_radius(1000)
    np.testing.assert_allclose(default / steering.near_radius(1000), gamma / 10.0, rtol=1e-12)
    with pytest.raises(ParameterError, match="gamma"):
        euclidean_steering(2.0, [0, 0], [1, 1], gamma=0.0)


def test_steer_straight_returns_a_target_within_reach_itself():
    steer = steer_straight(2.0)
    target = np.array([1.0, 1.0])
    assert steer(np.zeros(2), target) is target
    np.testing.assert_allclose(steer(np.zeros(2), np.array([3.0, 4.0])), [1.2, 1.6])


def test_tree_worked_by_hand():
    tree = Tree([[0, 0], [1, 0], [1, 2]], [-1, 0, 1], [0, 1, 3])
    path = tree.path_to(2)
    assert path.vertices == (0, 1, 2)
    assert path.length_m == 3.0
    assert nx.utils.graphs_equal(
        nx.create_empty_copy(tree.roadmap(), with_data=False),
        nx.create_empty_copy(build_roadmap(tree.positions, []), with_data=False),
    )
    assert list(tree.roadmap().edges(data="length")) == [(0, 1, 1.0), (1, 2, 2.0)]
    with pytest.raises(UnknownVertexError, match="expected 0 to 2, got 3"):
        tree.path_to(3)


@pytest.mark.parametrize(
    ("parents", "costs", "words"),
    [
        ([-1, 0], [0, 1, 2], "one parent and one cost"),
        ([-1, 2, 1], [0, 1, 2], "no cycle"),
        ([0, 0, 0], [0, 1, 2], "-1 for row 0 only"),
        ([-1, -1, 0], [0, 1, 2], "-1 for row 0 only"),
        ([-1, 0, 7], [0, 1, 2], "-1 for row 0 only"),
    ],
)
def test_wrong_trees_are_refused(parents, costs, words):
    with pytest.raises(ParameterError, match=words):
        Tree(np.zeros((3, 2)), parents, costs)
