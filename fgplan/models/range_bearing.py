"""Range, bearing and bearing-range to a point, planar and spatial.

With offset o = target - position and distance l = |o|: d(range) is the unit direction o / l; a
planar bearing turns by (-o_y, o_x) / l^2; a spatial bearing moves in the tangent plane of the unit
direction in the robot frame. Bearing rows come first, as in GTSAM.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fgplan.checks import check_not_negative, check_positive
from fgplan.models.pose import point_jacobian, position_in, rotation_matrix, skew
from fgplan.models.sensor import AbstractSensor, check_view
from fgplan.typing import Covariance, FloatArray, Jacobian, Pose


def _range_jacobians(pose: Pose, target: FloatArray) -> tuple[Jacobian, Jacobian]:
    """Derivatives of the distance: the unit direction."""
    offset = target - position_in(pose, target.size)
    direction = offset / np.linalg.norm(offset)
    return -direction[None, :] @ point_jacobian(pose, target.size), direction[None, :]


def _bearing_jacobians(pose: Pose, target: FloatArray) -> tuple[Jacobian, Jacobian]:
    """Derivatives of the direction in the robot frame, in a basis of its tangent plane."""
    if pose.ndim == 1:
        offset = target[:2] - pose[:2]
        square = float(offset @ offset)
        across = np.array([-offset[1], offset[0]]) / square
        by_pose = np.array([[*(-across @ rotation_matrix(pose)), -1.0]])
        return by_pose, np.append(across, np.zeros(target.size - 2))[None, :]
    local = pose[:3, :3].T @ (target - pose[:3, 3])
    distance = float(np.linalg.norm(local))
    unit = local / distance
    helper = np.eye(3)[int(np.argmin(np.abs(unit)))]
    first = np.cross(unit, helper)
    first /= np.linalg.norm(first)
    basis = np.vstack([first, np.cross(unit, first)])
    by_local = basis / distance
    by_pose = by_local @ np.hstack([skew(local), -np.eye(3)])
    return by_pose, by_local @ pose[:3, :3].T


def _wrapped(angle: FloatArray) -> FloatArray:
    """Angle in (-pi, pi]."""
    return np.arctan2(np.sin(angle), np.cos(angle))


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeSensor(AbstractSensor):
    """Distance to a point; sigma grows with distance.

    Attributes:
        sigma_m: Standard deviation at distance zero, metres.
        sigma_per_metre: Growth of the standard deviation with distance.
    """

    kind: ClassVar[str] = "range"
    sigma_m: float
    sigma_per_metre: float = 0.0
    max_range_m: float = np.inf
    field_of_view_rad: float = 2.0 * np.pi

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_view(self)
        check_positive(self.sigma_m, "range sigma_m")
        check_not_negative(self.sigma_per_metre, "range sigma_per_metre")

    def predict(self, pose: Pose, target: FloatArray) -> FloatArray:
        """Distance, shape (1,), metres."""
        return np.array([np.linalg.norm(target - position_in(pose, target.size))])

    def jacobians(self, pose: Pose, target: FloatArray) -> tuple[Jacobian, Jacobian]:
        """Shapes (1, d) and (1, n)."""
        return _range_jacobians(pose, target)

    def noise(self, pose: Pose, target: FloatArray) -> Covariance:
        """Shape (1, 1), square metres."""
        return (self.sigma_m + self.sigma_per_metre * self.predict(pose, target))[:, None] ** 2


@dataclass(frozen=True, slots=True, kw_only=True)
class BearingSensor(AbstractSensor):
    """Direction to a point in the robot frame.

    Attributes:
        sigma_rad: Standard deviation, radians; in space, of both directions.
    """

    kind: ClassVar[str] = "bearing"
    sigma_rad: float
    max_range_m: float = np.inf
    field_of_view_rad: float = 2.0 * np.pi

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_view(self)
        check_positive(self.sigma_rad, "bearing sigma_rad")

    def predict(self, pose: Pose, target: FloatArray) -> FloatArray:
        """Planar: the angle from the heading, shape (1,). Spatial: unit vector, shape (3,)."""
        if pose.ndim == 2:
            local = pose[:3, :3].T @ (target - pose[:3, 3])
            return local / np.linalg.norm(local)
        offset = target[:2] - pose[:2]
        return _wrapped(np.array([np.arctan2(offset[1], offset[0]) - pose[2]]))

    def difference(self, measured: FloatArray, predicted: FloatArray) -> FloatArray:
        """Wrapped angle; in space the difference of unit vectors."""
        return _wrapped(measured - predicted) if measured.size == 1 else measured - predicted

    def jacobians(self, pose: Pose, target: FloatArray) -> tuple[Jacobian, Jacobian]:
        """Planar (1, 3) and (1, n); spatial (2, 6) and (2, 3)."""
        return _bearing_jacobians(pose, target)

    def noise(self, pose: Pose, target: FloatArray) -> Covariance:
        """Shape (1, 1) planar or (2, 2) spatial, square radians."""
        del target
        return self.sigma_rad**2 * np.eye(1 if pose.ndim == 1 else 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class BearingRangeSensor(AbstractSensor):
    """Direction and distance to a point, independent of each other.

    Attributes:
        bearing_sigma_rad: Standard deviation of the bearing, radians.
        range_sigma_m: Standard deviation of the distance at distance zero, metres.
        range_sigma_per_metre: Growth of that standard deviation with distance.
    """

    kind: ClassVar[str] = "bearing_range"
    bearing_sigma_rad: float
    range_sigma_m: float
    range_sigma_per_metre: float = 0.0
    max_range_m: float = np.inf
    field_of_view_rad: float = 2.0 * np.pi

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_view(self)
        check_positive(self.bearing_sigma_rad, "bearing_range bearing_sigma_rad")
        check_positive(self.range_sigma_m, "bearing_range range_sigma_m")
        check_not_negative(self.range_sigma_per_metre, "bearing_range range_sigma_per_metre")

    def predict(self, pose: Pose, target: FloatArray) -> FloatArray:
        """Planar (angle, distance), shape (2,); spatial (unit vector, distance), shape (4,)."""
        bearing = BearingSensor(sigma_rad=self.bearing_sigma_rad).predict(pose, target)
        return np.append(bearing, np.linalg.norm(target - position_in(pose, target.size)))

    def difference(self, measured: FloatArray, predicted: FloatArray) -> FloatArray:
        """Residual with the planar angle wrapped."""
        residual = measured - predicted
        if residual.size == 2:
            residual[0] = _wrapped(residual[0])
        return residual

    def jacobians(self, pose: Pose, target: FloatArray) -> tuple[Jacobian, Jacobian]:
        """Planar (2, 3) and (2, n); spatial (3, 6) and (3, 3): bearing rows first, as GTSAM."""
        bearing, distance = _bearing_jacobians(pose, target), _range_jacobians(pose, target)
        return np.vstack([bearing[0], distance[0]]), np.vstack([bearing[1], distance[1]])

    def noise(self, pose: Pose, target: FloatArray) -> Covariance:
        """Shape (2, 2) planar or (3, 3) spatial."""
        distance = float(np.linalg.norm(target - position_in(pose, target.size)))
        bearings = [self.bearing_sigma_rad**2] * (1 if pose.ndim == 1 else 2)
        spread = self.range_sigma_m + self.range_sigma_per_metre * distance
        return np.diag([*bearings, spread**2])
