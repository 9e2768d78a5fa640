"""Robust noise: outliers weigh less; and the Gaussian noise that stands for it afterwards.

With the whitened length of a residual e = |W r| a factor weighs

    Huber   w = 1 if e <= k, else k / e            Cauchy   w = k^2 / (k^2 + e^2)

in every linear step. So at its solution the robust graph has the same linear steps as a Gaussian
one whose factors have the covariance C / w: that one has a belief, the robust one has none.
"""

from dataclasses import dataclass
from typing import Literal

import gtsam
import numpy as np

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError

_LOSSES = {"huber": gtsam.noiseModel.mEstimator.Huber, "cauchy": gtsam.noiseModel.mEstimator.Cauchy}
SMALLEST_WEIGHT = 1e-12
"""Floor of a weight, so that no covariance becomes infinite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustLoss:
    """How much a factor weighs whose residual is large.

    Attributes:
        loss: Which weight.
        parameter: k above, in standard deviations: 1.345 (Huber) and 2.3849 (Cauchy) lose 5 % of
            precision where there is no outlier and the residual is one number.
    """

    loss: Literal["huber", "cauchy"]
    parameter: float

    def __post_init__(self) -> None:
        """Check name and number.

        Raises:
            InvalidInputError: If either is not usable.
        """
        if self.loss not in _LOSSES:
            raise InvalidInputError(
                f"robust loss: expected one of {', '.join(_LOSSES)}, got {self.loss!r}"
            )
        check_positive(self.parameter, f"parameter of robust loss {self.loss!r}")

    def around(self, noise: gtsam.noiseModel.Gaussian) -> gtsam.noiseModel.Robust:
        """Robust noise model about a Gaussian one."""
        return gtsam.noiseModel.Robust.Create(_LOSSES[self.loss].Create(self.parameter), noise)


def weight_of(factor: gtsam.NonlinearFactor, values: gtsam.Values) -> float:
    """Weight of a factor with robust noise at given values, above zero and at most one."""
    model = factor.noiseModel()
    length = float(np.linalg.norm(model.noise().whiten(factor.unwhitenedError(values))))
    return max(float(model.robust().weight(length)), SMALLEST_WEIGHT)


def reweighted(factor: gtsam.NonlinearFactor, weight: float) -> gtsam.NonlinearFactor:
    """The same factor with Gaussian noise: its covariance divided by the weight."""
    inner = factor.noiseModel().noise()
    if isinstance(inner, gtsam.noiseModel.Diagonal):
        sigmas = inner.sigmas() / np.sqrt(weight)
        return factor.cloneWithNewNoiseModel(gtsam.noiseModel.Diagonal.Sigmas(sigmas, False))
    root = np.sqrt(weight) * inner.R()
    return factor.cloneWithNewNoiseModel(gtsam.noiseModel.Gaussian.SqrtInformation(root, False))
