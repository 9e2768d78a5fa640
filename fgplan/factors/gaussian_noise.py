"""GTSAM noise models from covariances.

A covariance C becomes its square-root information R, upper triangular with R'R = C^-1. GTSAM's own
``Gaussian.Covariance`` inverts C and factors the inverse, which costs digits and drops an
asymmetric part without a word; here the reversed C is factored once and nothing is inverted twice:

    J C J = L L'   =>   R = J L^-1 J        (J reverses the order)
"""

import hashlib

import gtsam
import numpy as np
from scipy.linalg import solve_triangular

from fgplan.errors import InvalidInputError
from fgplan.typing import Covariance


def gaussian_noise(covariance: Covariance, name: str) -> gtsam.noiseModel.Gaussian:
    """Noise model of a factor.

    Args:
        covariance: Shape (m, m), symmetric, in squared units of the measurement.
        name: What is measured, for the message.

    Returns:
        A diagonal model where the covariance is diagonal, else one with full square root.

    Raises:
        InvalidInputError: If the covariance is not finite and positive definite.
    """
    diagonal = np.diagonal(covariance)
    finite = np.isfinite(covariance).all() and (diagonal > 0.0).all()
    if finite and np.count_nonzero(covariance) == diagonal.size:
        return gtsam.noiseModel.Diagonal.Sigmas(np.sqrt(diagonal), False)
    try:
        if not finite:
            raise np.linalg.LinAlgError
        lower = np.linalg.cholesky(covariance[::-1, ::-1])
    except np.linalg.LinAlgError as error:
        raise InvalidInputError(
            f"noise of {name}: expected a finite positive definite covariance, got "
            f"{np.asarray(covariance).tolist()}"
        ) from error
    root = solve_triangular(lower, np.eye(len(lower)), lower=True)[::-1, ::-1]
    return gtsam.noiseModel.Gaussian.SqrtInformation(np.ascontiguousarray(root), False)


def noise_digest(covariance: Covariance) -> bytes:
    """Sixteen bytes that tell one covariance from another."""
    return hashlib.blake2b(np.ascontiguousarray(covariance).tobytes(), digest_size=16).digest()
