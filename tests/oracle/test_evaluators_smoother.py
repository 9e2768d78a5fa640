"""ISAM2 with candidates added and removed: variables come back elsewhere, exceptions rebuild."""

import gtsam
import numpy as np
import pytest
import scenes

from fgplan.beliefs.candidate_belief import candidate_belief
from fgplan.beliefs.from_scratch import planned_poses
from fgplan.beliefs.incremental_smoother import IncrementalSmoother
from fgplan.errors import IllPosedBeliefError
from fgplan.evaluation.isam2 import Isam2
from fgplan.factors.factor_set import FactorSet
from fgplan.factors.path_factors import local_factors, pair_factors, team_factors


@pytest.fixture
def scene():
    return scenes.random_scene(np.random.default_rng(21), robots=3, landmarks=4, radius_m=600.0)


def announce(smoother, problem, paths):
    smoother.announce(team_factors(problem, paths), planned_poses(problem, list(paths.values())))


def added(problem, path, announced):
    factors = local_factors(problem, path).factors
    for other in announced.values():
        factors += pair_factors(problem, path, other).factors
    return FactorSet(factors).graph(), planned_poses(problem, [path])


def exact(problem, paths, robot):
    whole = candidate_belief(problem, paths)
    return whole.belief().covariance(whole.key(robot))


def test_announced_paths_are_exchanged_in_place(scene):
    problem, paths = scene
    smoother = IncrementalSmoother(problem.prior)
    others = {"robot1": paths["robot1"][0], "robot2": paths["robot2"][0]}
    announce(smoother, problem, others)
    assert smoother.rebuilds == 1
    for turn in range(4):
        others["robot1"] = paths["robot1"][turn]
        announce(smoother, problem, others)
        for path in paths["robot0"]:
            graph, poses = added(problem, path, others)
            goal = candidate_belief(problem, {"robot0": path}).key("robot0")
            (found,) = smoother.covariances(graph, poses, [(goal,)])
            expected = exact(problem, {"robot0": path, **others}, "robot0")
            np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    assert smoother.rebuilds == 1


def test_announcing_the_same_again_changes_nothing(scene):
    problem, paths = scene
    smoother = IncrementalSmoother(problem.prior)
    for _ in range(2):
        announce(smoother, problem, {"robot1": paths["robot1"][0]})
    key = problem.start_keys["robot1"]
    (found,) = smoother.covariances(gtsam.NonlinearFactorGraph(), gtsam.Values(), [(key,)])
    expected = candidate_belief(problem, {"robot1": paths["robot1"][0]}).belief().covariance(key)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_after_an_exception_the_smoother_is_built_anew(scene):
    problem, paths = scene
    smoother = IncrementalSmoother(problem.prior)
    others = {"robot1": paths["robot1"][0]}
    announce(smoother, problem, others)
    loose, poses = gtsam.NonlinearFactorGraph(), gtsam.Values()
    loose.add(
        gtsam.RangeFactorPose2(
            problem.start_keys["robot0"], 12345, 5.0, gtsam.noiseModel.Isotropic.Sigma(1, 1.0)
        )
    )
    poses.insert(12345, gtsam.Pose2(1000.0, 1000.0, 0.0))
    with pytest.raises(IllPosedBeliefError):
        smoother.covariances(loose, poses, [(12345,)])
    path = paths["robot0"][0]
    graph, poses = added(problem, path, others)
    goal = candidate_belief(problem, {"robot0": path}).key("robot0")
    (found,) = smoother.covariances(graph, poses, [(goal,)])
    expected = exact(problem, {"robot0": path, **others}, "robot0")
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    assert smoother.rebuilds == 2


def test_the_smoother_stays_from_turn_to_turn(scene):
    problem, paths = scene
    evaluator = Isam2()
    state = evaluator.start(problem, "robot0", paths["robot0"])
    longest = max(paths["robot2"], key=lambda path: path.steps)
    rebuilt = []
    for turn in range(3):
        announced = {"robot1": paths["robot1"][turn], "robot2": longest}
        state, found = evaluator.evaluate(state, announced)
        rebuilt.append(found.report.messages_rebuilt)
        assert found.report.fallbacks == 0
    assert rebuilt == [1, 0, 0]
