"""The planner of Regev and Indelman 2017: announced paths, best response until nobody changes.

Roadmap, candidate paths, then turns: each robot announces the candidate that lowers the common
objective given what the others have announced. The end is a point from which nobody improves
alone; it depends on the order of turns and is not always the team's optimum (the planner
``exhaustive`` gives that for small teams).
"""

import dataclasses
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from fgplan.beliefs.candidate_belief import candidate_belief
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.evaluation.evaluations import ReevaluationReport
from fgplan.evaluation.problem import PlanningProblem
from fgplan.evaluation.registry import INEXACT, find_evaluator
from fgplan.paths.candidate_path import CandidatePath
from fgplan.planners.impacted_paths.candidates import CandidateSets, candidate_sets
from fgplan.planners.impacted_paths.options import ImpactedPathsOptions, read_options
from fgplan.planners.mission import Mission
from fgplan.planners.plan import ObjectiveValue, Plan, RobotPlan
from fgplan.planners.planner import Progress
from fgplan.planners.program import RobotProgram
from fgplan.team.agreement import Agreement, agreement_of
from fgplan.team.coordination import coordinate, set_up_team
from fgplan.team.envelope import TrafficByKind
from fgplan.team.options import CoordinationOptions
from fgplan.team.report import decode_report, encode_report, report_of
from fgplan.team.robot import step
from fgplan.team.robot_state import TurnRecord, same_path, start_robot
from fgplan.typing import FloatArray

REHEARSED = 4
"""Candidates a robot in a rehearsal."""


