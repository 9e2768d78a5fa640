"""Which problems the trees of single robots know: others are refused before anything is made."""

from fgplan.errors import InvalidInputError
from fgplan.planners.aia.arrays import Prepared
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.options import DistributedOptions
from fgplan.team.communication_graph import CommunicationGraph


def check_problem(
    problem: AcquisitionProblem, graph: CommunicationGraph, options: DistributedOptions
) -> None:
    """Refuse a problem that the trees do not know.

    Args:
        problem: What is planned for.
        graph: Who hears whom.
        options: How trees are grown.

    Raises:
        InvalidInputError: If the graph is of another team, an option of a robot that is not in the
            team, a robot has a terminal goal, or the targets are not independent points in the
            plane.
    """
    names = tuple(robot.name for robot in problem.robots)
    if tuple(graph.robots) != names:
        raise InvalidInputError(
            f"communication graph: expected the team {', '.join(names)}, got "
            f"{', '.join(graph.robots)}"
        )
    for name in options.of_robot or {}:
        if name not in names:
            raise InvalidInputError(
                f"planner option of_robot: expected some of {', '.join(names)}, got {name!r}"
            )
    for robot in problem.robots:
        if robot.goal is not None:
            raise InvalidInputError(
                f"robot {robot.name!r}: planner distributed_aia has no terminal goals; leave out "
                "terminal_goals or use planner aia"
            )
    if not problem.packed:
        raise InvalidInputError(
            "planner distributed_aia: expected independent targets in the plane and sensors of "
            "points; use planner aia for a coupled hidden state"
        )


def check_prepared(prepared: Prepared, problem: AcquisitionProblem) -> None:
    """Refuse sensors and functions that the kernels do not know.

    Args:
        prepared: The problem's arrays.
        problem: The problem.

    Raises:
        InvalidInputError: Names what is not known, and what to use instead.
    """
    if not prepared.compiled_sensors:
        raise InvalidInputError(
            "planner distributed_aia: expected built-in sensors, got one of a user's own; use "
            "planner aia"
        )
    if not prepared.compiled_objective:
        raise InvalidInputError(
            f"planner distributed_aia: objective {problem.objective!r}: expected determinant, "
            "trace or largest_eigenvalue"
        )
    if not prepared.compiled_terminal:
        raise InvalidInputError(
            f"planner distributed_aia: constraint {problem.terminal.function!r}: expected one that "
            "is a limit of a determinant, trace or largest eigenvalue at all times; for mutual "
            "information of targets that move see information.determinant_limit"
        )
