"""Planner ``intermittent``: a team whose robots can talk only when they are close.

The integrated framework of Algorithm 5 (Khodayi-mehr et al. 2019) is run for a number of steps on
what is expected: targets move as predicted and measurements are what the sensors predict, so the
plan holds every robot's path and all meetings. Executed against a world with noise, the same
robots (``team_run.run_team``) plan anew at each meeting with what they have measured.
"""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from fgplan.checks import check_generator, check_positive
from fgplan.errors import FgplanError, InvalidInputError, OptionError, UnknownNameError
from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.models.sensor import AbstractSensor
from fgplan.planners.intermittent.block_model import METRICS, BlockModel, is_block_state
from fgplan.planners.intermittent.dense_model import DenseModel
from fgplan.planners.intermittent.estimate import Estimate
from fgplan.planners.intermittent.geodesic_way import geodesic_cells
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.robot_state import TeamSetup, start_robot
from fgplan.planners.intermittent.schedule import PeriodChoice, make_schedule
from fgplan.planners.intermittent.segment_model import StateModel
from fgplan.planners.intermittent.sensor_rows import sensor_rows
from fgplan.planners.intermittent.state_model import HiddenProcess, TargetObservation
from fgplan.planners.intermittent.team_course import (
    course_of_reports,
    course_of_run,
    plan_of_course,
    robot_progress,
    robot_report,
    world_progress,
    world_report,
)
from fgplan.planners.intermittent.team_graph import TeamGraph, propose_teams
from fgplan.planners.intermittent.team_run import first_legs, run_team
from fgplan.planners.intermittent.truth import expected_truth
from fgplan.planners.intermittent.world import start_world
from fgplan.planners.intermittent.world import step as step_world
from fgplan.planners.intermittent.world_message import WORLD
from fgplan.planners.intermittent.world_robot import WorldRobot
from fgplan.planners.intermittent.world_robot import step as step_world_robot
from fgplan.planners.mission import Mission
from fgplan.planners.option_tables import check_option_names
from fgplan.planners.plan import Plan
from fgplan.planners.planner import Progress
from fgplan.planners.program import RobotProgram, participants
from fgplan.typing import FloatArray
from roadmaps import Workspace

