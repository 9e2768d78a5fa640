"""Executed plans of distributed robots: covariances, consistency of means, the stopping rule."""

import dataclasses

import numpy as np
import pytest
from aia_scenes import lattice_problem

from fgplan.errors import InvalidInputError
from fgplan.models.pose import between
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.models.range_bearing import RangeSensor
from fgplan.planners.aia.problem import TerminalConstraint
from fgplan.planners.aia.target_world import target_world
from fgplan.planners.distributed_aia.execution import execute
from fgplan.planners.distributed_aia.extraction import replay
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.planners.distributed_aia.search import search_distributed
from fgplan.planners.distributed_aia.stopping_rule import (
    cut_by_rule,
    first_steps,
    knows_done,
    links_along,
    rule_steps,
    satisfied_targets,
    stopping_steps,
)
from fgplan.riccati.distributed_mean import team_step_means_blocks
from fgplan.riccati.gaussian import predict, update
from fgplan.simulation.simulate import advance, start
from fgplan.team.communication_graph import CommunicationGraph

NAMES = ("r0", "r1", "r2")
CHAIN = CommunicationGraph.of_edges(NAMES, [("r0", "r1"), ("r1", "r2")])
GRAPHS = {
    "chain": CHAIN,
    "complete": CommunicationGraph.complete(NAMES),
    "none": CommunicationGraph.none(NAMES),
    "schedule": CommunicationGraph.on_schedule([CHAIN, CommunicationGraph.none(NAMES)], period=2),
    "range": CommunicationGraph.within_range(NAMES, 2.5),
}


def linear_problem(sensor=None, **rest):
    """Three robots, three drifting targets, sensors whose covariances depend on nothing."""
    return lattice_problem(
        [(0.5, 0.5), (2.5, 0.5), (5.5, 5.0)],
        [(2.0, 2.0), (1.0, 3.0), (4.0, 3.5)],
        sensor=sensor or PositionSensor(sigma_m=0.3),
        drifts=np.array([[0.02, 0.0], [0.0, 0.0], [-0.01, 0.02]]),
        process=1e-3,
        **rest,
    )


def walk(problem, steps):
    """All robots go right and come back."""
    poses = np.array([[robot.pose for robot in problem.robots]] * (steps + 1))
    poses[:, :2, 0] += 0.5 * (np.arange(steps + 1) % 4)[:, None]
    return poses


def grown(problem, graph):
    generators = np.random.default_rng(0).spawn(len(problem.robots))
    return ForestGrowth(problem, distributed_options(), graph, generators)


@pytest.mark.parametrize("name", GRAPHS)
def test_linear_sensors_execute_the_planned_covariances(name):
    problem, graph = linear_problem(), GRAPHS[name]
    poses = walk(problem, 7)
    run = execute(problem, poses, graph, np.random.default_rng(1))
    rows, _, _ = replay(grown(problem, graph), poses)
    planned = rows.reshape(8, 3, 3, 3)[..., [0, 1, 1, 2]].reshape(run.covariances.shape)
    np.testing.assert_allclose(run.covariances, planned, rtol=1e-10, atol=1e-16)
    np.testing.assert_allclose(run.poses, poses, atol=1e-12)
    assert (run.measurements == 3).all()


