"""Planner ``fvi``."""

import numpy as np

from fgplan.planners.aia.baseline import BaselinePlanner, BaselineResult, Budget
from fgplan.planners.aia.problem import AcquisitionProblem


def solve(
    problem: AcquisitionProblem, budget: Budget, generator: np.random.Generator
) -> BaselineResult:
    """Plan by feedforward value iteration.

    Args:
        problem: What is planned for.
        budget: When to give up.
        generator: Source of random numbers.

    Returns:
        The path found.
    """
    from fgplan.planners.fvi.iteration import iterate_values

    return iterate_values(problem, budget, generator)


PLANNER = BaselinePlanner("fvi", solve)
"""The planner, as the registry finds it."""
