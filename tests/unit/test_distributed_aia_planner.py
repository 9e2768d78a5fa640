"""Planner distributed_aia: densities, assignment, extraction, graphs, plans and bad input."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from aia_scenes import lattice_problem
from scipy.stats import chisquare

from fgplan.errors import InvalidInputError, NoCandidatePathError, OptionError, UnknownNameError
from fgplan.io.mission_file import load_mission
from fgplan.planners.aia.problem import TerminalConstraint
from fgplan.planners.aia.tree import way_to
from fgplan.planners.distributed_aia.assignment_kernels import assign_robot
from fgplan.planners.distributed_aia.candidate_kernels import draw_candidate, draw_child
from fgplan.planners.distributed_aia.extraction import claim_order, extract, team_parts
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.information import (
    determinant_limit,
    information_gathered,
    unmeasured_covariances,
)
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.planners.distributed_aia.search import search_distributed
from fgplan.planners.distributed_aia.stream import BLOCK, Stream
from fgplan.planners.registry import find_planner
from fgplan.riccati.distributed import team_step_blocks
from fgplan.team.communication_graph import CommunicationGraph

SCENARIO = "examples/scenarios/distributed_gathering.toml"


def small_problem(robots=3, **changes):
    """Robots in a room of 6 m with four targets."""
    starts = [(1.0, 1.0), (5.0, 1.0), (5.0, 5.0), (1.0, 5.0), (3.0, 1.0)][:robots]
    targets = [(2.6, 1.3), (4.4, 4.7), (1.4, 4.3), (4.7, 2.4)]
    return lattice_problem(starts, targets, boxes=[(2.2, 2.2, 3.8, 3.8)], **changes)


def graph_of(problem, kind="complete"):
    """A communication graph of the problem's team."""
    names = [robot.name for robot in problem.robots]
    if kind == "line":
        return CommunicationGraph.of_edges(names, list(pairwise(names)))
    return getattr(CommunicationGraph, kind)(names)


def plan_for(problem, graph, seed=0, **changes):
    """A search that is short."""
    options = distributed_options(**{"iterations": 3000} | changes)
    return search_distributed(problem, options, graph, np.random.default_rng(seed))


def stream_of(seed, count=100_000):
    """A robot's numbers."""
    numbers = np.random.default_rng(seed).random(count)
    return Stream(numbers, np.zeros(1, dtype=np.int64))


def family(children):
    """Links of a root with so many children, greatest number first."""
    first_child = np.full(children + 1, -1, dtype=np.int32)
    next_sibling = np.full(children + 1, -1, dtype=np.int32)
    first_child[0] = children
    next_sibling[2 : children + 1] = np.arange(1, children)
    return first_child, next_sibling


def naive_replay(problem, graph, poses, kappa):
    """Every robot's covariances along a path, from the sensors' own rows and ``riccati``."""
    steps, robots = poses.shape[:2]
    out = np.empty((steps, robots, problem.targets, 2, 2))
    out[0] = np.array(problem.priors)
    places = np.broadcast_to(problem.places_until(steps), (steps + 1, problem.targets, 2))
    for t in range(steps - 1):
        information = np.zeros((robots, problem.targets, 2, 2))
        for i, robot in enumerate(problem.robots):
            for sensor in robot.sensors:
                for k in range(problem.targets):
                    if sensor.visible(poses[t, i], places[t, k], problem.workspace):
                        rows = sensor.linearise(poses[t, i], places[t, k])[1]
                        information[i, k] += rows.T @ rows
        dynamics = [block.at(t) for block in problem.hidden.blocks]
        transitions, processes = (np.array([d[place] for d in dynamics]) for place in (0, 2))
        links = graph.links(t, poses[t, :, :2])
        out[t + 1] = team_step_blocks(out[t], links, information, transitions, processes, kappa)
    return out


