"""Compiled blocks of planned observations against the sensors' own Jacobians."""

from dataclasses import dataclass

import gtsam
import numpy as np
import pytest

from fgplan.beliefs.belief import Belief
from fgplan.errors import InvalidInputError
from fgplan.evaluation.incremental.observation_blocks import observation_blocks
from fgplan.evaluation.incremental.observation_table import observation_table
from fgplan.evaluation.objective import length_and_uncertainty
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.paths.candidate_path import CandidatePath, Observation

SENSORS = {
    "range": RangeSensor(sigma_m=0.5),
    "bearing": BearingSensor(sigma_rad=0.02),
    "both": BearingRangeSensor(bearing_sigma_rad=0.02, range_sigma_m=0.5),
}
LANDMARKS = {int(gtsam.symbol("l", i)): where for i, where in enumerate([(5.0, 2.0), (-3.0, 7.0)])}


@dataclass(frozen=True, slots=True, kw_only=True)
class Halved(RangeSensor):
    """A user's own: half the distance."""

    def jacobians(self, pose, target):
        return tuple(0.5 * block for block in RangeSensor.jacobians(self, pose, target))


def make_problem(sensors):
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(3, 0.1)))
    values.insert(0, gtsam.Pose2())
    for key, where in LANDMARKS.items():
        noise = gtsam.noiseModel.Isotropic.Sigma(2, 1.0)
        graph.add(gtsam.PriorFactorPoint2(key, np.array(where), noise))
        values.insert(key, np.array(where))
    return PlanningProblem(
        prior=Belief(graph, values),
        start_keys={"ann": 0},
        objective=length_and_uncertainty(("ann",)),
        sensors=sensors,
    )


def make_path(poses, observations):
    size = len(poses)
    return CandidatePath(
        robot="ann",
        poses=np.vstack([np.zeros(3), poses]),
        times_s=np.arange(size + 1.0),
        motion_covariances=np.tile(np.eye(3), (size, 1, 1)),
        observations=observations,
    )


def make_observations(generator, names, states):
    found = []
    for step in range(1, states + 1):
        for key in LANDMARKS:
            name = names[generator.integers(len(names))]
            size = 2 if name == "both" else 1
            half = generator.normal(size=(size, size))
            noise = half @ half.T + 0.1 * np.eye(size)
            found.append(Observation(step=step, landmark=key, sensor=name, covariance=noise))
    return found


@pytest.mark.parametrize("own", [False, True])
def test_blocks_equal_the_sensors_jacobians(own):
    generator = np.random.default_rng(0)
    sensors = {**SENSORS, "own": Halved(sigma_m=0.5)}
    problem = make_problem(sensors)
    names = list(sensors) if own else list(SENSORS)
    poses = generator.uniform([-9.0, -9.0, -4.0], [9.0, 9.0, 4.0], (40, 3))
    observations = make_observations(generator, names, len(poses))
    places = {key: 7 + index for index, key in enumerate(LANDMARKS)}
    path = make_path(poses, observations)
    blocks = observation_blocks(problem, poses, observation_table([path]), places.__getitem__)
    np.testing.assert_array_equal(np.diff(blocks.pointer), 2)
    for place, seen in enumerate(path.observations):
        pose = poses[seen.step - 1]
        landmark = problem.prior.point(seen.landmark)
        by_pose, by_landmark = sensors[seen.sensor].linearise(pose, landmark, seen.covariance)
        assert blocks.variable[place] == places[seen.landmark]
        assert blocks.rank[place] == len(by_pose)
        want = (by_pose.T @ by_pose, by_landmark.T @ by_pose, by_landmark.T @ by_landmark)
        found = (blocks.own[place], blocks.cross[place, :2], blocks.other[place, :2, :2])
        for one, other in zip(found, want, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12 * np.abs(other).max())


@pytest.mark.parametrize(
    "noise",
    [np.array([[-1.0]]), np.array([[np.nan]]), np.array([[0.0]]), np.eye(2)],
    ids=["negative", "nan", "zero", "of another size"],
)
def test_noise_that_is_none_is_refused_by_the_sensor(noise):
    problem = make_problem(SENSORS)
    seen = Observation(step=1, landmark=next(iter(LANDMARKS)), sensor="range", covariance=noise)
    poses = np.zeros((1, 3))
    table = observation_table([make_path(poses, [seen])])
    with pytest.raises(InvalidInputError, match="noise"):
        observation_blocks(problem, poses, table, lambda _: 0)


def test_a_landmark_at_the_pose_is_refused_by_the_sensor():
    problem = make_problem(SENSORS)
    key, where = next(iter(LANDMARKS.items()))
    seen = Observation(step=1, landmark=key, sensor="both", covariance=np.eye(2))
    poses = np.array([[*where, 0.0]])
    table = observation_table([make_path(poses, [seen])])
    with np.errstate(all="ignore"), pytest.raises(InvalidInputError, match="finite"):
        observation_blocks(problem, poses, table, lambda _: 0)
