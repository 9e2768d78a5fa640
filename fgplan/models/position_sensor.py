"""The position of a point, measured directly: z = target + v.

    sigma(l) = sigma_0 + slope l,    v ~ N(0, sigma(l)^2 I)

The simplest linear observation whose noise depends on the robot's state: the Jacobian by the target
is the identity, and the robot's pose enters through the noise and through what is in view.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fgplan.checks import check_not_negative, check_positive
from fgplan.models.pose import position_in, tangent_dim
from fgplan.models.sensor import AbstractSensor, check_view
from fgplan.typing import Covariance, FloatArray, Jacobian, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionSensor(AbstractSensor):
    """Coordinates of a point in the world frame.

    Attributes:
        sigma_m: Standard deviation of each coordinate at distance zero, metres.
        sigma_per_metre: Growth of the standard deviation with distance.
    """

    kind: ClassVar[str] = "position"
    sigma_m: float
    sigma_per_metre: float = 0.0
    max_range_m: float = np.inf
    field_of_view_rad: float = 2.0 * np.pi

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_view(self)
        check_positive(self.sigma_m, "position sigma_m")
        check_not_negative(self.sigma_per_metre, "position sigma_per_metre")

    def predict(self, pose: Pose, target: FloatArray) -> FloatArray:
        """The point itself, shape (n,), metres."""
        del pose
        return np.array(target)

    def jacobians(self, pose: Pose, target: FloatArray) -> tuple[Jacobian, Jacobian]:
        """Zero by the pose, shape (n, d), and the identity, shape (n, n)."""
        return np.zeros((target.size, tangent_dim(pose))), np.eye(target.size)

    def noise(self, pose: Pose, target: FloatArray) -> Covariance:
        """Shape (n, n), square metres."""
        distance = float(np.linalg.norm(target - position_in(pose, target.size)))
        return (self.sigma_m + self.sigma_per_metre * distance) ** 2 * np.eye(target.size)
