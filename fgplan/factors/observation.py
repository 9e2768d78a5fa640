"""Observation factors of mapped landmarks: P(Z_l | X_l) of equation (9).

The measurement is what the sensor predicts at the planned pose and the landmark's estimate, so the
error is zero there. Range, bearing and bearing-range become GTSAM's own factors; any other sensor
becomes a CustomFactor made of its ``predict``, ``jacobians`` and ``difference``. Rows of both agree
with ``AbstractSensor.linearise`` up to a rotation of the rows, which no covariance sees.

GTSAM's tangent plane of a spatial bearing has a basis of its own. Noise that is not the same in
both of its directions would mean something else there, so such noise takes the CustomFactor, whose
basis is the sensor's.
"""

from collections.abc import Mapping, MutableSequence, Sequence
from typing import Protocol

import gtsam
import numpy as np

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.factors.factor_set import FactorId, PlannedFactor, state_identity
from fgplan.factors.gaussian_noise import gaussian_noise, noise_digest
from fgplan.models.pose import position, position_in, rotation_matrix
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.sensor import AbstractSensor, checked_jacobians
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import Covariance, FloatArray, Jacobian, Key, Pose

JacobianList = MutableSequence[Jacobian] | None
"""Where GTSAM wants a CustomFactor's Jacobians: one place a key, or None if it wants none."""


class Estimates(Protocol):
    """What a factor asks of the prior: where landmarks are."""

    def point(self, key: Key) -> FloatArray:
        """Estimate of a point, shape (2,) or (3,), metres, world frame."""
        ...


def bearing_basis_agrees(sensor: AbstractSensor, pose: Pose, covariance: Covariance) -> bool:
    """Whether GTSAM's basis of the bearing's tangent plane gives the same information."""
    if pose.ndim == 1 or type(sensor) not in (BearingSensor, BearingRangeSensor):
        return True
    bearing = covariance[:2, :2]
    same = bearing[0, 0] == bearing[1, 1] and bearing[0, 1] == bearing[1, 0] == 0.0
    return bool(same and not covariance[:2, 2:].any())


def observation_factor(
    sensor: AbstractSensor,
    keys: tuple[Key, Key],
    pose: Pose,
    point: FloatArray,
    covariance: Covariance,
) -> gtsam.NonlinearFactor:
    """Factor of one planned observation of a point.

    Args:
        sensor: Model of the measurement.
        keys: Keys of the pose and the point.
        pose: Planned pose, shape (3,) or (4, 4), world frame.
        point: Estimate of the point, shape (2,) or (3,), metres, world frame.
        covariance: Noise, shape (m, m).

    Returns:
        GTSAM's own factor for the built-in sensors, else a CustomFactor.

    Raises:
        InvalidInputError: If the noise is not positive definite or of another size.
    """
    noise = gaussian_noise(covariance, f"{sensor.kind} observation")
    size = len(sensor.noise(pose, point))
    if covariance.shape != (size, size):
        raise InvalidInputError(
            f"noise of {sensor.kind} observation: expected shape ({size}, {size}), got "
            f"{covariance.shape}"
        )
    planar = pose.ndim == 1
    native = planar == (point.size == 2) and bearing_basis_agrees(sensor, pose, covariance)
    distance = float(np.linalg.norm(point - position_in(pose, point.size)))
    if native and type(sensor) is RangeSensor:
        ranging = gtsam.RangeFactor2D if planar else gtsam.RangeFactor3D
        return ranging(*keys, distance, noise)
    if native and type(sensor) is BearingSensor:
        if planar:
            return gtsam.BearingFactor2D(*keys, gtsam.Pose2(*pose).bearing(point), noise)
        return gtsam.BearingFactor3D(*keys, gtsam.Pose3(pose).bearing(point), noise)
    if native and type(sensor) is BearingRangeSensor:
        if planar:
            angle = gtsam.Pose2(*pose).bearing(point)
            return gtsam.BearingRangeFactor2D(*keys, angle, distance, noise)
        direction = gtsam.Pose3(pose).bearing(point)
        return gtsam.BearingRangeFactor3D(*keys, direction, distance, noise)
    return _point_custom_factor(sensor, keys, pose, point, noise)


