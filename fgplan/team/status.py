"""How far a robot has come: sign of life, question and answer in one.

A status names the head of the robot's log, how good that is, and the entries of the open turn that
it holds. Whoever is asked sends what is lacking, or its own status if nothing is; whoever hears of
a better log asks for it. Entries never change, so they are passed on as they were written.
"""

import math
from typing import Annotated

import msgspec

from fgplan.errors import InvalidInputError
from fgplan.message_reader import MessageReader
from fgplan.team.envelope import Count, Envelope, Name, Outgoing
from fgplan.team.known_logs import KnownLogs, entries_for
from fgplan.team.log import Preference
from fgplan.team.robot_setup import RobotSetup

STATUS = "status"
ANSWER_LIMIT = 256
"""Entries that one answer holds at most; the next status gets the rest."""


class Status(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag="status.v1",
    tag_field="schema",
):
    """How far a robot has come; turn and head are the envelope's ``sequence`` and ``parent``.

    Attributes:
        changes: Late openings and withdrawals in its log.
        value: Common objective of its ledger, or None.
        holds: Robots whose entries of the open turn it has.
        ask: Who shall send what it lacks, or empty.
    """

    changes: Count
    value: float | None = None
    holds: Annotated[tuple[Name, ...], msgspec.Meta(max_length=4096)] = ()
    ask: Annotated[str, msgspec.Meta(max_length=256)] = ""

    def preference(self, envelope: Envelope) -> Preference:
        """That of the log, as in ``Log``."""
        value = -math.inf if self.value is None else -self.value
        return self.changes, value, envelope.sequence, envelope.parent


_READER: MessageReader[Status] = MessageReader(Status)


def status_of(setup: RobotSetup, logs: KnownLogs, ask: str = "") -> Envelope:
    """Tell how far this robot has come.

    Args:
        setup: What it knows.
        logs: What it has heard.
        ask: Who shall send what it lacks, or empty.

    Returns:
        The message.
    """
    log = logs.current
    status = Status(changes=log.changes, value=log.ledger.value, holds=tuple(logs.pending), ask=ask)
    return Envelope(
        robot=setup.robot,
        session=setup.options.session,
        sequence=log.turn,
        kind=STATUS,
        parent=log.head,
        payload=msgspec.msgpack.encode(status),
    )


def decode_status(envelope: Envelope) -> Status:
    """Read a status.

    Args:
        envelope: As received.

    Returns:
        The status.

    Raises:
        InvalidInputError: If it is malformed or its value is not finite.
    """
    name = f"status of robot {envelope.robot!r}"
    status = _READER.read(envelope.payload, name)
    if status.value is not None and not math.isfinite(status.value):
        raise InvalidInputError(f"{name}: value: expected a finite number, got {status.value}")
    return status


def lacks(logs: KnownLogs, envelope: Envelope, status: Status) -> bool:
    """Whether a teammate has a better log, unknown here.

    Args:
        logs: What this robot has heard.
        envelope: The teammate's status.
        status: Its content.

    Returns:
        Whether this robot should ask it.
    """
    unknown = envelope.parent not in logs.known
    return unknown and status.preference(envelope) > logs.current.preference


def answer(
    setup: RobotSetup, logs: KnownLogs, envelope: Envelope, status: Status
) -> list[Outgoing]:
    """Answer a teammate that has asked this robot.

    Args:
        setup: What this robot knows.
        logs: What it has heard.
        envelope: The teammate's status.
        status: Its content.

    Returns:
        Entries that it lacks, or this robot's own status if it lacks none.
    """
    theirs = logs.known.get(envelope.parent, logs.known[b""])
    sent = entries_for(logs, theirs, status.holds, ANSWER_LIMIT) or (status_of(setup, logs),)
    return [Outgoing(message, envelope.robot) for message in sent]
