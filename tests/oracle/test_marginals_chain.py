"""Long chains against a closed form: cov' = Ad cov Ad' + Q, where gtsam.Marginals throws."""

from itertools import pairwise

import gtsam
import numpy as np
import pytest
import scipy.linalg

from fgplan.beliefs.elimination import eliminate_graph
from fgplan.beliefs.marginals import marginal_covariances

TOLERANCE = 1e-8  # of the block's largest entry; seen: 5e-13


def planar_chain(count, sigmas, prior_sigmas, seed=0):
    """Odometry chain from a prior; the factors at zero error, so adjoints propagate exactly."""
    rng = np.random.default_rng(seed)
    poses = [gtsam.Pose2(3.0, -2.0, 0.4)]
    for turn in rng.normal(scale=0.1, size=count - 1):
        poses.append(poses[-1].compose(gtsam.Pose2(1.0, 0.05, turn)))
    return assemble(poses, sigmas, prior_sigmas, gtsam.PriorFactorPose2, gtsam.BetweenFactorPose2)


def spatial_chain(count, sigmas, prior_sigmas, seed=0):
    rng = np.random.default_rng(seed)
    poses = [gtsam.Pose3.Expmap(rng.normal(size=6))]
    for turn in rng.normal(scale=0.1, size=(count - 1, 3)):
        poses.append(poses[-1].compose(gtsam.Pose3.Expmap(np.array([*turn, 1.0, 0.1, -0.1]))))
    return assemble(poses, sigmas, prior_sigmas, gtsam.PriorFactorPose3, gtsam.BetweenFactorPose3)


def assemble(poses, sigmas, prior_sigmas, prior, between):
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array(sigmas))
    graph.add(prior(0, poses[0], gtsam.noiseModel.Diagonal.Sigmas(np.array(prior_sigmas))))
    for step, pose in enumerate(poses):
        values.insert(step, pose)
        if step:
            graph.add(between(step - 1, step, poses[step - 1].between(pose), noise))
    maps = [a.between(b).inverse().AdjointMap() for a, b in pairwise(poses)]
    covariances = [np.diag(np.square(prior_sigmas))]
    for move in maps:
        covariances.append(move @ covariances[-1] @ move.T + np.diag(np.square(sigmas)))
    return graph, values, maps, covariances


def cross(maps, covariances, first, second):
    """cov(x_first, x_second), first <= second: x_second = Ad ... Ad x_first + noise."""
    block = covariances[first]
    for move in maps[first:second]:
        block = block @ move.T
    return block


def worst(have, want):
    return float(np.abs(have - want).max() / np.abs(want).max())


def check_chain(problem, queried):
    graph, values, maps, covariances = problem
    factor = eliminate_graph(graph.linearize(values))
    everything = marginal_covariances(factor)
    assert max(worst(everything[k], c) for k, c in enumerate(covariances)) < TOLERANCE
    for key in queried:
        assert worst(factor.covariance([key]), covariances[key]) < TOLERANCE
    last = queried[-1]
    for key in queried[:-1]:
        want = cross(maps, covariances, key, last)
        assert worst(factor.covariance([key], [last]), want) < TOLERANCE
        assert worst(factor.covariance([last], [key]), want.T) < TOLERANCE
    dim = covariances[0].shape[0]
    joint = factor.covariance(queried)
    rows, _ = eliminate_graph(graph.linearize(values), queried).information_rows()
    inverse = scipy.linalg.solve_triangular(rows, np.eye(len(rows)))
    assert worst(inverse @ inverse.T, joint) < TOLERANCE
    for i, first in enumerate(queried):
        for j, second in enumerate(queried):
            low, high = sorted((first, second))
            want = cross(maps, covariances, low, high)
            have = joint[i * dim : (i + 1) * dim, j * dim : (j + 1) * dim]
            assert worst(have, want if first <= second else want.T) < TOLERANCE


def test_ten_thousand_planar_poses():
    problem = planar_chain(10_000, (0.02, 0.02, 0.05), (1e-3, 1e-3, 1e-4))
    check_chain(problem, [0, 1, 2500, 5000, 7777, 9998, 9999])
    with pytest.raises(RuntimeError, match="Indetermina"):
        gtsam.Marginals(problem[0], problem[1])


@pytest.mark.parametrize("prior", [1e-6, 1.0, 1e3])
def test_prior_magnitudes_on_planar_chain(prior):
    check_chain(planar_chain(800, (0.02, 0.02, 0.05), (prior, prior, 1e-3)), [0, 5, 400, 799])


@pytest.mark.parametrize("prior", [1e-6, 1e3])
def test_precise_odometry_under_any_prior(prior):
    check_chain(planar_chain(500, (1e-4, 1e-4, 1e-6), (prior, prior, 1e-2)), [0, 250, 499])


def test_two_thousand_spatial_poses():
    sigmas = (0.01, 0.01, 0.01, 0.02, 0.02, 0.02)
    check_chain(spatial_chain(2000, sigmas, (1e-3,) * 6), [0, 3, 1000, 1999])


@pytest.mark.parametrize("odometry", [(1e-6, 1e-6, 1e-8), (1e-6, 1e-6, 0.5), (10.0, 10.0, 1e-8)])
@pytest.mark.parametrize("prior", [(1e-6, 1e-6, 1e-6), (1e3, 1e3, 3.0), (1e3, 1e3, 1e-6)])
def test_extreme_scales_are_neither_flagged_nor_wrong(odometry, prior):
    graph, values, _, covariances = planar_chain(60, odometry, prior)
    factor = eliminate_graph(graph.linearize(values))
    assert factor.deficient == ()
    for key in (0, 20, 59):
        assert worst(factor.covariance([key]), covariances[key]) < 1e-9
