"""Planner ``rig_tree``."""

import numpy as np

from fgplan.planners.aia.baseline import BaselinePlanner, BaselineResult, Budget
from fgplan.planners.aia.problem import AcquisitionProblem


def solve(
    problem: AcquisitionProblem, budget: Budget, generator: np.random.Generator
) -> BaselineResult:
    """Plan by the adapted RIG-tree.

    Args:
        problem: What is planned for.
        budget: When to give up.
        generator: Source of random numbers.

    Returns:
        The path found.
    """
    from fgplan.planners.rig_tree.growth import grow_rig_tree

    return grow_rig_tree(problem, budget, generator)


PLANNER = BaselinePlanner("rig_tree", solve)
"""The planner, as the registry finds it."""
