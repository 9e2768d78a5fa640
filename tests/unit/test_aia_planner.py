"""Algorithms 1 and 2: distributions, assignment, constraints, budgets, and bad input."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from aia_scenes import OPTIMA, lattice_problem, tiny_problem
from scipy.stats import chisquare

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.errors import InvalidInputError, OptionError
from fgplan.models.motion_primitives import MotionPrimitives, differential_drive
from fgplan.models.range_bearing import BearingSensor
from fgplan.models.uncertainty import UNCERTAINTY_FUNCTIONS, UncertaintyFunction
from fgplan.planners.aia.assignment_kernels import assign_targets
from fgplan.planners.aia.densities import Densities
from fgplan.planners.aia.growth_choice import make_growth
from fgplan.planners.aia.optimal_assignment import assign_optimally
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.problem import TerminalConstraint, TerminalGoal
from fgplan.planners.aia.sampling_kernels import draw_controls, draw_group
from fgplan.planners.aia.search import search
from fgplan.planners.aia.tree_kernels import GROUPS

SIGNIFICANCE = 1e-4


def grown(iterations=25, **changes):
    problem = kantaros_scene(2, 3, np.random.default_rng(1), delta=1e-9)
    growth = make_growth(problem, tree_options("reproduction", **changes))
    growth.plant()
    growth.run(iterations, np.random.default_rng(1))
    return growth


@pytest.mark.parametrize("uniform", [False, True])
def test_groups_are_drawn_with_the_probabilities_of_equation_8(uniform):
    tree = grown().tree
    groups = int(tree.counts[GROUPS])
    deepest = tree.deepest[: tree.counts[1 + GROUPS]]
    expected = np.full(groups, (1 - 0.8) / (groups - len(deepest)))
    expected[deepest] = 0.8 / len(deepest)
    if uniform:
        expected[:] = 1.0 / groups
    generator = np.random.default_rng(0)
    drawn = [
        draw_group(tree.counts, tree.deepest, tree.stamp, 0.8, uniform, generator)
        for _ in range(20_000)
    ]
    counts = np.bincount(drawn, minlength=groups)
    assert chisquare(counts, 20_000 * expected).pvalue > SIGNIFICANCE


@pytest.mark.parametrize("jointly", [False, True])
@pytest.mark.parametrize("near_m", [0.1, 100.0])
def test_controls_are_drawn_with_the_probabilities_of_equation_9(jointly, near_m):
    growth = grown(reject_jointly=jointly, near_m=near_m)
    tree, problem = growth.tree, growth.problem
    k = int(tree.group[growth.nodes - 1])
    node = int(tree.tail[k])
    ends, cells, found = np.empty((8, 3)), np.zeros(8, np.int64), np.empty(8, np.int64)
    generator = np.random.default_rng(0)
    counts = np.zeros((2, 8))
    expected = np.zeros((2, 8))
    after = []
    for j, robot in enumerate(problem.robots):
        pose = growth.poses.pose[tree.configuration[k, j]]
        after.append(robot.primitives.successors(pose))
        free = problem.workspace.are_motions_valid(pose[None, :2], after[j][:, :2])
        target = problem.mean.reshape(-1, 2)[tree.assigned[node, j]]
        field = growth.prepared.fields.distance_m[
            growth.prepared.fields.rows_of(target[None])[0]
        ].reshape(51, 51)
        place = np.rint(after[j][:, :2] / 0.2).astype(int)
        place = np.clip(place, 0, 50)
        distance = np.where(free, field[place[:, 1], place[:, 0]], np.inf)
        among = np.ones(8) / 8 if jointly else free / free.sum()
        best = int(np.argmin(distance))
        if np.linalg.norm(after[j][best, :2] - target) > near_m:
            expected[j] = 0.1 * among
            expected[j, best] += 0.9
        else:
            expected[j] = among
        expected[j] = np.where(free, expected[j], 0.0)
    trials = 6000
    for _ in range(trials):
        free = draw_controls(
            growth.prepared.setting,
            growth.settings,
            growth.poses,
            tree,
            k,
            False,
            False,
            0,
            ends,
            cells,
            found,
            generator,
        )
        if not free:
            continue
        for j in range(2):
            reached = growth.poses.pose[tree.drawn[j]]
            counts[j, int(np.argmin(((after[j] - reached) ** 2).sum(axis=1)))] += 1
    for j in range(2):
        share = expected[j] / expected[j].sum()
        possible = share > 0
        assert counts[j][~possible].sum() == 0
        total = counts[j].sum()
        assert chisquare(counts[j][possible], total * share[possible]).pvalue > SIGNIFICANCE


def assigned_by_algorithm_2(distance, satisfied, before, *, everybody=False):
    robots, targets = distance.shape
    out = np.array(before)
    assign_targets(
        distance.T.astype(np.float32).copy(),
        np.arange(targets),
        np.arange(robots),
        np.arange(robots),
        np.array(satisfied),
        out,
        everybody,
        np.zeros(targets, np.int64),
        np.zeros(targets, np.bool_),
    )
    return out.tolist()


def test_algorithm_2_by_hand():
    distance = np.array([[1.0, 2.0, 3.0], [1.0, 5.0, 2.0]])
    # Robot 0's target is satisfied; target 2 alone is neither assigned nor satisfied.
    assert assigned_by_algorithm_2(distance, [True, False, False], [0, 1]) == [2, 1]
    # Both share target 0, which is then assigned: both leave it, in order of index.
    assert assigned_by_algorithm_2(distance, [False, False, False], [0, 0]) == [1, 2]
    # Nothing is left to assign: all unsatisfied ones again, and again when these run out.
    assert assigned_by_algorithm_2(distance, [True, True, False], [0, 0]) == [2, 2]
    # Everything is satisfied: kept.
    assert assigned_by_algorithm_2(distance, [True, True, True], [0, 1]) == [0, 1]
    # The root: robots choose among all, in order of index.
    assert assigned_by_algorithm_2(distance, [False] * 3, [0, 0], everybody=True) == [0, 2]


def test_optimal_assignment_is_never_longer_and_serves_everybody():
    generator = np.random.default_rng(0)
    shorter = 0
    for _ in range(50):  # more targets than robots, so that one round serves everybody
        distance = generator.uniform(0.0, 5.0, (4, 9))
        satisfied = generator.random(9) < 0.2
        before = np.array([0, 0, 1, 1])
        if (~satisfied[2:]).sum() < 4:
            continue
        ours = assign_optimally(before, satisfied, distance)
        theirs = assigned_by_algorithm_2(distance, satisfied, before)
        rows = np.arange(4)
        gain = distance[rows, theirs].sum() - distance[rows, ours].sum()
        assert gain >= -1e-6
        shorter += gain > 1e-6
    assert shorter > 5
    distance = generator.uniform(0.0, 5.0, (5, 2))
    ours = assign_optimally(np.zeros(5, int), np.array([False, False]), distance, everybody=True)
    assert sorted(np.bincount(ours, minlength=2)) == [2, 3]
    kept = assign_optimally(np.array([1, 0]), np.array([True, True]), distance[:2])
    assert kept.tolist() == [1, 0]


@pytest.mark.parametrize("which", [0, 1])
def test_the_tree_reaches_the_optimum_with_branch_and_bound(which):
    """The optima are those of exhaustive search, see test_baselines."""
    for seed in range(10):
        options = tree_options(
            "reproduction",
            bound=True,
            dominance="same_time",
            until="budget",
            iterations=20_000,
            node_budget=400_000,
        )
        growth = make_growth(tiny_problem(which), options)
        growth.plant()
        generator = np.random.default_rng(seed)
        while growth.best_cost > OPTIMA[which] * (1 + 1e-9):
            assert growth.iterations < 20_000, (seed, growth.best_cost)
            assert growth.run(500, generator) == "iterations"
        assert growth.best_cost == pytest.approx(OPTIMA[which], rel=1e-9)


@pytest.mark.parametrize(
    ("function", "limit", "scope"),
    [
        ("trace", 0.08, "each"),
        ("largest_eigenvalue", 0.08, "each"),
        ("log_determinant", np.log(2e-3), "each"),
        ("entropy", 0.5 * (2 * np.log(2 * np.pi * np.e) + np.log(2e-3)), "each"),
        ("mutual_information", 1.5, "each"),
        ("determinant", 1e-6, "joint"),
        ("log_determinant", np.log(1e-6), "joint"),
        ("mutual_information", 3.0, "joint"),
        ("trace", 0.2, "joint"),
    ],
)
def test_any_function_may_be_the_terminal_constraint(function, limit, scope):
    problem = dataclasses.replace(
        tiny_problem(1), terminal=TerminalConstraint(limit=limit, function=function, scope=scope)
    )
    plans = []
    for changes in ({}, {"assignment": "optimal"}):  # compiled, and guided from Python
        options = tree_options("reproduction", iterations=3000, expand="node", **changes)
        found = search(problem, options, np.random.default_rng(0))
        assert found.plan is not None
        assert found.shortfall <= 1.0
        plans.append(found.plan)
    measure = UNCERTAINTY_FUNCTIONS[function]
    for plan in plans:
        for step in (plan.horizon - 1, plan.horizon):
            blocks, prior = plan.covariances[step], 0.2 * np.eye(2)
            if scope == "joint":
                blocks = np.block([[blocks[0], np.zeros((2, 2))], [np.zeros((2, 2)), blocks[1]]])
                prior, blocks = 0.2 * np.eye(4), blocks[None]
            values = [float(measure.evaluate(block, prior)) for block in blocks]
            more = function == "mutual_information"
            holds = all(value >= limit if more else value <= limit for value in values)
            assert holds == (step == plan.horizon)


def test_a_user_s_own_function_may_be_the_terminal_constraint(monkeypatch):
    own = UncertaintyFunction(
        name="own_spread",
        evaluate=lambda covariance, _: np.diagonal(covariance, axis1=-2, axis2=-1).max(-1),
        monotone=True,
        positive=True,
    )
    monkeypatch.setitem(UNCERTAINTY_FUNCTIONS, "own_spread", own)
    problem = dataclasses.replace(
        tiny_problem(1), terminal=TerminalConstraint(limit=0.09, function="own_spread")
    )
    options = tree_options("reproduction", iterations=3000, expand="node")
    found = search(problem, options, np.random.default_rng(0))
    assert found.plan is not None
    spread = np.diagonal(found.plan.covariances, axis1=-2, axis2=-1).max(axis=(-2, -1))
    assert spread[-1] <= 0.09 < spread[-2]


def test_terminal_goals_are_reached_after_the_targets_are_known():
    problem = tiny_problem(1)
    goal = TerminalGoal(position=np.array([0.5, 0.5]), radius_m=0.6)
    robots = (dataclasses.replace(problem.robots[0], goal=goal),)
    problem = dataclasses.replace(problem, robots=robots)
    options = tree_options("reproduction", expand="node", iterations=20_000)
    found = search(problem, options, np.random.default_rng(0))
    assert found.plan is not None
    assert np.linalg.norm(found.plan.poses[-1, 0, :2] - goal.position) <= 0.6
    assert np.linalg.det(found.plan.covariances[-1]).max() <= 2e-3


def test_own_densities_are_used_and_checked():
    calls = []

    def groups(view):
        calls.append(view.iteration)
        share = np.full(len(view.group_sizes), 0.5 / len(view.group_sizes))
        share[view.deepest] += 0.5 / len(view.deepest)
        return share

    def controls(view):
        return [np.full(8, 1 / 8) for _ in view.poses]

    options = tree_options("reproduction", iterations=30, until="budget")
    found = search(
        tiny_problem(),
        options,
        np.random.default_rng(0),
        densities=Densities(groups=groups, controls=controls, least_group=1e-6),
    )
    assert calls == list(range(30))
    assert found.nodes > 10

    def run(**own):
        search(tiny_problem(), options, np.random.default_rng(0), densities=Densities(**own))

    with pytest.raises(InvalidInputError, match=r"Assumption 3\.1"):
        run(groups=lambda view: np.eye(len(view.group_sizes))[0] if view.iteration else [1.0])
    with pytest.raises(InvalidInputError, match=r"Assumption 3\.2"):
        run(controls=lambda view: [np.eye(8)[0]])
    with pytest.raises(InvalidInputError, match="sum to 1"):
        run(controls=lambda view: [np.full(8, 0.2)])
    with pytest.raises(InvalidInputError, match="one array"):
        run(controls=lambda view: [])
    with pytest.raises(InvalidInputError, match=r"at least 0\.2"):
        run(controls=controls, least_control=0.2)


def test_circling_goes_round_a_target():
    problem = lattice_problem(
        [(1.0, 3.0)],
        [(3.0, 3.0)],
        sensor=BearingSensor(sigma_rad=0.05, max_range_m=3.0),
        primitives=differential_drive((0.0, 0.4)),
        delta=1e-12,
    )
    swept = {}
    for near in ("uniform", "circle"):
        options = tree_options(
            "reproduction",
            near_m=2.5,
            near_controls=near,
            until="budget",
            iterations=60,
            expand="node",
        )
        found = search(problem, options, np.random.default_rng(0))
        assert found.closest is not None
        offset = found.closest.poses[:, 0, :2] - (3.0, 3.0)
        swept[near] = np.ptp(np.unwrap(np.arctan2(offset[:, 1], offset[:, 0])))
    assert swept["circle"] > np.pi
    assert swept["circle"] > 2 * swept["uniform"]


def test_restarts_only_ever_improve():
    problem = kantaros_scene(3, 5, np.random.default_rng(0))
    options = tree_options("reproduction", restarts=20, expand="node")
    found = search(problem, options, np.random.default_rng(0))
    costs = [cost for _, cost in found.improvements]
    assert len(costs) > 1
    assert all(b < a for a, b in pairwise(costs))
    assert found.plan is not None
    assert found.plan.cost == costs[-1]


def test_an_interrupt_returns_the_best_plan_so_far():
    calls = []

    def stop(done, total, doing):
        calls.append(doing)
        if len(calls) == 3:
            raise KeyboardInterrupt

    options = tree_options("reproduction", until="budget", seconds=60.0, expand="node")
    problem = tiny_problem(1)
    found = search(problem, options, np.random.default_rng(0), progress=stop)
    assert found.ending == "interrupted"
    assert found.plan is not None
    assert "worst target" in calls[0]


def test_unreachable_limits_end_with_the_best_uncertainty():
    noisy = lattice_problem([(0.0, 0.0)], [(2.0, 2.0)], process=0.1, delta=1e-3)
    found = search(noisy, tree_options("pruned"), np.random.default_rng(0))
    assert found.ending == "unreachable"
    assert "process noise keeps its determinant at 0.01" in found.reason
    walled = lattice_problem(
        [(0.0, 0.0)],
        [(5.0, 5.0)],
        boxes=[(3.2, 3.2, 3.4, 6.1), (3.4, 3.2, 6.1, 3.4)],
        sensor=BearingSensor(sigma_rad=0.1, max_range_m=1.5),
    )
    options = tree_options("pruned", iterations=3000)
    found = search(walled, options, np.random.default_rng(0))
    assert found.plan is None
    assert found.ending == "iterations"
    assert found.shortfall == pytest.approx(0.04 / 2e-3)


def test_a_tree_that_is_complete_ends():
    corner = lattice_problem([(0.0, 0.0)], [(0.9, 0.9)], side=1.0, step=1.0, delta=1e-9)
    options = tree_options(
        "pruned", dominance="any_time", iterations=400_000, until="budget", node_budget=5_000
    )
    found = search(corner, options, np.random.default_rng(0))
    assert found.ending in ("stalled", "nodes")


def test_bad_problems_are_refused_by_name():
    with pytest.raises(InvalidInputError, match="inside an obstacle: no robot could see it"):
        lattice_problem([(0.0, 0.0)], [(3.0, 3.0)], boxes=[(2.5, 2.5, 3.5, 3.5)])
    with pytest.raises(InvalidInputError, match="robot 'r0': expected a start in free space"):
        lattice_problem([(3.0, 3.0)], [(0.5, 0.5)], boxes=[(2.5, 2.5, 3.5, 3.5)])
    with pytest.raises(InvalidInputError, match="positive semidefinite"):
        lattice_problem([(0.0, 0.0)], [(1.0, 1.0)], process=-1.0)
    with pytest.raises(InvalidInputError, match="positive variances"):
        lattice_problem([(0.0, 0.0)], [(1.0, 1.0)], prior=-1.0)
    with pytest.raises(InvalidInputError, match="empty set"):
        MotionPrimitives(relative=np.zeros((0, 3)))
    with pytest.raises(InvalidInputError, match="above zero"):
        lattice_problem([(0.0, 0.0)], [(1.0, 1.0)], delta=-1.0)
    good = tiny_problem()
    with pytest.raises(InvalidInputError, match=r"Remark 2\.1"):
        dataclasses.replace(good, objective="entropy")
    with pytest.raises(InvalidInputError, match="one limit or 2"):
        dataclasses.replace(good, terminal=TerminalConstraint(limit=[1.0, 1.0, 1.0]))
    with pytest.raises(InvalidInputError, match="one prior a block"):
        dataclasses.replace(good, priors=good.priors[:1])
    robot = dataclasses.replace(good.robots[0], sensors=())
    with pytest.raises(InvalidInputError, match="expected a sensor"):
        dataclasses.replace(good, robots=(robot,))
    goal = TerminalGoal(position=np.array([3.0, 3.0]), radius_m=1.0)
    robot = dataclasses.replace(good.robots[0], goal=goal)
    with pytest.raises(InvalidInputError, match="terminal goal in free space"):
        dataclasses.replace(good, robots=(robot,))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"p_group": 0.4}, "between 0.5 and 1"),
        ({"p_control": 1.0}, r"Assumption 3\.2"),
        ({"dominance": "always"}, "expected one of off, same_time, any_time"),
        ({"node_budget": 0}, "at least 1"),
        ({"near_m": -1.0}, "near_m"),
        ({"until": "budget"}, "needs iterations or seconds"),
        ({"colour": "red"}, "expected one of p_group"),
    ],
)
def test_bad_options_are_refused_by_name(changes, message):
    with pytest.raises(OptionError, match=message):
        tree_options("paper", **changes)


def test_unknown_presets_are_refused():
    with pytest.raises(OptionError, match="paper, reproduction, pruned"):
        tree_options("fast")