def test_means_are_those_of_the_filter_in_one_piece():
    problem, graph = linear_problem(), GRAPHS["schedule"]
    poses = walk(problem, 5)
    run = execute(problem, poses, graph, np.random.default_rng(2))
    generator = np.random.default_rng(2)
    world = target_world(problem, generator)
    step = start(world, generator)
    blocks = [block.at(0) for block in problem.hidden.blocks]
    A, d, Q = (np.array(each) for each in zip(*blocks, strict=True))  # noqa: N806
    means, spreads = run.means[0], run.covariances[0]
    for t in range(5):
        rows = np.broadcast_to(np.eye(2) / 0.3, (3, 3, 2, 2))
        values = np.array([one.value for one in step.measurements]).reshape(3, 3, 2) / 0.3
        means, spreads = team_step_means_blocks(
            means, spreads, graph.links(t), rows, values, A, d, Q
        )
        np.testing.assert_allclose(run.means[t + 1], means, rtol=1e-10)
        np.testing.assert_allclose(run.covariances[t + 1], spreads, rtol=1e-10, atol=1e-16)
        commands = {name: between(poses[t, j], poses[t + 1, j]) for j, name in enumerate(NAMES)}
        _, step = advance(world, step.state, commands)
        np.testing.assert_array_equal(run.truth[t + 1], step.hidden_state.reshape(3, 2))


def test_one_robot_has_the_plain_filter():
    problem = lattice_problem(
        [(0.5, 0.5)], [(2.0, 2.0)], sensor=PositionSensor(sigma_m=0.2), process=1e-3
    )
    poses = np.array([[[0.5 + 0.5 * t, 0.5, 0.0]] for t in range(5)])
    run = execute(problem, poses, CommunicationGraph.none(["r0"]), np.random.default_rng(3))
    generator = np.random.default_rng(3)
    world = target_world(problem, generator)
    step = start(world, generator)
    mean, spread = problem.mean, problem.priors[0]
    for t in range(4):
        (reading,) = step.measurements
        mean, spread = update(mean, spread, np.eye(2), reading.covariance, reading.value - mean)
        mean, spread = predict(mean, spread, *problem.hidden.blocks[0].at(t))
        np.testing.assert_allclose(run.means[t + 1, 0, 0], mean, rtol=1e-11)
        np.testing.assert_allclose(run.covariances[t + 1, 0, 0], spread, rtol=1e-10, atol=1e-16)
        _, step = advance(world, step.state, {"r0": between(poses[t, 0], poses[t + 1, 0])})
    np.testing.assert_array_equal(run.disagreement_m, np.zeros((5, 1)))


def test_what_nobody_sees_is_predicted_and_agreed_on():
    problem = linear_problem(PositionSensor(sigma_m=0.3, max_range_m=0.1))
    run = execute(problem, walk(problem, 4), GRAPHS["complete"], np.random.default_rng(0))
    expected = problem.hidden.predicted_means(problem.mean, 4).reshape(5, 1, 3, 2)
    np.testing.assert_allclose(run.means, np.tile(expected, (1, 3, 1, 1)), rtol=1e-12)
    grows = (0.2 + 1e-3 * np.arange(5))[:, None, None, None, None] * np.eye(2)
    np.testing.assert_allclose(run.covariances, np.broadcast_to(grows, (5, 3, 3, 2, 2)), rtol=1e-12)
    assert run.disagreement_m.max() < 1e-12
    assert run.measurements.sum() == 0


def test_who_sees_nothing_learns_from_neighbours():
    problem = linear_problem(PositionSensor(sigma_m=0.01, max_range_m=2.7), prior=1e-3)
    poses = walk(problem, 0).repeat(7, axis=0)
    alone = execute(problem, poses, GRAPHS["none"], np.random.default_rng(4))
    chain = execute(problem, poses, CHAIN, np.random.default_rng(4))
    # Of target t1 robot r2 is told by r1, which sees no more of it than r2 and is told by r0.
    np.testing.assert_array_equal(alone.covariances[:, 1:, 1], alone.covariances[:, [1, 1], 1])
    known = np.linalg.det(chain.covariances[:, :, 1])
    assert known[1, 2] == pytest.approx(np.linalg.det(alone.covariances[1, 2, 1]), rel=1e-9)
    assert known[-1, 2] < 0.3 * np.linalg.det(alone.covariances[-1, 2, 1])
    assert known[-1, 0] < known[-1, 1] < known[-1, 2]
    assert chain.disagreement_m[-1, 1] < alone.disagreement_m[-1, 1]
    assert chain.errors_m[-1, 2, 1] < alone.errors_m[-1, 2, 1]


