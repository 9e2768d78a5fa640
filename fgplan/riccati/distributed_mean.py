"""Distributed Kalman filter, means: what a robot believes when measurements have been taken.

    omega_i = sum_j w_ij Sigma_j^-1 mu_j + W' z,    mu_i(t + 1) = A Omega_i^-1 omega_i + d

beside the covariances of ``distributed``, with the same weights: they do not depend on the values
measured, so the covariances are those that were planned. It is computed from the robot's own mean,

    Omega_i^-1 omega_i = mu_i + Omega_i^-1 (sum_j w_ij Sigma_j^-1 (mu_j - mu_i) + W' (z - W mu_i))

which loses nothing where coordinates are large and covariances small.

Legend: mu prior mean, Sigma its covariance, w weights, W whitened rows of the robot's own
measurements and z the whitened measurements, of W x (``gaussian.whitened``), Omega and omega
information matrix and vector after, A transition, d drift, Q process noise, R number of robots that
are fused (own one first), N robots of the team, M targets of n coordinates, m rows. A sensor that
is linearised at mu has z = W mu + whitened innovation. A zero row measures nothing.
"""

from collections.abc import Sequence

import numpy as np

from fgplan.checks import check_finite
from fgplan.riccati.distributed import KAPPA, stacked_weights, target_weights
from fgplan.riccati.gaussian import predict_covariance
from fgplan.riccati.pooling import (
    covariance_of,
    covariance_roots,
    fused_robots,
    pooled_deviation,
    posterior_factor,
)
from fgplan.typing import BoolArray, Covariance, FloatArray, Jacobian


def fuse_means_blocks(
    mus: FloatArray,
    Sigmas: FloatArray,
    W: FloatArray,
    z: FloatArray,
    A: FloatArray,
    d: FloatArray,
    Q: FloatArray,
    kappa: float = KAPPA,
    robots: Sequence[str] = (),
) -> tuple[FloatArray, FloatArray]:
    """One robot's step for independent targets.

    Args:
        mus: Prior means, own robot first, shape (R, M, n).
        Sigmas: Prior covariances, shape (R, M, n, n), symmetric.
        W: Whitened rows of the robot's own measurements of each target, shape (M, m, n).
        z: Whitened measurements, shape (M, m).
        A: Transitions, shape (M, n, n).
        d: Drifts, shape (M, n).
        Q: Process noises, shape (M, n, n).
        kappa: Weight of the most certain robot.
        robots: Names in the order of ``Sigmas``, for messages; numbers from zero if left out.

    Returns:
        mu_i(t + 1) of shape (M, n) and Sigma_i(t + 1) of shape (M, n, n).

    Raises:
        InvalidInputError: If shapes do not fit, kappa is out of range or a prior is not positive
            definite.
    """
    roots = covariance_roots(Sigmas, robots)
    shape = roots.shape[1:]
    mus = check_finite(mus, "prior means", roots.shape[:-1])
    W = check_finite(W, "whitened rows W", (shape[0], None, shape[2]))
    z = check_finite(z, "whitened measurements z", W.shape[:-1])
    A, Q = check_finite(A, "transitions A", shape), check_finite(Q, "process noises Q", shape)
    d = check_finite(d, "drifts d", shape[:-1])
    after = _after(mus, roots, target_weights(roots, kappa), W, z)
    return _predict(*after, A, d, Q)


