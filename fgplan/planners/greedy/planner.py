"""Planner ``greedy``."""

import numpy as np

from fgplan.planners.aia.baseline import BaselinePlanner, BaselineResult, Budget
from fgplan.planners.aia.problem import AcquisitionProblem


def solve(
    problem: AcquisitionProblem, budget: Budget, generator: np.random.Generator
) -> BaselineResult:
    """Plan greedily, each robot for itself.

    Args:
        problem: What is planned for.
        budget: When to give up.
        generator: Source of random numbers.

    Returns:
        The path found.
    """
    from fgplan.planners.greedy.choice import choose_greedily

    return choose_greedily(problem, budget, generator, alone=True)


PLANNER = BaselinePlanner("greedy", solve)
"""The planner, as the registry finds it."""
