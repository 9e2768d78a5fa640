"""The tree grown without the compiler is the compiled one, node for node, and its parts too.

Covariances to 1e-12 relative: the formulas and their order are the same, so that they differ by
what numpy's and the compiler's functions do.
"""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from aia_scenes import lattice_problem, tiny_problem

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.models.motion_primitives import differential_drive, first_order
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.planners.aia.arrays import prepare
from fgplan.planners.aia.growth import Growth
from fgplan.planners.aia.growth_choice import make_growth
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.plain_growth import PlainGrowth
from fgplan.planners.aia.problem import TerminalConstraint, TerminalGoal
from roadmaps import OccupancyGrid, Workspace

TESTS = Path(__file__).parents[1]
STRUCTURE = ("parent", "depth", "group", "next_in_group", "next_sibling", "assigned")


def grow_both(problem, options, iterations, seed=1):
    prepared = prepare(problem, options)
    trees = [Growth(problem, options, prepared), PlainGrowth(problem, options, prepared)]
    for tree in trees:
        tree.plant()
        tree.run(iterations, np.random.default_rng(seed))
    return trees


def assert_same(first, second):
    assert first.counted() == second.counted()
    n = first.nodes
    for name in STRUCTURE:
        one, other = getattr(first.tree, name)[:n], getattr(second.tree, name)[:n]
        assert np.array_equal(one, other), name
    for name in ("covariance", "cost"):
        one, other = getattr(first.tree, name)[:n], getattr(second.tree, name)[:n]
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15)
    assert second.shortfall == pytest.approx(first.shortfall, rel=1e-12)
    assert second.best_cost == pytest.approx(first.best_cost, rel=1e-12)
    one, other = first.closest_path(), second.closest_path()
    np.testing.assert_allclose(one.poses, other.poses, rtol=0, atol=1e-9)