def team_step_means_blocks(
    mus: FloatArray,
    Sigmas: FloatArray,
    adjacency: BoolArray,
    W: FloatArray,
    z: FloatArray,
    A: FloatArray,
    d: FloatArray,
    Q: FloatArray,
    kappa: float = KAPPA,
    robots: Sequence[str] = (),
) -> tuple[FloatArray, FloatArray]:
    """One step of every robot, all from the priors of the same time.

    Args:
        mus: Prior mean of every robot, shape (N, M, n).
        Sigmas: Prior covariances, shape (N, M, n, n), symmetric.
        adjacency: Whether robot i has the prior of robot j, shape (N, N), diagonal false.
        W: Whitened rows of each robot's own measurements of each target, shape (N, M, m, n).
        z: Whitened measurements, shape (N, M, m).
        A: Transitions, shape (M, n, n).
        d: Drifts, shape (M, n).
        Q: Process noises, shape (M, n, n).
        kappa: Weight of the most certain robot.
        robots: Names in the order of the team, for messages; numbers from zero if left out.

    Returns:
        Means of shape (N, M, n) and covariances of shape (N, M, n, n).

    Raises:
        InvalidInputError: If shapes do not fit, a robot is linked to itself, kappa is out of range
            or a prior is not positive definite.
    """
    roots = covariance_roots(Sigmas, robots)
    shape = roots.shape[1:]
    mus = check_finite(mus, "prior means", roots.shape[:-1])
    W = check_finite(W, "whitened rows W", (*roots.shape[:2], None, shape[2]))
    z = check_finite(z, "whitened measurements z", W.shape[:-1])
    A, Q = check_finite(A, "transitions A", shape), check_finite(Q, "process noises Q", shape)
    d = check_finite(d, "drifts d", shape[:-1])
    means, covariances = np.empty(mus.shape), np.empty(roots.shape)
    for i, fused in enumerate(fused_robots(adjacency, len(roots))):
        weights = target_weights(roots[fused], kappa)
        means[i], covariances[i] = _after(mus[fused], roots[fused], weights, W[i], z[i])
    return _predict(means, covariances, A, d, Q)


def fuse_means_dense(
    mus: FloatArray,
    Sigmas: FloatArray,
    W: Jacobian,
    z: FloatArray,
    A: FloatArray,
    d: FloatArray,
    Q: Covariance,
    kappa: float = KAPPA,
    parts: Sequence[slice] | None = None,
    robots: Sequence[str] = (),
) -> tuple[FloatArray, Covariance]:
    """One robot's step for the stacked state; ``distributed.fuse_dense`` says what parts are.

    Args:
        mus: Prior means, own robot first, shape (R, n).
        Sigmas: Prior covariances, shape (R, n, n), symmetric.
        W: Whitened rows of the robot's own measurements, shape (m, n).
        z: Whitened measurements, shape (m,).
        A: Transition, shape (n, n).
        d: Drift, shape (n,).
        Q: Process noise, shape (n, n).
        kappa: Weight of the most certain robot.
        parts: Where the independent targets sit, in order; None gives a robot one weight.
        robots: Names in the order of ``Sigmas``, for messages; numbers from zero if left out.

    Returns:
        mu_i(t + 1) of shape (n,) and Sigma_i(t + 1) of shape (n, n).

    Raises:
        InvalidInputError: As for ``distributed.fuse_dense``.
    """
    Sigmas = np.asarray(Sigmas, dtype=np.float64)
    roots = covariance_roots(np.atleast_1d(Sigmas)[:, None], robots)[:, 0]
    shape = roots.shape[1:]
    mus = check_finite(mus, "prior means", roots.shape[:-1])
    W = check_finite(W, "whitened rows W", (None, shape[1]))
    z = check_finite(z, "whitened measurements z", W.shape[:-1])
    A, Q = check_finite(A, "transition A", shape), check_finite(Q, "process noise Q", shape)
    d = check_finite(d, "drift d", shape[:-1])
    weights = stacked_weights(Sigmas, roots, kappa, parts, robots)
    return _predict(*_after(mus, roots, weights, W, z), A, d, Q)


def _after(
    mus: FloatArray, roots: FloatArray, weights: FloatArray, W: FloatArray, z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance after fusing and measuring, before predicting."""
    own = mus[0]
    rows = np.swapaxes(W, -1, -2)
    innovation = z - _times(W, own)
    step = pooled_deviation(roots, weights, mus - own) + _times(rows, innovation)
    factor = posterior_factor(roots, weights, rows @ W)
    moved = _times(np.swapaxes(factor, -1, -2), _times(factor, step))
    return own + moved, covariance_of(factor)


def _predict(
    mu: FloatArray, Sigma: FloatArray, A: FloatArray, d: FloatArray, Q: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A mu + d and A Sigma A' + Q of each mean and covariance of a stack."""
    return _times(A, mu) + d, predict_covariance(Sigma, A, Q)


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Each matrix of a stack times its vector."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
