"""Distance to a point with noise in proportion to distance, down to a floor.

    sigma(l) = max(floor, sigma_0 + slope l)

Section VI-A of Kantaros et al. 2019 has sigma_0 = 0 and slope 0.25 out to the range of 2 m and
prints no floor; without one, information grows without bound as l goes to 0.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fgplan.checks import check_not_negative, check_positive
from fgplan.models.pose import position_in
from fgplan.models.range_bearing import RangeSensor
from fgplan.models.sensor import AbstractSensor, check_view
from fgplan.typing import Covariance, FloatArray, Jacobian, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class ProportionalRangeSensor(AbstractSensor):
    """Distance to a point; omnidirectional within range and line of sight by default.

    Attributes:
        slope: Standard deviation by metre of distance.
        sigma_m: Standard deviation at distance zero, metres.
        floor_m: Least standard deviation, metres.
    """

    kind: ClassVar[str] = "proportional_range"
    slope: float = 0.25
    sigma_m: float = 0.0
    floor_m: float = 0.01
    max_range_m: float = np.inf
    field_of_view_rad: float = 2.0 * np.pi

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_view(self)
        check_not_negative(self.slope, "proportional_range slope")
        check_not_negative(self.sigma_m, "proportional_range sigma_m")
        check_positive(self.floor_m, "proportional_range floor_m")

    def predict(self, pose: Pose, target: FloatArray) -> FloatArray:
        """Distance, shape (1,), metres."""
        return np.array([np.linalg.norm(target - position_in(pose, target.size))])

    def jacobians(self, pose: Pose, target: FloatArray) -> tuple[Jacobian, Jacobian]:
        """Shapes (1, d) and (1, n)."""
        return RangeSensor(sigma_m=self.floor_m).jacobians(pose, target)

    def noise(self, pose: Pose, target: FloatArray) -> Covariance:
        """Shape (1, 1), square metres."""
        sigma = self.sigma_m + self.slope * self.predict(pose, target)
        return np.maximum(self.floor_m, sigma)[:, None] ** 2