@pytest.mark.parametrize("name", ["none", "chain", "complete"])
def test_linear_filters_are_consistent(name):
    problem = linear_problem()
    poses = walk(problem, 6)
    runs = [
        execute(problem, poses, GRAPHS[name], np.random.default_rng(seed)) for seed in range(25)
    ]
    mean = np.mean([run.normalised_squared[-1] for run in runs])
    # 25 runs of 3 targets are independent, the robots of a team are not, for they share the truth:
    # chi-square of two degrees of freedom, mean 2, deviation 2 / sqrt(75).
    bound = 4 * 2 / np.sqrt(75)
    if name == "none":
        assert abs(mean - 2.0) < bound
    else:
        # Pooled beliefs share measurements; they are never bolder than they may be.
        assert 0.2 < mean < 2.0


def test_range_filters_are_within_a_bound():
    problem = linear_problem(RangeSensor(sigma_m=0.1, max_range_m=10.0), prior=0.05)
    poses = walk(problem, 8)
    for name in ("none", "complete"):
        means = [
            execute(problem, poses, GRAPHS[name], np.random.default_rng(seed))
            .normalised_squared[-1]
            .mean()
            for seed in range(12)
        ]
        # Linearised: 2 and four deviations of 36 independent targets.
        assert np.mean(means) < 2.0 + 4 * 2 / np.sqrt(36)


def test_the_weight_of_the_bend_makes_range_filters_more_careful():
    poses = walk(linear_problem(), 6)
    dets, squares = {}, {}
    for name, sensor in (
        ("linear", PositionSensor(sigma_m=0.3)),
        ("range", ProportionalRangeSensor(max_range_m=2.0)),
    ):
        problem = linear_problem(sensor)
        for weight in (1.0, 16.0):
            runs = [
                execute(
                    problem,
                    poses,
                    GRAPHS["complete"],
                    np.random.default_rng(seed),
                    bend_weight=weight,
                )
                for seed in range(8)
            ]
            dets[name, weight] = np.mean([np.linalg.det(run.covariances[-1]) for run in runs])
            squares[name, weight] = np.mean([run.normalised_squared[-1] for run in runs])
    assert dets["linear", 16.0] == dets["linear", 1.0]
    assert dets["range", 16.0] > dets["range", 1.0]
    # Linearised: 2 and four deviations of 24 independent targets.
    assert max(squares.values()) < 2.0 + 4 * 2 / np.sqrt(24)


def test_the_rule_by_hand():
    satisfied = np.array(
        [
            [[False, True], [False, False], [False, False]],
            [[False, True], [True, False], [False, False]],
            [[False, True], [True, False], [False, True]],
        ]
    )
    links = np.array([GRAPHS["complete"].links()] * 3)
    chain = np.array([CHAIN.links()] * 3)
    alone = np.zeros((3, 3, 3), dtype=bool)
    assert knows_done(satisfied, links).tolist() == [[False] * 3, [True] * 3, [True] * 3]
    knows = knows_done(satisfied, chain)
    assert knows.tolist() == [[False] * 3, [True, True, False], [True, True, True]]
    assert first_steps(knows).tolist() == [1, 1, 2]
    assert stopping_steps(knows, CHAIN).tolist() == [1, 1, 1]
    assert first_steps(knows_done(satisfied, alone)).tolist() == [-1, -1, -1]
    pair = CommunicationGraph.of_edges(NAMES, [("r1", "r2")])
    knows = knows_done(satisfied, np.array([pair.links()] * 3))
    assert first_steps(knows).tolist() == [-1, 2, 2]
    assert stopping_steps(knows, pair).tolist() == [-1, 2, 2]


