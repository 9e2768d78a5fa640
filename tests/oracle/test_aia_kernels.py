"""Compiled pieces of the sampling tree equal what they stand for, one by one."""

import dataclasses

import numpy as np
import pytest
from aia_scenes import lattice_problem
from scipy.sparse.csgraph import dijkstra

from fgplan.bench.aia_scene import kantaros_scene, kantaros_world
from fgplan.errors import InvalidInputError
from fgplan.models.linear_observation import AbstractLinearObservation
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.planners.aia.arrays import prepare
from fgplan.planners.aia.densities import Densities
from fgplan.planners.aia.geodesic_fields import GeodesicFields
from fgplan.planners.aia.growth import Growth
from fgplan.planners.aia.growth_choice import make_growth
from fgplan.planners.aia.guided_growth import GuidedGrowth
from fgplan.planners.aia.obstacle_arrays import obstacle_arrays
from fgplan.planners.aia.obstacle_kernels import in_sight, motion_free
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.pose_kernels import enter_pose
from fgplan.planners.aia.tree_kernels import DEEPEST, DEPTH, GROUPS, NODES
from roadmaps import OccupancyGrid, Workspace
from roadmaps.geodesic import build_geodesic_grid


def grid_world(generator):
    cells = np.where(generator.random((12, 15)) < 0.2, 100, 0).astype(np.int8)
    grid = OccupancyGrid(
        occupancy=cells, resolution_m=0.5, origin=np.array([-1.0, -0.5]), yaw_rad=0.3
    )
    return Workspace(lower=np.zeros(2), upper=np.full(2, 5.0), grid=grid, unknown_is_free=True)


@pytest.mark.parametrize("which", ["boxes", "disc", "grid"])
def test_ways_and_sight_are_free_where_the_workspace_says_so(which):
    generator = np.random.default_rng(0)
    world = grid_world(generator) if which == "grid" else kantaros_world()
    if which == "disc":
        world = dataclasses.replace(world, robot_radius_m=0.3)
    arrays = obstacle_arrays(world)
    starts = generator.uniform(-0.5, world.upper[0] + 0.5, (600, 2))
    ends = starts + generator.normal(0.0, 1.0, (600, 2))
    pairs = list(zip(starts, ends, strict=True))
    free = [motion_free(arrays, *a, *b) for a, b in pairs]
    seen = [in_sight(arrays, *a, *b) for a, b in pairs]
    assert free == world.are_motions_valid(starts, ends).tolist()
    assert seen == world.has_line_of_sight(starts, ends).tolist()
    assert 50 < sum(free) < 550
    assert 50 < sum(seen) < 590


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("which", ["boxes", "disc", "grid"])
def test_geodesic_fields_are_those_of_the_grid_of_the_same_cells(which, compiled, monkeypatch):
    monkeypatch.setattr("fgplan.planners.aia.geodesic_fields._COMPILED", compiled)
    generator = np.random.default_rng(5)
    world = grid_world(generator) if which == "grid" else kantaros_world()
    if which == "disc":
        world = dataclasses.replace(world, robot_radius_m=0.3)
    fields = GeodesicFields(world, (0.43, 0.38), 0.2)
    x0, y0, side, columns, rows = fields.frame
    lower = np.array([x0, y0])
    covered = dataclasses.replace(
        world, lower=lower, upper=lower + side * np.array([columns, rows])
    )
    grid = build_geodesic_grid(covered, resolution_m=0.2)
    np.testing.assert_array_equal(fields.free, grid.free.ravel())
    assert 0 < (~fields.free).sum() < fields.free.sum()
    sources = generator.choice(np.flatnonzero(fields.free), 70, replace=False)
    places = fields.cell_centers[sources]
    rows_of = fields.rows_of(places)
    found = fields.distance_m[rows_of]
    expected = dijkstra(grid.motions, directed=False, indices=sources)
    np.testing.assert_array_equal(found, expected.astype(np.float32))
    assert np.isinf(found).any()
    again = fields.rows_of(places[::-1])
    np.testing.assert_array_equal(again, rows_of[::-1])
    assert len(fields.distance_m) == 70


