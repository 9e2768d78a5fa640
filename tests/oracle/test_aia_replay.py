"""A plan returned, replayed step by step through GTSAM factor graphs.

Its stated covariances and cost come out, the terminal constraint holds at the end and nowhere
before, every step is a control, and no way crosses an obstacle.
"""

import gtsam
import numpy as np
import pytest

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.search import search


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