def test_satisfied_targets_read_the_constraint():
    problem = linear_problem(delta=4e-2)
    spreads = np.array([0.19, 0.1999, 0.21])[:, None, None] * np.eye(2)
    assert satisfied_targets(problem, spreads).tolist() == [True, True, False]
    half = TerminalConstraint(limit=0.5 * np.log(4.0), function="mutual_information")
    problem = dataclasses.replace(problem, terminal=half)
    spreads = np.array([0.0999, 0.09, 0.1001])[:, None, None] * np.eye(2)
    # Half the variance in two coordinates: log 2 nats.
    assert satisfied_targets(problem, spreads).tolist() == [True, True, False]
    joint = TerminalConstraint(limit=1e-6, scope="joint")
    with pytest.raises(InvalidInputError, match="joint covariance"):
        satisfied_targets(dataclasses.replace(problem, terminal=joint), spreads)


def test_links_of_a_path_depend_on_where_the_robots_are():
    poses = walk(linear_problem(), 3)
    links = links_along(GRAPHS["range"], poses)
    assert links.shape == (4, 3, 3)
    assert links[:, 0, 1].all()
    assert not links[:, 0, 2].any()


@pytest.mark.parametrize("name", ["complete", "chain", "none"])
def test_a_plan_is_cut_where_a_robot_knows(name):
    problem = lattice_problem(
        [(0.5, 0.5), (5.5, 0.5), (5.5, 5.5)], [(1.5, 4.5), (4.5, 1.5), (3.0, 3.0)], step=0.5
    )
    graph = GRAPHS[name]
    plan = search_distributed(
        problem, distributed_options(constraint_at="all"), graph, np.random.default_rng(0)
    ).plan
    assert plan is not None
    steps = rule_steps(problem, graph, plan)
    cut = cut_by_rule(grown(problem, graph), plan)
    assert cut.horizons.tolist() == steps.tolist()
    assert (steps <= plan.horizons).all()
    assert cut.cost <= plan.cost * (1 + 1e-12)
    knows = knows_done(satisfied_targets(problem, cut.covariances), links_along(graph, cut.poses))
    if name == "none":
        # Alone, the rule is the constraint.
        np.testing.assert_array_equal(cut.poses, plan.poses)
        assert cut.cost == pytest.approx(plan.cost, rel=1e-12)
        assert first_steps(knows).tolist() == plan.horizons.tolist()
    else:
        assert knows[-1].any()
        assert not knows[:-1].any()
        assert cut.horizon < plan.horizon


def test_execution_stops_by_the_rule_and_goes_on_beyond_the_path():
    problem = linear_problem(delta=2e-4)
    poses = walk(problem, 12)
    full = execute(problem, poses, CHAIN, np.random.default_rng(5))
    done = int(full.done_at[full.done_at >= 0].min())
    assert 1 < done < 12
    stopped = execute(problem, poses, CHAIN, np.random.default_rng(5), stop=True)
    assert stopped.steps == done
    np.testing.assert_array_equal(stopped.means, full.means[: done + 1])
    longer = execute(problem, poses, CHAIN, np.random.default_rng(5), steps=14)
    assert longer.steps == 14
    np.testing.assert_allclose(longer.poses[12:], np.broadcast_to(poses[12], (3, 3, 3)), atol=1e-12)
    np.testing.assert_array_equal(longer.means[:13], full.means)


def test_what_cannot_be_executed_is_refused():
    problem = linear_problem()
    poses = walk(problem, 2)
    other = CommunicationGraph.complete(["r0", "r1"])
    with pytest.raises(InvalidInputError, match="expected the team r0, r1, r2"):
        execute(problem, poses, other, np.random.default_rng(0))
    with pytest.raises(InvalidInputError, match="from the robots' poses"):
        execute(problem, poses[:, :2], CHAIN, np.random.default_rng(0))
    with pytest.raises(InvalidInputError, match="from the robots' poses"):
        execute(problem, poses + 0.1, CHAIN, np.random.default_rng(0))