@pytest.mark.parametrize("kind", ["complete", "line", "range", "schedule", "none"])
def test_a_returned_plan_is_what_a_naive_replay_says(kind):
    problem = small_problem(drifts=[(0.0, 0.01)] * 4, process=1e-5)
    names = [robot.name for robot in problem.robots]
    if kind == "range":
        graph = CommunicationGraph.within_range(names, 4.5)
    elif kind == "schedule":
        graph = CommunicationGraph.on_schedule(
            [graph_of(problem, "line"), graph_of(problem, "none")], 2
        )
    else:
        graph = graph_of(problem, kind)
    found = plan_for(problem, graph)
    plan = found.plan
    assert plan is not None
    replayed = naive_replay(problem, graph, plan.poses, 0.9)
    np.testing.assert_allclose(plan.covariances, replayed, rtol=1e-8, atol=1e-12)
    determinants = np.linalg.det(replayed)
    met = (determinants <= 2e-3).all(axis=-1)
    assert (met[plan.horizons, np.arange(3)] == plan.satisfied).all()
    cost = 0.0
    for part in team_parts(graph):
        horizon = plan.horizons[part[0]]
        assert met[horizon, list(part)].any()
        assert not met[:horizon, list(part)].any()
        cost += determinants[: horizon + 1, list(part)].sum()
    assert plan.cost == pytest.approx(cost, rel=1e-9)
    for j, robot in enumerate(problem.robots):
        for before, after in zip(plan.poses[:-1, j], plan.poses[1:, j], strict=True):
            ends = robot.primitives.successors(before)
            moved = np.abs(ends[:, :2] - after[:2]).max(axis=1).min() < 1e-9
            assert moved or np.array_equal(before, after)
            assert problem.workspace.are_positions_valid(after[None, :2])[0]


def test_the_constraint_at_all_robots_holds_at_all():
    problem = small_problem()
    one = plan_for(problem, graph_of(problem, "line"), constraint_at="one").plan
    every = plan_for(problem, graph_of(problem, "line"), constraint_at="all").plan
    assert one is not None
    assert every is not None
    assert every.satisfied.all()
    assert every.horizon >= one.horizon
    assert not one.satisfied.all()


def test_the_same_seed_gives_the_same_plan_and_another_one_another():
    problem = small_problem()
    graph = graph_of(problem)
    first, again, other = (plan_for(problem, graph, seed).plan for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.poses, again.poses)
    assert first.cost == again.cost
    assert first.poses.shape != other.poses.shape or not np.array_equal(first.poses, other.poses)


def test_a_budget_gives_a_plan_at_most_as_expensive_as_the_first():
    problem = small_problem()
    first = plan_for(problem, graph_of(problem), uniform_after="never")
    best = plan_for(
        problem, graph_of(problem), until="budget", iterations=600, uniform_after="never"
    )
    assert best.plan.cost <= first.plan.cost
    assert best.candidates > first.candidates


def test_the_candidate_is_drawn_by_mass_function_10():
    first_child, next_sibling = family(4)
    uncertainty = np.array([0.0, -3.0, -5.0, -1.0, -5.0])
    stream = stream_of(0)
    drawn = [
        draw_child(first_child, next_sibling, uncertainty, 0, 5, 0.7, stream) for _ in range(20_000)
    ]
    counts = np.bincount(drawn, minlength=5)
    assert counts[0] == 0
    expected = 20_000 * np.array([0.1, 0.7, 0.1, 0.1])  # of equal ones the first made is best
    assert chisquare(counts[1:], expected).pvalue > 1e-3


def test_only_known_children_of_the_node_used_before_are_admissible():
    first_child, next_sibling = family(3)
    uncertainty, depth = np.zeros(4), np.array([0, 1, 1, 1], dtype=np.int32)
    links = (first_child, next_sibling, depth, uncertainty)
    stream = stream_of(1)
    drawn = {draw_candidate(*links, 0, 1, 3, 0.9, stream) for _ in range(200)}
    assert drawn == {1, 2}  # node 3 is not known yet
    before = int(stream.place[0])
    assert draw_candidate(*links, 0, 1, 2, 0.9, stream) == 1  # a single one is no draw
    assert draw_candidate(*links, -1, 0, 4, 0.9, stream) == 0  # the root at the start
    assert draw_candidate(*links, 2, 2, 4, 0.9, stream) == 2  # none: the node stays, and lags
    assert draw_candidate(*links, -1, 0, 0, 0.9, stream) == -1  # nothing has arrived
    assert stream.place[0] == before


