"""Multi-robot factors: P(z_ij^{r,r'} | x_i^r, x_j^r') of equation (11).

Which pairs of states of two robots are joined, for every multi-robot model of the problem:

    future of one  x  future of the other           where the criterion holds
    future of one  x  past states of the other      past states that the problem lists, if the
                                                    model includes the past
    never                                           two states that the prior holds

Future means look-ahead step 1 or more. A robot's current pose is the prior's: the pair of two
current poses gets no factor (it would be counted twice), and a current pose takes part only where
the problem lists it among its past states. The robot earlier in the team measures the later one,
whichever is future: noise lives in the tangent of the second pose, and two robots must not compute
two beliefs.
"""

from collections.abc import Sequence

import gtsam
import numpy as np

from fgplan.factors.factor_set import FactorId, PlannedFactor, state_identity
from fgplan.factors.gaussian_noise import gaussian_noise, noise_digest
from fgplan.factors.motion import between_factor
from fgplan.factors.observation import (
    JacobianList,
    bearing_basis_agrees,
    sensor_residual,
    store_jacobians,
)
from fgplan.models.pose import point_jacobian, position
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor, checked_jacobians
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.paths.state import State
from fgplan.typing import Covariance, FloatArray, Key, Pose

KeyedState = tuple[Key, State]


def joined_pairs(
    model: MultiRobotModel, first: Sequence[State], second: Sequence[State]
) -> list[tuple[int, int]]:
    """Pairs of states that a multi-robot factor joins.

    Args:
        model: Criterion and sensor.
        first: States of the robot earlier in the team, n of them.
        second: States of the robot later in the team, m of them.

    Returns:
        Pairs (index into first, index into second), in ascending order. A distance criterion with
        relative poses is tested on all n m pairs at once; any other asks ``model.joins``.
    """
    if not first or not second:
        return []
    if type(model.criterion) is DistanceCriterion and isinstance(model.sensor, RelativePoseSensor):
        here = np.array([position(state.pose) for state in first])
        there = np.array([position(state.pose) for state in second])
        offset = here[:, None, :] - there[None, :, :]
        near = np.sqrt((offset**2).sum(axis=2)) < model.criterion.distance_m
        return [(int(i), int(j)) for i, j in np.argwhere(near)]
    return [
        (i, j)
        for i, state in enumerate(first)
        for j, other in enumerate(second)
        if model.joins(state, other)
    ]


def multi_robot_factors(
    models: Sequence[MultiRobotModel],
    first: Sequence[KeyedState],
    second: Sequence[KeyedState],
) -> tuple[PlannedFactor, ...]:
    """Factors between the states of two robots.

    Args:
        models: Multi-robot models of the problem; several may hold at once.
        first: States of the robot earlier in the team with their keys, future and past.
        second: States of the robot later in the team with their keys.

    Returns:
        Factors by model, then by place in ``first`` and ``second``; none between two states of
        the prior.

    Raises:
        InvalidInputError: If a sensor's noise does not fit or is not positive definite.
    """
    factors: list[PlannedFactor] = []
    identities = [[state_identity(state) for _, state in side] for side in (first, second)]
    for place, model in enumerate(models):
        sides = [
            [i for i, (_, state) in enumerate(side) if state.step >= 1 or model.include_past]
            for side in (first, second)
        ]
        pairs = joined_pairs(
            model, [first[i][1] for i in sides[0]], [second[j][1] for j in sides[1]]
        )
        name = f"{place}:{_kind(model)}"
        sensor = model.sensor
        if isinstance(sensor, RelativePoseSensor):
            fixed = _noise(sensor.covariance, "relative pose")
        for near, far in pairs:
            i, j = sides[0][near], sides[1][far]
            (key, state), (other_key, other) = first[i], second[j]
            if state.step < 1 and other.step < 1:
                continue
            noise, digest = (
                fixed
                if isinstance(sensor, RelativePoseSensor)
                else _noise(
                    sensor.noise(state.pose, position(other.pose)),
                    f"{sensor.kind} to another robot",
                )
            )
            identity = FactorId(
                "multi_robot",
                name,
                (key, other_key),
                (identities[0][i], identities[1][j]),
                digest,
            )
            factor = multi_robot_factor(model, (key, other_key), state.pose, other.pose, noise)
            factors.append(PlannedFactor(identity, factor, max(state.step, other.step)))
    return tuple(factors)


def multi_robot_factor(
    model: MultiRobotModel,
    keys: tuple[Key, Key],
    pose: Pose,
    other: Pose,
    noise: gtsam.noiseModel.Base,
) -> gtsam.NonlinearFactor:
    """One factor between two robots' poses, with zero error at both.

    Args:
        model: Criterion and sensor.
        keys: Keys of the two poses.
        pose: Pose of the robot that measures, world frame.
        other: Pose of the robot that is measured, world frame.
        noise: Noise model of the measurement.

    Returns:
        GTSAM's own factor for relative pose, range, bearing-range and planar bearing, else a
        CustomFactor.
    """
    sensor, planar = model.sensor, pose.ndim == 1
    if isinstance(sensor, RelativePoseSensor):
        return between_factor(*keys, pose, other, noise)
    target = position(other)
    distance = float(np.linalg.norm(target - position(pose)))
    native = planar or bearing_basis_agrees(sensor, pose, sensor.noise(pose, target))
    if type(sensor) is RangeSensor:
        ranging = gtsam.RangeFactorPose2 if planar else gtsam.RangeFactorPose3
        return ranging(*keys, distance, noise)
    if native and type(sensor) is BearingRangeSensor:
        if planar:
            angle = gtsam.Pose2(*pose).bearing(target)
            return gtsam.BearingRangeFactorPose2(*keys, angle, distance, noise)
        direction = gtsam.Pose3(pose).bearing(gtsam.Pose3(other))
        return gtsam.BearingRangeFactorPose3(*keys, direction, distance, noise)
    if planar and type(sensor) is BearingSensor:
        return gtsam.BearingFactorPose2(*keys, gtsam.Pose2(*pose).bearing(target), noise)
    return _pose_custom_factor(sensor, keys, pose, other, noise)


def _kind(model: MultiRobotModel) -> str:
    """Name of a model's sensor."""
    return "relative_pose" if isinstance(model.sensor, RelativePoseSensor) else model.sensor.kind


def _noise(covariance: Covariance, name: str) -> tuple[gtsam.noiseModel.Base, bytes]:
    """Noise model and digest of a covariance."""
    return gaussian_noise(covariance, name), noise_digest(covariance)


def _pose_custom_factor(
    sensor: AbstractSensor,
    keys: tuple[Key, Key],
    pose: Pose,
    other: Pose,
    noise: gtsam.noiseModel.Base,
) -> gtsam.CustomFactor:
    """A user's sensor that sees another robot's position, as a GTSAM factor."""
    checked_jacobians(sensor, pose, position(other))
    measured = sensor.predict(pose, position(other))
    planar = pose.ndim == 1

    def read(values: gtsam.Values, key: Key) -> Pose:
        if not planar:
            return values.atPose3(key).matrix()
        found = values.atPose2(key)
        return np.array([found.x(), found.y(), found.theta()])

    def error(
        factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: JacobianList
    ) -> FloatArray:
        first, second = tuple(factor.keys())
        where, there = read(values, first), read(values, second)
        target = position(there)
        by_pose, by_target = sensor.jacobians(where, target)
        store_jacobians(jacobians, (by_pose, by_target @ point_jacobian(there, target.size)))
        return sensor_residual(sensor, where, target, measured)

    return gtsam.CustomFactor(noise, list(keys), error)
