"""Planner ``distributed_aia``: one sampling tree a robot, neighbours fuse what they know.

Tzes, Kantaros and Pappas, "Technical Report: Distributed Sampling-based Planning for Non-Myopic
Active Information Gathering", 2021 (arXiv 2107.11163), section III.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fgplan.checks import check_positive
from fgplan.errors import FgplanError, InvalidInputError, OptionError
from fgplan.planners.aia.mission_problem import (
    PROBLEM_OPTIONS,
    mission_plan,
    mission_problem,
    no_plan,
    read_problem_options,
)
from fgplan.planners.aia.options import split_options
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.mission import Mission
from fgplan.planners.plan import Plan
from fgplan.planners.planner import Progress
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.communication_table import read_communication_graph
from fgplan.team.in_process import InProcessTransport, NetworkFaults, read_faults

if TYPE_CHECKING:
    from fgplan.planners.distributed_aia.team_plan import TeamPlan

_WHY = {
    "iterations": "the iterations are spent",
    "nodes": "the node budget of every robot is spent",
    "seconds": "the time is over",
    "interrupted": "interrupted, or the network's time limit is over",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExchangeOptions:
    """How robots hear of each other; the other options are ``DistributedOptions``.

    Attributes:
        graph: Communication graph as plain data, see ``fgplan.team.communication_table``;
            all-to-all if left out.
        messages: Whether robots of this process talk through messages alone; otherwise they read
            each other's trees, to the same plan. Network faults need messages.
        communication: Faults of the simulated network, as ``[team.communication]`` gives them.
        wait_s: Seconds after which a robot no longer waits for a neighbour.
        time_limit_s: Seconds on the network's clock after which the team gives up.
    """

    graph: Mapping[str, Any] | None = None
    messages: bool = False
    communication: Mapping[str, Any] | None = None
    wait_s: float = 1.0
    time_limit_s: float = 1e6

    def __post_init__(self) -> None:
        """Check names and numbers."""
        if not isinstance(self.messages, bool):
            raise InvalidInputError(
                f"planner option messages: expected true or false, got {self.messages!r}"
            )
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


_EXCHANGE_OPTIONS = tuple(option.name for option in fields(ExchangeOptions))


def plan_details(
    problem: AcquisitionProblem, graph: CommunicationGraph, plan: "TeamPlan"
) -> dict[str, Any]:
    """What only this planner has to say of a plan.

    Args:
        problem: What was planned for.
        graph: Who hears whom.
        plan: The plan.

    Returns:
        ``seen_by``: the robot whose covariances ``target_covariances`` are; horizon of each robot;
        who satisfies the constraint; links by set of the schedule; the worst target's determinant
        and the mutual information (5a), nats, of each robot at each step.
    """
    from fgplan.planners.distributed_aia.information import information_gathered

    determinants = np.linalg.det(plan.covariances)
    gathered = information_gathered(problem, plan.covariances)
    return {
        "seen_by": graph.robots[plan.first_origin],
        "horizons": plan.horizons.tolist(),
        "satisfied": plan.satisfied.tolist(),
        "origins": [[graph.robots[robot], node] for robot, node in plan.origins],
        "links": [[list(edge) for edge in edges] for edges in graph.schedule],
        "worst_determinant": determinants.max(axis=-1).tolist(),
        "mutual_information": gathered.tolist(),
        "accumulated_mutual_information": float(gathered.sum()),
    }


class DistributedAiaPlanner:
    """Planner ``distributed_aia``.

    Options: ``preset`` (``paper`` or ``reproduction``; the latter if left out), those of
    ``DistributedOptions``, ``ExchangeOptions`` and ``ProblemOptions``.
    """

    name = "distributed_aia"

    def plan(
        self, mission: Mission, generator: np.random.Generator, progress: Progress | None = None
    ) -> Plan:
        """Plan for every robot of a mission.

        Args:
            mission: Robots with sensors, and targets.
            generator: Source of every random number: the graph's, each robot's, the network's.
            progress: Told sweeps, the budget, and how far the nearest robot is.

        Returns:
            The best plan found, replayed through the distributed Kalman filter.

        Raises:
            NoCandidatePathError: If no feasible plan was found; says the best uncertainty reached.
            OptionError: If an option is not known or not usable.
            InvalidInputError: If the mission is not one of gathering information.
        """
        from fgplan.planners.distributed_aia.message_search import search_by_messages
        from fgplan.planners.distributed_aia.options import distributed_options
        from fgplan.planners.distributed_aia.search import search_distributed

        own, others = split_options(mission.options, PROBLEM_OPTIONS)
        talk, others = split_options(others, _EXCHANGE_OPTIONS)
        problem = mission_problem(mission, read_problem_options(own))
        preset = others.pop("preset", "reproduction")
        options = distributed_options(preset, **others)
        drawing, planning, network = generator.spawn(3)
        names = tuple(robot.name for robot in problem.robots)
        try:
            exchange = ExchangeOptions(**talk)
            graph = exchange.read_graph(names, drawing)
            faults = exchange.faults()
        except (FgplanError, TypeError) as error:
            raise OptionError(str(error)) from error
        transport = None
        if exchange.messages or faults is not None:
            transport = InProcessTransport(names, faults, network)
            found = search_by_messages(
                problem,
                options,
                graph,
                planning,
                transport,
                wait_s=exchange.wait_s,
                time_limit_s=exchange.time_limit_s,
            )
        else:
            found = search_distributed(problem, options, graph, planning, progress=progress)
        if found.plan is None:
            if found.ending == "interrupted" and transport is None:
                raise KeyboardInterrupt
            why = found.reason or _WHY.get(found.ending, found.ending)
            raise no_plan(self.name, problem, found.shortfall, why)
        plan = mission_plan(
            mission,
            problem,
            found.plan.at(found.plan.first_origin),
            planner=self.name,
            agreed=found.ending != "interrupted",
            report=found.counts
            | {
                "sweeps": found.sweeps,
                "team_paths_replayed": found.candidates,
                "team_paths_refused": found.refused,
            },
            seconds=found.seconds,
            options={"preset": preset, **asdict(options), **talk, **own},
            details=plan_details(problem, graph, found.plan)
            | {"ending": found.ending, "bytes_per_node": found.bytes_per_node},
        )
        if transport is None:
            return plan
        kinds = transport.traffic.kinds
        return replace(plan, traffic={kind: asdict(counts) for kind, counts in kinds.items()})
