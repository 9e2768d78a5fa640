"""The compiled forest equals a dense reference, node for node, and the filter that it rests on."""

import numpy as np
import pytest

from fgplan.bench.dense_reference import centralised_reference, distributed_reference
from fgplan.bench.distributed_aia_scene import tzes_scene
from fgplan.planners.aia.growth_choice import make_growth
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.tree import way_to
from fgplan.planners.distributed_aia.extraction import replay
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.riccati.block_diagonal import riccati_map_blocks
from fgplan.riccati.distributed import team_step_blocks
from fgplan.team.communication_graph import CommunicationGraph

EQUAL = {"rtol": 1e-9, "atol": 0.0}
LONG = {"until": "budget", "iterations": 10**6, "node_budget": 100_000}


def scene(robots, targets, *, range_m=20.0, delta=1e-4, seed=0, **given):
    """A scene; where robots see far, no decision hangs on rounding of equal covariances."""
    generator = np.random.default_rng(seed)
    return tzes_scene(robots, targets, generator, range_m=range_m, delta=delta, **given)


def graph_of(kind, problem):
    names = [robot.name for robot in problem.robots]
    generator = np.random.default_rng(7)
    if kind == "complete":
        return CommunicationGraph.complete(names)
    if kind == "none":
        return CommunicationGraph.none(names)
    if kind == "range":
        return CommunicationGraph.within_range(names, 4.0)
    constant = CommunicationGraph.random_connected(names, 2.0, generator)
    if kind == "random":
        return constant
    other = CommunicationGraph.of_edges(names, [(names[0], names[-1])])
    turns = (constant, CommunicationGraph.none(names), other)
    return CommunicationGraph.on_schedule(turns, 2)


def grown(problem, options, graph, sweeps, seed=1):
    generators = np.random.default_rng(seed).spawn(len(problem.robots))
    growth = ForestGrowth(problem, options, graph, generators)
    while growth.sweep < sweeps:
        growth.run(sweeps - growth.sweep)
        growth.goals_looked_at()
    return growth


def assert_same_forest(problem, options, graph, sweeps):
    growth = grown(problem, options, graph, sweeps)
    generators = np.random.default_rng(1).spawn(len(problem.robots))
    reference = distributed_reference(problem, options, growth.prepared, graph, generators)
    reference.run(sweeps)
    forest, targets = growth.forest, problem.targets
    blocks = np.arange(targets)
    for row, robot in enumerate(reference.robots):
        n = len(robot.nodes)
        assert growth.nodes(row) == n
        degree = len(robot.neighbours)
        made = slice(0, n)
        parents = [node.parent for node in robot.nodes]
        sources = [node.sources for node in robot.nodes]
        assert forest.trees.parent[row, made].tolist() == parents
        assert [tuple(one) for one in forest.source[row, made, :degree].tolist()] == sources
        assert (forest.source[row, made, degree:] == -1).all()
        assert forest.trees.assigned[row, made, 0].tolist() == [
            node.assigned for node in robot.nodes
        ]
        assert np.flatnonzero(forest.is_goal[row, made]).tolist() == robot.goals
        dense = np.array([node.covariance for node in robot.nodes])
        dense = dense.reshape(n, targets, 2, targets, 2)
        inside = dense[:, blocks, :, blocks, :].transpose(1, 0, 2, 3)
        rows = forest.trees.covariance[row, made].reshape(n, targets, 3)
        assert np.abs(inside[..., [0, 0, 1], [0, 1, 1]] - rows).max() < 1e-10
        dense[:, blocks, :, blocks, :] = 0.0
        assert np.abs(dense).max() < 1e-10
        np.testing.assert_allclose(
            forest.trees.cost[row, made], [node.cost for node in robot.nodes], **EQUAL
        )
        poses = np.array([robot.groups.poses[node.group] for node in robot.nodes])
        np.testing.assert_allclose(growth.poses_to(row, range(n)), poses, rtol=0, atol=1e-9)
    counted = growth.counted()
    for name in ("fused", "measured", "rejected", "repeated", "close_calls"):
        counted[name] = sum(getattr(robot, name) for robot in reference.robots)
    assert counted["covariances_fused"] == counted["fused"]
    assert counted["measurement_models"] == counted["measured"]
    assert counted["rejected_draws"] == counted["rejected"]
    assert counted["close_calls"] == 0, "rounding decided: take another scene"
    return growth, reference


