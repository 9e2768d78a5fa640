"""A team of robots step by step in a simulated world: move, measure, talk to whoever is in range.

Nothing but each robot's own ``step`` decides. The world moves a robot to where it wants to be,
unless it is absent: then it stays, measures nothing and says nothing. In the first step after an
absence it sees where it is; its leg would have it elsewhere, and no robot jumps.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.estimate import Estimate, Filtered, Record
from fgplan.planners.intermittent.leg import Leg
from fgplan.planners.intermittent.message import Sensed, wrap
from fgplan.planners.intermittent.radio import Radio
from fgplan.planners.intermittent.robot import place_at, step
from fgplan.planners.intermittent.robot_state import RobotState, TeamSetup, start_robot
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from fgplan.planners.intermittent.truth import Truth
from fgplan.planners.planner import Progress
from fgplan.team.envelope import Inbox, TrafficByKind
from fgplan.team.in_process import InProcessTransport
from fgplan.typing import FloatArray


@dataclass(frozen=True, slots=True)
class Absence:
    """A time in which a robot stands still, blind and silent.

    Attributes:
        robot: Name.
        start: First step.
        end: First step in which it goes on; infinite for a robot that is gone.
    """

    robot: str
    start: int
    end: float

    def __post_init__(self) -> None:
        """Check that it ends after it began."""
        if not 1 <= self.start < self.end:
            raise InvalidInputError(
                f"absence of robot {self.robot!r}: expected 1 <= start < end, got {self.start} "
                f"and {self.end}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """A robot's estimate as fused at a meeting.

    Attributes:
        robot: Name.
        team: Team that met.
        epoch: Epoch of the meeting.
        time: Step of the meeting.
        begun: Time of the checkpoint that it was fused from.
        filtered: From the checkpoint to the meeting.
    """

    robot: str
    team: int
    epoch: int
    time: int
    begun: int
    filtered: Filtered


@dataclass(frozen=True, slots=True, eq=False)
class TeamRun:
    """What came of a run.

    Attributes:
        positions: Of every robot, shape (steps + 1, N, 2), metres.
        records: Robot and record of all measurements, in order of time, then of robot.
        everything: The filter over all of them at once: the global estimate of every step.
        robots: States at the end.
        snapshots: What the first robot present fused at every meeting, in order of time.
        traffic: Messages and bytes by kind.
        readings: Measurements stored by all robots together after each step, shape (steps + 1,).
    """

    positions: FloatArray
    records: tuple[tuple[int, Record], ...]
    everything: Filtered
    robots: tuple[RobotState, ...]
    snapshots: tuple[Snapshot, ...]
    traffic: TrafficByKind
    readings: FloatArray


def run_team(
    setup: TeamSetup,
    legs: Mapping[str, Mapping[int, Leg]],
    estimate: Estimate,
    truth: Truth,
    *,
    absences: Sequence[Absence] = (),
    progress: Progress | None = None,
) -> TeamRun:
    """Run a team for as long as the truth is known.

    Args:
        setup: What all robots know.
        legs: Initial paths of every robot, by team.
        estimate: The common first estimate, at time 0.
        truth: States and noise.
        absences: Who stands still when.
        progress: Told the steps that are done.

    Returns:
        The run.
    """
    names = setup.robots
    states = {name: start_robot(setup, name, legs[name], estimate) for name in names}
    positions = np.zeros((truth.steps + 1, len(names), 2))
    positions[0] = [state.position for state in states.values()]
    transport = InProcessTransport(names)
    radio = Radio(transport, setup.options.range_m, dict(zip(names, positions[0], strict=True)))
    records: list[tuple[int, Record]] = []
    snapshots: list[Snapshot] = []
    stored = np.zeros(truth.steps + 1)
    held = np.zeros(len(names))
    away: set[str] = set()
    for time in range(1, truth.steps + 1):
        if progress is not None and time % 20 == 0:
            progress(time, truth.steps, f"{len(snapshots)} meetings")
        woken, away = away, {one.robot for one in absences if one.start <= time < one.end}
        sensed = {}
        for row, name in enumerate(names):
            place = positions[time - 1, row]
            if name not in away:
                place = place if name in woken else place_at(states[name], time)
                sensed[name] = Sensed(sense(setup, row, place, time, truth))
                records.append((row, sensed[name].record))
            positions[time, row] = place
            radio.move(name, None if name in away else place)
        before = {name: len(states[name].meetings) for name in names}
        for name, content in sensed.items():
            _step(states, name, radio, (wrap(name, 0, time, content),))
        while True:
            waiting = [name for name in radio.waiting() if name not in away]
            for name in waiting:
                _step(states, name, radio, ())
            if waiting:
                continue
            # No message is under way: whoever leads a complete team plans now.
            for name in sensed:
                _step(states, name, radio, ())
            if not radio.waiting():
                break
        seen: set[int] = set()  # teams of which a member has spoken
        for row, name in enumerate(names):
            state = states[name]
            if name in sensed:
                held[row] += len(sensed[name].record.readings)
            if len(state.meetings) > before[name] and state.fused is not None:
                last = state.meetings[-1]
                held[row] = last.readings
                if last.team not in seen:
                    seen.add(last.team)
                    snapshots.append(Snapshot(name, last.team, last.epoch, time, *state.fused))
        stored[time] = held.sum()
    return TeamRun(
        positions=positions,
        records=tuple(records),
        everything=setup.model.run(estimate, truth.steps, records),
        robots=tuple(states.values()),
        snapshots=tuple(snapshots),
        traffic=transport.traffic,
        readings=stored,
    )


def first_legs(
    setup: TeamSetup, starts: Mapping[str, FloatArray], estimate: Estimate
) -> dict[str, dict[int, Leg]]:
    """Initial paths: every team's first meeting, planned one epoch after the other.

    Args:
        setup: What all robots know.
        starts: Where each robot is at time 0, shape (2,), metres.
        estimate: The common first estimate, at time 0.

    Returns:
        Legs of every robot, by team.

    Raises:
        NoCandidatePathError: If obstacles keep a team apart.
    """
    schedule = setup.schedule
    legs: dict[str, dict[int, Leg]] = {name: {} for name in setup.robots}
    for epoch in range(1, schedule.period + 1):
        for team in schedule.teams_in(epoch):
            members = schedule.graph.teams[team]
            last = [
                max(legs[name].values(), key=lambda leg: leg.epoch, default=None)
                for name in members
            ]
            begins = [0 if leg is None else leg.due for leg in last]
            rows = range(max(begins) + 1)
            tracks = [
                [_initial_place(legs[name], np.asarray(starts[name]), time) for name in members]
                for time in rows
            ]
            problem = SegmentProblem(
                workspace=setup.workspace,
                model=setup.model,
                estimate=estimate,
                starts=np.array(
                    [
                        starts[name] if leg is None else leg.places[-1]
                        for name, leg in zip(members, last, strict=True)
                    ]
                ),
                times=np.array(begins),
                tracks=np.array(tracks),
                carriers=np.array([setup.robots.index(name) for name in members]),
                bodies=np.arange(len(members)),
            )
            generator = np.random.default_rng([setup.seed, team, epoch])
            segment = setup.planner(problem, setup.options, generator)
            for name, begin, places in zip(members, begins, segment.places, strict=True):
                legs[name][team] = Leg(team, epoch, segment.end, begin, places)
    return legs


def _initial_place(legs: Mapping[int, Leg], start: FloatArray, time: int) -> FloatArray:
    """Where a robot is on its initial legs."""
    place = start
    for leg in sorted(legs.values(), key=lambda leg: leg.epoch):
        if time >= leg.start:
            place = leg.place_at(time)
    return place


def sense(setup: TeamSetup, row: int, place: FloatArray, time: int, truth: Truth) -> Record:
    """What a robot's sensors say in a step.

    Args:
        setup: What all robots know.
        row: The robot, in the order of the team.
        place: Where it is, shape (2,), metres.
        time: Step.
        truth: States and noise.

    Returns:
        The record of the step, without readings where it does not measure.
    """
    readings: tuple[tuple[int, tuple[float, ...]], ...] = ()
    if time % setup.model.every == 0:
        normals = truth.normals[time, row]
        readings = setup.model.measure(row, truth.states[time], place, normals)
    return Record(time, (float(place[0]), float(place[1])), readings)


def _step(states: dict[str, RobotState], name: str, radio: Radio, own: tuple) -> None:
    """One robot's step, and what it sends."""
    inbox = Inbox(radio.now(), (*own, *radio.receive(name)))
    states[name], outbox = step(states[name], inbox)
    for outgoing in outbox:
        radio.send(name, outgoing.envelope, outgoing.to)
