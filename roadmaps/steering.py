"""How a tree grows from one position towards another, what that costs, and who is near.

The defaults are Euclidean and of any dimension; a team's joint space passes its own functions.
RRT* and RRG also join two vertices that exist, directly: they need every short motion to be
possible. RRT joins only what `steer` has reached, and so serves where that is not the case.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from roadmaps.checks import check_positive
from roadmaps.collision import as_bounds
from roadmaps.typing import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Steering:
    """The functions that a growing tree or graph asks.

    Attributes:
        steer: Takes an origin and a target, each (d,); returns the position to grow to, (d,),
            and the target itself, unchanged, where it can be reached in one step.
        distances: Takes positions (n, d) and one target (d,); returns (n,): from which vertex
            to grow is decided by it.
        costs: Takes starts and ends, each (n, d); returns the cost of each motion, (n,),
            positive, additive along a path, metres unless the user means otherwise.
        near_radius: Takes the number of vertices; returns the distance (in `distances`) within
            which RRT* and RRG look for neighbours.
    """

    steer: Callable[[FloatArray, FloatArray], FloatArray]
    distances: Callable[[FloatArray, FloatArray], FloatArray]
    costs: Callable[[FloatArray, FloatArray], FloatArray]
    near_radius: Callable[[int], float]


def euclidean_distances(positions: FloatArray, target: FloatArray) -> FloatArray:
    """Euclidean distance of each position to a target.

    Args:
        positions: Shape (n, d), metres.
        target: Shape (d,), metres.

    Returns:
        Shape (n,), metres.
    """
    difference = positions - target
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", difference, difference)))


def euclidean_costs(starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Euclidean length of each motion.

    Args:
        starts: Shape (n, d), metres.
        ends: Shape (n, d), metres.

    Returns:
        Shape (n,), metres.
    """
    return euclidean_distances(ends - starts, np.zeros(ends.shape[1]))


def steer_straight(step_m: float) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Make a function that steps straight towards a target, at most `step_m` far.

    Args:
        step_m: Greatest step, metres.

    Returns:
        The function, as in `Steering.steer`.

    Raises:
        ParameterError: If `step_m` is not positive.
    """
    check_positive(step_m, "step_m")

    def steer(origin: FloatArray, target: FloatArray) -> FloatArray:
        difference = target - origin
        distance = math.sqrt(float(difference @ difference))
        if distance <= step_m:
            return target
        return np.asarray(origin + (step_m / distance) * difference)

    return steer


def euclidean_steering(
    step_m: float, lower: ArrayLike, upper: ArrayLike, *, gamma: float | None = None
) -> Steering:
    """Make straight steps with Euclidean distance and cost, and the shrinking radius of RRT*.

    The radius at n vertices is min(gamma (log n / n)^(1/d), step_m).

    Args:
        step_m: Greatest step, metres.
        lower: Least coordinates of the space, shape (d,), metres.
        upper: Greatest coordinates of the space, shape (d,), metres.
        gamma: Metres. None takes 1.001 times 2 (1 + 1/d)^(1/d) (volume / unit ball)^(1/d), with
            the volume of the bounds: not less than that of the free space, as optimality asks.

    Returns:
        The functions.

    Raises:
        ParameterError: If `step_m` or `gamma` is not positive.
        WorkspaceError: If a lower bound is not below its upper bound.

    References:
        Karaman and Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR
        30(7), 2011, doi:10.1177/0278364911406761.
    """
    low, high = as_bounds(lower, upper, None)
    dimension = len(low)
    if gamma is None:
        unit_ball = math.pi ** (dimension / 2) / math.gamma(dimension / 2 + 1)
        volume = float(np.prod(high - low))
        gamma = 2.002 * ((1 + 1 / dimension) * volume / unit_ball) ** (1 / dimension)
    check_positive(gamma, "gamma")
    scale = gamma

    def near_radius(count: int) -> float:
        if count < 2:
            return step_m
        return float(min(scale * (math.log(count) / count) ** (1 / dimension), step_m))

    return Steering(
        steer=steer_straight(step_m),
        distances=euclidean_distances,
        costs=euclidean_costs,
        near_radius=near_radius,
    )