def observation_factors(
    path: CandidatePath,
    keys: Sequence[Key],
    sensors: Mapping[str, AbstractSensor],
    prior: Estimates,
) -> tuple[PlannedFactor, ...]:
    """Factors of all observations that a path plans.

    Args:
        path: The path.
        keys: Key of each pose, length L + 1.
        sensors: Sensors by the names that the path uses.
        prior: Where the landmarks are.

    Returns:
        One factor an observation, by increasing step.

    Raises:
        UnknownNameError: If a sensor is not known or a landmark is not in the prior.
        InvalidInputError: If the noise is not positive definite.
    """
    factors: list[PlannedFactor] = []
    seen: dict[FactorId, int] = {}
    for planned in path.observations:
        if planned.sensor not in sensors:
            known = ", ".join(sensors) or "none"
            raise UnknownNameError(
                f"path of robot {path.robot!r}: sensor {planned.sensor!r} is not one of: {known}"
            )
        variables = (keys[planned.step], planned.landmark)
        point = prior.point(planned.landmark)
        factor = observation_factor(
            sensors[planned.sensor], variables, path.poses[planned.step], point, planned.covariance
        )
        state = state_identity(path.state(planned.step))
        digest = noise_digest(planned.covariance)
        identity = FactorId("observation", planned.sensor, variables, (state,), digest)
        repeat = seen[identity] = seen.get(identity, -1) + 1
        identity = FactorId("observation", planned.sensor, variables, (state,), digest, repeat)
        factors.append(PlannedFactor(identity, factor, planned.step))
    return tuple(factors)


def sensor_residual(
    sensor: AbstractSensor, pose: Pose, target: FloatArray, measured: FloatArray
) -> FloatArray:
    """Predicted minus measured, one number a row of the sensor's Jacobians.

    A spatial bearing is a unit vector of three numbers in a tangent plane of two; it is read in
    the basis that the Jacobians use, which is d * (dh / dtarget) wRr.
    """
    residual = sensor.difference(sensor.predict(pose, target), measured)
    if pose.ndim == 1 or not isinstance(sensor, BearingSensor | BearingRangeSensor):
        return residual
    by_target = sensor.jacobians(pose, target)[1][:2]
    distance = np.linalg.norm(target - position(pose))
    basis = distance * by_target @ rotation_matrix(pose)
    return np.append(basis @ residual[:3], residual[3:])


def store_jacobians(into: JacobianList, blocks: Sequence[Jacobian]) -> None:
    """Hand Jacobians to GTSAM, which asks for them by a list of empty matrices or None."""
    if into is not None:
        for place, block in enumerate(blocks):
            into[place] = np.asfortranarray(block)


def _point_custom_factor(
    sensor: AbstractSensor,
    keys: tuple[Key, Key],
    pose: Pose,
    point: FloatArray,
    noise: gtsam.noiseModel.Base,
) -> gtsam.CustomFactor:
    """A user's sensor, or a planar robot that sees a point in space, as a GTSAM factor."""
    checked_jacobians(sensor, pose, point)  # here and not in GTSAM's callback, which hides errors
    measured = sensor.predict(pose, point)
    planar, flat = pose.ndim == 1, point.size == 2

    def error(
        factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: JacobianList
    ) -> FloatArray:
        pose_key, point_key = factor.keys()
        if planar:
            read = values.atPose2(pose_key)
            where = np.array([read.x(), read.y(), read.theta()])
        else:
            where = values.atPose3(pose_key).matrix()
        target = values.atPoint2(point_key) if flat else values.atPoint3(point_key)
        store_jacobians(jacobians, sensor.jacobians(where, target))
        return sensor_residual(sensor, where, target, measured)

    return gtsam.CustomFactor(noise, list(keys), error)
