"""Relative pose of two robots: the measurement behind two views of one scene.

With h = x1^-1 x2 and noise in the tangent of x2, the whitened Jacobians at zero error are
-W Ad(h^-1) by x1 and W by x2, W'W = noise^-1: GTSAM's BetweenFactor to the last digit.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.checks import check_covariance
from fgplan.errors import InvalidInputError
from fgplan.models.pose import adjoint, between, tangent_dim
from fgplan.typing import Covariance, Jacobian, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class RelativePoseSensor:
    """Relative pose of two robots, at any two times.

    Attributes:
        covariance: Shape (3, 3) or (6, 6), tangent of the second pose, GTSAM's order.
    """

    covariance: Covariance

    def __post_init__(self) -> None:
        """Check the covariance."""
        covariance = check_covariance(self.covariance, "relative pose covariance")
        if covariance.shape[0] not in (3, 6):
            raise InvalidInputError(
                f"relative pose covariance: expected 3 x 3 or 6 x 6, got {covariance.shape}"
            )
        object.__setattr__(self, "covariance", covariance)

    def whitening(self) -> Jacobian:
        """W with W'W = covariance^-1, lower triangular, shape (d, d)."""
        weight: Jacobian = np.linalg.inv(np.linalg.cholesky(self.covariance))
        return weight

    def linearise_between(self, pose: Pose, other: Pose) -> tuple[Jacobian, Jacobian]:
        """Whitened Jacobians of h = pose^-1 other at zero error: -W Ad(h^-1) and W.

        Args:
            pose: First pose, world frame.
            other: Second pose, world frame.

        Returns:
            Two blocks of shape (d, d).

        Raises:
            InvalidInputError: If the poses have another dimension than the covariance.
        """
        if tangent_dim(pose) != len(self.covariance):
            raise InvalidInputError(
                f"relative pose: expected a covariance of {tangent_dim(pose)} rows for these "
                f"poses, got {len(self.covariance)}"
            )
        weight = self.whitening()
        return -weight @ adjoint(between(other, pose)), weight
