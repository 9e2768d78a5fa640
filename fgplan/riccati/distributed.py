"""Distributed Kalman filter: each robot fuses the priors of the robots it is linked to.

Robot i measures by itself and pools priors, then predicts (Sigma_i(t) is before measuring at t):

    Omega_i = sum_j w_ij Sigma_j(t)^-1 + J_i(t),    Sigma_i(t + 1) = A Omega_i^-1 A' + Q

over j = i and its neighbours, with weights that sum to one. What the neighbours measure at t comes
in through their priors of t + 1. The weights are chosen for every target k on its own:

    w_ib = kappa for the most certain robot b, the one of least det Sigma_j^k (ties: i itself, then
    the first); the others share 1 - kappa equally; alone, w_ii = 1

Legend: Sigma prior covariance, J information of the robot's own measurements, Omega information
after, A transition, Q process noise, R number of robots that are fused (own one first), N robots of
the team, M targets of n coordinates each.

Read in Tzes et al. 2021: the update takes the robot's own covariance and those of its neighbours
(section III-A2); a weight has one of two values, which interchange by a condition on a target
(section VI). The text at hand has lost formula (4), the condition and both values: the form above,
"most certain" as the condition, the rule for several neighbours and kappa = 0.9 are reconstructed.
The filter is cited from Atanasov et al. 2014, "Joint Estimation and Localization in Sensor
Networks", of which only the abstract was read: "a version of a distributed Kalman filter", "mean
square consistent in the case of static target estimation".

Any weights that sum to one and do not depend on measurements make a covariance intersection: priors
may share measurements, Sigma_i is never below the covariance of the error and, with one prior for
all at the beginning, Sigma_i^-1 never above the information of all measurements of all robots.

No covariance is inverted: see ``pooling``; the means are in ``distributed_mean``.
"""

from collections.abc import Sequence

import numpy as np

from fgplan.checks import check_finite, check_positive
from fgplan.errors import InvalidInputError
from fgplan.riccati.gaussian import predict_covariance
from fgplan.riccati.pooling import (
    check_parts,
    covariance_of,
    covariance_roots,
    fused_robots,
    log_determinants_of,
    posterior_factor,
)
from fgplan.typing import BoolArray, Covariance, FloatArray, InformationMatrix

KAPPA = 0.9
"""Weight of the most certain robot; reconstructed, see the module header."""


def fusion_weights(log_determinants: FloatArray, kappa: float = KAPPA) -> FloatArray:
    """Weights of the fused robots.

    Args:
        log_determinants: log det of each robot's prior covariance, shape (..., R), own robot first.
        kappa: Weight of the most certain robot, at least 0.5 and below one.

    Returns:
        Shape (..., R), positive, sum one along the last axis; all equal log determinants give
        ``kappa`` to the robot itself, and a robot alone has weight one.

    Raises:
        InvalidInputError: If kappa is not in [0.5, 1), or a log determinant is not finite.
    """
    check_positive(kappa, "fusion weight kappa")
    if not 0.5 <= kappa < 1.0:
        raise InvalidInputError(
            f"fusion weight kappa: expected at least 0.5 and below one, got {kappa}; the most "
            "certain robot gets kappa, the others share the rest"
        )
    values = np.asarray(log_determinants, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] == 0 or not np.isfinite(values).all():
        raise InvalidInputError(
            "log determinants: expected finite numbers of shape (..., R) with the robot itself "
            f"first, got {values.tolist()}"
        )
    robots = values.shape[-1]
    if robots == 1:
        return np.ones(values.shape)
    best = np.argmin(values, axis=-1)[..., None]
    return np.where(np.arange(robots) == best, kappa, (1.0 - kappa) / (robots - 1))


def fuse_blocks(
    Sigmas: FloatArray,
    J: FloatArray,
    A: FloatArray,
    Q: FloatArray,
    kappa: float = KAPPA,
    robots: Sequence[str] = (),
) -> FloatArray:
    """One robot's step for independent targets, one weight a robot and target.

    A coupled state is one target: M = 1.

    Args:
        Sigmas: Prior covariances, own robot first, shape (R, M, n, n), symmetric.
        J: Information of the robot's own measurements of each target, shape (M, n, n).
        A: Transitions, shape (M, n, n).
        Q: Process noises, shape (M, n, n).
        kappa: Weight of the most certain robot.
        robots: Names in the order of ``Sigmas``, for messages; numbers from zero if left out.

    Returns:
        Sigma_i(t + 1), shape (M, n, n), exactly symmetric.

    Raises:
        InvalidInputError: If shapes do not fit, kappa is out of range or a prior is not positive
            definite.
    """
    roots = covariance_roots(Sigmas, robots)
    shape = roots.shape[1:]
    J = check_finite(J, "information J of the robot's own measurements", shape)
    A, Q = check_finite(A, "transitions A", shape), check_finite(Q, "process noises Q", shape)
    factor = posterior_factor(roots, target_weights(roots, kappa), J)
    return predict_covariance(covariance_of(factor), A, Q)


