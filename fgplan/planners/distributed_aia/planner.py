"""Planner ``distributed_aia``: one sampling tree a robot, neighbours fuse what they know.

Tzes, Kantaros and Pappas, "Technical Report: Distributed Sampling-based Planning for Non-Myopic
Active Information Gathering", 2021 (arXiv 2107.11163), section III.
"""

import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fgplan.planners.aia.lower_bound import unreachable_reason
from fgplan.planners.aia.mission_problem import mission_plan, no_plan
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.mission_team import (
    OPTION_TABLES,
    REAL_WAIT_S,
    SIMULATED_WAIT_S,
    MissionTeam,
    read_mission_options,
    read_mission_team,
)
from fgplan.planners.distributed_aia.options import PRESETS
from fgplan.planners.mission import Mission
from fgplan.planners.plan import Plan
from fgplan.planners.planner import Progress
from fgplan.planners.program import RobotProgram, participants
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.in_process import InProcessTransport

REHEARSED_LIMIT = 1e12
REHEARSED_SWEEPS = 20

if TYPE_CHECKING:
    from fgplan.planners.distributed_aia.search import DistributedResult
    from fgplan.planners.distributed_aia.team_plan import TeamPlan

_WHY = {
    "iterations": "the iterations are spent",
    "nodes": "the node budget of every robot is spent",
    "seconds": "the time is over",
    "lost": "a robot was lost, and a plan has a way of every robot",
    "interrupted": "interrupted, or the network's time limit is over",
}


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
    """Planner ``distributed_aia``; ``option_tables`` are its options."""

    name = "distributed_aia"
    option_tables: tuple[type, ...] = OPTION_TABLES
    presets: Mapping[str, Mapping[str, Any]] = PRESETS
    companions: tuple[str, ...] = ()

    def check_options(self, given: Mapping[str, Any]) -> None:
        """Refuse what ``plan`` would refuse of its options; see ``CheckedPlanner``.

        Args:
            given: By name.

        Raises:
            OptionError: If one is not known or not usable.
        """
        read_mission_options(given)

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
        from fgplan.planners.distributed_aia.search import search_distributed

        team = read_mission_team(mission, generator)
        if not team.exchange.messages and team.faults is None:
            found = search_distributed(
                team.problem, team.options, team.graph, team.planning, progress=progress
            )
            if found.plan is None and found.ending == "interrupted":
                raise KeyboardInterrupt
            return _plan_of(mission, team, found)
        names = tuple(robot.name for robot in team.problem.robots)
        transport = InProcessTransport(names, team.faults, team.network)
        found = search_by_messages(
            team.problem,
            team.options,
            team.graph,
            team.planning,
            transport,
            wait_s=team.exchange.wait_s or SIMULATED_WAIT_S,
            time_limit_s=team.exchange.time_limit_s,
        )
        kinds = transport.traffic.kinds
        return replace(
            _plan_of(mission, team, found),
            traffic={kind: asdict(counts) for kind, counts in kinds.items()},
        )

    def rehearse(self, mission: Mission, generator: np.random.Generator) -> None:
        """Run every compiled kernel, briefly; see ``DistributedPlanner``.

        Args:
            mission: Robots with sensors, and targets.
            generator: As for ``program``.

        Raises:
            OptionError: If an option is not known or not usable.
            InvalidInputError: If the mission is not one of gathering information.
        """
        from fgplan.planners.distributed_aia.message_search import search_by_messages

        team = read_mission_team(mission, generator)
        # With a limit that every node keeps there are plans to claim, replay and report at once.
        terminal = replace(team.problem.terminal, limit=REHEARSED_LIMIT)
        names = tuple(robot.name for robot in team.problem.robots)
        search_by_messages(
            replace(team.problem, terminal=terminal),
            replace(team.options, until="budget", iterations=REHEARSED_SWEEPS),
            team.graph,
            team.planning,
            InProcessTransport(names),
        )

    def program(self, mission: Mission, robot: str, generator: np.random.Generator) -> RobotProgram:
        """Make the program of one robot; see ``DistributedPlanner``.

        Args:
            mission: Robots with sensors, and targets.
            robot: Name of the robot.
            generator: Source of every random number, as for ``plan``.

        Returns:
            The program.

        Raises:
            NoCandidatePathError: If no plan can satisfy the constraint.
            OptionError: If an option is not known or not usable.
            UnknownNameError: If there is no such robot.
        """
        from fgplan.planners.distributed_aia.message_search import set_up_robot
        from fgplan.planners.distributed_aia.robot import REPORT, step
        from fgplan.planners.distributed_aia.robot_outcome import progress_of, report_of

        began = time.perf_counter()
        team = read_mission_team(mission, generator)
        state = set_up_robot(
            team.problem,
            team.options,
            team.graph,
            team.planning,
            robot,
            wait_s=team.exchange.wait_s or REAL_WAIT_S,
        )
        reason = unreachable_reason(team.problem)
        if reason:
            growth = state.growth
            raise no_plan(self.name, team.problem, growth.shortfall, reason, growth.farthest)
        return RobotProgram(
            robot=robot,
            participants=participants(self, mission),
            state=state,
            step=step,
            report=report_of,
            progress=progress_of,
            time_limit_s=team.exchange.time_limit_s,
            seconds={"setup": time.perf_counter() - began},
            relayed=frozenset({REPORT}),
        )

    def team_plan(
        self, mission: Mission, reports: Mapping[str, Any], generator: np.random.Generator
    ) -> Plan:
        """Make the plan of what all robots handed in; see ``DistributedPlanner``.

        Args:
            mission: As for ``program``.
            reports: By robot.
            generator: As for ``program``.

        Returns:
            The best plan found, replayed through the distributed Kalman filter.

        Raises:
            NoCandidatePathError: If no feasible plan was found; says the best uncertainty reached.
            InvalidInputError: If a report is malformed, or there is none.
        """
        from fgplan.planners.distributed_aia.robot_outcome import result_of_reports

        team = read_mission_team(mission, generator)
        found = result_of_reports(team.problem, team.options, team.graph, team.planning, reports)
        return _plan_of(mission, team, found)


def _plan_of(mission: Mission, team: MissionTeam, found: "DistributedResult") -> Plan:
    """The plan of what the robots found.

    Raises:
        NoCandidatePathError: If they found none.
    """
    if found.plan is None:
        why = found.reason or _WHY.get(found.ending, found.ending)
        raise no_plan(
            DistributedAiaPlanner.name, team.problem, found.shortfall, why, found.farthest
        )
    return mission_plan(
        mission,
        team.problem,
        found.plan.at(found.plan.first_origin),
        planner=DistributedAiaPlanner.name,
        agreed=found.ending not in ("interrupted", "lost"),
        report=found.counts
        | {
            "sweeps": found.sweeps,
            "team_paths_replayed": found.candidates,
            "team_paths_refused": found.refused,
        },
        seconds=found.seconds,
        options=team.used,
        details=plan_details(team.problem, team.graph, found.plan)
        | {"ending": found.ending, "bytes_per_node": found.bytes_per_node},
    )
