"""Weighted sum of information matrices, and what it leaves, without inverting a covariance.

    Omega = sum_j D_j Sigma_j^-1 D_j + J,    D_j = diag(sqrt(w_j))

With L_j L_j' = Sigma_j and L = L_0 the factor of the robot itself,

    B_j = L_j^-1 D_j L,    C C' = sum_j B_j' B_j + L' J L,    F = C^-1 L',    Omega^-1 = F' F

so only ratios of covariances occur: with equal priors the matrix that is factored is I + L' J L,
however small Sigma is, and the result is symmetric by construction.

Legend: Sigma prior covariance, w weights, J information of the robot's own measurements, Omega
information after, R number of robots that are fused (own one first), N robots of the team, n
coordinates. Where a weight is the same for all coordinates, D_j Sigma_j^-1 D_j = w_j Sigma_j^-1.
"""

from collections.abc import Sequence

import numpy as np

from fgplan.checks import SYMMETRY_TOLERANCE
from fgplan.errors import InvalidInputError
from fgplan.typing import BoolArray, FloatArray, IntArray


def covariance_roots(Sigmas: FloatArray, robots: Sequence[str] = ()) -> FloatArray:
    """Cholesky factors of every robot's covariances.

    Args:
        Sigmas: One a robot and target, shape (R, M, n, n), R and M at least one, symmetric.
        robots: Names in the order of ``Sigmas``, for messages; numbers from zero if left out.

    Returns:
        Lower triangular, shape (R, M, n, n).

    Raises:
        InvalidInputError: If shapes do not fit or a covariance is not positive definite; names
            robot and target.
    """
    Sigmas = np.asarray(Sigmas, dtype=np.float64)
    shape = Sigmas.shape
    if len(shape) != 4 or 0 in shape or shape[2] != shape[3]:
        raise InvalidInputError(
            "prior covariances: expected one a robot and target, shape (robots, targets, n, n) or, "
            f"of a stacked state, (robots, n, n), got {shape}"
        )
    if len(robots) not in (0, shape[0]):
        raise InvalidInputError(
            f"robots: expected {shape[0]} names, one a prior covariance, got {len(robots)}"
        )
    roots = _roots(Sigmas)
    if roots is not None:
        return roots
    robot, target = next(at for at in np.ndindex(shape[:2]) if _roots(Sigmas[at]) is None)
    raise InvalidInputError(
        f"prior covariance of robot {repr(robots[robot]) if robots else robot}, target {target}: "
        f"expected a positive definite matrix, got {Sigmas[robot, target].tolist()}; a perfectly "
        "known target needs a small positive variance, not zero"
    )


def log_determinants_of(roots: FloatArray) -> FloatArray:
    """Log determinants of the covariances with these factors.

    Args:
        roots: Shape (..., n, n).

    Returns:
        Shape (...).
    """
    diagonal = np.diagonal(roots, axis1=-2, axis2=-1)
    return np.asarray(2.0 * np.log(diagonal).sum(axis=-1))


def posterior_factor(roots: FloatArray, weights: FloatArray, J: FloatArray) -> FloatArray:
    """F of the module header.

    Args:
        roots: Factors of the priors, own robot first, shape (R, ..., n, n).
        weights: Of every coordinate, shape (R, ..., n) or (R, ..., 1).
        J: Information of the robot's own measurements, shape (..., n, n), symmetric.

    Returns:
        Shape (..., n, n), F' F = Omega^-1.

    Raises:
        InvalidInputError: If the sum is not positive definite.
    """
    own = roots[0]
    ratios = np.linalg.solve(roots, np.sqrt(weights)[..., None] * own)
    middle = (_transposed(ratios) @ ratios).sum(axis=0) + _transposed(own) @ J @ own
    try:
        root = np.linalg.cholesky(middle)
    except np.linalg.LinAlgError as error:
        raise InvalidInputError(
            "information of the robot's own measurements: expected positive semidefinite matrices, "
            f"got {np.asarray(J).tolist()} (or variances of two robots differ by more than 1e14)"
        ) from error
    return np.asarray(np.linalg.solve(root, _transposed(own)))


