"""Argument checks: what GTSAM would silently accept is refused here, by name.

Each check returns the value as a read-only float64 array, so that a product is checked and frozen
in one call.
"""

import math
from collections.abc import Callable

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.typing import ArrayLike, Covariance, FloatArray

SYMMETRY_TOLERANCE = 1e-9
"""Largest |M - M'| accepted, relative to the largest entry."""

CONDITION_LIMIT = 1e14
"""Largest ratio of eigenvalues of a covariance, after scaling its diagonal to one."""


def frozen(values: ArrayLike) -> FloatArray:
    """Copy to a read-only float64 array."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def check_finite(values: ArrayLike, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    """Check that an array is finite and has a shape.

    Args:
        values: The array.
        name: What it is, for the message.
        shape: Expected shape; None stands for any size.

    Returns:
        A read-only float64 copy.

    Raises:
        InvalidInputError: If the array is not numeric, not finite or has another shape.
    """
    try:
        array = frozen(values)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: expected numbers, got {values!r}") from error
    matches = array.shape == shape or (
        len(array.shape) == len(shape)
        and all(size is None or size == have for size, have in zip(shape, array.shape, strict=True))
    )
    if not matches:
        wanted = "(" + ", ".join("any" if size is None else str(size) for size in shape) + ")"
        raise InvalidInputError(f"{name}: expected shape {wanted}, got {array.shape}")
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InvalidInputError(f"{name}: expected finite numbers, got {array[where]} at {where}")
    return array


def check_positive(value: float, name: str) -> float:
    """Check that a scalar is finite and above zero.

    Raises:
        InvalidInputError: If it is not.
    """
    if not (isinstance(value, int | float | np.floating | np.integer) and math.isfinite(value)):
        raise InvalidInputError(f"{name}: expected a finite number above zero, got {value!r}")
    if value <= 0.0:
        raise InvalidInputError(f"{name}: expected a number above zero, got {value!r}")
    return float(value)


def check_not_negative(value: float, name: str) -> float:
    """Check that a scalar is finite and at least zero.

    Raises:
        InvalidInputError: If it is not.
    """
    if not (isinstance(value, int | float | np.floating | np.integer) and math.isfinite(value)):
        raise InvalidInputError(f"{name}: expected a finite number, zero or more, got {value!r}")
    if value < 0.0:
        raise InvalidInputError(f"{name}: expected zero or more, got {value!r}")
    return float(value)


def check_generator(generator: object, name: str) -> np.random.Generator:
    """Check that a source of randomness is a Generator.

    Args:
        generator: It.
        name: Whose it is, for the message.

    Returns:
        The same object.

    Raises:
        InvalidInputError: If it is something else, such as a seed.
    """
    if not isinstance(generator, np.random.Generator):
        seed = generator if isinstance(generator, int) else "seed"
        raise InvalidInputError(
            f"{name}: generator: expected a numpy.random.Generator, got {generator!r}; pass "
            f"numpy.random.default_rng({seed})"
        )
    return generator


def check_covariance(values: ArrayLike, name: str, size: int | None = None) -> Covariance:
    """Check that a matrix is a covariance: square, finite, symmetric, positive definite.

    Args:
        values: Shape (n, n).
        name: What it is, for the message.
        size: Expected n, or None for any.

    Returns:
        A read-only copy, exactly symmetric.

    Raises:
        InvalidInputError: If it is not; GTSAM would take any of these without a word.
    """
    matrix = _check_symmetric(values, name, size)
    diagonal = np.diag(matrix)
    if (diagonal <= 0.0).any():
        worst = int(np.argmin(diagonal))
        raise InvalidInputError(
            f"{name}: expected positive variances, got {diagonal[worst]:g} at index {worst}; "
            "a perfectly known quantity needs a small positive variance, not zero"
        )
    scale = 1.0 / np.sqrt(diagonal)
    eigenvalues = np.linalg.eigvalsh(matrix * np.outer(scale, scale))
    if eigenvalues[0] <= eigenvalues[-1] / CONDITION_LIMIT:
        raise InvalidInputError(
            f"{name}: expected a positive definite matrix, got smallest eigenvalue "
            f"{eigenvalues[0]:g} (diagonal scaled to one); check signs of the off-diagonal entries"
        )
    return matrix


def check_covariances(values: FloatArray, name: Callable[[int], str]) -> FloatArray:
    """Check a stack of covariances at once.

    Args:
        values: Shape (K, n, n).
        name: What each of them is, for the message.

    Returns:
        Shape (K, n, n), read-only, exactly symmetric.

    Raises:
        InvalidInputError: If one of them is none; see ``check_covariance``.
    """
    variances = np.diagonal(values, axis1=1, axis2=2)
    if np.isfinite(values).all() and (variances > 0.0).all():
        if np.count_nonzero(values) == variances.size:
            return frozen(values)
        if (values == np.swapaxes(values, 1, 2)).all():
            scale = 1.0 / np.sqrt(variances)
            scaled = values * (scale[:, :, None] * scale[:, None, :])
            eigenvalues = np.linalg.eigvalsh(scaled)
            if (eigenvalues[:, 0] > eigenvalues[:, -1] / CONDITION_LIMIT).all():
                return frozen(values)
    checked = [check_covariance(matrix, name(index)) for index, matrix in enumerate(values)]
    return frozen(np.reshape(checked, values.shape))


def check_semidefinite(values: ArrayLike, name: str, size: int | None = None) -> Covariance:
    """Check that a matrix is symmetric and positive semidefinite; zero is allowed.

    Args:
        values: Shape (n, n).
        name: What it is, for the message.
        size: Expected n, or None for any.

    Returns:
        A read-only copy, exactly symmetric.

    Raises:
        InvalidInputError: If it is not.
    """
    matrix = _check_symmetric(values, name, size)
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest < -SYMMETRY_TOLERANCE * float(np.abs(matrix).max()):
        raise InvalidInputError(
            f"{name}: expected a positive semidefinite matrix, got an eigenvalue of {smallest:g}; "
            "check signs"
        )
    return matrix


def _check_symmetric(values: ArrayLike, name: str, size: int | None) -> FloatArray:
    """Square, finite and symmetric; returned read-only and exactly symmetric."""
    matrix = check_finite(values, name, (size, size))
    if matrix.shape[0] != matrix.shape[1] or matrix.shape[0] == 0:
        raise InvalidInputError(f"{name}: expected a square matrix, got shape {matrix.shape}")
    asymmetry = float(np.abs(matrix - matrix.T).max())
    if asymmetry > SYMMETRY_TOLERANCE * float(np.abs(matrix).max()):
        raise InvalidInputError(
            f"{name}: expected a symmetric matrix, got |M - M'| up to {asymmetry:g}; "
            "symmetrise it as (M + M') / 2 if the difference is rounding"
        )
    return frozen(0.5 * (matrix + matrix.T))
