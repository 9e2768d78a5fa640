"""Revisits and oscillations of a plan, counted, of which section VI-B of Tzes et al. 2021 speaks.

"Robots may revisit targets that have already been satisfied"; without communication they "oscillate
between the two moving targets".

A revisit: a robot comes to where it can sense a target (range and line of sight, from one step to
the next) that is already satisfied at that robot. An oscillation: the target that a robot is
assigned changes back to one that it was assigned before. Both end with the robot's own horizon.
"""

import numpy as np

from fgplan.models.sensor import AbstractSensor
from fgplan.planners.aia.mission_problem import target_positions
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.stopping_rule import satisfied_targets
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.typing import BoolArray, IntArray


def count_revisits(problem: AcquisitionProblem, plan: TeamPlan) -> IntArray:
    """Visits to targets that are satisfied already.

    Args:
        problem: What was planned for; its constraint holds for each target.
        plan: The plan.

    Returns:
        Number of each robot, shape (N,).
    """
    senses = sensed(problem, plan)
    satisfied = satisfied_targets(problem, plan.covariances)
    enters = senses[1:] & ~senses[:-1] & satisfied[1:]
    counts = [enters[:horizon, j].sum() for j, horizon in enumerate(plan.horizons)]
    return np.array(counts, dtype=np.int64)


def count_oscillations(plan: TeamPlan) -> IntArray:
    """Changes back to a target that was assigned before.

    Args:
        plan: The plan.

    Returns:
        Number of each robot, shape (N,).
    """
    counts = []
    for j, horizon in enumerate(plan.horizons):
        held = plan.assigned[: horizon + 1, j].tolist()
        changes = [t for t in range(1, len(held)) if held[t] != held[t - 1]]
        counts.append(sum(held[t] in held[: t - 1] for t in changes))
    return np.array(counts, dtype=np.int64)


def sensed(problem: AcquisitionProblem, plan: TeamPlan) -> BoolArray:
    """Whether each robot can sense each target's predicted place at each step.

    Args:
        problem: What was planned for.
        plan: The plan.

    Returns:
        Shape (F + 1, N, M).
    """
    places = target_positions(problem, plan.horizon)
    out = np.zeros((*plan.poses.shape[:2], problem.targets), dtype=np.bool_)
    for t, j, k in np.ndindex(out.shape):
        out[t, j, k] = any(
            sensor.visible(plan.poses[t, j], places[t, k], problem.workspace)
            for sensor in problem.robots[j].sensors
            if isinstance(sensor, AbstractSensor)
        )
    return out
