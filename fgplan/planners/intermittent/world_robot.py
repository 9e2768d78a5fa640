"""A robot of an intermittently connected team in a simulated world, each in its own process.

Around the robot of ``robot.step``: the world says where it is, what it measured and who is in
range; what it says to all goes to each of these; after everything that it has taken in it tells
the world where it stands. Messages of teammates name the step in which they were sent, as the
basis that they have of the world; one that is a step ahead waits until the world has said the same
here.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.planners.intermittent.message import Sensed, unwrap, wrap
from fgplan.planners.intermittent.robot import place_at
from fgplan.planners.intermittent.robot import step as step_alone
from fgplan.planners.intermittent.robot_state import RobotState
from fgplan.planners.intermittent.world_message import (
    WORLD,
    Over,
    Quiet,
    Stood,
    unwrap_world,
    wrap_world,
)
from fgplan.team.envelope import Envelope, Inbox, Outbox, Outgoing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorldRobot:
    """A robot between two steps, and what it knows of the world's.

    Attributes:
        robot: The robot itself.
        number: Of the world's last message.
        in_range: Teammates within range of radio.
        sent: Messages to each teammate so far.
        heard: Messages of each teammate so far.
        ahead: Messages that were sent in the next step.
        answers: Times that it has told the world where it stands.
        refused: Messages of teammates that were malformed.
        failed: Why it cannot go on, or nothing.
        finished: Whether the world is over.
        wake_s: When it wants to be stepped at the latest.
    """

    robot: RobotState
    number: int = 0
    in_range: tuple[str, ...] = ()
    sent: Mapping[str, int] = field(default_factory=dict)
    heard: Mapping[str, int] = field(default_factory=dict)
    ahead: tuple[Envelope, ...] = ()
    answers: int = 0
    refused: int = 0
    failed: str = ""
    finished: bool = False
    wake_s: float = 0.0

    @property
    def time(self) -> int:
        """Step of the world."""
        return self.robot.now


def step(state: WorldRobot, inbox: Inbox) -> tuple[WorldRobot, Outbox]:
    """Take in what the world and teammates say, and tell the world where it stands.

    Args:
        state: The robot; not changed.
        inbox: Messages of the world and of teammates.

    Returns:
        The robot afterwards, and what it sends.

    Raises:
        InvalidInputError: If a message of the world is malformed, or one of a teammate is of a
            step that has not come or is over.
    """
    out: list[Outgoing] = []
    for envelope in inbox.envelopes:
        state = (
            _follow(state, envelope, out)
            if envelope.robot == WORLD
            else _hear(state, envelope, out)
        )
    began = state.answers > 0
    if began and inbox.present is not None and WORLD not in inbox.present:
        state = replace(state, finished=True)
    if state.finished or (began and not inbox.envelopes):
        return replace(state, wake_s=np.inf), tuple(out)
    state = replace(state, answers=state.answers + 1, wake_s=np.inf)
    out.append(Outgoing(wrap_world(state.robot.robot, state.answers, _stood(state)), WORLD))
    return state, tuple(out)


def _follow(state: WorldRobot, envelope: Envelope, out: list[Outgoing]) -> WorldRobot:
    """What the world says."""
    content, robot = unwrap_world(envelope), state.robot
    if isinstance(content, Stood) or content.number <= state.number:
        raise InvalidInputError(
            f"message {envelope.kind!r} of the world: expected one after number {state.number}"
        )
    state = replace(state, number=content.number)
    if isinstance(content, Over):
        return replace(state, finished=True)
    if isinstance(content, Quiet):
        return _step_alone(state, (), out)
    if content.record.time != state.time + 1 or not set(content.in_range) <= _teammates(robot):
        raise InvalidInputError(
            f"message 'tick' of the world: expected step {state.time + 1} and teammates in range, "
            f"got step {content.record.time} and {list(content.in_range)}"
        )
    state = replace(state, in_range=content.in_range)
    sensed = wrap(robot.robot, 0, content.record.time, Sensed(content.record))
    state = _step_alone(state, (sensed,), out)
    waiting, state = state.ahead, replace(state, ahead=())
    for message in waiting:
        state = _hear(state, message, out)
    return state


def _hear(state: WorldRobot, envelope: Envelope, out: list[Outgoing]) -> WorldRobot:
    """What a teammate says, once the world here is as far as it was there."""
    sent_in = envelope.basis.get(WORLD, -1)
    if envelope.robot not in _teammates(state.robot) or not 0 <= sent_in - state.time <= 1:
        raise InvalidInputError(
            f"message {envelope.kind!r} of {envelope.robot!r}: expected one of a teammate in step "
            f"{state.time} or the next, got one of step {sent_in}"
        )
    if sent_in > state.time:
        return replace(state, ahead=(*state.ahead, envelope))
    count = state.heard.get(envelope.robot, 0) + 1
    state = replace(state, heard={**state.heard, envelope.robot: count})
    try:
        if isinstance(unwrap(envelope), Sensed):
            raise InvalidInputError("message 'sensed': expected from the robot's own sensors")
        return _step_alone(state, (envelope,), out)
    except InvalidInputError:
        # It counts as heard all the same, or the world would wait for it.
        return replace(state, refused=state.refused + 1)


def _step_alone(
    state: WorldRobot, envelopes: tuple[Envelope, ...], out: list[Outgoing]
) -> WorldRobot:
    """The robot's own step; what it says to all goes to each who is in range."""
    if state.failed:
        return state
    try:
        robot, said = step_alone(state.robot, Inbox(0.0, envelopes))
    except NoCandidatePathError as error:
        return replace(state, failed=str(error))
    sent = dict(state.sent)
    for outgoing in said:
        envelope, basis = outgoing.envelope, {WORLD: robot.now}
        message = msgspec.structs.replace(envelope, basis=basis).keep(envelope.content)
        for other in state.in_range:
            if outgoing.to in (None, other):
                sent[other] = sent.get(other, 0) + 1
                out.append(Outgoing(message, other))
    return replace(state, robot=robot, sent=sent)


def _teammates(robot: RobotState) -> set[str]:
    """Everybody else."""
    return set(robot.setup.robots) - {robot.robot}


def _stood(state: WorldRobot) -> Stood:
    """Where it stands."""
    x, y = place_at(state.robot, state.time + 1).tolist()
    return Stood(
        number=state.number,
        meeting=state.robot.phase == "meeting",
        place=(x, y),
        sent=dict(state.sent),
        heard=dict(state.heard),
        failed=state.failed,
    )
