"""The planner's robots run by their own ``step`` over a transport of this process.

What ``search`` does on shared arrays, robots that talk through messages alone do here, to the same
trees and the same plan where no message is lost or late; where some are, the trees stay valid and
the plan satisfies the constraint all the same.
"""

import time

import numpy as np

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.planners.aia.lower_bound import unreachable_reason
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.extraction import team_parts
from fgplan.planners.distributed_aia.options import DistributedOptions
from fgplan.planners.distributed_aia.robot import step
from fgplan.planners.distributed_aia.robot_outcome import (
    joined_plan,
    joined_result,
    outcome_of,
)
from fgplan.planners.distributed_aia.robot_state import RobotSetup, RobotState, start_robot
from fgplan.planners.distributed_aia.search import DistributedResult
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.loop import run_robots
from fgplan.team.transport import SimulatedTransport
from fgplan.threads import one_blas_thread


def set_up_robots(
    problem: AcquisitionProblem,
    options: DistributedOptions,
    graph: CommunicationGraph,
    generator: np.random.Generator,
    *,
    wait_s: float = 1.0,
    session: int = 0,
) -> dict[str, RobotState]:
    """The robots of a team before their first steps.

    Args:
        problem: What is planned for.
        options: How.
        graph: Who hears whom.
        generator: Source of every random number; each robot has a stream of its own.
        wait_s: Seconds after which a robot no longer waits for a neighbour.
        session: Number of the planning session.

    Returns:
        State of each robot, in the order of the team.

    Raises:
        InvalidInputError: If the problem is of a kind that these trees do not know, or a limit in
            seconds is asked for, which no clock of messages can keep.
    """
    generators = generator.spawn(len(problem.robots))
    states: dict[str, RobotState] = {}
    fields = None
    for j, robot in enumerate(problem.robots):
        setup = _setup(j, options, graph, wait_s=wait_s, session=session)
        states[robot.name] = start_robot(problem, setup, generators, fields)
        fields = states[robot.name].growth.prepared.fields
    return states


def set_up_robot(
    problem: AcquisitionProblem,
    options: DistributedOptions,
    graph: CommunicationGraph,
    generator: np.random.Generator,
    robot: str,
    *,
    wait_s: float = 1.0,
    session: int = 0,
) -> RobotState:
    """One robot of ``set_up_robots``, alone: equal to the one that is made with the others.

    Args:
        problem: What is planned for.
        options: How.
        graph: Who hears whom.
        generator: Source of every random number; each robot has a stream of its own.
        robot: Its name.
        wait_s: Seconds after which a robot no longer waits for a neighbour.
        session: Number of the planning session.

    Returns:
        Its state.

    Raises:
        InvalidInputError: As ``set_up_robots``.
        UnknownNameError: If there is no such robot.
    """
    names = [one.name for one in problem.robots]
    if robot not in names:
        raise UnknownNameError(f"robot {robot!r}: expected one of {', '.join(names)}")
    setup = _setup(names.index(robot), options, graph, wait_s=wait_s, session=session)
    return start_robot(problem, setup, generator.spawn(len(names)))


def _setup(
    robot: int,
    options: DistributedOptions,
    graph: CommunicationGraph,
    *,
    wait_s: float,
    session: int,
) -> RobotSetup:
    """What a robot knows before it plans."""
    if options.seconds is not None:
        raise InvalidInputError(
            "planner option seconds: expected none where robots talk through messages; give "
            "iterations or node_budget"
        )
    part = next(part for part in team_parts(graph) if robot in part)
    return RobotSetup(
        robot=robot, part=part, options=options, graph=graph, wait_s=wait_s, session=session
    )


@one_blas_thread()
def search_by_messages(
    problem: AcquisitionProblem,
    options: DistributedOptions,
    graph: CommunicationGraph,
    generator: np.random.Generator,
    transport: SimulatedTransport,
    *,
    wait_s: float = 1.0,
    time_limit_s: float = np.inf,
) -> DistributedResult:
    """Plan for a team whose robots talk through messages alone.

    Args:
        problem: What is planned for.
        options: How.
        graph: Who hears whom.
        generator: Source of every random number of the robots.
        transport: What carries their messages.
        wait_s: Seconds after which a robot no longer waits for a neighbour.
        time_limit_s: Seconds on the transport's clock after which to give up.

    Returns:
        The plan and what was counted.

    Raises:
        InvalidInputError: As ``set_up_robots``.
    """
    began = time.perf_counter()
    states = set_up_robots(problem, options, graph, generator, wait_s=wait_s)
    planted = time.perf_counter()
    reason = unreachable_reason(problem)
    if not reason:
        states = run_robots(states, step, transport, time_limit_s=time_limit_s)
    seconds = {"setup": planted - began, "search": time.perf_counter() - planted}
    robots = list(states.values())
    return joined_result(
        robots[0].growth, [outcome_of(state) for state in robots], seconds, reason=reason
    )


def plan_of_reports(states: list[RobotState]) -> TeamPlan | None:
    """The plan that the robots hold, each part of the team its own.

    Args:
        states: Of all robots, in the order of the team.

    Returns:
        The plan; None if a part has none.
    """
    return joined_plan(states[0].growth, [state.plan for state in states])