REHEARSED_SAMPLES = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamOptions:
    """Options of the planner beside those of ``SegmentOptions``.

    Attributes:
        teams: Members of each team; proposed for the robots if left out.
        teams_per_robot: Teams of each robot in the proposal.
        period: Length of the schedules: epochs ``used``, or ``degree+1``.
        steps: Number of steps to plan.
        step_s: Duration of a step, seconds.
        every: Steps between measurements.
        metric: Uncertainty function of the targets, one that is positive.
        wait_steps: How long robots wait for a teammate, steps.
        recovery_steps: Steps in which a team makes up for a meeting that failed, at the same place.
        cell_m: Side of the cells of short ways, metres.
    """

    teams: tuple[tuple[str, ...], ...] = ()
    teams_per_robot: int = 2
    period: PeriodChoice = "used"
    steps: int = 300
    step_s: float = 1.0
    every: int = 1
    metric: str = "largest_eigenvalue"
    wait_steps: int = 40
    recovery_steps: int = 150
    cell_m: float = 0.25

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("step_s", "cell_m"):
            check_positive(getattr(self, name), f"planner option {name}")
        for name in ("steps", "every"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise InvalidInputError(
                    f"planner option {name}: expected a whole number above zero, got {value!r}"
                )


class IntermittentPlanner:
    """Planner ``intermittent``; options are those of ``TeamOptions`` and ``SegmentOptions``."""

    name = "intermittent"
    option_tables: tuple[type, ...] = (TeamOptions, SegmentOptions)
    companions: tuple[str, ...] = (WORLD,)

    def check_options(self, given: Mapping[str, Any]) -> None:
        """Refuse what ``plan`` would refuse of its options; see ``CheckedPlanner``.

        Args:
            given: By name.

        Raises:
            OptionError: If one is not known or not usable.
        """
        read_options(given)

    def plan(
        self, mission: Mission, generator: np.random.Generator, progress: Progress | None = None
    ) -> Plan:
        """Plan for every robot of a mission.

        Args:
            mission: Planar robots with sensors, and targets.
            generator: Source of every random number.
            progress: Told the steps that are planned.

        Returns:
            Paths over the steps asked for; ``details`` holds teams, schedules, meetings, the
            delay bound and the targets' covariances by step.

        Raises:
            OptionError: If an option is not known or not usable.
            InvalidInputError: If the mission has no targets, or robots are not planar.
            NoCandidatePathError: If obstacles keep a team apart.
        """
        began = time.perf_counter()
        check_generator(generator, f"planner {self.name!r}")
        own, segment = read_options(mission.options)
        setup, starts, estimate = mission_team(
            mission, own, segment, int(generator.integers(2**31))
        )
        truth = expected_truth(setup.model, estimate, own.steps, len(setup.robots))
        legs = first_legs(setup, starts, estimate)
        run = run_team(setup, legs, estimate, truth, progress=progress)
        plan = plan_of_course(mission, setup, course_of_run(run), asdict(own), own.step_s)
        return replace(
            plan,
            traffic={kind: asdict(counts) for kind, counts in run.traffic.kinds.items()},
            seconds={"plan": time.perf_counter() - began},
        )

    def rehearse(self, mission: Mission, generator: np.random.Generator) -> None:
        """Run every compiled kernel, briefly; see ``DistributedPlanner``.

        Args:
            mission: Planar robots with sensors, and targets.
            generator: As for ``program``.

        Raises:
            OptionError: If an option is not known or not usable.
            InvalidInputError: If the mission has no targets, or robots are not planar.
        """
        own, segment = read_options(mission.options)
        few = {
            "steps": own.every,
            "samples": min(segment.samples, REHEARSED_SAMPLES),
            "explore": min(segment.explore, REHEARSED_SAMPLES // 4),
            # Anywhere within range will do for a meeting, so that there are some.
            "delta": 1e12,
            "travel_m": 1e-9,
        }
        self.plan(replace(mission, options={**mission.options, **few}), generator)

    def program(self, mission: Mission, robot: str, generator: np.random.Generator) -> RobotProgram:
        """Make the program of one robot, or of the world; see ``DistributedPlanner``.

        Args:
            mission: Planar robots with sensors, and targets.
            robot: Name of the robot, or ``world``.
            generator: Source of every random number, as for ``plan``.

        Returns:
            The program.

        Raises:
            OptionError: If an option is not known or not usable.
            InvalidInputError: If the mission has no targets, or robots are not planar.
            NoCandidatePathError: If obstacles keep a team apart.
            UnknownNameError: If there is no such participant.
        """
        began = time.perf_counter()
        names = participants(self, mission)
        if robot not in names:
            raise UnknownNameError(f"robot {robot!r}: expected one of {', '.join(names)}")
        own, segment = read_options(mission.options)
        setup, starts, estimate = mission_team(
            mission, own, segment, int(generator.integers(2**31))
        )
        if robot == WORLD:
            truth = expected_truth(setup.model, estimate, own.steps, len(setup.robots))
            return RobotProgram(
                robot=robot,
                participants=names,
                state=start_world(setup, truth, starts),
                step=step_world,
                report=world_report,
                progress=world_progress,
                seconds={"setup": time.perf_counter() - began},
            )
        legs = first_legs(setup, starts, estimate)
        return RobotProgram(
            robot=robot,
            participants=names,
            state=WorldRobot(robot=start_robot(setup, robot, legs[robot], estimate)),
            step=step_world_robot,
            report=robot_report,
            progress=robot_progress,
            seconds={"setup": time.perf_counter() - began},
        )

    def team_plan(
        self, mission: Mission, reports: Mapping[str, Any], generator: np.random.Generator
    ) -> Plan:
        """Make the plan of what the world and the robots handed in; see ``DistributedPlanner``.

        Args:
            mission: As for ``program``.
            reports: By participant.
            generator: As for ``program``.

        Returns:
            As ``plan``, where no robot was lost; one that was stands still from then on.

        Raises:
            NoCandidatePathError: If obstacles kept a team apart.
            InvalidInputError: If a report is malformed, or the world's is missing.
        """
        own, segment = read_options(mission.options)
        setup, _, estimate = mission_team(mission, own, segment, int(generator.integers(2**31)))
        course = course_of_reports(setup, estimate, own.steps, reports)
        return plan_of_course(mission, setup, course, asdict(own), own.step_s)


def read_options(given: Mapping[str, Any]) -> tuple[TeamOptions, SegmentOptions]:
    """Options of a scenario.

    Args:
        given: By name.

    Returns:
        Of the team, and of planning a segment.

    Raises:
        OptionError: If one is not known or not usable.
    """
    team = [option.name for option in fields(TeamOptions)]
    segment = [option.name for option in fields(SegmentOptions)]
    check_option_names(given, IntermittentPlanner.option_tables, IntermittentPlanner.name)
    chosen = {name: value for name, value in given.items() if name in team}
    if "teams" in chosen:
        chosen["teams"] = tuple(tuple(members) for members in chosen["teams"])
    try:
        return (
            TeamOptions(**chosen),
            SegmentOptions(**{name: value for name, value in given.items() if name in segment}),
        )
    except FgplanError as error:
        raise OptionError(str(error)) from error


def mission_team(
    mission: Mission, own: TeamOptions, segment: SegmentOptions, seed: int
) -> tuple[TeamSetup, dict[str, FloatArray], Estimate]:
    """A mission as a team.

    Args:
        mission: Planar robots with sensors, and targets.
        own: Options of the team.
        segment: Options of planning.
        seed: Of every plan.

    Returns:
        What all robots know, where each starts, and the first estimate.

    Raises:
        InvalidInputError: If the mission has no targets, or robots are not planar.
        OptionError: If the teams or a number are not usable.
    """
    if not mission.targets:
        raise InvalidInputError(
            "mission: expected [[targets]] to gather information about, got none"
        )
    starts, carried = {}, []
    for robot in mission.robots:
        pose = mission.prior.pose(robot.start_key)
        if np.shape(pose) != (3,):
            raise InvalidInputError(
                f"robot {robot.name!r}: expected a planar start pose, got shape {np.shape(pose)}"
            )
        starts[robot.name] = np.array(pose[:2])
        carried.append(tuple(_sensor(mission, robot.name, name) for name in robot.sensors))
    hidden = HiddenState(
        tuple(
            HiddenBlock(
                targets=(target.name,),
                transition=target.transition,
                drift=target.drift,
                process=target.process,
            )
            for target in mission.targets
        )
    )
    names = tuple(robot.name for robot in mission.robots)
    try:
        graph = (
            TeamGraph(names, own.teams) if own.teams else propose_teams(names, own.teams_per_robot)
        )
        schedule = make_schedule(graph, own.period)
        model, blocks = _model(hidden, tuple(carried), mission.workspace, own)
        setup = TeamSetup(
            schedule=schedule,
            model=model,
            workspace=mission.workspace,
            grid=geodesic_cells(mission.workspace, own.cell_m),
            options=segment,
            seed=seed,
            wait_steps=own.wait_steps,
            recovery_steps=own.recovery_steps,
        )
    except FgplanError as error:
        raise OptionError(f"planner 'intermittent': {error}") from error
    mean = np.concatenate([target.mean for target in mission.targets])
    spreads = [np.asarray(target.covariance) for target in mission.targets]
    covariance = np.array(spreads) if blocks else _on_diagonal(spreads)[None]
    return setup, starts, Estimate(0, mean, covariance)


def _sensor(mission: Mission, robot: str, name: str) -> AbstractSensor:
    """A sensor that sees all round: these robots have no heading."""
    if name not in mission.sensors:
        known = ", ".join(mission.sensors) or "none"
        raise InvalidInputError(f"robot {robot!r}: sensor {name!r} is not one of: {known}")
    sensor = mission.sensors[name]
    if sensor.field_of_view_rad < 2.0 * np.pi - 1e-9:
        raise InvalidInputError(
            f"robot {robot!r}: sensor {name!r}: expected one that sees all round, got a field of "
            f"view of {sensor.field_of_view_rad:g} rad; robots of this planner have no heading"
        )
    return sensor


def _model(
    hidden: HiddenState,
    carried: tuple[tuple[AbstractSensor, ...], ...],
    workspace: Workspace,
    own: TeamOptions,
) -> tuple[StateModel, bool]:
    """The compiled model where it serves, else the dense one; and which."""
    if is_block_state(hidden) and sensor_rows(list(carried)) is not None and own.metric in METRICS:
        return BlockModel(hidden, carried, workspace, own.metric, own.every), True
    parts = tuple(hidden.slice_of(name) for name in hidden.targets)
    observations = tuple(
        tuple(TargetObservation(sensor, part) for sensor in sensors for part in parts)
        for sensors in carried
    )
    process = HiddenProcess(hidden)
    return DenseModel(process, observations, workspace, own.metric, own.every, parts), False


def _on_diagonal(blocks: list[FloatArray]) -> FloatArray:
    """Blocks on the diagonal of one matrix."""
    size = sum(len(block) for block in blocks)
    whole, at = np.zeros((size, size)), 0
    for block in blocks:
        whole[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return whole
