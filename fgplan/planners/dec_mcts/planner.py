"""Planner ``dec_mcts``."""

import numpy as np

from fgplan.planners.aia.baseline import BaselinePlanner, BaselineResult, Budget
from fgplan.planners.aia.problem import AcquisitionProblem


def solve(
    problem: AcquisitionProblem, budget: Budget, generator: np.random.Generator
) -> BaselineResult:
    """Plan by Dec-MCTS.

    Args:
        problem: What is planned for.
        budget: When to give up.
        generator: Source of random numbers.

    Returns:
        The path found.
    """
    from fgplan.planners.dec_mcts.search import search_decentralised

    return search_decentralised(problem, budget, generator)


PLANNER = BaselinePlanner("dec_mcts", solve)
"""The planner, as the registry finds it."""
