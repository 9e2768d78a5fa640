"""Noise models that GTSAM builds without a word and that have no usable covariance.

A Gaussian factor weighs its error by R with R'R = covariance^-1. So each sigma must be finite and
above zero (zero is a hard constraint, infinity says nothing), R must be finite with a positive
diagonal (GTSAM's R of an indefinite covariance is nonsense), and there must be one R at all: a
robust model has a weight that depends on the values.
"""

import gtsam
import numpy as np

from fgplan.errors import InvalidInputError

MAX_SIGMA = 1e9
"""Largest sigma accepted: GTSAM drops whitened entries below 1e-12 when it lists a graph's rows."""


def check_noise(model: gtsam.noiseModel.Base | None, name: object) -> None:
    """Check that a factor's noise model is Gaussian with a positive definite covariance.

    Args:
        model: The factor's noise model; None is GTSAM's unit noise.
        name: Which factor, for the message; made a string only when there is one.

    Raises:
        InvalidInputError: If it is not.
    """
    if model is None:
        return
    if isinstance(model, gtsam.noiseModel.Robust):
        raise InvalidInputError(
            f"{name}: robust noise has no covariance (its weight depends on the values); plan with "
            "the inner model, factor.noiseModel().noise(), and leave out the factors that the "
            "robust solution rejected"
        )
    if isinstance(model, gtsam.noiseModel.Diagonal):
        sigmas = model.sigmas()
        if not np.isfinite(sigmas).all():
            raise InvalidInputError(f"{name}: expected finite sigmas, got {sigmas}")
        if model.isConstrained() or (sigmas <= 0.0).any():
            raise InvalidInputError(
                f"{name}: expected sigmas above zero, got {sigmas}; GTSAM makes a hard constraint "
                "of a zero sigma: use a small one (1e-6) or one variable instead of two"
            )
        if (sigmas > MAX_SIGMA).any():
            raise InvalidInputError(
                f"{name}: expected sigmas up to {MAX_SIGMA:g}, got {sigmas}; leave out a factor "
                "that says nothing, or measure fewer dimensions"
            )
        return
    if not isinstance(model, gtsam.noiseModel.Gaussian):
        raise InvalidInputError(
            f"{name}: expected Gaussian noise, got {type(model).__name__}, which has no covariance"
        )
    root = model.R()
    if not np.isfinite(root).all() or (np.diag(root) <= 0.0).any():
        raise InvalidInputError(
            f"{name}: expected a symmetric positive definite covariance, got a noise model whose "
            f"square-root information has the diagonal {np.diag(root)}; check the covariance's "
            "signs and off-diagonal entries"
        )
