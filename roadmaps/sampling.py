"""Uniform sampling of valid positions by rejection.

A draw is uniform in the box of the bounds and kept if valid, so what is kept is uniform in the
free space. The Generator is an argument: the same seed gives the same positions.
"""

import numpy as np

from roadmaps.checks import check_count, check_generator
from roadmaps.collision import CollisionChecker
from roadmaps.errors import SamplingError
from roadmaps.typing import FloatArray


def draw_position(checker: CollisionChecker, rng: np.random.Generator) -> FloatArray:
    """Draw one position in the bounds, valid or not.

    Args:
        checker: The world.
        rng: Source of randomness.

    Returns:
        The position, shape (d,), metres.
    """
    return rng.uniform(checker.lower, checker.upper)


def sample_positions(
    checker: CollisionChecker,
    count: int,
    rng: np.random.Generator,
    *,
    max_draws_each: int = 1000,
) -> FloatArray:
    """Draw valid positions, uniform in the free space.

    Args:
        checker: The world.
        count: Number of positions.
        rng: Source of randomness.
        max_draws_each: Gives up after this many draws a wanted position.

    Returns:
        Positions, shape (count, d), metres, in the order drawn.

    Raises:
        SamplingError: If too few draws are valid.
        ParameterError: If `count` is negative, or `rng` is no Generator.
    """
    check_generator(rng)
    check_count(count, "count", minimum=0)
    check_count(max_draws_each, "max_draws_each")
    found: list[FloatArray] = []
    kept = drawn = 0
    dimension = len(checker.lower)
    while kept < count:
        if drawn >= max_draws_each * count:
            raise SamplingError(
                f"expected {count} valid positions, found {kept} in {drawn} draws; the free "
                "space is too small a part of the bounds: narrow the bounds, use a smaller "
                "robot radius, or raise max_draws_each"
            )
        rate = (kept + 1) / (drawn + 1) if drawn else 0.8
        size = int(min(max(32, 1.1 * (count - kept) / rate), 100_000, max_draws_each * count))
        draws = rng.uniform(checker.lower, checker.upper, size=(size, dimension))
        valid = draws[checker.are_positions_valid(draws)]
        found.append(valid)
        kept += len(valid)
        drawn += size
    return np.concatenate([np.zeros((0, dimension)), *found])[:count]