CASES = [
    (3, 5, "first-order", False, "paper", {}),
    (10, 20, "first-order", False, "reproduction", {"uniform_after": "never"}),
    (6, 4, "first-order", False, "reproduction", {"uniform_after": 40, "assignment": "keep"}),
    (4, 3, "first-order", True, "reproduction", {"measure_at": "child"}),
    (3, 4, "first-order", True, "paper", {"expand": "node", "near_m": 0.5}),
    (2, 3, "differential-drive", True, "reproduction", {"expand": "node"}),
    (2, 2, "differential-drive", False, "pruned", {"near_controls": "circle"}),
    (4, 5, "differential-drive", False, "paper", {"near_m": 0.2}),
    (1, 2, "first-order", False, "reproduction", {"bound": True, "dominance": "same_time"}),
    (1, 2, "first-order", False, "reproduction", {"bound": True, "dominance": "any_time"}),
    (1, 2, "first-order", True, "reproduction", {"bound": True, "dominance": "same_time"}),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_compiled_and_plain_trees_are_the_same_tree(case):
    robots, targets, dynamics, moving, preset, changes = case
    problem = kantaros_scene(
        robots,
        targets,
        np.random.default_rng(0),
        dynamics=dynamics,
        moving=moving,
        delta=1e-4,
    )
    iterations = 60 if robots == 1 else 200
    options = tree_options(preset, until="budget", iterations=iterations, **changes)
    first, second = grow_both(problem, options, iterations)
    assert first.nodes > 15
    assert_same(first, second)


@pytest.mark.parametrize(
    "sensor",
    [
        RangeSensor(sigma_m=0.1, sigma_per_metre=0.2, max_range_m=3.0, field_of_view_rad=2.0),
        BearingSensor(sigma_rad=0.1, max_range_m=3.0),
        BearingRangeSensor(bearing_sigma_rad=0.1, range_sigma_m=0.2, range_sigma_per_metre=0.1),
        PositionSensor(sigma_m=0.1, sigma_per_metre=0.2, field_of_view_rad=1.5),
    ],
    ids=lambda sensor: sensor.kind,
)
@pytest.mark.parametrize("turning", [False, True])
def test_every_built_in_sensor_and_every_dynamics(sensor, turning):
    generator = np.random.default_rng(1)
    problem = lattice_problem(
        [(0.0, 0.0), (1.0, 0.0)],
        generator.uniform(0.5, 5.5, (6, 2)),
        boxes=[(2.2, 2.2, 2.8, 2.8)],
        sensor=sensor,
        primitives=differential_drive((0.0, 0.5)) if turning else first_order(1.0),
        delta=1e-3,
    )
    if turning:  # one kind of robot steps, the other turns; targets spin and spread
        robots = (
            dataclasses.replace(problem.robots[0], primitives=first_order(0.5)),
            problem.robots[1],
        )
        spin = np.array([[0.99, -0.05], [0.04, 0.98]])
        blocks = tuple(
            HiddenBlock(
                targets=block.targets,
                transition=spin,
                drift=np.array([0.1, 0.05]),
                process=np.array([[2e-3, 1e-3], [1e-3, 3e-3]]),
            )
            for block in problem.hidden.blocks
        )
        problem = dataclasses.replace(problem, robots=robots, hidden=HiddenState(blocks=blocks))
    options = tree_options("reproduction", until="budget", iterations=150, expand="node")
    first, second = grow_both(problem, options, 150)
    gained = first.tree.covariance[0] - first.tree.covariance[1 : first.nodes]
    assert np.abs(gained).max() > 1e-3
    assert_same(first, second)


@pytest.mark.parametrize(
    ("function", "limit", "scope"),
    [
        ("trace", 0.08, "each"),
        ("largest_eigenvalue", 0.08, "each"),
        ("entropy", 0.5 * (2 * np.log(2 * np.pi * np.e) + np.log(2e-3)), "each"),
        ("determinant", 1e-6, "joint"),
        ("trace", 0.2, "joint"),
        ("largest_eigenvalue", 0.1, "joint"),
    ],
)
@pytest.mark.parametrize("objective", ["determinant", "trace", "largest_eigenvalue"])
def test_every_built_in_function(function, limit, scope, objective):
    problem = dataclasses.replace(
        tiny_problem(1),
        objective=objective,
        objective_scope=scope if scope == "joint" else "sum",
        terminal=TerminalConstraint(limit=limit, function=function, scope=scope),
    )
    first, second = grow_both(problem, tree_options("reproduction", expand="node"), 400)
    assert first.nodes > 5
    assert_same(first, second)


def test_a_limit_of_each_target_a_goal_and_a_grid():
    generator = np.random.default_rng(0)
    cells = np.where(generator.random((12, 15)) < 0.15, 100, 0).astype(np.int8)
    cells[:5, :5] = 0
    grid = OccupancyGrid(occupancy=cells, resolution_m=0.5, origin=np.zeros(2))
    world = Workspace(lower=np.zeros(2), upper=np.full(2, 5.5), grid=grid, unknown_is_free=True)
    problem = lattice_problem([(1.0, 1.0), (1.0, 1.5)], [(3.2, 1.3), (1.1, 3.7)], step=0.5)
    goal = TerminalGoal(position=np.array([1.0, 1.0]), radius_m=0.6)
    problem = dataclasses.replace(
        problem,
        workspace=world,
        robots=(dataclasses.replace(problem.robots[0], goal=goal), problem.robots[1]),
        terminal=TerminalConstraint(limit=np.array([2e-2, 8e-3])),
    )
    options = tree_options("reproduction", until="budget", iterations=800, expand="node")
    first, second = grow_both(problem, options, 800)
    assert first.feasible
    assert_same(first, second)
    bound = 1.1 * first.best_cost
    for tree in (first, second):  # again, with a bound and the tables as they are
        tree.plant(bound)
        tree.run(300, np.random.default_rng(2))
    assert_same(first, second)


def test_room_is_made_for_poses_and_times():
    problem = kantaros_scene(
        3, 2, np.random.default_rng(5), dynamics="differential-drive", moving=True
    )
    options = tree_options("reproduction", until="budget", iterations=1000, expand="node")
    first, second = grow_both(problem, options, 1000)
    assert len(second.poses.pose) > 2048
    assert len(second.prepared.setting.sight.places) > 64
    assert_same(first, second)


def test_room_is_made_for_nodes_until_the_budget_ends():
    options = tree_options("reproduction", until="budget", iterations=500, node_budget=6000)
    first, second = grow_both(tiny_problem(), options, 500)
    assert first.nodes > 4096
    assert first.iterations < 500
    assert_same(first, second)


PROGRAM = """
import json
import numpy as np
from fgplan.bench.aia_scene import kantaros_scene
from fgplan.planners.aia.growth_choice import make_growth
from fgplan.planners.aia.options import tree_options

problem = kantaros_scene(4, 6, np.random.default_rng(2))
growth = make_growth(problem, tree_options("reproduction", until="budget", iterations=300))
growth.plant()
growth.run(300, np.random.default_rng(2))
n, tree = growth.nodes, growth.tree
print(json.dumps([
    type(growth).__name__, tree.parent[:n].tolist(), tree.assigned[:n].tolist(),
    tree.cost[:n].tolist(), tree.covariance[:n].tolist(),
]))
"""


def test_without_the_compiler_the_plain_growth_is_chosen():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "PYTHONPATH": str(TESTS.parent), "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    name, parent, assigned, cost, covariance = json.loads(done.stdout)
    assert name == "PlainGrowth"
    problem = kantaros_scene(4, 6, np.random.default_rng(2))
    growth = make_growth(problem, tree_options("reproduction", until="budget", iterations=300))
    assert type(growth) is Growth
    growth.plant()
    growth.run(300, np.random.default_rng(2))
    n, tree = growth.nodes, growth.tree
    assert n > 200
    assert parent == tree.parent[:n].tolist()
    assert assigned == tree.assigned[:n].tolist()
    np.testing.assert_allclose(cost, tree.cost[:n], rtol=1e-12)
    np.testing.assert_allclose(covariance, tree.covariance[:n], rtol=1e-12, atol=1e-15)
