"""A mission as the planner ``distributed_aia`` reads it: problem, options, graph, random numbers.

Whoever reads the same mission with the same generator gets the same team: one process with all
robots, and every robot's own process.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, NamedTuple

import numpy as np

from fgplan.checks import check_generator, check_positive
from fgplan.errors import FgplanError, OptionError
from fgplan.planners.aia.mission_problem import (
    PROBLEM_OPTIONS,
    ProblemOptions,
    mission_problem,
    read_problem_options,
)
from fgplan.planners.aia.options import split_options
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.options import DistributedOptions, distributed_options
from fgplan.planners.mission import Mission
from fgplan.planners.option_checks import check_switch
from fgplan.planners.option_tables import check_option_names
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.communication_table import read_communication_graph
from fgplan.team.in_process import NetworkFaults, read_faults

SIMULATED_WAIT_S = 1.0
"""``wait_s`` where nothing else is asked for, on a simulated clock."""
REAL_WAIT_S = 60.0
"""``wait_s`` where nothing else is asked for, between processes: a slow machine is not a fault."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PresetOptions:
    """Which preset the planner starts from.

    Attributes:
        preset: What the defaults of the other options are changed to.
    """

    preset: Literal["paper", "reproduction"] = "reproduction"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExchangeOptions:
    """How robots hear of each other; the other options are ``DistributedOptions``.

    Attributes:
        graph: Communication graph, a table of its own with a ``kind``; all-to-all if left out.
        messages: Whether robots of this process talk through messages alone; otherwise they read
            each other's trees, to the same plan. Network faults need messages.
        communication: Faults of the simulated network, as ``[team.communication]`` gives them.
        wait_s: Seconds after which a robot no longer waits for a neighbour; if left out 1 s on a
            simulated clock, 60 s between processes.
        time_limit_s: Seconds on the network's clock after which the team gives up.
    """

    graph: Mapping[str, Any] | None = None
    messages: bool = False
    communication: Mapping[str, Any] | None = None
    wait_s: float | None = None
    time_limit_s: float = 1e6

    def __post_init__(self) -> None:
        """Check names and numbers."""
        check_switch("messages", self.messages)
        if self.wait_s is not None:
            check_positive(self.wait_s, "planner option wait_s")
        check_positive(self.time_limit_s, "planner option time_limit_s")

    def read_graph(
        self, robots: tuple[str, ...], generator: np.random.Generator
    ) -> CommunicationGraph:
        """The communication graph.

        Args:
            robots: In the order of the team.
            generator: Source of random graphs.
        """
        return read_communication_graph(self.graph or {"kind": "complete"}, robots, generator)

    def faults(self) -> NetworkFaults | None:
        """Faults of the network; None for a perfect one."""
        return None if self.communication is None else read_faults(self.communication)


OPTION_TABLES: tuple[type, ...] = (
    PresetOptions,
    ProblemOptions,
    DistributedOptions,
    ExchangeOptions,
)
"""All options of the planner."""
_EXCHANGE_OPTIONS = tuple(option.name for option in fields(ExchangeOptions))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MissionTeam:
    """A mission as this planner reads it.

    Attributes:
        problem: What is planned for.
        options: How trees are grown.
        exchange: How robots hear of each other.
        graph: Who hears whom.
        faults: Of the simulated network; None for a perfect one.
        planning: Source of the robots' random numbers.
        network: Source of the network's faults.
        used: Options as used, for the plan.
    """

    problem: AcquisitionProblem
    options: DistributedOptions
    exchange: ExchangeOptions
    graph: CommunicationGraph
    faults: NetworkFaults | None
    planning: np.random.Generator
    network: np.random.Generator
    used: Mapping[str, Any]


class MissionOptions(NamedTuple):
    """Options of a scenario, read.

    Attributes:
        problem: Of the problem.
        growth: Of how trees are grown.
        exchange: Of how robots hear of each other.
        used: All as used, for the plan.
    """

    problem: ProblemOptions
    growth: DistributedOptions
    exchange: ExchangeOptions
    used: Mapping[str, Any]


def read_mission_options(given: Mapping[str, Any]) -> MissionOptions:
    """Read the options of a scenario; the graph is read with the team's names.

    Args:
        given: By name.

    Returns:
        The options.

    Raises:
        OptionError: If an option is not known or not usable.
    """
    check_option_names(given, OPTION_TABLES, "distributed_aia")
    own, others = split_options(given, PROBLEM_OPTIONS)
    talk, others = split_options(others, _EXCHANGE_OPTIONS)
    preset = others.pop("preset", PresetOptions().preset)
    growth = distributed_options(preset, **others)
    try:
        exchange = ExchangeOptions(**talk)
        exchange.faults()
    except (FgplanError, TypeError) as error:
        raise OptionError(str(error)) from error
    return MissionOptions(
        problem=read_problem_options(own),
        growth=growth,
        exchange=exchange,
        used={"preset": preset, **asdict(growth), **talk, **own},
    )


def read_mission_team(mission: Mission, generator: np.random.Generator) -> MissionTeam:
    """Read a mission.

    Args:
        mission: Robots with sensors, and targets.
        generator: Source of every random number: the graph's, each robot's, the network's.

    Returns:
        The team.

    Raises:
        OptionError: If an option is not known or not usable.
        InvalidInputError: If the mission is not one of gathering information.
    """
    check_generator(generator, "planner 'distributed_aia'")
    read = read_mission_options(mission.options)
    problem = mission_problem(mission, read.problem)
    drawing, planning, network = generator.spawn(3)
    try:
        graph = read.exchange.read_graph(tuple(robot.name for robot in problem.robots), drawing)
    except (FgplanError, TypeError) as error:
        raise OptionError(str(error)) from error
    return MissionTeam(
        problem=problem,
        options=read.growth,
        exchange=read.exchange,
        graph=graph,
        faults=read.exchange.faults(),
        planning=planning,
        network=network,
        used=read.used,
    )