def test_geodesic_cells_too_many_or_none_free_are_refused():
    with pytest.raises(InvalidInputError, match="at most 25 million cells"):
        GeodesicFields(kantaros_world(), (0.5, 0.5), 1e-3)
    walled = Workspace(
        lower=np.zeros(2), upper=np.ones(2), obstacles=[[(0, 0), (1, 0), (1, 1), (0, 1)]]
    )
    with pytest.raises(InvalidInputError, match="some are free"):
        GeodesicFields(walled, (0.5, 0.5), 0.2)


@pytest.mark.parametrize(
    "sensor",
    [
        ProportionalRangeSensor(max_range_m=2.0),
        RangeSensor(sigma_m=0.1, sigma_per_metre=0.2, max_range_m=3.0, field_of_view_rad=2.0),
        BearingSensor(sigma_rad=0.1, max_range_m=3.0),
        BearingRangeSensor(bearing_sigma_rad=0.1, range_sigma_m=0.2, range_sigma_per_metre=0.1),
        PositionSensor(sigma_m=0.1, sigma_per_metre=0.2, field_of_view_rad=1.5),
    ],
    ids=lambda sensor: sensor.kind,
)
@pytest.mark.parametrize("moving", [False, True])
def test_information_is_that_of_the_sensor_s_whitened_rows(sensor, moving):
    generator = np.random.default_rng(1)
    targets = generator.uniform(0.5, 5.5, (6, 2))
    drifts = 0.05 * generator.standard_normal((6, 2)) if moving else np.zeros((6, 2))
    problem = lattice_problem(
        [(0.0, 0.0), (1.0, 0.0)],
        targets,
        boxes=[(2.2, 2.2, 2.8, 2.8)],
        sensor=sensor,
        drifts=drifts,
    )
    growth = make_growth(problem, tree_options("reproduction"))
    assert type(growth) is Growth
    growth.plant()
    seen = 0
    for time in range(5):
        poses = np.column_stack(
            [generator.uniform(0.0, 6.0, (2, 2)), generator.uniform(-3.0, 3.0, 2)]
        )
        frame = growth.prepared.setting.fields.frame
        rows = np.array([enter_pose(growth.poses, frame, 0, *map(float, pose)) for pose in poses])
        found = growth._information(rows, time).reshape(6, 3)
        expected = np.zeros((6, 2, 2))
        means = problem.hidden.predicted_means(problem.mean, time)[-1].reshape(6, 2)
        for pose in poses:
            for i, mean in enumerate(means):
                if sensor.visible(pose, mean, problem.workspace):
                    _, weighted = sensor.linearise(pose, mean)
                    expected[i] += weighted.T @ weighted
                    seen += 1
        flat = np.stack([expected[:, 0, 0], expected[:, 0, 1], expected[:, 1, 1]], axis=1)
        np.testing.assert_allclose(found, flat, rtol=1e-9, atol=1e-9 * max(1.0, flat.max()))
    assert seen > 3