def test_a_node_that_lags_is_followed_until_it_is_of_the_time():
    parent = [-1, 0, 1, 2, 3]
    first_child = np.array([1, 2, 3, 4, -1], dtype=np.int32)
    next_sibling = np.full(5, -1, dtype=np.int32)
    depth = np.arange(5, dtype=np.int32)
    links = (first_child, next_sibling, depth, np.zeros(5))
    assert draw_candidate(*links, 1, 3, 5, 0.9, stream_of(0)) == 3
    assert draw_candidate(*links, 1, 9, 5, 0.9, stream_of(0)) == 4
    assert way_to(np.array(parent), 4) == [0, 1, 2, 3, 4]


def test_algorithm_2_takes_the_nearest_target_that_no_neighbour_goes_for():
    distance = np.array([[3.0], [1.0], [2.0]], dtype=np.float32)
    fields = np.arange(3)

    def chosen(satisfied, inherited, taken):
        return assign_robot(distance, fields, 0, np.array(satisfied), inherited, np.array(taken))

    nobody = [False, False, False]
    assert chosen(nobody, -1, nobody) == 1  # the root takes the nearest
    assert chosen(nobody, 0, [False, True, True]) == 0  # not satisfied: kept
    assert chosen([True, False, False], 0, [False, True, False]) == 2  # 1 is a neighbour's
    assert chosen([True, False, False], 0, [False, True, True]) == 1  # all taken: the nearest
    assert chosen([True, True, True], 0, nobody) == 0  # all satisfied: kept


def test_claims_go_by_the_fewest_hops_then_the_earlier_robot():
    graph = CommunicationGraph.of_edges(
        "abcdef", [("a", "c"), ("a", "b"), ("b", "d"), ("c", "d"), ("d", "e")]
    )
    assert claim_order(graph, 0) == [(0, 0), (1, 0), (2, 0), (3, 1), (4, 3)]
    assert team_parts(graph) == ((0, 1, 2, 3, 4), (5,))


def test_extraction_follows_the_nodes_that_were_fused():
    problem = small_problem(5)
    graph = graph_of(problem, "line")
    options = distributed_options(until="budget", iterations=400, uniform_after="never")
    growth = ForestGrowth(problem, options, graph, np.random.default_rng(3).spawn(5))
    growth.run(400)
    goal = growth.goal_nodes(2)[0]
    ways = extract(growth, 2, goal)
    forest = growth.forest
    steps = int(forest.trees.depth[2, goal])
    fused = int(forest.source[2, goal, 1])  # of robot 3, the second neighbour of robot 2
    nodes = way_to(forest.trees.parent[3], fused)
    np.testing.assert_array_equal(ways[3].poses[: len(nodes)], growth.poses_to(3, nodes))
    beyond = int(forest.source[3, fused, 1])  # of robot 4 when robot 3's node was made
    nodes = way_to(forest.trees.parent[4], beyond)
    np.testing.assert_array_equal(ways[4].poses[: len(nodes)], growth.poses_to(4, nodes))
    assert [len(way.poses) for way in ways.values()] == [steps + 1] * 5
    assert int(forest.trees.depth[4, beyond]) <= steps - 2


def test_a_robot_alone_plans_for_itself_and_the_last_one_sets_the_horizon():
    problem = small_problem()
    plan = plan_for(problem, graph_of(problem, "none")).plan
    assert plan.satisfied.all()
    assert plan.horizon == plan.horizons.max()
    assert len(plan.origins) == 3
    done = int(np.argmin(plan.horizons))
    rest = plan.poses[plan.horizons[done] :, done]
    np.testing.assert_array_equal(rest, np.broadcast_to(rest[0], rest.shape))


def test_more_communication_is_no_worse_over_trials():
    horizons = {
        kind: np.mean(
            [
                plan_for(small_problem(5), graph_of(small_problem(5), kind), seed).plan.horizon
                for seed in range(12)
            ]
        )
        for kind in ("complete", "none")
    }
    assert horizons["complete"] < 0.7 * horizons["none"]


