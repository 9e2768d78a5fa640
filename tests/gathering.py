"""A small protocol to try endpoints with: robots gather a number of each teammate."""

import math

import msgspec

from fgplan.errors import InvalidInputError
from fgplan.team.envelope import Envelope, Outgoing

ASK_EVERY_S = 0.2


class GatherState(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot has gathered."""

    robot: str
    robots: tuple[str, ...]
    numbers: dict[str, int] = {}
    present: tuple[str, ...] = ()
    wake_s: float = 0.0

    @property
    def finished(self):
        return len(self.numbers) == len(self.robots)


def gather_step(state, inbox):
    """Take numbers in, answer asks, ask for what is missing when it is time."""
    numbers, outgoing = dict(state.numbers), []
    if state.robot not in numbers:
        numbers[state.robot] = len(state.robot) + ord(state.robot[-1])
        outgoing.append(Outgoing(envelope_of(state.robot, "number", numbers[state.robot])))
    for envelope in inbox.envelopes:
        if envelope.kind == "ask":
            mine = envelope_of(state.robot, "number", numbers[state.robot])
            outgoing.append(Outgoing(mine, envelope.robot))
        elif envelope.kind == "number" and envelope.payload == b"":
            numbers[envelope.robot] = envelope.sequence
        else:
            raise InvalidInputError(f"{envelope.kind}: expected a number")
    state = msgspec.structs.replace(
        state, numbers=numbers, present=tuple(sorted(inbox.present or ()))
    )
    if state.finished:
        return msgspec.structs.replace(state, wake_s=math.inf), tuple(outgoing)
    if inbox.now_s >= state.wake_s:
        outgoing.append(Outgoing(envelope_of(state.robot, "ask", 0)))
        state = msgspec.structs.replace(state, wake_s=inbox.now_s + ASK_EVERY_S)
    return state, tuple(outgoing)


def envelope_of(robot, kind, number):
    return Envelope(robot=robot, session=0, sequence=number, kind=kind)
