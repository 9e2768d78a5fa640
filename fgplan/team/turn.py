"""A turn: taking in the entries of its writers, and closing it once they are all there.

Entries are applied in the order of the team, whatever the order of arrival; of several that
answered at the same moment with one basis the ledger therefore accepts the earliest robot's.
"""

from typing import cast

import msgspec

from fgplan.announcement.announcement import (
    Announcement,
    Message,
    Withdrawal,
    decode_message,
)
from fgplan.errors import InvalidInputError, StaleAnnouncementError
from fgplan.team.envelope import Envelope
from fgplan.team.order import round_order
from fgplan.team.refusal import Refusal, decode_refusal
from fgplan.team.robot_state import RobotSetup, RobotState

AHEAD_LIMIT = 4096
"""Entries of later turns that are kept."""


def take_in(state: RobotState, envelope: Envelope) -> RobotState:
    """Keep an entry of the open turn or of a later one; drop what is old or not ours.

    Args:
        state: The robot.
        envelope: What arrived.

    Returns:
        The robot with it.

    Raises:
        InvalidInputError: If the entry is of a robot whose turn it is not.
    """
    setup, turn = state.setup, envelope.sequence
    if envelope.session != setup.options.session or envelope.robot not in setup.robots:
        return msgspec.structs.replace(state, dropped=state.dropped + 1)
    if state.finished or turn < state.turn:
        return state
    if turn > state.turn:
        if len(state.ahead) >= AHEAD_LIMIT:
            return msgspec.structs.replace(state, dropped=state.dropped + 1)
        ahead = {**state.ahead, (turn, envelope.robot): envelope}
        return msgspec.structs.replace(state, ahead=ahead)
    if envelope.robot not in state.writers:
        raise InvalidInputError(
            f"turn {turn}: expected entries of {', '.join(state.writers)}, got one of robot "
            f"{envelope.robot!r}; do all robots have the same order and seed?"
        )
    if envelope.robot in state.written:
        return state
    return msgspec.structs.replace(state, written={**state.written, envelope.robot: envelope})


def close_turn(state: RobotState) -> RobotState:
    """Apply the entries of the open turn in the order of the team, and open the next.

    Args:
        state: The robot, with the entries of all writers.

    Returns:
        The robot on the next turn, or finished.

    Raises:
        InvalidInputError: If an entry is malformed, or its prior or objective differ.
        StaleAnnouncementError: If an entry was computed from another ledger.
    """
    setup, options = state.setup, state.setup.options
    ledger, stale, incumbent = state.ledger, state.stale, state.incumbent
    first, accepted = state.first_value, False
    refused = set(state.refused)
    basis = ledger.basis()
    entries = [state.written[robot] for robot in setup.robots if robot in state.written]
    for envelope in entries:
        message = _content(state, envelope)
        if state.turn > 0 and envelope.basis != basis:
            raise StaleAnnouncementError(
                f"turn {state.turn} of robot {envelope.robot!r}: computed from {envelope.basis}, "
                f"but the ledger holds {basis}"
            )
        if isinstance(message, Refusal):
            refused.add(envelope.robot)
            first = message.value if first is None else first
            continue
        try:
            ledger = ledger.accept(message)
        except StaleAnnouncementError:
            if options.turns or state.turn == 0:
                raise
            stale += 1  # of those that answered at the same moment the earlier has won
            continue
        accepted = True
        if isinstance(message, Announcement):
            first = message.incumbent_value if first is None else first
            if message.robot == setup.robot and state.proposed is not None:
                incumbent = state.proposed[1]
    turn = state.turn + 1
    refused = set() if accepted else refused
    place, order = (turn - 1) % len(setup.robots), state.order
    if place == 0:
        order = round_order(setup.robots, options, (turn - 1) // len(setup.robots))
    agreed = len(refused) == len(setup.robots)
    waiting = {key: envelope for key, envelope in state.ahead.items() if key[0] == turn}
    state = msgspec.structs.replace(
        state,
        ledger=ledger,
        stale=stale,
        incumbent=incumbent,
        first_value=first,
        refused=frozenset(refused),
        turn=turn,
        order=order,
        writers=(order[place],) if options.turns else setup.robots,
        log=(*state.log, *entries),
        written={},
        agreed=agreed,
        finished=agreed or turn > options.max_turns,
    )
    if waiting:
        rest = {key: envelope for key, envelope in state.ahead.items() if key not in waiting}
        state = msgspec.structs.replace(state, ahead=rest)
        for envelope in waiting.values():
            state = take_in(state, envelope)
    return state


def _content(state: RobotState, envelope: Envelope) -> Message | Refusal:
    """The decoded payload; checked where it came as bytes, and kept with the envelope."""
    if envelope.content is not None:
        kept = cast(Message | Refusal, envelope.content)
        if isinstance(kept, Announcement):
            _check_terms(state.setup, kept)
        return kept
    name = f"turn {envelope.sequence} of robot {envelope.robot!r}"
    message: Message | Refusal
    if envelope.kind == "refusal":
        message = decode_refusal(envelope.payload, envelope.robot)
    elif envelope.kind in ("announcement", "withdrawal"):
        message = decode_message(envelope.payload, envelope.robot)
        _check_message(state.setup, envelope, message)
    else:
        raise InvalidInputError(
            f"{name}: kind: expected announcement, withdrawal or refusal, got {envelope.kind!r}"
        )
    envelope.keep(message)
    return message


def _check_message(setup: RobotSetup, envelope: Envelope, message: Message) -> None:
    """Check a teammate's announcement against what this robot knows."""
    name = f"announcement {message.sequence} of robot {message.robot!r}"
    author = message.by if isinstance(message, Withdrawal) else message.robot
    if author != envelope.robot or message.basis != envelope.basis:
        raise InvalidInputError(
            f"{name}: robot and basis: expected those of the envelope, {envelope.robot!r} and "
            f"{envelope.basis}, got {author!r} and {message.basis}"
        )
    if isinstance(message, Withdrawal):
        return
    _check_terms(setup, message)
    setup.problem.check_path(message.path())


def _check_terms(setup: RobotSetup, message: Announcement) -> None:
    """Check that a teammate minimises what this robot does."""
    expected = setup.expected_terms[message.robot]
    if message.terms != expected:
        raise InvalidInputError(
            f"announcement {message.sequence} of robot {message.robot!r}: terms: expected "
            f"{expected}, got {message.terms}; all robots must have the same objective"
        )
