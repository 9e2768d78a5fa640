"""Arguments are checked once, where they enter: converted to float64, or refused by name."""

import math
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from roadmaps.errors import ParameterError
from roadmaps.typing import FloatArray


def as_positions(values: ArrayLike, dimension: int | None, name: str) -> FloatArray:
    """Convert to an (n, dimension) array of finite positions; a single one becomes (1, d).

    Args:
        values: Positions, shape (n, dimension) or (dimension,), metres, world frame.
        dimension: Expected number of coordinates; None accepts any.
        name: What the message calls the argument.

    Returns:
        The positions, float64, shape (n, dimension).

    Raises:
        ParameterError: If the shape differs or a coordinate is not finite.
    """
    try:
        positions = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ParameterError(
            f"{name}: expected numbers of shape (n, {dimension or 'd'}), got {values!r}: {error}"
        ) from error
    if positions.ndim == 1:
        positions = positions[None, :] if positions.size else positions.reshape(0, dimension or 0)
    if positions.ndim != 2 or (dimension is not None and positions.shape[1] != dimension):
        raise ParameterError(
            f"{name}: expected positions of shape (n, {dimension or 'd'}), got shape "
            f"{np.shape(values)}; give one row of coordinates a position"
        )
    if not np.isfinite(positions).all():
        row = int(np.flatnonzero(~np.isfinite(positions).all(axis=1))[0])
        raise ParameterError(
            f"{name}: expected finite coordinates, got {positions[row].tolist()} in row {row}"
        )
    return positions


def as_position(values: ArrayLike, dimension: int | None, name: str) -> FloatArray:
    """Convert to one finite position.

    Args:
        values: Coordinates, shape (dimension,), metres, world frame.
        dimension: Expected number of coordinates; None accepts any.
        name: What the message calls the argument.

    Returns:
        The position, float64, shape (dimension,).

    Raises:
        ParameterError: If the shape differs or a coordinate is not finite.
    """
    positions = as_positions(values, dimension, name)
    if np.ndim(values) != 1 or len(positions) != 1:
        raise ParameterError(
            f"{name}: expected one position of shape ({dimension or 'd'},), "
            f"got shape {np.shape(values)}"
        )
    return cast(FloatArray, positions[0])


def check_positive(value: float, name: str) -> None:
    """Raise unless `value` is finite and greater than zero.

    Args:
        value: The number to check.
        name: What the message calls it.

    Raises:
        ParameterError: If it is not.
    """
    if not (math.isfinite(value) and value > 0.0):
        raise ParameterError(f"{name}: expected a finite number greater than 0, got {value!r}")


def check_non_negative(value: float, name: str) -> None:
    """Raise unless `value` is finite and not negative.

    Args:
        value: The number to check.
        name: What the message calls it.

    Raises:
        ParameterError: If it is not.
    """
    if not (math.isfinite(value) and value >= 0.0):
        raise ParameterError(f"{name}: expected a finite number of at least 0, got {value!r}")


def check_count(value: int, name: str, minimum: int = 1) -> None:
    """Raise unless `value` is an integer of at least `minimum`.

    Args:
        value: The number to check.
        name: What the message calls it.
        minimum: Smallest number allowed.

    Raises:
        ParameterError: If it is not.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < minimum:
        raise ParameterError(f"{name}: expected an integer of at least {minimum}, got {value!r}")


def check_generator(rng: object) -> np.random.Generator:
    """Give `rng` back, or raise unless it is a Generator.

    Args:
        rng: Source of randomness.

    Returns:
        The same object.

    Raises:
        ParameterError: If it is something else, such as a seed.
    """
    if not isinstance(rng, np.random.Generator):
        raise ParameterError(
            f"rng: expected a numpy.random.Generator, got {rng!r}; pass "
            f"numpy.random.default_rng({rng if isinstance(rng, int) else 'seed'})"
        )
    return rng


def read_only(array: FloatArray) -> FloatArray:
    """Return a contiguous copy of `array` that cannot be written to.

    Args:
        array: Any float array.

    Returns:
        The copy, same shape.
    """
    copy = np.array(array, dtype=np.float64, order="C")
    copy.flags.writeable = False
    return copy
