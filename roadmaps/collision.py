"""What a builder asks of the world: which positions and which motions are valid.

Any dimension. `Workspace` answers for one disc-shaped robot in the plane; `SampledChecker` turns
a predicate on positions (a team's joint position, say) into an answer for motions, by testing
points along them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from roadmaps.checks import as_position, as_positions, check_positive, read_only
from roadmaps.errors import InvalidPositionError, ParameterError, WorkspaceError
from roadmaps.typing import BoolArray, FloatArray


class CollisionChecker(Protocol):
    """The world as a builder sees it; positions are rows of d coordinates."""

    @property
    def lower(self) -> FloatArray:
        """Least valid coordinates, shape (d,)."""

    @property
    def upper(self) -> FloatArray:
        """Greatest valid coordinates, shape (d,)."""

    def are_positions_valid(self, positions: ArrayLike) -> BoolArray:
        """Tell which positions, shape (n, d), are valid; shape (n,)."""

    def are_motions_valid(self, starts: ArrayLike, ends: ArrayLike) -> BoolArray:
        """Tell which straight motions between rows, shape (n, d) each, are valid; shape (n,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledChecker:
    """Validity from a predicate on positions, motions by points along them.

    A motion is valid if points at most `step_m` apart along it, both ends included, are. Thinner
    obstacles can be missed: choose `step_m` less than what must not be crossed.

    Attributes:
        lower: Least coordinates, shape (d,), metres.
        upper: Greatest coordinates, shape (d,), metres.
        are_valid: Takes positions of shape (n, d), returns booleans of shape (n,). It need not
            test the bounds.
        step_m: Greatest distance between tested points, metres (Euclidean norm in d dimensions).

    Raises:
        WorkspaceError: If a lower bound is not below its upper bound.
        ParameterError: If `step_m` is not positive.

    Example:
        Two robots on a line that must keep 1 m apart:

        >>> team = SampledChecker(
        ...     lower=[0, 0], upper=[9, 9], step_m=0.1,
        ...     are_valid=lambda p: abs(p[:, 0] - p[:, 1]) >= 1.0,
        ... )
        >>> team.are_motions_valid([[0, 5]], [[5, 6]]), team.are_motions_valid([[0, 5]], [[5, 0]])
        (array([ True]), array([False]))
    """

    lower: FloatArray
    upper: FloatArray
    are_valid: Callable[[FloatArray], BoolArray]
    step_m: float

    def __post_init__(self) -> None:
        lower, upper = as_bounds(self.lower, self.upper, None)
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)
        check_positive(self.step_m, "step_m")

    def are_positions_valid(self, positions: ArrayLike) -> BoolArray:
        """Tell which positions are within the bounds and valid.

        Args:
            positions: Shape (n, d) or (d,), metres.

        Returns:
            True where valid, shape (n,).

        Raises:
            ParameterError: If the predicate returns another shape.
        """
        points = as_positions(positions, len(self.lower), "positions")
        valid = np.asarray(self.are_valid(points), dtype=np.bool_)
        if valid.shape != (len(points),):
            raise ParameterError(
                f"are_valid: expected booleans of shape ({len(points)},), got {valid.shape}"
            )
        return np.asarray(valid & are_within(self.lower, self.upper, points))

    def are_motions_valid(self, starts: ArrayLike, ends: ArrayLike) -> BoolArray:
        """Tell which motions are valid at every tested point.

        Args:
            starts: Shape (n, d) or (d,), metres; one row serves all of `ends`.
            ends: Shape (n, d) or (d,), metres; one row serves all of `starts`.

        Returns:
            True where valid, shape (n,).
        """
        first, last = as_motions(starts, ends, len(self.lower))
        counts = np.ceil(np.linalg.norm(last - first, axis=1) / self.step_m).astype(np.int64) + 1
        counts = np.maximum(counts, 2)
        owner = np.repeat(np.arange(len(first)), counts)
        rank = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = rank / (counts[owner] - 1)
        points = first[owner] + share[:, None] * (last[owner] - first[owner])
        points[rank == counts[owner] - 1] = last
        invalid = ~self.are_positions_valid(points)
        valid = np.ones(len(first), dtype=np.bool_)
        valid[owner[invalid]] = False
        return valid


def as_bounds(
    lower: ArrayLike, upper: ArrayLike, dimension: int | None
) -> tuple[FloatArray, FloatArray]:
    """Check a rectangle (a box in d dimensions).

    Args:
        lower: Least coordinates, shape (d,), metres.
        upper: Greatest coordinates, shape (d,), metres.
        dimension: Expected d; None accepts any.

    Returns:
        Both, float64, read-only.

    Raises:
        WorkspaceError: If shapes differ or a lower bound is not below its upper bound.
    """
    try:
        low = read_only(as_position(lower, dimension, "lower"))
        high = read_only(as_position(upper, len(low), "upper"))
    except ParameterError as error:
        raise WorkspaceError(str(error)) from error
    if not (low < high).all():
        raise WorkspaceError(
            f"bounds: expected lower < upper on every axis, got {low.tolist()} and {high.tolist()}"
        )
    return low, high


def are_within(lower: FloatArray, upper: FloatArray, positions: FloatArray) -> BoolArray:
    """Tell which positions are within bounds, the bounds included.

    Args:
        lower: Least coordinates, shape (d,), metres.
        upper: Greatest coordinates, shape (d,), metres.
        positions: Shape (n, d), metres.

    Returns:
        True where within, shape (n,).
    """
    return np.asarray(((positions >= lower) & (positions <= upper)).all(axis=1))


def as_motions(starts: ArrayLike, ends: ArrayLike, dimension: int) -> tuple[FloatArray, FloatArray]:
    """Pair the ends of motions row by row; a single row serves all of the other argument.

    Args:
        starts: Shape (n, dimension) or (dimension,), metres.
        ends: Shape (n, dimension) or (dimension,), metres.
        dimension: Number of coordinates.

    Returns:
        Both, shape (n, dimension).

    Raises:
        ParameterError: If the numbers of rows differ and neither is one.
    """
    first = as_positions(starts, dimension, "starts")
    last = as_positions(ends, dimension, "ends")
    if len(first) != len(last):
        if 1 not in (len(first), len(last)):
            raise ParameterError(
                f"starts and ends: expected as many rows in both, got {len(first)} and {len(last)}"
            )
        first, last = np.broadcast_arrays(first, last)
    return first, last


def check_position_valid(checker: CollisionChecker, position: ArrayLike, name: str) -> FloatArray:
    """Raise unless a position is valid.

    Args:
        checker: The world.
        position: Shape (d,), metres.
        name: What the message calls it, such as "start".

    Returns:
        The position, float64, shape (d,).

    Raises:
        InvalidPositionError: If it is outside the bounds or touches an obstacle.
    """
    point = as_position(position, len(checker.lower), name)
    if not are_within(checker.lower, checker.upper, point[None]).all():
        raise InvalidPositionError(
            f"{name}: expected a position within {checker.lower.tolist()} to "
            f"{checker.upper.tolist()}, got {point.tolist()}; move it or widen the bounds"
        )
    if not checker.are_positions_valid(point[None]).all():
        raise InvalidPositionError(
            f"{name}: expected a free position, but {point.tolist()} touches an obstacle (or is "
            "nearer to one than the robot's radius, or in an unknown cell); move it, or check "
            "the robot's radius and how unknown cells count"
        )
    return point