def test_mutual_information_of_targets_that_stay_is_a_limit_of_determinants():
    problem = small_problem()
    nats = 0.5 * np.log(0.04 / 2e-3)
    assert determinant_limit(0.04, nats) == pytest.approx(2e-3, rel=1e-12)
    told = TerminalConstraint(limit=nats, function="mutual_information")
    same = dataclasses.replace(problem, terminal=told)
    graph = graph_of(problem)
    first, second = plan_for(problem, graph).plan, plan_for(same, graph).plan
    np.testing.assert_array_equal(first.poses, second.poses)
    gathered = information_gathered(problem, first.covariances)
    assert (np.diff(gathered, axis=0) > -1e-9).all()
    each = 0.5 * np.log(0.04 / np.linalg.det(first.covariances[-1, first.first_origin]))
    assert gathered[-1, first.first_origin] == pytest.approx(each.sum(), rel=1e-9)
    assert each.min() >= nats - 1e-9


def test_information_is_measured_against_what_would_be_known_without_measuring():
    problem = small_problem(drifts=[(0.0, 0.0)] * 4, process=1e-3)
    unmeasured = unmeasured_covariances(problem, 5)
    np.testing.assert_allclose(unmeasured[5], (0.2 + 5e-3) * np.eye(2)[None].repeat(4, 0))
    nothing = np.repeat(unmeasured[:, None], 3, axis=1)
    np.testing.assert_allclose(information_gathered(problem, nothing), 0.0, atol=1e-12)


def test_a_node_budget_ends_the_search_and_says_so():
    problem = small_problem(delta=1e-9)
    found = plan_for(problem, graph_of(problem), node_budget=50)
    assert found.plan is None
    assert found.ending == "nodes"
    assert found.counts["nodes"] <= 150


def test_the_planner_runs_a_scenario_and_gives_what_it_promises():
    mission = load_mission(SCENARIO)
    plan = find_planner("distributed_aia").plan(mission, np.random.default_rng(mission.seed))
    assert plan.agreed
    assert plan.details["horizon"] == max(plan.details["horizons"])
    limits = np.array(plan.details["worst_determinant"])[-1]
    assert (limits[np.array(plan.details["satisfied"])] <= 1.8e-6).all()
    assert len(plan.details["links"][0]) == 6
    assert plan.details["accumulated_mutual_information"] > 0.0
    assert not plan.traffic


def test_messages_in_a_scenario_give_the_same_plan_and_are_counted():
    mission = load_mission(SCENARIO)
    planner = find_planner("distributed_aia")
    plans = [
        planner.plan(
            dataclasses.replace(mission, options=dict(mission.options) | changes),
            np.random.default_rng(0),
        )
        for changes in ({}, {"messages": True})
    ]
    assert plans[0].details["controls"] == plans[1].details["controls"]
    assert plans[0].value == plans[1].value
    assert plans[1].traffic["nodes"]["sent"] > 0