CASES = [
    (3, 5, "first-order", False, "paper", {}),
    (4, 3, "first-order", True, "reproduction", {"measure_at": "child"}),
    (2, 3, "differential-drive", True, "reproduction", {"expand": "node"}),
    (2, 2, "differential-drive", False, "pruned", {"near_controls": "circle"}),
    (1, 2, "first-order", False, "reproduction", {"bound": True, "dominance": "same_time"}),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_compiled_and_guided_trees_are_the_same_tree(case):
    robots, targets, dynamics, moving, preset, changes = case
    problem = kantaros_scene(
        robots,
        targets,
        np.random.default_rng(0),
        dynamics=dynamics,
        moving=moving,
        delta=1e-4,
    )
    iterations = 60 if robots == 1 else 150
    options = tree_options(preset, until="budget", iterations=iterations, **changes)
    prepared = prepare(problem, options)
    trees = [Growth(problem, options, prepared)]
    trees.append(GuidedGrowth(problem, options, prepared, Densities()))
    for one in trees:
        one.plant()
        one.run(iterations, np.random.default_rng(1))
    first, second = trees
    assert first.counted() == second.counted()
    n = first.nodes
    assert n > 15
    for name in ("parent", "depth", "group", "assigned"):
        one, other = getattr(first.tree, name)[:n], getattr(second.tree, name)[:n]
        assert np.array_equal(one, other), name
    for name in ("covariance", "cost"):
        one, other = getattr(first.tree, name)[:n], getattr(second.tree, name)[:n]
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    assert first.shortfall == pytest.approx(second.shortfall, rel=1e-9)


def test_bookkeeping_of_groups_equals_brute_force():
    problem = kantaros_scene(2, 3, np.random.default_rng(3), delta=1e-12)
    growth = make_growth(problem, tree_options("reproduction", until="budget", iterations=1))
    growth.plant()
    generator = np.random.default_rng(3)
    for _ in range(8):
        growth.run(25, generator)
        tree = growth.tree
        n, groups = int(tree.counts[NODES]), int(tree.counts[GROUPS])
        poses = growth.poses.pose[tree.configuration[tree.group[:n]].astype(int)].reshape(n, -1)
        by_pose: dict[tuple[float, ...], list[int]] = {}
        for node in range(n):
            by_pose.setdefault(tuple(poses[node].round(6)), []).append(node)
        assert len(by_pose) == groups
        for nodes in by_pose.values():
            k = tree.group[nodes[0]]
            listed = []
            node = int(tree.head[k])
            while node >= 0:
                listed.append(node)
                node = int(tree.next_in_group[node])
            assert listed == nodes
            assert tree.size[k] == len(nodes)
            assert tree.tail[k] == nodes[-1]
        depth = [0] * n
        for node in range(1, n):
            depth[node] = depth[tree.parent[node]] + 1
        assert depth == tree.depth[:n].tolist()
        longest = max(depth)
        assert tree.counts[DEPTH] == longest
        deepest = {int(tree.group[node]) for node in range(n) if depth[node] == longest}
        assert set(tree.deepest[: tree.counts[DEEPEST]].tolist()) == deepest
        pairs = [(int(tree.parent[node]), int(tree.group[node])) for node in range(1, n)]
        assert len(set(pairs)) == len(pairs), "a node was extended twice to one configuration"
    assert growth.counted()["repeated"] > 0


def test_room_is_made_without_changing_the_tree():
    problem = kantaros_scene(3, 4, np.random.default_rng(5), dynamics="differential-drive")
    options = tree_options("reproduction", until="budget", iterations=6000, expand="node")
    whole, parts = (make_growth(problem, options) for _ in range(2))
    generators = [np.random.default_rng(5) for _ in range(2)]
    for one in (whole, parts):
        one.plant()
    whole.run(6000, generators[0])
    for _ in range(60):
        parts.run(100, generators[1])
    n = whole.nodes
    assert n == parts.nodes > 4096
    assert np.array_equal(whole.tree.cost[:n], parts.tree.cost[:n])
    groups = int(whole.tree.counts[GROUPS])
    one, other = whole.tree.configuration[:groups], parts.tree.configuration[:groups]
    assert np.array_equal(one, other)


class OneCell(AbstractLinearObservation):
    """Sees the first target's x from anywhere."""

    def matrix(self, pose, world=None):
        return np.array([[1.0, 0.0, 0.5, 0.0]])

    def noise(self, pose):
        return np.array([[0.1]])


def test_a_linear_observation_of_two_targets_makes_the_state_dense():
    problem = lattice_problem([(0.0, 0.0)], [(2.0, 2.0), (4.0, 4.0)])
    robot = dataclasses.replace(problem.robots[0], sensors=(OneCell(),))
    problem = dataclasses.replace(problem, robots=(robot,))
    assert not problem.packed
    options = tree_options("reproduction", until="budget", iterations=5)
    growth = make_growth(problem, options)
    growth.plant()
    growth.run(5, np.random.default_rng(0))
    covariance = growth.path_to(growth.nodes - 1).covariances[-1]
    assert covariance[0, 2] < 0.0
