"""iSAM2 step by step against least squares on the whole graph at once, run to convergence."""

import gtsam
import numpy as np
import pytest
from slam_worlds import (
    BEARING_RANGE,
    fed,
    planar_world,
    run_of,
    slam_of,
    spatial_world,
    with_relative_poses,
)

from fgplan.models.range_bearing import BearingSensor, RangeSensor
from fgplan.slam.consistency import chi_square_interval, normalised_error_squared
from fgplan.slam.robust_noise import RobustLoss
from fgplan.slam.slam_options import SlamOptions

TIGHT = SlamOptions(relinearise_threshold=1e-5)
RANGE = RangeSensor(sigma_m=0.1, max_range_m=30.0)
BEARING = BearingSensor(sigma_rad=0.01, max_range_m=30.0)


def batch(graph, values):
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType("MULTIFRONTAL_QR")
    parameters.setRelativeErrorTol(1e-15)
    parameters.setAbsoluteErrorTol(1e-15)
    return gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()


def farthest(values, others):
    delta, keys = values.localCoordinates(others), values.dims()
    return max(float(np.abs(delta.at(key)).max()) for key in keys)


@pytest.mark.parametrize("sigma", [1e-6, 20.0], ids=["prior 1e-6 m", "prior 20 m"])
@pytest.mark.parametrize("sensor", [BEARING_RANGE, RANGE, BEARING], ids=lambda one: one.kind)
@pytest.mark.parametrize("world_of", [planar_world, spatial_world])
def test_slam_agrees_with_batch_least_squares(world_of, sensor, sigma):
    world = with_relative_poses(world_of(sensor))
    slam = fed(slam_of(world, TIGHT, sigma=sigma), run_of(world, 12))
    assert len(slam.landmarks()) >= 5
    # What has moved by less than the threshold is not linearised anew.
    best = batch(slam.graph(), slam.values())
    graph = slam.graph()
    assert graph.error(slam.values()) == pytest.approx(graph.error(best), rel=1e-7)
    belief = slam.belief()
    for robot in slam.robots:
        exact, given = belief.covariance(slam.key(robot)), slam.covariance(robot)
        np.testing.assert_allclose(given, exact, atol=2e-6 * np.abs(exact).max(), rtol=0)
        for one, other in zip(slam.keys(robot), slam.trajectory(robot), strict=True):
            gap = slam.values().localCoordinates(best).at(one)
            assert np.abs(gap).max() < 1e-4
            assert other.shape == world.robots[0].pose.shape


def test_default_threshold_costs_a_small_share_of_a_sigma():
    world = planar_world()
    slam = fed(slam_of(world), run_of(world, 25))
    best = batch(slam.graph(), slam.values())
    gaps = slam.values().localCoordinates(best)
    for robot in slam.robots:
        gap = gaps.at(slam.key(robot))
        assert gap @ np.linalg.solve(slam.covariance(robot), gap) < 0.05**2
    assert farthest(slam.values(), best) > 0.0


def test_reweighted_graph_has_its_minimum_where_the_robust_one_has():
    world = planar_world()
    robust = {"sees": RobustLoss(loss="cauchy", parameter=2.3849)}
    slam = slam_of(world, SlamOptions(relinearise_threshold=1e-6, robust=robust))
    fed(slam, run_of(world, 12))
    # At the solution the gradients of both are zero: the same weighted residuals.
    assert farthest(slam.values(), batch(slam.graph(), slam.values())) < 1e-4


def test_errors_are_as_large_as_the_covariances_say():
    seeds, robots = 10, 2
    found = []
    for seed in range(seeds):
        world = planar_world(seed=seed, robots=robots, landmarks=20)
        steps = run_of(world, 12, seed)
        slam = slam_of(world, sigma=0.3, generator=np.random.default_rng(100 + seed))
        for step in steps:
            slam.update(step.state.step, step.odometry, step.measurements)
            found += [
                normalised_error_squared(slam.pose(name), step.poses[name], slam.covariance(name))
                for name in slam.robots
            ]
    mean = np.array(found).reshape(seeds, 13, robots).mean(axis=(0, 2))
    low, high = np.array(chi_square_interval(3 * seeds * robots)) / (seeds * robots)
    assert ((low < mean) & (mean < high)).mean() >= 0.9
