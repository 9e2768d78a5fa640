"""A plan returned, replayed step by step through GTSAM factor graphs.

Its stated covariances and cost come out, the terminal constraint holds at the end and nowhere
before, every step is a control, and no way crosses an obstacle.
"""

import dataclasses

import gtsam
import numpy as np
import pytest
from scipy.linalg import block_diag

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.models.motion_primitives import differential_drive
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.search import search
from fgplan.riccati.covariance_path import propagate


def marginal(problem, path, target, step, *, at_child):
    """Covariance of a target at a step, from the factor graph cut there.

    Without process noise the target is one shared variable.
    """
    block = problem.hidden.blocks[target]
    still = not block.process.any()
    unit = gtsam.noiseModel.Unit.Create(2)
    graph = gtsam.GaussianFactorGraph()
    prior = np.linalg.inv(np.linalg.cholesky(problem.priors[target]))
    graph.add(gtsam.JacobianFactor(0, prior, np.zeros(2), unit))
    means = problem.hidden.predicted_means(problem.mean, step)[:, 2 * target : 2 * target + 2]
    for t in range(step + 1 if at_child else step):
        for j, robot in enumerate(problem.robots):
            pose = path.poses[t, j]
            for sensor in robot.sensors:
                if sensor.visible(pose, means[t], problem.workspace):
                    _, weighted = sensor.linearise(pose, means[t])
                    noise = gtsam.noiseModel.Unit.Create(len(weighted))
                    zero = np.zeros(len(weighted))
                    key = 0 if still else t
                    graph.add(gtsam.JacobianFactor(key, weighted, zero, noise))
    if not still:
        for t in range(step):
            transition, _, process = block.at(t)
            weight = np.linalg.inv(np.linalg.cholesky(process))
            graph.add(
                gtsam.JacobianFactor(t, -weight @ transition, t + 1, weight, np.zeros(2), unit)
            )
    ordering = gtsam.Ordering()
    for t in range(1 if still else step + 1):
        ordering.push_back(t)
    bayes = graph.eliminateSequential(ordering)
    inverse = np.linalg.inv(bayes.at(bayes.size() - 1).R())
    return inverse @ inverse.T


@pytest.mark.parametrize(
    ("dynamics", "moving", "preset", "measure_at"),
    [
        ("first-order", False, "paper", "parent"),
        ("first-order", True, "reproduction", "parent"),
        ("differential-drive", True, "pruned", "child"),
    ],
)
def test_a_plan_replayed_through_factor_graphs_is_what_it_says(
    dynamics, moving, preset, measure_at
):
    delta = 5e-5
    problem = kantaros_scene(
        3, 3, np.random.default_rng(2), dynamics=dynamics, moving=moving, delta=delta
    )
    options = tree_options(preset, measure_at=measure_at, expand="node", iterations=20_000)
    found = search(problem, options, np.random.default_rng(2))
    path = found.plan
    assert path is not None
    assert path.horizon > 5
    cost = 0.0
    for step in range(path.horizon + 1):
        numbers = []
        for target in range(3):
            expected = marginal(problem, path, target, step, at_child=measure_at == "child")
            have = path.covariances[step, target]
            np.testing.assert_allclose(have, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
            numbers.append(np.linalg.det(expected))
        cost += sum(numbers)
        assert (max(numbers) <= delta * (1 + 1e-9)) == (step == path.horizon)
    assert path.cost == pytest.approx(cost, rel=1e-9)
    controls = path.controls(problem)
    for j, robot in enumerate(problem.robots):
        np.testing.assert_array_equal(path.poses[0, j], robot.pose)
        for t in range(path.horizon):
            u = controls[t, j]
            after = robot.primitives.successors(path.poses[t, j])[u]
            # Poses less than half a micrometre apart are one.
            np.testing.assert_allclose(after[:2], path.poses[t + 1, j, :2], atol=1e-6)
            heading = path.poses[t, j, 2] if robot.primitives.frame == "body" else 0.0
            turn = np.array(
                [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
            )
            way = robot.primitives.waypoints[u] @ turn.T + path.poses[t, j, :2]
            way = np.vstack([path.poses[t, j, :2], way])
            assert problem.workspace.are_motions_valid(way[:-1], way[1:]).all()


def test_a_team_of_two_kinds_before_targets_whose_dynamics_vary_with_time():
    """Heterogeneous robots; A, d and Q that change at every step: against the dense recursion."""
    generator = np.random.default_rng(4)
    base = kantaros_scene(2, 3, generator, delta=1e-3)
    steps = 200
    blocks = []
    for i in range(3):
        turn = 0.002 * generator.standard_normal((steps, 2, 2))
        process = np.abs(generator.normal(0.0, 2e-6, (steps, 1, 1))) * np.eye(2)
        block = HiddenBlock(
            targets=(f"t{i}",),
            transition=np.eye(2) + turn,
            drift=-np.einsum("tij,j->ti", turn, base.mean.reshape(-1, 2)[i]),
            process=process,
        )
        blocks.append(block)
    first, second = base.robots
    second = dataclasses.replace(
        second,
        primitives=differential_drive((0.0, 0.3)),
        sensors=(
            BearingRangeSensor(
                bearing_sigma_rad=0.1, range_sigma_m=0.2, max_range_m=3.0, field_of_view_rad=2.5
            ),
        ),
    )
    problem = dataclasses.replace(base, robots=(first, second), hidden=HiddenState(tuple(blocks)))
    path = search(problem, tree_options("pruned", iterations=20_000), np.random.default_rng(0)).plan
    assert path is not None
    means = problem.hidden.predicted_means(problem.mean, path.horizon)
    rows = []
    for t in range(path.horizon + 1):
        seen = [np.zeros((0, 6))]
        for j, robot in enumerate(problem.robots):
            for i in range(3):
                place, wide = means[t, 2 * i : 2 * i + 2], np.zeros((2, 6))
                if robot.sensors[0].visible(path.poses[t, j], place, problem.workspace):
                    _, weighted = robot.sensors[0].linearise(path.poses[t, j], place)
                    wide[: len(weighted), 2 * i : 2 * i + 2] = weighted
                    seen.append(wide)
        rows.append(np.concatenate(seen))
    dense = propagate(problem.hidden, block_diag(*problem.priors), rows)
    for i in range(3):
        part = slice(2 * i, 2 * i + 2)
        np.testing.assert_allclose(
            path.covariances[:, i], dense[:, part, part], rtol=0, atol=1e-9 * dense[0].max()
        )
    for j, robot in enumerate(problem.robots):
        for t in range(path.horizon):
            after = robot.primitives.successors(path.poses[t, j])
            offset = np.linalg.norm(after[:, :2] - path.poses[t + 1, j, :2], axis=1)
            assert offset.min() < 1e-6