class ImpactedPathsPlanner:
    """Planner ``impacted_paths``; its options are ``ImpactedPathsOptions``."""

    name = "impacted_paths"
    option_tables: tuple[type, ...] = (ImpactedPathsOptions,)
    companions: tuple[str, ...] = ()

    def check_options(self, given: Mapping[str, Any]) -> None:
        """Refuse what ``plan`` would refuse of its options; see ``CheckedPlanner``.

        Args:
            given: By name.

        Raises:
            OptionError: If one is not known or not usable.
            UnknownNameError: If an evaluator is not known.
        """
        self._options(given)

    def _options(self, given: Mapping[str, Any]) -> ImpactedPathsOptions:
        """Options of a mission; an unknown evaluator is refused before any work."""
        options = read_options(ImpactedPathsOptions, given, self.name)
        find_evaluator(options.evaluator)
        return options

    def plan(
        self, mission: Mission, generator: np.random.Generator, progress: Progress | None = None
    ) -> Plan:
        """Plan by announcements until nobody changes.

        Args:
            mission: What is given.
            generator: Source of every random number.
            progress: Told how far it is.

        Returns:
            The plan; ``agreed`` is False if turns ran out.

        Raises:
            NoCandidatePathError: If a robot has no candidate and may not stay; names it.
            OptionError: If an option is not known or has a value that is not usable.
            UnknownNameError: If an evaluator or sensor is not known.
        """
        tell = progress or _silent
        options = self._options(mission.options)
        tell(0, 0, "candidate paths")
        began = time.perf_counter()
        sets = candidate_sets(mission, options, generator, without_path=options.without_path)
        candidates_s = time.perf_counter() - began

        def hear(record: TurnRecord) -> None:
            """Pass progress on."""
            tell(record.turn, 0, "turns")

        agreement = coordinate(
            sets.problem,
            sets.candidates,
            options.evaluator,
            options=_coordination(mission, options),
            goals=_goals(mission),
            transport=options.transport(sets.problem.robots, generator),
            progress=None if progress is None else hear,
        )
        tell(agreement.turns, agreement.turns, "turns")
        return _plan_of(mission, options, sets, agreement, candidates_s)

    def rehearse(self, mission: Mission, generator: np.random.Generator) -> None:
        """Plan briefly with few candidates; see ``DistributedPlanner``.

        Args:
            mission: What is given.
            generator: As for ``program``.

        Raises:
            NoCandidatePathError: If a robot has no candidate and may not stay; names it.
            OptionError: If an option is not known or has a value that is not usable.
        """
        options = self._options(mission.options)
        sets = candidate_sets(mission, options, generator, without_path=options.without_path)
        few = {robot: paths[:REHEARSED] for robot, paths in sets.candidates.items()}
        agreement = coordinate(
            sets.problem, few, options.evaluator, options=_coordination(mission, options)
        )
        if options.covariances:
            pose_covariances(sets.problem, agreement.paths)

    def program(self, mission: Mission, robot: str, generator: np.random.Generator) -> RobotProgram:
        """Make the program of one robot; see ``DistributedPlanner``.

        Args:
            mission: What is given, the same at all robots.
            robot: Name of the robot.
            generator: Source of every random number of the run, as for ``plan``.

        Returns:
            The program; its report is a ``fgplan.team.report.RobotReport`` in bytes.

        Raises:
            NoCandidatePathError: If a robot has no candidate and may not stay; names it.
            OptionError: If an option is not known or has a value that is not usable.
            UnknownNameError: If there is no such robot.
        """
        began = time.perf_counter()
        options = self._options(mission.options)
        sets = candidate_sets(mission, options, generator, without_path=options.without_path)
        candidates_s = time.perf_counter() - began
        setups = set_up_team(
            sets.problem,
            sets.candidates,
            options.evaluator,
            options=_coordination(mission, options, processes=True),
            goals=_goals(mission),
        )
        if robot not in setups:
            raise UnknownNameError(f"robot {robot!r} is not one of {', '.join(setups)}")
        began = time.perf_counter()
        state = start_robot(setups[robot])
        start_s = time.perf_counter() - began
        return RobotProgram(
            robot=robot,
            participants=tuple(setups),
            state=state,
            step=step,
            report=lambda ended: {"session": encode_report(report_of(ended))},
            progress=lambda now: (now.turn, 0, "turns"),
            time_limit_s=options.time_limit_s,
            seconds={"candidates": candidates_s, "start": start_s},
            session=options.session,
        )

    def team_plan(
        self, mission: Mission, reports: Mapping[str, Any], generator: np.random.Generator
    ) -> Plan:
        """Make the plan of what all robots handed in; see ``DistributedPlanner``.

        Args:
            mission: What is given.
            reports: By robot; one that was lost on the way is left out.
            generator: As for ``program``.

        Returns:
            The plan.

        Raises:
            InvalidInputError: If a report is malformed, or there is none.
            StaleAnnouncementError: If robots that have finished hold different ledgers.
        """
        began = time.perf_counter()
        options = self._options(mission.options)
        sets = candidate_sets(mission, options, generator, without_path=options.without_path)
        candidates_s = time.perf_counter() - began
        if not reports:
            raise InvalidInputError("reports: expected that of one robot at least, got none")
        read = [decode_report(report["session"]) for report in reports.values()]
        evaluated_s = sum(r.decision.seconds for one in read for r in one.records if r.decision)
        agreement = agreement_of(
            read,
            _coordination(mission, options, processes=True),
            traffic=TrafficByKind(),
            clock_s=max(one.clock_s for one in read),
            seconds={"evaluation": evaluated_s},
        )
        found = dict(agreement.chosen)
        for robot, path in agreement.paths.items():  # of a lost robot nobody has said which
            same = (i for i, c in enumerate(sets.candidates[robot]) if same_path(c, path))
            found.setdefault(robot, next(same, -1))
        agreement = dataclasses.replace(agreement, chosen=found)
        return _plan_of(mission, options, sets, agreement, candidates_s)


def _coordination(
    mission: Mission, options: ImpactedPathsOptions, *, processes: bool = False
) -> CoordinationOptions:
    """How the team comes to agree."""
    exact = options.evaluator not in INEXACT
    return options.coordination(mission.seed, exact=exact, processes=processes)


def _goals(mission: Mission) -> dict[str, FloatArray]:
    """Last goal of each robot that has one, metres, world frame."""
    return {robot.name: robot.goals[-1] for robot in mission.robots if len(robot.goals)}


