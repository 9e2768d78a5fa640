"""The information form: Y = Sigma^-1 and y = Sigma^-1 mu.

    update    Y <- Y + J,  y <- y + sum_j H_j' R_j^-1 z_j
    predict   Y <- M - M (M + Q^-1)^-1 M,  M = A^-T Y A^-1,  computed for any Q >= 0 as
              Y <- (I + M Q)^-1 M,         y <- (I + M Q)^-1 A^-T y + Y d

Legend: Y information matrix, y information vector, A transition (invertible), d drift, Q process
noise. An update is a sum, so contributions of several robots may come in any order; complete
ignorance, Y = 0, is allowed, which no covariance can say.
"""

import numpy as np
from numpy.typing import NDArray

from fgplan.errors import IllPosedBeliefError, InvalidInputError
from fgplan.typing import Covariance, FloatArray, InformationMatrix


def to_information(mu: FloatArray, Sigma: Covariance) -> tuple[FloatArray, InformationMatrix]:
    """Information vector and matrix of a mean and covariance.

    Args:
        mu: Shape (n,).
        Sigma: Shape (n, n), positive definite.

    Returns:
        y of shape (n,) and Y of shape (n, n).
    """
    Y = _symmetric(np.linalg.inv(Sigma))
    return Y @ mu, Y


def from_information(y: FloatArray, Y: InformationMatrix) -> tuple[FloatArray, Covariance]:
    """Mean and covariance of the information form.

    Args:
        y: Shape (n,).
        Y: Shape (n, n).

    Returns:
        mu of shape (n,) and Sigma of shape (n, n).

    Raises:
        IllPosedBeliefError: If some direction has no information.
    """
    values = np.linalg.eigvalsh(Y)
    if values[0] <= 1e-14 * max(values[-1], np.finfo(float).tiny):
        raise IllPosedBeliefError(
            f"information matrix: expected information in every direction, got a smallest "
            f"eigenvalue of {values[0]:g}; some direction has neither prior nor measurement"
        )
    Sigma = _symmetric(np.linalg.inv(Y))
    return Sigma @ y, Sigma


def update_information(
    y: FloatArray, Y: InformationMatrix, W: FloatArray, z: FloatArray
) -> tuple[FloatArray, InformationMatrix]:
    """Add measurements.

    Args:
        y: Shape (n,).
        Y: Shape (n, n).
        W: Whitened rows, shape (m, n).
        z: Whitened measurements, shape (m,), of W x.

    Returns:
        The information after the measurements.
    """
    return y + W.T @ z, Y + W.T @ W


def predict_information(
    y: FloatArray, Y: InformationMatrix, A: FloatArray, d: FloatArray, Q: Covariance
) -> tuple[FloatArray, InformationMatrix]:
    """Predict one step.

    Args:
        y: Shape (n,).
        Y: Shape (n, n); zero is allowed.
        A: Transition, shape (n, n), invertible.
        d: Drift, shape (n,).
        Q: Process noise, shape (n, n); zero is allowed.

    Returns:
        The information of the next step.

    Raises:
        InvalidInputError: If A is singular: it would make directions known exactly.
    """
    try:
        inverse = np.linalg.inv(A)
    except np.linalg.LinAlgError as error:
        raise InvalidInputError(
            "transition: expected an invertible matrix for the information form, got a singular "
            "one; use the covariance form"
        ) from error
    M = inverse.T @ Y @ inverse
    factor = np.linalg.inv(np.eye(len(Y)) + M @ Q)
    after = _symmetric(factor @ M)
    return factor @ (inverse.T @ y) + after @ d, after


def _symmetric(matrix: NDArray[np.floating]) -> FloatArray:
    """The symmetric part: rounding makes the other part."""
    return np.asarray(0.5 * (matrix + matrix.T), dtype=np.float64)
