"""Predict and update of a Gaussian belief over a linear hidden state.

    predict   mu <- A mu + d,                    Sigma <- A Sigma A' + Q
    update    J = sum_j H_j' R_j^-1 H_j,         Sigma <- (Sigma^-1 + J)^-1
              mu <- mu + Sigma_new sum_j H_j' R_j^-1 (z_j - H_j mu)

Legend: mu mean, Sigma covariance, A transition, d drift, Q process noise, H measurement matrix,
R its noise, J information of the measurements of one step. The Riccati map rho(p, Sigma) of
equation (5e) of Kantaros et al. 2019 is the update by the measurements taken at configuration p
followed by the prediction: A (Sigma^-1 + J(p))^-1 A' + Q.

The update is computed as Sigma - Sigma W' (I + W Sigma W')^-1 W Sigma with W'W = J (W are the
whitened rows): symmetric by construction, Sigma is never inverted, and J may be singular, which it
is for a range measurement.
"""

import numpy as np
from scipy.linalg import solve_triangular

from fgplan.errors import InvalidInputError
from fgplan.typing import Covariance, FloatArray, InformationMatrix, Jacobian


def predict(
    mu: FloatArray, Sigma: Covariance, A: FloatArray, d: FloatArray, Q: Covariance
) -> tuple[FloatArray, Covariance]:
    """Predict one step.

    Args:
        mu: Mean, shape (n,).
        Sigma: Covariance, shape (n, n).
        A: Transition, shape (n, n).
        d: Drift, shape (n,).
        Q: Process noise, shape (n, n), positive semidefinite.

    Returns:
        Mean and covariance of the next step.
    """
    return A @ mu + d, predict_covariance(Sigma, A, Q)


def predict_covariance(Sigma: Covariance, A: FloatArray, Q: Covariance) -> Covariance:
    """A Sigma A' + Q, exactly symmetric.

    Args:
        Sigma: Shape (..., n, n).
        A: Shape (..., n, n).
        Q: Shape (..., n, n).

    Returns:
        Shape (..., n, n).
    """
    after = A @ Sigma @ np.swapaxes(A, -1, -2) + Q
    return 0.5 * (after + np.swapaxes(after, -1, -2))


def update(
    mu: FloatArray, Sigma: Covariance, H: Jacobian, R: Covariance, innovation: FloatArray
) -> tuple[FloatArray, Covariance]:
    """Update by one measurement.

    Args:
        mu: Mean, shape (n,).
        Sigma: Covariance, shape (n, n).
        H: Measurement matrix, shape (m, n).
        R: Noise, shape (m, m), positive definite.
        innovation: z - h(mu), shape (m,); the sensor wraps angles.

    Returns:
        Mean and covariance after the measurement.

    Raises:
        InvalidInputError: If R is not positive definite.
    """
    W, z = whitened(H, R, innovation)
    after = update_covariance(Sigma, W)
    return mu + after @ (W.T @ z), after


def update_covariance(Sigma: Covariance, W: Jacobian) -> Covariance:
    """Covariance after measurements with whitened rows.

    Args:
        Sigma: Shape (n, n), positive semidefinite.
        W: Shape (m, n), W'W = J; no rows change nothing.

    Returns:
        (Sigma^-1 + J)^-1, shape (n, n), exactly symmetric.
    """
    if len(W) == 0:
        return np.array(Sigma)
    cross = W @ Sigma
    lower = np.linalg.cholesky(np.eye(len(W)) + cross @ W.T)
    gain = solve_triangular(lower, cross, lower=True)
    return np.asarray(Sigma - gain.T @ gain)


def riccati_map(Sigma: Covariance, W: Jacobian, A: FloatArray, Q: Covariance) -> Covariance:
    """One step of equation (5e): measure, then predict.

    Args:
        Sigma: Covariance before the measurements, shape (n, n).
        W: Whitened rows of the measurements taken at the configuration left, shape (m, n).
        A: Transition, shape (n, n).
        Q: Process noise, shape (n, n).

    Returns:
        Covariance before the next measurements, shape (n, n).
    """
    return predict_covariance(update_covariance(Sigma, W), A, Q)


def riccati_map_at_child(
    Sigma: Covariance, W: Jacobian, A: FloatArray, Q: Covariance
) -> Covariance:
    """The posterior reading: predict, then measure at the configuration reached.

    Args:
        Sigma: Covariance after the measurements of the configuration left, shape (n, n).
        W: Whitened rows of the measurements taken at the configuration reached, shape (m, n).
        A: Transition, shape (n, n).
        Q: Process noise, shape (n, n).

    Returns:
        Covariance after the measurements of the configuration reached, shape (n, n).
    """
    return update_covariance(predict_covariance(Sigma, A, Q), W)


def whitened(H: Jacobian, R: Covariance, innovation: FloatArray) -> tuple[Jacobian, FloatArray]:
    """Rows and innovation multiplied by L^-1, L L' = R.

    Args:
        H: Shape (m, n).
        R: Shape (m, m).
        innovation: Shape (m,).

    Returns:
        Shapes (m, n) and (m,).

    Raises:
        InvalidInputError: If R is not positive definite.
    """
    try:
        lower = np.linalg.cholesky(R)
    except np.linalg.LinAlgError as error:
        raise InvalidInputError(
            f"measurement noise: expected a positive definite matrix, got {np.asarray(R).tolist()}"
        ) from error
    return (
        solve_triangular(lower, H, lower=True),
        solve_triangular(lower, innovation, lower=True),
    )


def information_of(W: Jacobian) -> InformationMatrix:
    """J = W'W of whitened rows, shape (n, n).

    Args:
        W: Shape (m, n).

    Returns:
        Shape (n, n), positive semidefinite.
    """
    return np.asarray(W.T @ W)
