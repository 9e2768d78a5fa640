"""Robots of a planner, each to be run in a process of its own.

A program is what one participant runs: a state, the step, and what it hands in at the end. Every
participant makes its own from the scenario and the seed alone; nothing but messages goes from one
to another, and the plan is made of what all have handed in. Participants are the robots, and
beside them what the planner names (``companions``): a simulated world, say.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.mission import Mission
from fgplan.planners.plan import Plan
from fgplan.planners.planner import AbstractPlanner
from fgplan.team.admission import RELAYED
from fgplan.team.envelope import Inbox, Outbox
from fgplan.team.loop import run_robots
from fgplan.team.transport import SimulatedTransport


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotProgram:
    """What one participant runs.

    Attributes:
        robot: Its name.
        participants: All names: the robots in the order of the team, then the companions.
        state: Before the first step; has ``finished`` and ``wake_s``.
        step: ``step(state, inbox) -> (state, outbox)``; a value in, a value out.
        report: What a state hands in at the end: plain data (numbers, text, bytes, lists and
            dictionaries) that ``team_plan`` of the planner reads.
        progress: How far a state is: parts done, parts in all (0 where not known), of what.
        time_limit_s: Seconds on the network's clock after which it gives up.
        seconds: Real seconds that making it took, by stage.
        relayed: Kinds of message that a teammate may pass on as another wrote them.
        session: The only planning session whose messages the network lets through; None leaves
            that to the step.
    """

    robot: str
    participants: tuple[str, ...]
    state: Any
    step: Callable[[Any, Inbox], tuple[Any, Outbox]]
    report: Callable[[Any], dict[str, Any]]
    progress: Callable[[Any], tuple[int, int, str]]
    time_limit_s: float = np.inf
    seconds: Mapping[str, float]
    relayed: Collection[str] = RELAYED
    session: int | None = None

    @property
    def finished(self) -> bool:
        """Whether the state has nothing more to do, though it still answers."""
        return bool(self.state.finished)

    @property
    def wake_s(self) -> float:
        """When the state wants to be stepped at the latest."""
        return float(self.state.wake_s)


@runtime_checkable
class DistributedPlanner(AbstractPlanner, Protocol):
    """A planner whose robots can run in processes of their own.

    ``team_plan`` of the reports of all programs is the plan that ``plan`` makes in one process,
    value for value; counts of work and traffic may depend on who is faster.

    Attributes:
        companions: Names of participants that are no robots.
    """

    companions: tuple[str, ...]

    def rehearse(self, mission: Mission, generator: np.random.Generator) -> None:
        """Run every compiled kernel that programs and ``team_plan`` of the mission need, briefly.

        Called in one process alone before many start, so that each need not compile them again. A
        planner without kernels has nothing to do.

        Args:
            mission: What is given.
            generator: As for ``program``.

        Raises:
            OptionError: If an option is not known or not usable.
        """
        ...

    def program(self, mission: Mission, robot: str, generator: np.random.Generator) -> RobotProgram:
        """Make the program of one participant.

        Args:
            mission: What is given, the same at all participants.
            robot: Name of the participant.
            generator: Source of every random number of the run, new and the same at all.

        Returns:
            The program.

        Raises:
            NoCandidatePathError: If there is no feasible plan, as far as it can tell alone.
            OptionError: If an option is not known or not usable.
            UnknownNameError: If there is no such participant.
        """
        ...

    def team_plan(
        self, mission: Mission, reports: Mapping[str, Any], generator: np.random.Generator
    ) -> Plan:
        """Make the plan of what all participants handed in.

        Args:
            mission: What is given.
            reports: By participant, in their order; one that was lost on the way is left out.
            generator: As for ``program``.

        Returns:
            The plan; ``traffic`` and the seconds of the network are for the caller to fill in.

        Raises:
            NoCandidatePathError: If there is no feasible plan.
            InvalidInputError: If a report is malformed.
        """
        ...


def participants(planner: DistributedPlanner, mission: Mission) -> tuple[str, ...]:
    """Names of all participants: the robots in the order of the team, then the companions.

    Args:
        planner: The planner.
        mission: The mission.

    Returns:
        The names.

    Raises:
        InvalidInputError: If a robot has the name of a companion.
    """
    robots = tuple(robot.name for robot in mission.robots)
    for name in planner.companions:
        if name in robots:
            raise InvalidInputError(
                f"robot {name!r}: planner {planner.name!r} needs this name for a process beside "
                "the robots; give the robot another"
            )
    return robots + planner.companions


def step_program(program: RobotProgram, inbox: Inbox) -> tuple[RobotProgram, Outbox]:
    """Step a program, whichever it is.

    Args:
        program: The program.
        inbox: Time and envelopes.

    Returns:
        The program with its state afterwards, and what it sends.
    """
    state, outbox = program.step(program.state, inbox)
    return replace(program, state=state), outbox


def run_programs(
    programs: Mapping[str, RobotProgram], transport: SimulatedTransport
) -> dict[str, RobotProgram]:
    """Run all programs in this process: the reference for processes.

    Args:
        programs: By participant, in their order.
        transport: What carries their messages.

    Returns:
        The programs with their states at the end.
    """
    limit_s = min(program.time_limit_s for program in programs.values())
    return run_robots(programs, step_program, transport, time_limit_s=limit_s)
