"""Robust noise: outliers weigh less; and the Gaussian noise that stands for it afterwards.

With the whitened length of a residual e = |W r| a factor weighs

    Huber   w = 1 if e <= k, else k / e            Cauchy   w = k^2 / (k^2 + e^2)

in every linear step. So at its solution the robust graph has the same linear steps as a Gaussian
one whose factors have the covariance C / w: that one has a belief, the robust one has none.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import gtsam
import numpy as np

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError

_LOSSES = ("huber", "cauchy")
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

    def weight(self, length: float) -> float:
        """Weight w of a residual of a whitened length, above zero and at most one."""
        if self.loss == "huber":
            weight = 1.0 if length <= self.parameter else self.parameter / length
        else:
            weight = self.parameter**2 / (self.parameter**2 + length**2)
        return max(weight, SMALLEST_WEIGHT)

    def around(self, noise: gtsam.noiseModel.Gaussian) -> gtsam.noiseModel.Robust:
        """GTSAM's robust noise model about a Gaussian one."""
        estimator = gtsam.noiseModel.mEstimator
        loss = estimator.Huber if self.loss == "huber" else estimator.Cauchy
        return gtsam.noiseModel.Robust.Create(loss.Create(self.parameter), noise)


FactorMaker = Callable[[gtsam.noiseModel.Base], gtsam.NoiseModelFactor]
"""Makes a factor with a noise model. GTSAM cannot clone a CustomFactor with another."""


@dataclass(frozen=True, slots=True)
class RobustFactor:
    """A factor whose residual weighs less where it is large.

    Attributes:
        sensor: Name of the sensor that measured.
        make: Makes the factor.
        noise: Its Gaussian noise.
        loss: How it weighs.
    """

    sensor: str
    make: FactorMaker
    noise: gtsam.noiseModel.Gaussian
    loss: RobustLoss

    def factor(self) -> gtsam.NoiseModelFactor:
        """The factor with robust noise, for iSAM2."""
        return self.make(self.loss.around(self.noise))

    def weight(self, values: gtsam.Values) -> float:
        """Its weight at given values."""
        residual = self.make(self.noise).whitenedError(values)
        return self.loss.weight(float(np.linalg.norm(residual)))

    def reweighted(self, values: gtsam.Values) -> gtsam.NoiseModelFactor:
        """The factor with Gaussian noise, its covariance divided by the weight at the values."""
        root = np.sqrt(self.weight(values))
        model: gtsam.noiseModel.Gaussian
        if isinstance(self.noise, gtsam.noiseModel.Diagonal):
            model = gtsam.noiseModel.Diagonal.Sigmas(self.noise.sigmas() / root, False)
        else:
            model = gtsam.noiseModel.Gaussian.SqrtInformation(root * self.noise.R(), False)
        return self.make(model)
