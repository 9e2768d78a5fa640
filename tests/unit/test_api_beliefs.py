"""Candidate beliefs and priors as a user asks them: keys, covariances, refusals."""

import dataclasses

import gtsam
import numpy as np
import pytest
from scenes import landmark_key, random_scene

from fgplan.beliefs.belief import Belief
from fgplan.beliefs.candidate_belief import candidate_belief
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.evaluation.as_published import AsPublished
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.isam2 import Isam2


def scene(planar=True):
    problem, paths = random_scene(
        np.random.default_rng(3), robots=3, candidates=2, landmarks=3, planar=planar
    )
    return problem, {robot: options[0] for robot, options in paths.items()}


@pytest.mark.parametrize("planar", [True, False])
def test_covariances_of_a_robot_are_the_belief_s(planar):
    problem, paths = scene(planar)
    joint = candidate_belief(problem, {"robot0": paths["robot0"], "robot1": paths["robot1"]})
    oracle = Belief(joint.graph, joint.values)
    where, turn = (slice(0, 2), slice(2, 3)) if planar else (slice(3, 6), slice(0, 3))
    last = paths["robot0"].steps
    for step in (0, 1, last):
        expected = oracle.covariance(joint.keys["robot0"][step])
        assert joint.key("robot0", step) == joint.keys["robot0"][step]
        for block, part in (("pose", slice(None)), ("position", where), ("heading", turn)):
            found = joint.covariance("robot0", step, block)
            np.testing.assert_allclose(found, expected[part, part], rtol=1e-12)
        sigma = np.sqrt(np.trace(expected[where, where]))
        assert joint.position_sigma_m("robot0", step) == pytest.approx(sigma, rel=1e-12)
    assert joint.key("robot0") == joint.key("robot0", last)
    np.testing.assert_array_equal(joint.covariance("robot0"), joint.covariance("robot0", last))
    assert joint.position_sigma_m("robot0") == joint.position_sigma_m("robot0", last)
    assert joint.key("robot2") == problem.start_keys["robot2"]  # it has no path
    assert joint.belief() is joint.belief()
    assert len(candidate_belief(problem, paths, 1).keys["robot0"]) == 2


def test_steps_blocks_and_robots_that_are_not_there_are_refused():
    problem, paths = scene()
    joint = candidate_belief(problem, paths)
    last = paths["robot0"].steps
    for step in (-1, last + 1):
        with pytest.raises(InvalidInputError, match=f"'robot0'.*from 0 to {last}, got {step}"):
            joint.key("robot0", step)
    with pytest.raises(InvalidInputError, match="from 0 to 1, got 2"):
        candidate_belief(problem, paths, 1).position_sigma_m("robot0", 2)
    with pytest.raises(InvalidInputError, match="expected block pose, position or heading"):
        joint.covariance("robot0", block="xy")
    with pytest.raises(UnknownNameError, match="robot 'eve': expected one of robot0"):
        joint.key("eve")


def test_paths_under_another_name_or_alone_are_refused_by_all():
    problem, paths = scene()
    own = [paths["robot0"]]
    asks = [lambda given: candidate_belief(problem, given), problem.check_announced]
    for evaluator in (FromScratch(), Isam2(), AsPublished()):
        state = evaluator.start(problem, "robot0", own)
        asks.append(lambda given, e=evaluator, s=state: e.evaluate(s, given))
    for ask in asks:
        with pytest.raises(InvalidInputError, match=r"robot 'robot1': got a path of .*'robot2'"):
            ask({"robot1": paths["robot2"]})
        with pytest.raises(InvalidInputError, match=r"expected a mapping.*got CandidatePath"):
            ask(paths["robot1"])
        with pytest.raises(InvalidInputError, match="expected a CandidatePath, got list"):
            ask({"robot1": [paths["robot1"]]})
        with pytest.raises(UnknownNameError, match="'eve': expected one of robot0, robot1"):
            ask({"eve": paths["robot1"]})
    state = Incremental().start(problem, "robot0", own)
    with pytest.raises(InvalidInputError, match="robot 'robot1': got a path of robot 'robot2'"):
        Incremental().evaluate(state, {"robot1": paths["robot2"]})


@pytest.mark.parametrize("planar", [True, False])
def test_landmarks_of_a_prior_by_key(planar):
    problem, _ = scene(planar)
    found = problem.prior.landmarks()
    assert list(found) == [landmark_key(index) for index in range(3)]
    for key, point in found.items():
        assert point.shape == ((2,) if planar else (3,))
        np.testing.assert_array_equal(point, problem.prior.point(key))


def test_graph_and_values_exchanged_are_refused():
    problem, _ = scene()
    graph, values = problem.prior.graph, problem.prior.values
    with pytest.raises(InvalidInputError, match=r"graph of type NonlinearFactorGraph, got Values"):
        Belief(values, graph)
    with pytest.raises(InvalidInputError, match="values of type Values, got dict"):
        Belief(gtsam.NonlinearFactorGraph(), {})


def test_models_and_past_states_come_in_tuples():
    problem, _ = scene()
    [model] = problem.multi_robot
    assert dataclasses.replace(problem, multi_robot=[model]).multi_robot == (model,)
    for wrong in (model, [model.sensor]):
        with pytest.raises(InvalidInputError, match="multi_robot: expected a tuple of MultiRobotM"):
            dataclasses.replace(problem, multi_robot=wrong)
    with pytest.raises(InvalidInputError, match="past_states: expected a tuple of PastState"):
        dataclasses.replace(problem, past_states=[3])


@pytest.mark.parametrize(
    "ask",
    [
        lambda belief: belief.covariance("ann"),
        lambda belief: belief.covariance(["ann", "bob"]),
        lambda belief: belief.covariance(belief.keys[0], "ann"),
        lambda belief: belief.dim("ann"),
        lambda belief: belief.pose("ann"),
        lambda belief: belief.point("ann"),
        lambda belief: belief.marginal_covariances(["ann"]),
        lambda belief: belief.square_root_information("ann"),
    ],
)
def test_a_name_in_place_of_a_key_is_refused(ask):
    problem, _ = scene()
    with pytest.raises(InvalidInputError, match=r"an integer, got 'ann'; make .*symbol_key"):
        ask(problem.prior)


def test_a_key_that_is_no_integer_is_refused():
    problem, _ = scene()
    for key in (1.5, None):
        with pytest.raises(InvalidInputError, match=f"an integer, got {key}"):
            problem.prior.covariance(key)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("prior", (1, 2), r"prior: expected Belief, got tuple; make one: Belief\(graph, values\)"),
        ("start_keys", [1], "start_keys: expected Mapping, got list; give the key of each"),
        ("objective", (), "objective: expected Objective, got tuple"),
        ("sensors", ["lidar"], "sensors: expected Mapping, got list; give each its name"),
    ],
)
def test_parts_of_a_problem_of_another_kind_are_refused(name, value, words):
    problem, _ = scene()
    with pytest.raises(InvalidInputError, match=f"planning problem {words}"):
        dataclasses.replace(problem, **{name: value})
