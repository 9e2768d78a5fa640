"""Motion noise that grows with the way travelled.

A step with relative pose h travels a distance (metres) and turns by an angle (radians). The noise
of the motion factor is in the tangent of the later pose, with variances

    base^2 + distance * per_metre^2 + turn * per_radian^2

Variances, not sigmas, grow with the way, so that a step cut in two carries the same noise (apart
from the base, which is the noise of one measurement).
"""

import itertools
from dataclasses import dataclass, field

import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.models.pose import between, travelled
from fgplan.typing import Covariance, FloatArray, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionModel:
    """Noise of one motion step.

    Attributes:
        sigmas: Shape (3,) planar (x, y, heading: m, m, rad) or (6,) spatial (rotation first).
        per_metre: Same shape; standard deviation after one metre (m/sqrt(m), rad/sqrt(m)).
        per_radian: Same shape; standard deviation after turning one radian.
        speed_m_per_s: Speed along a path, m/s; turns path length into time.
    """

    sigmas: FloatArray
    per_metre: FloatArray = field(default_factory=lambda: np.zeros(0))
    per_radian: FloatArray = field(default_factory=lambda: np.zeros(0))
    speed_m_per_s: float = 1.0

    def __post_init__(self) -> None:
        """Check shapes and that some noise remains in every direction."""
        sigmas = check_finite(self.sigmas, "motion sigmas", (None,))
        if sigmas.size not in (3, 6):
            raise InvalidInputError(
                f"motion sigmas: expected 3 (planar) or 6 (spatial) numbers, got {sigmas.size}"
            )
        object.__setattr__(self, "sigmas", sigmas)
        for name in ("per_metre", "per_radian"):
            given = np.asarray(getattr(self, name), dtype=np.float64)
            values = check_finite(
                given if given.size else np.zeros(sigmas.size), f"motion {name}", (sigmas.size,)
            )
            if (values < 0).any():
                raise InvalidInputError(f"motion {name}: expected zero or more, got {values}")
            object.__setattr__(self, name, values)
        if (sigmas < 0).any() or not (sigmas + self.per_metre > 0).all():
            raise InvalidInputError(
                f"motion sigmas: expected sigmas or per_metre above zero in every direction, got "
                f"{sigmas} and {self.per_metre}; a direction without noise is no belief"
            )
        if not (np.isfinite(self.speed_m_per_s) and self.speed_m_per_s > 0):
            raise InvalidInputError(
                f"motion speed_m_per_s: expected a number above zero, got {self.speed_m_per_s!r}"
            )

    def covariance(self, relative: Pose) -> Covariance:
        """Covariance of one step.

        Args:
            relative: Relative pose of the step, shape (3,) or (4, 4).

        Returns:
            Shape (3, 3) or (6, 6), tangent of the later pose.

        Raises:
            InvalidInputError: If the step has no noise in some direction (no base, no way).
        """
        distance, turn = travelled(relative)
        variances = self.sigmas**2 + distance * self.per_metre**2 + turn * self.per_radian**2
        if not (variances > 0).all():
            raise InvalidInputError(
                f"motion: a step of {distance:g} m and {turn:g} rad would carry no noise; give "
                "sigmas above zero or leave out poses that do not move"
            )
        return np.diag(variances)

    def covariances(self, poses: FloatArray) -> FloatArray:
        """Covariances of all steps of a path.

        Args:
            poses: Shape (L + 1, 3) or (L + 1, 4, 4), world frame.

        Returns:
            Shape (L, d, d).
        """
        if poses.ndim == 3:
            steps = [self.covariance(between(a, b)) for a, b in itertools.pairwise(poses)]
            return np.array(steps)
        way = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
        turn = np.diff(poses[:, 2])
        turn = np.abs(np.arctan2(np.sin(turn), np.cos(turn)))
        variances = (
            self.sigmas**2 + way[:, None] * self.per_metre**2 + turn[:, None] * self.per_radian**2
        )
        if not (variances > 0).all():
            step = int(np.argwhere(variances <= 0)[0][0])
            return np.array([self.covariance(between(poses[step], poses[step + 1]))])
        out = np.zeros((len(way), 3, 3))
        out[:, [0, 1, 2], [0, 1, 2]] = variances
        return out