@pytest.mark.parametrize(
    ("changes", "error", "says"),
    [
        ({"kappa": 0.2}, OptionError, "kappa"),
        ({"p_candidate": 1.0}, OptionError, "Assumption 4"),
        ({"empty_set": "ask"}, OptionError, "empty_set"),
        ({"constraint_at": "most"}, OptionError, "constraint_at"),
        ({"goals_kept": 0}, OptionError, "goals_kept"),
        ({"goals_kept": 1.5}, OptionError, "goals_kept"),
        ({"kappa": "0.9"}, OptionError, "option kappa: expected a finite number"),
        ({"p_candidate": [1]}, OptionError, "option p_candidate: expected a finite number"),
        ({"p_control": "a"}, OptionError, "option p_control: expected a finite number"),
        ({"uniform_after": 10**20}, OptionError, "uniform_after: expected at most"),
        ({"preset": ["paper"]}, OptionError, "preset"),
        ({"of_robot": 3}, OptionError, "of_robot: expected a table by robot"),
        ({"of_robot": {"ann": {"kappa": 0.9}}}, OptionError, "of_robot: ann: expected a table"),
        ({"of_robot": {"ann": {"p_group": 0.1}}}, OptionError, "of_robot: ann: .* p_group"),
        ({"of_robot": {"zed": {"p_group": 0.6}}}, InvalidInputError, "of_robot: expected some of"),
        ({"bound": True}, OptionError, "'bound'"),
        ({"preset": "pruned"}, OptionError, "preset"),
        ({"messages": "yes"}, OptionError, "messages"),
        ({"wait_s": -1.0}, OptionError, "wait_s"),
        ({"graph": {"kind": "ring"}}, OptionError, "kind"),
        (
            {"graph": {"kind": "schedule", "graphs": [{"kind": "none"}], "period": 10**20}},
            OptionError,
            "period: expected at most",
        ),
        ({"graph": {"kind": "random", "average_degree": 0.4}}, OptionError, "average_degree"),
        ({"messages": True, "seconds": 1.0}, InvalidInputError, "seconds"),
        ({"terminal_goals": True}, InvalidInputError, "terminal goals"),
        ({"delta": 1e-30, "iterations": 50}, NoCandidatePathError, "best uncertainty"),
    ],
)
def test_bad_options_are_refused_by_name(changes, error, says):
    mission = load_mission(SCENARIO)
    options = dict(mission.options) | changes
    with pytest.raises(error, match=says):
        find_planner("distributed_aia").plan(
            dataclasses.replace(mission, options=options), np.random.default_rng(0)
        )


def test_mass_functions_may_differ_by_robot():
    problem = small_problem()
    graph = graph_of(problem, "none")

    def grown(**changes):
        options = distributed_options(until="budget", iterations=300, **changes)
        growth = ForestGrowth(problem, options, graph, np.random.default_rng(0).spawn(3))
        growth.run(300)
        return [growth.forest.trees.parent[row, : growth.nodes(row)].tolist() for row in range(3)]

    same = grown(p_group=0.6)
    alike = grown(of_robot={name: {"p_group": 0.6} for name in ("r0", "r1", "r2")})
    assert same == alike
    base, one = grown(), grown(of_robot={"r1": {"p_group": 0.6}})
    assert (one[0], one[1], one[2]) == (base[0], same[1], base[2])
    drawn = grown(of_robot={"r2": {"p_control": 0.1}})
    assert drawn[:2] == base[:2]
    assert drawn[2] == grown(p_control=0.1)[2] != base[2]


def test_the_candidates_mass_function_is_the_robot_s_own():
    problem = small_problem()
    graph = graph_of(problem)

    def sources(**changes):
        options = distributed_options(until="budget", iterations=60, **changes)
        growth = ForestGrowth(problem, options, graph, np.random.default_rng(0).spawn(3))
        growth.run(60)
        return growth.forest.source[:, :60].tolist()

    alike = sources(of_robot={name: {"p_candidate": 0.2} for name in ("r0", "r1", "r2")})
    assert alike == sources(p_candidate=0.2)
    assert alike != sources(of_robot={"r0": {"p_candidate": 0.2}}) != sources()


def test_a_robot_that_rests_makes_nobody_draw_ever_more_numbers():
    problem = small_problem()
    options = distributed_options(until="budget", iterations=10**6)
    graph = graph_of(problem, "none")
    growth = ForestGrowth(problem, options, graph, np.random.default_rng(0).spawn(3))
    growth.rest([0])
    growth.run(20_000)
    assert growth._numbers.shape[1] == BLOCK


def test_problems_that_the_trees_do_not_know_are_refused():
    problem = small_problem()
    other = CommunicationGraph.complete(["x", "y", "z"])
    with pytest.raises(InvalidInputError, match="expected the team r0, r1, r2"):
        plan_for(problem, other)
    moving = small_problem(
        drifts=[(0.0, 0.0)] * 4, process=1e-4, function="mutual_information", delta=1.0
    )
    with pytest.raises(InvalidInputError, match="determinant_limit"):
        plan_for(moving, graph_of(moving))
    entropy = dataclasses.replace(problem, objective="trace")
    assert plan_for(entropy, graph_of(entropy)).plan is not None
    with pytest.raises(UnknownNameError, match="number 7"):
        graph_of(problem).ever(7)
