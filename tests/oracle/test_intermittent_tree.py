"""The joint tree is RRT*: against ``roadmaps.RRTStar``, and against its dense twin."""

import numpy as np
import pytest
from intermittent_scenes import block_model, dense_estimate, dense_model, estimate_of, room

from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.planners.intermittent.block_model import BlockModel
from fgplan.planners.intermittent.estimate import Estimate
from fgplan.planners.intermittent.joint_tree import JointTree
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.segment import draw_samples
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from roadmaps import RRTStar, Steering, euclidean_steering


def blind_problem(world, starts):
    """Nothing is seen and nothing changes: uncertainty is one, so cost is the number of steps."""
    hidden = HiddenState((HiddenBlock(targets=("x",), transition=np.eye(2)),))
    model = BlockModel(hidden, ((),) * len(starts), world)
    return SegmentProblem(
        workspace=world,
        model=model,
        estimate=Estimate(0, np.array([5.0, 9.0]), np.eye(2)[None]),
        starts=np.array(starts),
        times=np.zeros(len(starts), dtype=int),
    )


@pytest.mark.parametrize("sync", ["slowdown", "relaxed"])
def test_same_tree_as_the_generic_rrt_star(sync):
    world, starts = room(), [(1.0, 1.0), (7.0, 2.0)]
    options = SegmentOptions(samples=400, explore=400, sync=sync, epsilon_m=1.0)
    if sync == "relaxed":
        starts = starts[:1]  # one body: a cost of its own ends, as the generic class wants it
    bodies = len(starts)
    problem = blind_problem(world, starts)
    grown = JointTree(problem, options)
    samples = draw_samples(problem, options, np.random.default_rng(4))
    for wanted in samples:
        grown.extend(wanted)

    def costs(first, last):
        ways = (last - first).reshape(-1, bodies, 2)
        steps = np.ceil(np.hypot(ways[..., 0], ways[..., 1]) / options.step_m - 1e-9)
        return steps.max(axis=1)

    def steer(origin, target):
        ways = (target - origin).reshape(bodies, 2)
        far = np.hypot(ways[:, 0], ways[:, 1])
        if sync == "relaxed":
            longest = min(np.floor(far.min() / options.step_m + 1e-9), 10)
        else:
            longest = min(np.ceil(far.max() / options.step_m - 1e-9), 10)
        if longest < 1:
            return origin
        share = longest * options.step_m / np.maximum(far, 1e-300)
        return (origin.reshape(bodies, 2) + np.minimum(share, 1.0)[:, None] * ways).reshape(-1)

    class Joint:
        lower, upper = np.tile(world.lower, bodies), np.tile(world.upper, bodies)

        def are_positions_valid(self, positions):
            points = np.asarray(positions).reshape(-1, 2)
            return world.are_positions_valid(points).reshape(-1, bodies).all(axis=1)

        def are_motions_valid(self, first, last):
            a, b = np.broadcast_arrays(np.atleast_2d(first), np.atleast_2d(last))
            free = world.are_motions_valid(a.reshape(-1, 2), b.reshape(-1, 2))
            return free.reshape(-1, bodies).all(axis=1)

    reach = options.epsilon_m * np.sqrt(bodies)
    euclidean = euclidean_steering(reach, Joint.lower, Joint.upper)
    steering = Steering(
        steer=steer,
        distances=euclidean.distances,
        costs=costs,
        near_radius=euclidean.near_radius,
    )
    given = iter(samples.reshape(len(samples), -1))
    generic = RRTStar(
        Joint(),
        np.ravel(starts),
        np.random.default_rng(0),
        steering=steering,
        sampler=lambda checker, rng: next(given),
    )
    generic.grow(sample_count=len(samples))
    assert grown.count == len(generic) > 150
    np.testing.assert_allclose(
        grown.tree.position[: grown.count].reshape(grown.count, -1), generic.positions, rtol=1e-12
    )
    np.testing.assert_array_equal(grown.tree.parent[: grown.count], generic.tree().parents)
    np.testing.assert_allclose(grown.tree.cost[: grown.count], generic.tree().costs, rtol=1e-12)


@pytest.mark.parametrize(
    ("sync", "metric", "form"),
    [
        ("slowdown", "largest_eigenvalue", "information"),
        ("strict", "trace", "covariance"),
        ("relaxed", "determinant", "covariance"),
    ],
)
def test_compiled_and_dense_models_grow_the_same_tree(sync, metric, form):
    blocks = block_model(2, metric=metric, every=2)
    options = SegmentOptions(samples=60, explore=40, sync=sync, horizon_steps=150)
    start = estimate_of(3)
    problems = [
        SegmentProblem(
            workspace=room(),
            model=model,
            estimate=estimate,
            starts=np.array([(1.0, 1.0), (3.0, 2.0)]),
            times=np.array([0, 7]),
        )
        for model, estimate in (
            (blocks, start),
            (dense_model(blocks, form), dense_estimate(start)),
        )
    ]
    samples = draw_samples(problems[0], options, np.random.default_rng(6))
    trees = [JointTree(problem, options) for problem in problems]
    for grown in trees:
        for wanted in samples:
            grown.extend(wanted)
    ours, theirs = trees
    assert ours.count == theirs.count > 15
    np.testing.assert_array_equal(ours.tree.parent, theirs.tree.parent)
    np.testing.assert_array_equal(ours.tree.time, theirs.tree.time)
    # The information form inverts a matrix twice a step.
    np.testing.assert_allclose(ours.tree.cost, theirs.tree.cost, rtol=1e-8)