def count_lagging(reference):
    """Sources that were older than the node they were fused for."""
    return sum(
        other.nodes[source].depth < node.depth - 1
        for robot in reference.robots
        for node in robot.nodes
        for other, source in zip(robot.neighbours, node.sources, strict=True)
        if source >= 0
    )


CASES = [
    ("first-order", False, "complete", "reproduction", {}),
    ("first-order", True, "random", "paper", {}),
    ("first-order", False, "none", "paper", {"expand": "node"}),
    ("differential-drive", True, "schedule", "reproduction", {"expand": "group"}),
    ("differential-drive", False, "range", "paper", {"empty_set": "predict"}),
    ("differential-drive", True, "complete", "reproduction", {"empty_set": "literal"}),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_forest_is_the_reference_s_node_for_node(case):
    dynamics, moving, kind, preset, changes = case
    problem = scene(4, 4, dynamics=dynamics, moving=moving, seed=2)
    options = distributed_options(preset, **(LONG | changes))
    sweeps = 60 if options.expand == "node" else 30
    growth, reference = assert_same_forest(problem, options, graph_of(kind, problem), sweeps)
    assert growth.counted()["nodes"] > 100
    if kind not in ("none", "range"):
        assert count_lagging(reference) > 20


@pytest.mark.full
@pytest.mark.parametrize("kind", ["complete", "random", "none", "schedule", "range"])
@pytest.mark.parametrize("dynamics", ["first-order", "differential-drive"])
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("expand", ["node", "group"])
@pytest.mark.parametrize("empty_set", ["predict", "literal"])
def test_forests_are_the_reference_s_node_for_node(kind, dynamics, moving, expand, empty_set):
    # With seed 2 rounding decides one draw of this case: two nodes are equally uncertain.
    close = (kind, dynamics, moving, expand) == ("schedule", "differential-drive", False, "node")
    problem = scene(6, 7, dynamics=dynamics, moving=moving, seed=3 if close else 2)
    options = distributed_options(
        "reproduction", expand=expand, empty_set=empty_set, p_candidate=0.6, kappa=0.7, **LONG
    )
    sweeps = 150 if expand == "node" else 30
    assert_same_forest(problem, options, graph_of(kind, problem), sweeps)


def test_draws_become_uniform_with_a_robot_s_own_first_goal_node():
    problem = scene(3, 2, delta=5e-3)
    options = distributed_options("reproduction", **LONG)
    _, reference = assert_same_forest(problem, options, graph_of("random", problem), 80)
    assert all(0 < robot.goals[0] < len(robot.nodes) - 10 for robot in reference.robots)


def walk(problem, steps, seed=3):
    """Poses of a team that follows any free controls, shape (steps + 1, N, 3)."""
    generator = np.random.default_rng(seed)
    poses = np.array([[robot.pose for robot in problem.robots]])
    for _ in range(steps):
        now = []
        for robot, pose in zip(problem.robots, poses[-1], strict=True):
            ends = robot.primitives.successors(pose)
            starts = np.broadcast_to(pose[:2], (len(ends), 2))
            free = problem.workspace.are_motions_valid(starts, ends[:, :2])
            now.append(ends[generator.choice(np.flatnonzero(free))])
        poses = np.concatenate([poses, [now]])
    return poses


def one_information(problem, robot, pose, t):
    """Information of one robot's own sensors about each target at t, shape (M, 2, 2)."""
    places = problem.hidden.predicted_means(problem.mean, t)[-1].reshape(-1, 2)
    pose, found = np.asarray(pose), np.zeros((len(places), 2, 2))
    for k, place in enumerate(places):
        for sensor in robot.sensors:
            if sensor.visible(pose, place, problem.workspace):
                _, weighted = sensor.linearise(pose, place)
                found[k] += weighted.T @ weighted
    return found


def information(problem, poses, t):
    """That of every robot of a team, shape (N, M, 2, 2)."""
    pairs = zip(problem.robots, poses, strict=True)
    return np.array([one_information(problem, robot, pose, t) for robot, pose in pairs])


def dynamics_of(problem, t):
    """Transitions and process noises at t, shape (M, 2, 2) each."""
    blocks = [block.at(t) for block in problem.hidden.blocks]
    return np.array([one[0] for one in blocks]), np.array([one[2] for one in blocks])


def matrices(rows):
    """Rows of three numbers a target as matrices."""
    parts = np.asarray(rows).reshape(*np.shape(rows)[:-1], -1, 3)
    return parts[..., [0, 1, 1, 2]].reshape(*parts.shape[:-1], 2, 2)


def assert_not_more_certain(covariances, centralised):
    """Information of the first at most that of the second, up to rounding: Sigma >= Sigma_c."""
    least = np.linalg.eigvalsh(covariances - centralised)[..., 0]
    assert (least >= -1e-9 * np.trace(centralised, axis1=-2, axis2=-1)).all()


@pytest.mark.parametrize("kind", ["complete", "random", "none", "schedule", "range"])
@pytest.mark.parametrize("moving", [False, True])
def test_replay_is_the_filter_and_knows_no_more_than_the_centralised_one(kind, moving):
    problem = scene(4, 5, range_m=3.0, moving=moving)
    graph = graph_of(kind, problem)
    growth = ForestGrowth(problem, distributed_options(), graph, np.random.default_rng(0).spawn(4))
    poses = walk(problem, 12)
    rows, terms, shortfalls = replay(growth, poses)
    team = np.broadcast_to(np.array(problem.priors), (4, 5, 2, 2))
    centralised = np.array(problem.priors)
    seen = links = 0
    for t in range(13):
        np.testing.assert_allclose(matrices(rows[t]), team, rtol=1e-9, atol=1e-9 * team.max())
        dets = np.linalg.det(team)
        np.testing.assert_allclose(terms[t], dets.sum(axis=-1), rtol=1e-9)
        np.testing.assert_allclose(shortfalls[t], dets.max(axis=-1) / 1e-4, rtol=1e-9)
        assert_not_more_certain(team, centralised)
        J = information(problem, poses[t], t)  # noqa: N806
        linked = graph.links(t, poses[t])
        transition, process = dynamics_of(problem, t)
        team = team_step_blocks(team, linked, J, transition, process)
        centralised = riccati_map_blocks(centralised, J.sum(axis=0), transition, process)
        seen += (J[..., 0, 0] > 0.0).sum()
        links += linked.sum()
    assert seen > 20
    assert (links > 0) == (kind != "none")


def test_robots_with_equal_priors_on_one_path_are_the_plain_filter():
    problem = scene(3, 4, range_m=4.0, moving=True)
    growth = ForestGrowth(
        problem,
        distributed_options(),
        graph_of("complete", problem),
        np.random.default_rng(0).spawn(3),
    )
    poses = walk(problem, 10)
    poses[:] = poses[:, :1]
    rows, _, _ = replay(growth, poses)
    plain = np.array(problem.priors)
    for t in range(11):
        for robot in range(3):
            np.testing.assert_allclose(matrices(rows[t, robot]), plain, rtol=1e-9, atol=1e-12)
        transition, process = dynamics_of(problem, t)
        own = information(problem, poses[t], t)[0]
        plain = riccati_map_blocks(plain, own, transition, process)


@pytest.mark.parametrize("moving", [False, True])
def test_a_robot_without_neighbours_is_the_riccati_core_along_its_path(moving):
    problem = scene(2, 4, range_m=4.0, moving=moving)
    options = distributed_options("reproduction", **LONG)
    growth = grown(problem, options, graph_of("none", problem), 60)
    for row in range(2):
        last = int(np.argmax(growth.forest.trees.depth[row, : growth.nodes(row)]))
        nodes = way_to(growth.forest.trees.parent[row], last)
        assert len(nodes) > 20
        plain, cost = np.array(problem.priors), 0.0
        for t, (node, pose) in enumerate(zip(nodes, growth.poses_to(row, nodes), strict=True)):
            found = matrices(growth.forest.trees.covariance[row, node])
            np.testing.assert_allclose(found, plain, rtol=1e-9, atol=1e-12)
            cost += np.linalg.det(plain).sum()
            transition, process = dynamics_of(problem, t)
            own = one_information(problem, problem.robots[row], pose, t)
            plain = riccati_map_blocks(plain, own, transition, process)
        assert growth.forest.trees.cost[row, last] == pytest.approx(cost, rel=1e-9)


class Origins:
    """Which measurements are in a node's covariance, through its parent and what it fused."""

    def __init__(self, growth):
        self.growth = growth
        self.known = {}

    def of(self, row, node):
        """Poses by (time, robot, rounded pose), and whether any covariance on the way lagged."""
        growth, forest = self.growth, self.growth.forest
        if (row, node) in self.known:
            return self.known[row, node]
        parent = int(forest.trees.parent[row, node])
        found, lags = {}, False
        if parent >= 0:
            t, robot = int(forest.trees.depth[row, parent]), growth.robots[row]
            pose = growth.poses_to(row, [parent])[0]
            found[t, robot, *pose.round(6).tolist()] = pose
            uses = [(row, parent)]
            for d, other in enumerate(growth.graph.ever(robot)):
                source = int(forest.source[row, node, d])
                uses.append((other, source))
                lags |= int(forest.trees.depth[other, source]) < t
            for use in uses:
                more, lagged = self.of(*use)
                found = more | found
                lags |= lagged
        self.known[row, node] = found, lags
        return found, lags


@pytest.mark.parametrize("empty_set", ["predict", "literal"])
@pytest.mark.parametrize("moving", [False, True])
def test_a_tree_never_knows_more_than_the_centralised_filter(empty_set, moving):
    """Of all measurements in a node's covariance, each counted once at its time.

    Fused as it is, a covariance that lags promises too much where there is process noise: for the
    literal rule nothing is claimed then.
    """
    problem = scene(3, 3, range_m=4.0, moving=moving)
    options = distributed_options("reproduction", empty_set=empty_set, **LONG)
    growth = grown(problem, options, graph_of("complete", problem), 15)
    origins, without_lag, compared = Origins(growth), 0, 0
    for row in range(3):
        for node in range(1, growth.nodes(row)):
            measured, lags = origins.of(row, node)
            without_lag += not lags
            if lags and empty_set == "literal":
                continue
            plain = np.array(problem.priors)
            for t in range(int(growth.forest.trees.depth[row, node])):
                total = np.zeros((3, 2, 2))
                for (time, robot, *_), pose in measured.items():
                    if time == t:
                        total += one_information(problem, problem.robots[robot], pose, t)
                plain = riccati_map_blocks(plain, total, *dynamics_of(problem, t))
            assert_not_more_certain(matrices(growth.forest.trees.covariance[row, node]), plain)
            compared += 1
    assert without_lag > 20
    assert compared > without_lag or empty_set == "literal"


@pytest.mark.parametrize("kind", ["complete", "random", "none"])
def test_operations_an_expanded_node_are_those_of_theorem_3(kind):
    """One state update, one measurement model and deg + 1 covariances; N and N centralised."""
    robots, targets = 5, 3
    problem = scene(robots, targets)
    graph = graph_of(kind, problem)
    options = distributed_options("reproduction", **LONG)
    growth = grown(problem, options, graph, 40)
    expanded = [growth.nodes(row) - 1 for row in range(robots)]
    degrees = [len(graph.ever(robot)) for robot in range(robots)]
    counted = growth.counted()
    assert counted["measurement_models"] == sum(expanded)
    assert counted["covariances_fused"] == sum(
        nodes * (degree + 1) for nodes, degree in zip(expanded, degrees, strict=True)
    )
    assert growth.forest.trees.drawn.shape[1] == growth.forest.trees.configuration.shape[2] == 1
    centralised = make_growth(problem, tree_options("reproduction"))
    assert centralised.tree.drawn.shape == (robots,)
    generators = np.random.default_rng(1).spawn(robots)
    one = distributed_reference(
        problem, options, growth.prepared, graph, generators, every_row=True
    )
    every = centralised_reference(
        problem, tree_options("reproduction"), centralised.prepared, every_row=True
    )
    starts = np.array([robot.pose for robot in problem.robots])
    assert len(one.world.rows(starts[0], 0)[0]) == targets
    assert len(every._rows(starts, 0)[0]) == robots * targets


def test_rows_of_what_is_not_seen_change_nothing():
    """The dense forms with every row as printed grow the trees of those that keep what is seen."""
    problem = scene(3, 4, range_m=3.0)
    graph = graph_of("random", problem)
    options = distributed_options("reproduction", **LONG)
    growth = ForestGrowth(problem, options, graph, np.random.default_rng(0).spawn(3))
    teams, trees = [], []
    for every_row in (False, True):
        generators = np.random.default_rng(1).spawn(3)
        teams.append(
            distributed_reference(
                problem, options, growth.prepared, graph, generators, every_row=every_row
            )
        )
        teams[-1].run(25)
        tree = tree_options("reproduction")
        prepared = make_growth(problem, tree).prepared
        trees.append(centralised_reference(problem, tree, prepared, every_row=every_row))
        trees[-1].run(25, np.random.default_rng(1), stop=False)
    kept, printed = ([*team.robots, tree] for team, tree in zip(teams, trees, strict=True))
    for one, other in zip(kept, printed, strict=True):
        assert [node.parent for node in one.nodes] == [node.parent for node in other.nodes]
        for a, b in zip(one.nodes, other.nodes, strict=True):
            np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-9, atol=1e-12)
