"""What each robot comes to, and what the team comes to by that.

Each part of the team holds one plan, the same at all its members; the plans of all parts together
are replayed once more and are the team's.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.search import Ending
from fgplan.planners.distributed_aia.extraction import replayed, team_parts
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.options import DistributedOptions
from fgplan.planners.distributed_aia.plan_messages import PlanMessage
from fgplan.planners.distributed_aia.robot_state import RobotState
from fgplan.planners.distributed_aia.search import DistributedResult
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.threads import one_blas_thread


class RobotOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """What one robot came to.

    Attributes:
        ending: Why it grows no more.
        plan: The plan of its part of the team, None for none.
        sweeps: Its iterations.
        shortfall: Least shortfall of any of its nodes.
        farthest: Target farthest from its limit there; empty of a joint constraint.
        counts: What was counted.
        bytes_per_node: Memory by room for a node.
        replayed: Team paths replayed and refused.
    """

    ending: str
    plan: PlanMessage | None
    sweeps: int
    shortfall: float
    farthest: str
    counts: dict[str, int]
    bytes_per_node: float
    replayed: tuple[int, int]


def outcome_of(state: RobotState) -> RobotOutcome:
    """What a robot came to.

    Args:
        state: At the end.
    """
    return RobotOutcome(
        ending=state.ending or "interrupted",
        plan=state.plan,
        sweeps=state.growth.sweep,
        shortfall=state.growth.shortfall,
        farthest=state.growth.farthest,
        counts=state.growth.counted(),
        bytes_per_node=state.growth.bytes_per_node,
        replayed=state.replayed,
    )


def report_of(state: RobotState) -> dict[str, Any]:
    """What a robot came to, as plain data.

    Args:
        state: At the end.
    """
    return dict(msgspec.to_builtins(outcome_of(state), builtin_types=(bytes,)))


def progress_of(state: RobotState) -> tuple[int, int, str]:
    """How far a robot is: sweeps done, sweeps in all.

    Args:
        state: The robot.
    """
    growth = state.growth
    doing = f"sweeps; worst target {growth.shortfall:.3g}"
    return growth.sweep, state.setup.options.iterations or 0, doing


def joined_plan(growth: ForestGrowth, plans: Sequence[PlanMessage | None]) -> TeamPlan | None:
    """The plan that the robots hold, each part of the team its own.

    Args:
        growth: Of any robot.
        plans: Of each robot, in the order of the team; None also for one that is not heard of.

    Returns:
        The plan; None if a part has none.
    """
    ways, origins = {}, []
    for part in team_parts(growth.graph):
        held = [plan for plan in (plans[robot] for robot in part) if plan is not None]
        if not held:
            return None
        plan = min(held, key=lambda one: one.key)
        ways.update(plan.ways())
        origins.append((plan.origin, plan.goal))
    return replayed(growth, ways, origins)


def joined_result(
    growth: ForestGrowth,
    outcomes: Sequence[RobotOutcome | None],
    seconds: Mapping[str, float],
    *,
    reason: str = "",
) -> DistributedResult:
    """What the team came to.

    Args:
        growth: Of any robot.
        outcomes: Of each robot, in the order of the team; None for one that was lost.
        seconds: Real seconds by stage.
        reason: Why the constraint is unreachable, if it is.

    Returns:
        The plan and what was counted.
    """
    there = [outcome for outcome in outcomes if outcome is not None]
    counts: dict[str, int] = {}
    for outcome in there:
        for name, number in outcome.counts.items():
            counts[name] = counts.get(name, 0) + number
    nearest = min(there, key=lambda outcome: outcome.shortfall)
    endings = ["lost" if one is None else one.ending for one in outcomes]
    return DistributedResult(
        plan=joined_plan(growth, [None if one is None else one.plan for one in outcomes]),
        ending="unreachable" if reason else _ending(endings),
        sweeps=max(outcome.sweeps for outcome in there),
        shortfall=nearest.shortfall,
        farthest=nearest.farthest,
        counts=counts,
        bytes_per_node=there[0].bytes_per_node,
        seconds=dict(seconds),
        candidates=sum(outcome.replayed[0] for outcome in there),
        refused=sum(outcome.replayed[1] for outcome in there),
        reason=reason,
    )


@one_blas_thread()
def result_of_reports(
    problem: AcquisitionProblem,
    options: DistributedOptions,
    graph: CommunicationGraph,
    generator: np.random.Generator,
    reports: Mapping[str, Any],
) -> DistributedResult:
    """What the team came to, from what its robots handed in.

    Args:
        problem: What was planned for.
        options: How.
        graph: Who hears whom.
        generator: Source of the robots' random numbers, new.
        reports: As ``report_of`` gives them, by robot; of those that were not lost.

    Returns:
        The plan and what was counted; no seconds.

    Raises:
        InvalidInputError: If a report is malformed, or there is none.
    """
    outcomes: list[RobotOutcome | None] = []
    for robot in problem.robots:
        if robot.name not in reports:
            outcomes.append(None)
            continue
        try:
            outcomes.append(msgspec.convert(reports[robot.name], RobotOutcome))
        except msgspec.ValidationError as error:
            raise InvalidInputError(f"report of robot {robot.name!r}: {error}") from error
    if not any(outcomes):
        raise InvalidInputError("reports: expected one of a robot at least, got none")
    generators = generator.spawn(len(problem.robots))
    growth = ForestGrowth(problem, options, graph, generators, robot=0)
    return joined_result(growth, outcomes, {})


def _ending(endings: Sequence[str]) -> Ending:
    """One word for the team."""
    words: tuple[Ending, ...] = ("interrupted", "lost", "nodes", "iterations")
    return next((word for word in words if word in endings), "feasible")