def team_step_blocks(
    Sigmas: FloatArray,
    adjacency: BoolArray,
    J: FloatArray,
    A: FloatArray,
    Q: FloatArray,
    kappa: float = KAPPA,
    robots: Sequence[str] = (),
) -> FloatArray:
    """One step of every robot, all from the priors of the same time.

    Args:
        Sigmas: Prior covariance of every robot, shape (N, M, n, n), symmetric.
        adjacency: Whether robot i has the prior of robot j, shape (N, N), diagonal false.
        J: Information of each robot's own measurements, shape (N, M, n, n).
        A: Transitions, shape (M, n, n).
        Q: Process noises, shape (M, n, n).
        kappa: Weight of the most certain robot.
        robots: Names in the order of the team, for messages; numbers from zero if left out.

    Returns:
        Shape (N, M, n, n), exactly symmetric.

    Raises:
        InvalidInputError: If shapes do not fit, a robot is linked to itself, kappa is out of range
            or a prior is not positive definite.
    """
    roots = covariance_roots(Sigmas, robots)
    shape = roots.shape[1:]
    A, Q = check_finite(A, "transitions A", shape), check_finite(Q, "process noises Q", shape)
    J = check_finite(J, "information J of the robots' own measurements", roots.shape)
    out = np.empty(roots.shape)
    for i, fused in enumerate(fused_robots(adjacency, len(roots))):
        weights = target_weights(roots[fused], kappa)
        out[i] = covariance_of(posterior_factor(roots[fused], weights, J[i]))
    return predict_covariance(out, A, Q)


def fuse_dense(
    Sigmas: FloatArray,
    J: InformationMatrix,
    A: FloatArray,
    Q: Covariance,
    kappa: float = KAPPA,
    parts: Sequence[slice] | None = None,
    robots: Sequence[str] = (),
) -> Covariance:
    """One robot's step for the stacked state.

    Without ``parts`` a robot has one weight, by the determinant of its joint covariance; that is
    safe for coupled states. With ``parts`` it has one weight a target and its prior enters as
    D_j Sigma_j^-1 D_j, D_j = diag(sqrt(w_j^k)): equal to ``fuse_blocks``.

    Args:
        Sigmas: Prior covariances, own robot first, shape (R, n, n), symmetric.
        J: Information of the robot's own measurements, shape (n, n).
        A: Transition, shape (n, n).
        Q: Process noise, shape (n, n).
        kappa: Weight of the most certain robot.
        parts: Where the independent targets sit, in order; together they are the whole state.
        robots: Names in the order of ``Sigmas``, for messages; numbers from zero if left out.

    Returns:
        Sigma_i(t + 1), shape (n, n), exactly symmetric.

    Raises:
        InvalidInputError: As for ``fuse_blocks``, if the parts do not cover the state, or if a
            prior correlates two parts: the weights of such a sum would promise too much.
    """
    Sigmas = np.asarray(Sigmas, dtype=np.float64)
    roots = covariance_roots(np.atleast_1d(Sigmas)[:, None], robots)[:, 0]
    shape = roots.shape[1:]
    J = check_finite(J, "information J of the robot's own measurements", shape)
    A, Q = check_finite(A, "transition A", shape), check_finite(Q, "process noise Q", shape)
    weights = stacked_weights(Sigmas, roots, kappa, parts, robots)
    return predict_covariance(covariance_of(posterior_factor(roots, weights, J)), A, Q)


def target_weights(roots: FloatArray, kappa: float) -> FloatArray:
    """Weights of the fused robots for independent targets.

    Args:
        roots: Cholesky factors of the priors, own robot first, shape (R, M, n, n).
        kappa: Weight of the most certain robot.

    Returns:
        Shape (R, M, 1): one for all coordinates of a target.

    Raises:
        InvalidInputError: If kappa is out of range.
    """
    return fusion_weights(log_determinants_of(roots).T, kappa).T[..., None]


def stacked_weights(
    Sigmas: FloatArray,
    roots: FloatArray,
    kappa: float,
    parts: Sequence[slice] | None,
    robots: Sequence[str] = (),
) -> FloatArray:
    """Weights of the fused robots for every coordinate of the stacked state.

    Args:
        Sigmas: Priors, own robot first, shape (R, n, n).
        roots: Their Cholesky factors, shape (R, n, n).
        kappa: Weight of the most certain robot.
        parts: Where independent targets sit; None gives a robot one weight.
        robots: Names in the order of ``Sigmas``, for messages; numbers from zero if left out.

    Returns:
        Shape (R, 1) or, with parts, (R, n).

    Raises:
        InvalidInputError: If kappa is out of range, the parts are not the whole state, or a prior
            correlates two parts.
    """
    if parts is None:
        return fusion_weights(log_determinants_of(roots), kappa)[:, None]
    inside = check_parts(Sigmas, parts, robots)
    by_part = [log_determinants_of(roots[:, part][:, :, part]) for part in inside]
    weights = fusion_weights(np.array(by_part), kappa)
    return np.repeat(weights.T, [len(part) for part in inside], axis=1)
