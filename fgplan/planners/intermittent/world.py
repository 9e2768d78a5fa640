"""The simulated world as a participant: ``step(state, inbox) -> (state, outbox)``.

It moves robots to where they want to be, measures for them, and says who is within range of radio;
what robots tell each other goes from one to the other and is not seen here. Time goes on when no
message is under way. That is so when every robot has answered the world's last message to it and,
for every pair, what one says it has sent is what the other says it has heard: robots act on
messages alone, so the first to act after its answer would have to have got one more than it says.
Robots at a meeting are told that it is quiet, until that makes nobody speak; then comes the next
step. So the run is that of ``team_run.run_team``, whatever the order in which messages arrive.

A robot that the network no longer sees stands still from then on, blind and silent, for good:
messages to it may be lost, and it would be of another time if it came back.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.estimate import Record
from fgplan.planners.intermittent.radio import is_in_range
from fgplan.planners.intermittent.robot_state import TeamSetup
from fgplan.planners.intermittent.team_run import sense
from fgplan.planners.intermittent.truth import Truth
from fgplan.planners.intermittent.world_message import (
    WORLD,
    Over,
    Quiet,
    Stood,
    Tick,
    WorldMessage,
    unwrap_world,
    wrap_world,
)
from fgplan.team.envelope import Envelope, Inbox, Outbox, Outgoing
from fgplan.typing import FloatArray

Place = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorldState:
    """The world between two steps.

    Attributes:
        setup: What all robots know.
        truth: States and noise.
        time: Steps that have begun.
        places: Where each robot was in each step, in the order of the team.
        records: Robot and record of all measurements, in order of time, then of robot.
        number: Of its last message.
        told: Number of its last message to each robot; none is 0, as robots that report for the
            first time say.
        stood: The last answer of each robot and its place among that robot's answers.
        spoken: Messages that robots had sent when they were last told that it is quiet; -1 where
            they were not in this step.
        gone: Robots that the network no longer sees, and the step since when.
        failed: Why a robot could not go on, or nothing.
        finished: Whether the last step is over.
        wake_s: When it wants to be stepped at the latest.
    """

    setup: TeamSetup
    truth: Truth
    time: int = 0
    places: tuple[tuple[Place, ...], ...]
    records: tuple[tuple[int, Record], ...] = ()
    number: int = 0
    told: Mapping[str, int] = field(default_factory=dict)
    stood: Mapping[str, tuple[int, Stood]] = field(default_factory=dict)
    spoken: int = -1
    gone: Mapping[str, int] = field(default_factory=dict)
    failed: str = ""
    finished: bool = False
    wake_s: float = 0.0


def start_world(setup: TeamSetup, truth: Truth, starts: Mapping[str, FloatArray]) -> WorldState:
    """The world before the first step.

    Args:
        setup: What all robots know.
        truth: States and noise.
        starts: Where each robot is, shape (2,), metres.

    Returns:
        The world; step 1 begins when all robots have said where they want to be in it.
    """
    rows = np.array([starts[name] for name in setup.robots], dtype=np.float64).tolist()
    return WorldState(setup=setup, truth=truth, places=(tuple((x, y) for x, y in rows),))


def step(state: WorldState, inbox: Inbox) -> tuple[WorldState, Outbox]:
    """Take in what robots say; let time go on when no message is under way.

    Args:
        state: The world; not changed.
        inbox: ``stood`` of robots.

    Returns:
        The world afterwards, and what it tells the robots.

    Raises:
        InvalidInputError: If a message is malformed.
    """
    for envelope in inbox.envelopes:
        state = _take_in(state, envelope)
    if inbox.present is not None and not state.finished:  # else they leave because it is over
        left = {
            name: state.time
            for name in state.setup.robots
            if name not in inbox.present and name not in state.gone
        }
        state = replace(state, gone={**state.gone, **left})
    out: list[Outgoing] = []
    while not state.finished and _is_quiet(state):  # again where nobody is there any more
        state = _go_on(state, out)
    return replace(state, wake_s=np.inf), tuple(out)


def _take_in(state: WorldState, envelope: Envelope) -> WorldState:
    """The answer of a robot; an earlier one that comes later is dropped."""
    content = unwrap_world(envelope)
    robot = envelope.robot
    if robot not in state.setup.robots or not isinstance(content, Stood):
        raise InvalidInputError(
            f"message {envelope.kind!r} of {robot!r}: expected 'stood' of one of "
            f"{', '.join(state.setup.robots)}"
        )
    if not np.isfinite(content.place).all():
        raise InvalidInputError(f"message 'stood' of {robot!r}: expected a finite place")
    if robot in state.stood and state.stood[robot][0] >= envelope.sequence:
        return state
    return replace(
        state,
        stood={**state.stood, robot: (envelope.sequence, content)},
        failed=state.failed or content.failed,
    )


def _there(state: WorldState) -> list[str]:
    """Robots that are not gone, in the order of the team."""
    return [name for name in state.setup.robots if name not in state.gone]


def _is_quiet(state: WorldState) -> bool:
    """Whether no message is under way, see the module header."""
    there = _there(state)
    if state.failed:
        return True
    if any(name not in state.stood for name in there):
        return False
    answers = {name: state.stood[name][1] for name in there}
    if any(answer.number != state.told.get(name, 0) for name, answer in answers.items()):
        return False
    return all(
        answers[one].sent.get(other, 0) == answers[other].heard.get(one, 0)
        for one in there
        for other in there
    )


def _go_on(state: WorldState, out: list[Outgoing]) -> WorldState:
    """It is quiet: say so to those at a meeting, or begin the next step, or end."""
    answers = {name: state.stood[name][1] for name in _there(state) if name in state.stood}
    meeting = [name for name, answer in answers.items() if answer.meeting]
    spoken = sum(sum(answer.sent.values()) for answer in answers.values())
    number = state.number + 1
    if meeting and spoken != state.spoken and not state.failed:
        state = replace(state, spoken=spoken)
        messages: dict[str, WorldMessage] = {name: Quiet(number=number) for name in meeting}
    elif state.failed or state.time == state.truth.steps:
        state = replace(state, finished=True)
        messages = {name: Over(number=number) for name in state.setup.robots}
    else:
        state = _moved(state)
        messages = {name: _tick_of(state, name, number) for name in _there(state)}
    for name, message in messages.items():
        out.append(Outgoing(wrap_world(WORLD, number, message), name))
    return replace(state, number=number, told={**state.told, **dict.fromkeys(messages, number)})


def _moved(state: WorldState) -> WorldState:
    """Begin the next step: move, and measure."""
    time, setup = state.time + 1, state.setup
    places, records = list(state.places[-1]), list(state.records)
    for row, name in enumerate(setup.robots):
        if name in state.gone:
            continue
        places[row] = state.stood[name][1].place
        records.append((row, sense(setup, row, np.array(places[row]), time, state.truth)))
    return replace(
        state,
        time=time,
        places=(*state.places, tuple(places)),
        records=tuple(records),
        spoken=-1,
    )


def _tick_of(state: WorldState, name: str, number: int) -> Tick:
    """What the world tells a robot of a step that has begun."""
    setup, places = state.setup, np.array(state.places[-1])
    row = setup.robots.index(name)
    record = next(record for other, record in state.records[-len(_there(state)) :] if other == row)
    return Tick(
        number=number,
        record=record,
        in_range=tuple(
            other
            for column, other in enumerate(setup.robots)
            if other != name
            and other not in state.gone
            and is_in_range(places[row], places[column], setup.options.range_m)
        ),
    )
