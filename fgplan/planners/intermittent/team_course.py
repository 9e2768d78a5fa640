"""What a team did: its course, from one process or from what many handed in, and as a plan."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.paths.candidate_path import KNOWN_MOTION, CandidatePath
from fgplan.planners.intermittent.estimate import Estimate, Filtered, Record
from fgplan.planners.intermittent.robot_state import MeetingRecord, TeamSetup
from fgplan.planners.intermittent.team_run import TeamRun
from fgplan.planners.intermittent.world import WorldState
from fgplan.planners.intermittent.world_message import WORLD
from fgplan.planners.intermittent.world_robot import WorldRobot
from fgplan.planners.mission import Mission
from fgplan.planners.plan import ObjectiveValue, Plan, RobotPlan
from fgplan.typing import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TeamCourse:
    """What a team did.

    Attributes:
        positions: Of every robot, shape (steps + 1, N, 2), metres.
        records: Robot and record of all measurements, in order of time, then of robot.
        everything: The filter over all of them at once.
        meetings: What each robot saw of each of its meetings, in the order of the team.
        gone: Robots that were lost, and the step since when.
    """

    positions: FloatArray
    records: tuple[tuple[int, Record], ...]
    everything: Filtered
    meetings: tuple[MeetingRecord, ...]
    gone: Mapping[str, int] = field(default_factory=dict)


class WorldReport(msgspec.Struct, frozen=True, kw_only=True):
    """What the world hands in.

    Attributes:
        places: Of each robot in each step so far, metres.
        records: Robot and record of all measurements.
        gone: Robots that were lost, and the step since when.
        failed: Why a robot could not go on, or nothing.
    """

    places: tuple[tuple[tuple[float, float], ...], ...]
    records: tuple[tuple[int, Record], ...]
    gone: dict[str, int]
    failed: str


class RobotReport(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot hands in.

    Attributes:
        meetings: What it saw of each of its meetings.
    """

    meetings: tuple[MeetingRecord, ...]


def world_report(state: WorldState) -> dict[str, Any]:
    """What the world hands in, as plain data.

    Args:
        state: At the end.
    """
    report = WorldReport(
        places=state.places, records=state.records, gone=dict(state.gone), failed=state.failed
    )
    return dict(msgspec.to_builtins(report))


def robot_report(state: WorldRobot) -> dict[str, Any]:
    """What a robot hands in, as plain data.

    Args:
        state: At the end.
    """
    return dict(msgspec.to_builtins(RobotReport(meetings=state.robot.meetings)))


def world_progress(state: WorldState) -> tuple[int, int, str]:
    """How far the world is.

    Args:
        state: The world.
    """
    return state.time, state.truth.steps, "steps"


def robot_progress(state: WorldRobot) -> tuple[int, int, str]:
    """How far a robot is.

    Args:
        state: The robot.
    """
    return state.time, 0, f"steps; {len(state.robot.meetings)} meetings"


def course_of_run(run: TeamRun) -> TeamCourse:
    """What a team did in one process.

    Args:
        run: The run.
    """
    return TeamCourse(
        positions=run.positions,
        records=run.records,
        everything=run.everything,
        meetings=tuple(record for state in run.robots for record in state.meetings),
    )


def course_of_reports(
    setup: TeamSetup, estimate: Estimate, steps: int, reports: Mapping[str, Any]
) -> TeamCourse:
    """What a team did, from what the world and the robots handed in.

    Args:
        setup: What all robots know.
        estimate: The common first estimate.
        steps: Number of steps of a whole run.
        reports: By participant; of those that were not lost.

    Returns:
        The course.

    Raises:
        NoCandidatePathError: If a robot could not go on.
        InvalidInputError: If a report is malformed, or the world's is missing or not whole.
    """
    if WORLD not in reports:
        raise InvalidInputError(
            "reports: expected one of the world, which holds where the robots were, got "
            f"{', '.join(reports) or 'none'}"
        )
    world = _read(WORLD, reports[WORLD], WorldReport)
    if world.failed:
        raise NoCandidatePathError(f"planner 'intermittent': {world.failed}")
    wanted = (steps + 1, len(setup.robots), 2)
    positions = np.array(world.places, dtype=np.float64)
    if positions.shape != wanted:
        raise InvalidInputError(
            f"report of the world: expected places of shape {wanted}, got {positions.shape}: the "
            "run was not brought to its end"
        )
    meetings: list[MeetingRecord] = []
    for name in setup.robots:
        if name in reports:
            meetings += _read(name, reports[name], RobotReport).meetings
    return TeamCourse(
        positions=positions,
        records=world.records,
        everything=setup.model.run(estimate, steps, list(world.records)),
        meetings=tuple(meetings),
        gone=world.gone,
    )


