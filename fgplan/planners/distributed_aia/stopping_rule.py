"""When a robot knows that its team is done: the rule of section VI-B of Tzes et al. 2021.

"The planning terminates once a robot realizes that the targets have been identified either by
itself and/or by any of the neighboring robots":

    robot i knows at t  iff  for every target k  det Sigma_j^k(t) <= delta_k
                             at j = i or at some j that i is linked to at t

(or whatever uncertainty function the constraint has). The terminal constraint at one robot is the
same with j = i alone, so the rule never comes later. It reads
covariances only, planned or filtered.
"""

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.models.uncertainty import uncertainty_function
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.extraction import replay, team_parts
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.typing import BoolArray, FloatArray, IntArray


def satisfied_targets(problem: AcquisitionProblem, covariances: FloatArray) -> BoolArray:
    """Which targets satisfy the terminal constraint.

    Args:
        problem: Its terminal constraint holds for each target.
        covariances: Shape (..., M, 2, 2), square metres.

    Returns:
        Shape (..., M).

    Raises:
        InvalidInputError: If the constraint is of the joint covariance.
    """
    terminal = problem.terminal
    if terminal.scope != "each":
        raise InvalidInputError(
            "stopping rule: expected a terminal constraint for each target, got one of the "
            f"{terminal.scope} covariance, which no target satisfies on its own"
        )
    function = uncertainty_function(terminal.function)
    limits = terminal.limits(problem.targets)
    out = np.empty(covariances.shape[:-2], dtype=np.bool_)
    for k, prior in enumerate(problem.priors):
        numbers = function.evaluate(covariances[..., k, :, :], prior)
        out[..., k] = numbers >= limits[k] if function.needs_prior else numbers <= limits[k]
    return out


def links_along(graph: CommunicationGraph, poses: FloatArray) -> BoolArray:
    """Links of every step of a team's path.

    Args:
        graph: Who hears whom.
        poses: Shape (T + 1, N, 3), world frame.

    Returns:
        Shape (T + 1, N, N).
    """
    return np.array([graph.links(t, now[:, :2]) for t, now in enumerate(poses)])


def knows_done(satisfied: BoolArray, links: BoolArray) -> BoolArray:
    """Whether each robot knows that every target is satisfied, at itself or at a linked robot.

    Args:
        satisfied: By robot and target, shape (..., N, M).
        links: Who hears whom, shape (..., N, N).

    Returns:
        Shape (..., N).
    """
    heard = links[..., None] & satisfied[..., None, :, :]
    return np.asarray((satisfied | heard.any(axis=-2)).all(axis=-1))


def first_steps(knows: BoolArray) -> IntArray:
    """First step at which each robot knows.

    Args:
        knows: Shape (T + 1, N).

    Returns:
        Shape (N,), -1 for never.
    """
    return np.where(knows.any(axis=0), knows.argmax(axis=0), -1)


def stopping_steps(knows: BoolArray, graph: CommunicationGraph) -> IntArray:
    """Step at which each robot's part of the team stops: when its first robot knows.

    Args:
        knows: Shape (T + 1, N).
        graph: Who hears whom; robots that no way of communicating joins stop on their own.

    Returns:
        Shape (N,), -1 for never.
    """
    steps = np.empty(knows.shape[1], dtype=np.int64)
    for part in team_parts(graph):
        anybody = np.asarray(knows[:, list(part)].any(axis=1))
        steps[list(part)] = first_steps(anybody[:, None])
    return steps


def rule_steps(problem: AcquisitionProblem, graph: CommunicationGraph, plan: TeamPlan) -> IntArray:
    """Step of a plan at which the rule stops each robot.

    Args:
        problem: What was planned for.
        graph: Who hears whom.
        plan: The plan.

    Returns:
        Shape (N,); never later than the plan's own horizons.

    Raises:
        InvalidInputError: If the terminal constraint is of the joint covariance.
    """
    satisfied = satisfied_targets(problem, plan.covariances)
    steps = stopping_steps(knows_done(satisfied, links_along(graph, plan.poses)), graph)
    # Where rounding at the limit hides the step at which the replay ended, that step stays.
    return np.where(steps < 0, plan.horizons, np.minimum(steps, plan.horizons))


def cut_by_rule(growth: ForestGrowth, plan: TeamPlan) -> TeamPlan:
    """The plan as far as the rule lets it go; robots that have stopped stay where they are.

    Args:
        growth: Problem, graph and options of the plan.
        plan: The plan.

    Returns:
        A replayed plan of the same or a shorter horizon. Its ``satisfied`` may be false at every
        robot: what one of them knows, it may know of its neighbours.

    Raises:
        InvalidInputError: If the terminal constraint is of the joint covariance.
    """
    horizons = rule_steps(growth.problem, growth.graph, plan)
    last = int(horizons.max())
    poses = np.array(plan.poses[: last + 1])
    for j, horizon in enumerate(horizons):
        poses[horizon:, j] = poses[horizon, j]
    rows, terms, shortfalls = replay(growth, poses)
    team = np.arange(len(horizons))
    blocks = rows.reshape(*rows.shape[:2], growth.problem.targets, 3)[..., [0, 1, 1, 2]]
    return TeamPlan(
        poses=poses,
        covariances=blocks.reshape(*blocks.shape[:3], 2, 2),
        horizons=horizons,
        satisfied=shortfalls[horizons, team] <= 1.0,
        cost=float(sum(terms[: h + 1, j].sum() for j, h in enumerate(horizons))),
        assigned=plan.assigned[: last + 1],
        origins=plan.origins,
    )
