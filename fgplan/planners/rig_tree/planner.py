"""Planner ``rig_tree``."""

import numpy as np

from fgplan.planners.aia.baseline import BaselineResult, Budget, plan_mission
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.mission import Mission
from fgplan.planners.plan import Plan
from fgplan.planners.planner import Progress


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


class RigTreePlanner:
    """Planner ``rig_tree``; its options are those of ``Budget`` and ``ProblemOptions``."""

    name = "rig_tree"

    def plan(
        self, mission: Mission, generator: np.random.Generator, progress: Progress | None = None
    ) -> Plan:
        """Plan for every robot of a mission.

        Args:
            mission: Robots with sensors, and targets.
            generator: Source of every random number.
            progress: Told that it has begun.

        Returns:
            The plan.

        Raises:
            NoCandidatePathError: If no feasible plan was found within the budget.
            OptionError: If an option is not known or not usable.
        """
        return plan_mission(mission, generator, progress, self.name, solve)