def plan_of_course(
    mission: Mission,
    setup: TeamSetup,
    course: TeamCourse,
    options: Mapping[str, Any],
    step_s: float,
) -> Plan:
    """A run on what is expected, as a plan.

    Args:
        mission: What was given.
        setup: What all robots know.
        course: What they did.
        options: Options of the team as used.
        step_s: Duration of a step, seconds.

    Returns:
        The plan, without traffic and seconds.
    """
    goals = {robot.name: robot.goals for robot in mission.robots}
    robots = []
    for row, name in enumerate(setup.robots):
        places = course.positions[:, row]
        ways = np.diff(places, axis=0)
        headings = np.append(np.arctan2(ways[:, 1], ways[:, 0]), 0.0)
        headings[-1] = headings[-2]
        poses = np.column_stack([places, headings])
        path = CandidatePath(
            robot=name,
            poses=poses,
            times_s=np.arange(len(poses), dtype=np.float64) * step_s,
            motion_covariances=np.tile(KNOWN_MOTION * np.eye(3), (len(ways), 1, 1)),
        )
        robots.append(
            RobotPlan(
                robot=name,
                start=poses[0],
                path=path,
                covariances=np.zeros((0, 3, 3)),
                goals=goals[name],
            )
        )
    schedule = setup.schedule
    meetings = sorted(
        (record for record in course.meetings if record.rank > -2),
        key=lambda record: (record.time, record.team),
    )
    return Plan(
        planner="intermittent",
        mission=mission.name,
        scenario_digest=mission.digest,
        seed=mission.seed,
        robots=tuple(robots),
        objective=(ObjectiveValue(0, "", float(course.everything.uncertainty.sum())),),
        report={
            "meetings": len(meetings),
            "without_fallback": sum(r.rank == 0 and not r.failed for r in meetings),
            "measurements": sum(len(record.readings) for _, record in course.records),
        },
        agreed=not course.gone,
        warnings=tuple(
            f"robot {name!r} was lost in step {time}: it stands still from then on"
            for name, time in course.gone.items()
        ),
        options={**options, **asdict(setup.options)},
        details={
            "teams": [list(team) for team in schedule.graph.teams],
            "schedules": {name: list(schedule.sequence(name)) for name in setup.robots},
            "period": schedule.period,
            "delay_bound_epochs": schedule.delay_bound,
            "meetings": [_meeting(record, setup, course) for record in meetings],
            "targets": [target.name for target in mission.targets],
            "uncertainty": course.everything.uncertainty.tolist(),
            "target_means": course.everything.means.tolist(),
            "target_covariance_at_end": course.everything.estimate.covariance.tolist(),
        },
    )


def _meeting(record: MeetingRecord, setup: TeamSetup, course: TeamCourse) -> dict[str, Any]:
    """A meeting as plain data."""
    rows = [setup.robots.index(name) for name in record.present]
    return {
        "team": record.team,
        "epoch": record.epoch,
        "step": record.time,
        "robots": list(record.present),
        "places": course.positions[record.time, rows].tolist(),
        "next_plan_failed": list(record.failed),
        "next_plan_rank": record.rank,
    }


def _read(name: str, report: Any, kind: type) -> Any:  # noqa: ANN401 - plain data in, kind out
    """A report of plain data."""
    try:
        return msgspec.convert(report, kind)
    except msgspec.ValidationError as error:
        raise InvalidInputError(f"report of {name!r}: {error}") from error
