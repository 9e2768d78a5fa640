"""Distance to a point with noise that grows linearly between two levels.

    sigma(l) = min(ceiling, max(floor, sigma_0 + slope l))

Equation (12) of Khodayi-mehr et al. 2019 has floor 0.01 m up to 1 m, 0.045 l - 0.035 from 1 to 3 m
and ceiling 0.1 m from there to the range of 5 m: the defaults.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fgplan.checks import check_not_negative, check_positive
from fgplan.errors import InvalidInputError
from fgplan.models.pose import position_in
from fgplan.models.range_bearing import RangeSensor
from fgplan.models.sensor import AbstractSensor, check_view
from fgplan.typing import Covariance, FloatArray, Jacobian, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class ClampedRangeSensor(AbstractSensor):
    """Distance to a point; omnidirectional within range and line of sight by default.

    Attributes:
        slope: Growth of the standard deviation by metre between the two levels.
        sigma_m: The line's value at distance zero, metres; may be negative.
        floor_m: Least standard deviation, metres.
        ceiling_m: Greatest standard deviation, metres.
    """

    kind: ClassVar[str] = "clamped_range"
    slope: float = 0.045
    sigma_m: float = -0.035
    floor_m: float = 0.01
    ceiling_m: float = 0.1
    max_range_m: float = 5.0
    field_of_view_rad: float = 2.0 * np.pi

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_view(self)
        check_not_negative(self.slope, "clamped_range slope")
        check_positive(self.floor_m, "clamped_range floor_m")
        if not np.isfinite(self.sigma_m) or not self.ceiling_m >= self.floor_m:
            raise InvalidInputError(
                "clamped_range: expected a finite sigma_m and a ceiling_m of at least floor_m, "
                f"got {self.sigma_m!r}, {self.ceiling_m!r} and {self.floor_m!r}"
            )

    def predict(self, pose: Pose, target: FloatArray) -> FloatArray:
        """Distance, shape (1,), metres."""
        return np.array([np.linalg.norm(target - position_in(pose, target.size))])

    def jacobians(self, pose: Pose, target: FloatArray) -> tuple[Jacobian, Jacobian]:
        """Shapes (1, d) and (1, n)."""
        return RangeSensor(sigma_m=self.floor_m).jacobians(pose, target)

    def noise(self, pose: Pose, target: FloatArray) -> Covariance:
        """Shape (1, 1), square metres."""
        sigma = self.sigma_m + self.slope * self.predict(pose, target)
        return np.clip(sigma, self.floor_m, self.ceiling_m)[:, None] ** 2
