"""Identity, provenance, cuts and differences of planned factors; which states are joined."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
import scenes

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.factors.factor_set import FactorSet, factor_difference, join_factor_sets
from fgplan.factors.keys import future_key
from fgplan.factors.multi_robot import joined_pairs, multi_robot_factors
from fgplan.factors.path_factors import (
    local_factors,
    pair_factors,
    past_factors,
    path_keys,
    pose_key,
    team_factors,
)
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel


@pytest.fixture
def scene():
    return scenes.random_scene(np.random.default_rng(11), robots=3, landmarks=8, past=2)


def first_paths(paths):
    return {robot: options[0] for robot, options in paths.items()}


def test_path_keys_start_at_the_prior(scene):
    problem, paths = scene
    path = paths["robot1"][0]
    keys = path_keys(problem, path)
    assert keys[0] == problem.start_keys["robot1"] == pose_key(problem, "robot1", 0)
    assert keys[3] == future_key(1, 3) == pose_key(problem, "robot1", 3)
    assert len(keys) == path.steps + 1


def test_local_factors_are_motion_and_observations_with_their_steps(scene):
    problem, paths = scene
    path = max(paths["robot0"], key=lambda p: len(p.observations))
    factors = local_factors(problem, path)
    kinds = [f.identity.kind for f in factors]
    assert kinds == ["motion"] * path.steps + ["observation"] * len(path.observations)
    assert path.observations
    for planned in factors:
        assert planned.step == planned.identity.step
        assert planned.identity.robots == ("robot0",)
    assert [f.step for f in factors][path.steps :] == [o.step for o in path.observations]


def test_equal_observations_are_two_measurements(scene):
    problem, paths = scene
    path = next(p for p in paths["robot0"] if p.observations)
    twice = replace(path, observations=path.observations * 2)
    factors = local_factors(problem, twice)
    assert len(set(factors.identities())) == len(factors) == path.steps + 2 * len(path.observations)


def test_joined_pairs_agree_with_the_model_pair_by_pair():
    generator = np.random.default_rng(12)
    problem, paths = scenes.random_scene(generator, robots=2, candidates=6)
    model = problem.multi_robot[0]
    found = 0
    for path in paths["robot0"]:
        for other in paths["robot1"]:
            pairs = joined_pairs(model, path.states(), other.states())
            expected = [
                (i, j)
                for i, state in enumerate(path.states())
                for j, seen in enumerate(other.states())
                if model.joins(state, seen)
            ]
            assert pairs == expected
            found += len(pairs)
    assert found > 20
    assert joined_pairs(model, (), paths["robot1"][0].states()) == []


@pytest.mark.parametrize("kind", ["range", "bearing_range", "bearing"])
def test_sensors_join_states_of_one_time(kind):
    problem, paths = scenes.random_scene(np.random.default_rng(13), kind=kind, radius_m=800.0)
    model = problem.multi_robot[0]
    own, other = paths["robot0"][0].states(), paths["robot1"][0].states()
    pairs = joined_pairs(model, own, other)
    assert 0 < len(pairs) < len(own) * len(other)
    for i, j in pairs:
        assert abs(own[i].time_s - other[j].time_s) <= model.time_tolerance_s


def test_a_users_criterion_is_asked_for_every_pair():
    problem, paths = scenes.random_scene(np.random.default_rng(14))
    own, other = paths["robot0"][0].states(), paths["robot1"][0].states()
    model = MultiRobotModel(
        criterion=lambda first, second: first.step == second.step,
        sensor=problem.multi_robot[0].sensor,
    )
    shorter = min(len(own), len(other))
    assert joined_pairs(model, own, other) == [(i, i) for i in range(shorter)]


def test_the_earlier_robot_measures_whoever_asks(scene):
    problem, paths = scene
    path, other = paths["robot0"][0], paths["robot2"][0]
    one, two = pair_factors(problem, path, other), pair_factors(problem, other, path)
    assert one.identities() == two.identities()
    for planned in one:
        assert planned.identity.robots == ("robot0", "robot2")
        assert tuple(planned.factor.keys()) == planned.identity.variables


def test_two_paths_of_one_robot_have_no_factors(scene):
    problem, paths = scene
    with pytest.raises(InvalidInputError, match="two of 'robot0'"):
        pair_factors(problem, paths["robot0"][0], paths["robot0"][1])


def test_past_states_of_others_take_part_by_their_prior_keys(scene):
    problem, paths = scene
    everywhere = replace(problem.multi_robot[0], criterion=DistanceCriterion(1e5))
    problem = replace(problem, multi_robot=(everywhere,))
    path = paths["robot1"][0]
    factors = past_factors(problem, path)
    others = [p for p in problem.past_states if p.state.robot != "robot1"]
    assert len(factors) == path.steps * len(others) == path.steps * 6
    for planned in factors:
        first, second = planned.identity.states
        assert (first[0], second[0]) in {("robot0", "robot1"), ("robot1", "robot2")}
        assert min(first[1], second[1]) <= 0 < planned.step == max(first[1], second[1])
    known = {past.key for past in others}
    assert {key for f in factors for key in f.identity.variables} - set(
        path_keys(problem, path)[1:]
    ) == known


def test_past_states_are_left_out_where_the_model_says_so(scene):
    problem, paths = scene
    model = replace(problem.multi_robot[0], criterion=DistanceCriterion(1e5), include_past=False)
    problem = replace(problem, multi_robot=(model,))
    assert len(past_factors(problem, paths["robot1"][0])) == 0


def test_two_states_of_the_prior_get_no_factor(scene):
    """The pair of two current poses belongs to the prior: it would be counted twice."""
    problem, paths = scene
    model = replace(problem.multi_robot[0], criterion=DistanceCriterion(1e5))
    own = [(problem.start_keys["robot0"], paths["robot0"][0].state(0))]
    other = [(problem.start_keys["robot1"], paths["robot1"][0].state(0))]
    future = [(future_key(1, 1), paths["robot1"][0].state(1))]
    assert multi_robot_factors((model,), own, other) == ()
    (planned,) = multi_robot_factors((model,), own, other + future)
    assert planned.identity.variables == (own[0][0], future[0][0])


def test_current_poses_take_part_only_if_listed():
    generator = np.random.default_rng(15)
    problem, paths = scenes.random_scene(generator, radius_m=1e5)
    factors = team_factors(problem, first_paths(paths))
    starts = set(problem.start_keys.values())
    joined = {k for f in factors if f.identity.kind == "multi_robot" for k in f.identity.variables}
    assert joined
    assert not joined & starts


def test_a_cut_keeps_factors_all_of_whose_states_are_early(scene):
    problem, paths = scene
    chosen = first_paths(paths)
    everything = team_factors(problem, chosen)
    assert everything.cut(None) is everything
    assert everything.cut(everything.last_step) is everything
    for step in range(everything.last_step + 1):
        kept = set(team_factors(problem, chosen, step).identities())
        expected = {
            f for f in everything.identities() if all(state[1] <= step for state in f.states)
        }
        assert kept == expected
    assert len(everything.cut(0)) == 0
    assert FactorSet().last_step == 0


def test_difference_is_by_identity(scene):
    problem, paths = scene
    before = first_paths(paths)
    after = {**before, "robot2": paths["robot2"][1]}
    old, new = team_factors(problem, before), team_factors(problem, after)
    change = factor_difference(old, new)
    assert set(change.added.identities()) == set(new.identities()) - set(old.identities())
    assert set(change.removed.identities()) == set(old.identities()) - set(new.identities())
    assert set(change.kept.identities()) == set(new.identities()) & set(old.identities())
    assert len(change.added)
    assert len(change.removed)
    # the paths are equal in content, not the same objects: nothing changed
    same = factor_difference(old, team_factors(problem, before))
    assert len(same.added) == len(same.removed) == 0
    assert len(join_factor_sets([old, new])) == len(new) + len(change.removed)


@pytest.mark.parametrize("field", ["times_s", "motion_covariances", "vertices", "poses"])
def test_identity_sees_time_noise_vertex_and_pose(scene, field):
    problem, paths = scene
    path = paths["robot0"][0]
    moved = {
        "times_s": path.times_s * 2.0,
        "motion_covariances": path.motion_covariances * 2.0,
        "vertices": tuple(vertex + 100 for vertex in path.vertices),
        "poses": np.vstack([path.poses[:1], path.poses[1:] + np.array([0.0, 0.0, 0.1])]),
    }
    before = local_factors(problem, path)
    after = local_factors(problem, replace(path, **{field: moved[field]}))
    motions = [f for f in factor_difference(before, after).kept if f.identity.kind == "motion"]
    assert not motions


def test_two_models_may_hold_at_once(scene):
    problem, paths = scene
    model = problem.multi_robot[0]
    tight = MultiRobotModel(
        criterion=model.criterion, sensor=RelativePoseSensor(covariance=np.eye(3))
    )
    path, other = paths["robot0"][0], paths["robot1"][0]
    single = pair_factors(problem, path, other)
    double = pair_factors(replace(problem, multi_robot=(model, tight)), path, other)
    assert len(double) == 2 * len(single) > 0
    assert len(set(double.identities())) == len(double)
    twice = pair_factors(replace(problem, multi_robot=(model, model)), path, other)
    assert len(set(twice.identities())) == 2 * len(single)


def test_a_set_is_a_graph_in_order(scene):
    problem, paths = scene
    factors = team_factors(problem, first_paths(paths))
    graph = factors.graph()
    assert isinstance(graph, gtsam.NonlinearFactorGraph)
    assert graph.size() == len(factors)
    assert [tuple(graph.at(i).keys()) for i in range(graph.size())] == [
        f.identity.variables for f in factors
    ]


def test_an_unknown_landmark_is_named(scene):
    problem, paths = scene
    path = next(p for p in paths["robot0"] if p.observations)
    lost = replace(path.observations[0], landmark=gtsam.symbol("q", 7))
    with pytest.raises(UnknownNameError, match="q7"):
        local_factors(problem, replace(path, observations=(lost,)))