def _plan_of(
    mission: Mission,
    options: ImpactedPathsOptions,
    sets: CandidateSets,
    agreement: Agreement,
    candidates_s: float,
) -> Plan:
    """The plan that a team has agreed on."""
    began = time.perf_counter()
    known: dict[str, FloatArray] = {}
    if options.covariances:
        known = pose_covariances(sets.problem, agreement.paths)
    covariances_s = time.perf_counter() - began
    return Plan(
        planner=ImpactedPathsPlanner.name,
        mission=mission.name,
        scenario_digest=mission.digest,
        seed=mission.seed,
        robots=robot_plans(mission, sets, agreement.paths, agreement.chosen, known),
        agreed=agreement.agreed,
        objective=objective_values(agreement),
        report=report_counts(agreement),
        traffic={
            kind: dataclasses.asdict(counts) for kind, counts in agreement.traffic.kinds.items()
        },
        seconds={"candidates": candidates_s, **agreement.seconds, "covariances": covariances_s},
        warnings=(*_reasons(sets), *agreement.warnings),
        options=dataclasses.asdict(options),
        details={
            "turns": [turn_data(record) for record in agreement.records],
            "clock_s": agreement.clock_s,
        },
    )


def robot_plans(
    mission: Mission,
    sets: CandidateSets,
    paths: Mapping[str, CandidatePath],
    chosen: Mapping[str, int],
    covariances: Mapping[str, FloatArray],
) -> tuple[RobotPlan, ...]:
    """Plan of each robot, in the order of the team."""
    return tuple(
        RobotPlan(
            robot=robot.name,
            start=mission.prior.pose(robot.start_key),
            path=paths.get(robot.name),
            covariances=covariances.get(robot.name, np.zeros((0, 0, 0))),
            goals=robot.goals,
            candidate=chosen.get(robot.name, -1),
            candidates=len(sets.candidates[robot.name]),
        )
        for robot in mission.robots
    )


def pose_covariances(
    problem: PlanningProblem, paths: Mapping[str, CandidatePath]
) -> dict[str, FloatArray]:
    """Covariance of every pose of a team's plan, every path followed to its end.

    Args:
        problem: Prior, team and models.
        paths: Path of each robot that has one.

    Returns:
        By robot, shape (L + 1, d, d), tangent of each pose; one for a robot without a path.
    """
    joint = candidate_belief(problem, paths)
    marginals = joint.belief().marginal_covariances(
        [key for keys in joint.keys.values() for key in keys]
    )
    return {robot: np.array([marginals[key] for key in keys]) for robot, keys in joint.keys.items()}


def objective_values(agreement: Agreement) -> tuple[ObjectiveValue, ...]:
    """Common objective by accepted announcement, from the end of round 0."""
    announcers = [item.robot for item in agreement.ledger.history if item.value is not None]
    return tuple(
        ObjectiveValue(place, robot, value)
        for place, (robot, value) in enumerate(
            zip(["", *announcers], agreement.values, strict=True)
        )
    )


def report_counts(agreement: Agreement) -> dict[str, int]:
    """Counts of the work of all robots on all turns."""
    counts = {
        "turns": agreement.turns,
        "announcements": len(agreement.values) - 1,
        "evaluations": agreement.evaluations,
        "stale": agreement.stale,
    }
    reports = [record.decision.report for record in agreement.records if record.decision]
    for item in dataclasses.fields(ReevaluationReport):
        values = [getattr(report, item.name) for report in reports]
        if item.name == "bytes_held":
            counts[item.name] = max(values, default=0)
        elif item.name != "notes":
            counts[item.name] = sum(len(v) if isinstance(v, tuple) else int(v) for v in values)
    return counts


def turn_data(record: TurnRecord) -> dict[str, Any]:
    """One turn as plain data."""
    data: dict[str, Any] = {
        "turn": record.turn,
        "robot": record.robot,
        "announced": record.announced,
        "evaluated": record.decision is not None,
    }
    if record.decision is not None:
        found = record.decision
        data |= {
            "candidate": found.index,
            "value": found.value,
            "incumbent": found.incumbent,
            "incumbent_value": found.incumbent_value,
            "seconds": found.seconds,
            "impacted": list(found.report.impacted),
            "untouched": list(found.report.untouched),
            "skipped": len(found.report.skipped),
            "notes": list(found.report.notes),
        }
    return data


def _reasons(sets: CandidateSets) -> tuple[str, ...]:
    """Why robots stay."""
    return tuple(f"robot {robot!r} stays: {reason}" for robot, reason in sets.reasons.items())


def _silent(done: int, total: int, doing: str) -> None:
    """Say nothing."""
    del done, total, doing