def covariance_of(factor: FloatArray) -> FloatArray:
    """F' F, Omega^-1.

    Args:
        factor: F, shape (..., n, n).

    Returns:
        Shape (..., n, n).
    """
    return np.asarray(_transposed(factor) @ factor)


def pooled_deviation(roots: FloatArray, weights: FloatArray, deviations: FloatArray) -> FloatArray:
    """sum_j D_j Sigma_j^-1 D_j (mu_j - mu_0), what the other robots' means add to the information.

    Args:
        roots: Factors of the priors, own robot first, shape (R, ..., n, n).
        weights: Of every coordinate, shape (R, ..., n) or (R, ..., 1).
        deviations: mu_j - mu_0, shape (R, ..., n).

    Returns:
        Shape (..., n).
    """
    scales = np.sqrt(weights)
    inner = np.linalg.solve(roots, (scales * deviations)[..., None])
    return np.asarray((scales * np.linalg.solve(_transposed(roots), inner)[..., 0]).sum(axis=0))


def fused_robots(adjacency: BoolArray, robots: int) -> list[IntArray]:
    """Whose priors each robot fuses: itself first, then those it is linked to, in team order.

    Args:
        adjacency: Whether robot i has the prior of robot j, shape (N, N), diagonal false.
        robots: N.

    Returns:
        One array of indices a robot.

    Raises:
        InvalidInputError: If it is not such a matrix.
    """
    links = np.asarray(adjacency)
    if links.shape != (robots, robots) or links.dtype != np.bool_:
        raise InvalidInputError(
            f"adjacency: expected booleans of shape ({robots}, {robots}), one row a robot, got "
            f"{links.dtype} of shape {links.shape}"
        )
    loops = np.flatnonzero(np.diag(links))
    if len(loops):
        raise InvalidInputError(
            f"adjacency: expected no link of a robot to itself, got one of robot {loops[0]}; its "
            "own prior is fused anyhow"
        )
    return [np.concatenate(([i], np.flatnonzero(row))) for i, row in enumerate(links)]


def check_parts(
    Sigmas: FloatArray, parts: Sequence[slice], robots: Sequence[str] = ()
) -> list[IntArray]:
    """Coordinates of independent targets, and that no prior correlates two of them.

    Args:
        Sigmas: Priors of the stacked state, shape (R, n, n), positive definite.
        parts: Where the targets sit, in order; together they are the whole state.
        robots: Names in the order of ``Sigmas``, for messages; numbers from zero if left out.

    Returns:
        One array of coordinates a target.

    Raises:
        InvalidInputError: If the parts are not the whole state, or a prior correlates two parts.
    """
    size = Sigmas.shape[-1]
    every = np.arange(size)
    inside = [every[part] for part in parts]
    if min(map(len, inside), default=0) == 0 or np.concatenate(inside).tolist() != every.tolist():
        raise InvalidInputError(
            f"parts: expected slices that together are 0..{size - 1} in order, got {list(parts)}"
        )
    part_of = np.repeat(np.arange(len(inside)), [len(part) for part in inside])
    apart = part_of[:, None] != part_of
    deviation = np.sqrt(np.diagonal(Sigmas, axis1=-2, axis2=-1))
    limit = SYMMETRY_TOLERANCE * deviation[:, :, None] * deviation[:, None, :]
    wrong = np.argwhere(apart & (np.abs(Sigmas) > limit))
    if len(wrong):
        robot, row, column = wrong[0].tolist()
        raise InvalidInputError(
            f"prior covariance of robot {repr(robots[robot]) if robots else robot}: expected no "
            f"covariance between the parts, got {Sigmas[robot, row, column]:g} between coordinates "
            f"{row} and {column}; leave parts out: one weight a robot is safe for coupled targets"
        )
    return inside


def _roots(Sigmas: FloatArray) -> FloatArray | None:
    """Cholesky factors, or None where a matrix is not positive definite."""
    if not np.isfinite(Sigmas).all():
        return None
    try:
        return np.asarray(np.linalg.cholesky(Sigmas))
    except np.linalg.LinAlgError:
        return None


def _transposed(matrices: FloatArray) -> FloatArray:
    """Each matrix of a stack transposed."""
    return np.swapaxes(matrices, -1, -2)
