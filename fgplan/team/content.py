"""What an entry says: decoded and checked once, where it arrives."""

from typing import cast

from fgplan.announcement.announcement import (
    Announcement,
    Message,
    Withdrawal,
    decode_message,
)
from fgplan.errors import InvalidInputError
from fgplan.team.envelope import Envelope
from fgplan.team.refusal import Refusal, decode_refusal
from fgplan.team.robot_setup import RobotSetup

Content = Message | Refusal

ENTRIES = ("announcement", "withdrawal", "refusal")
"""Kinds of entries; whoever has one may pass it on."""


def content_of(setup: RobotSetup, envelope: Envelope) -> Content:
    """The payload of an entry; checked where it came as bytes, and kept with the envelope.

    Args:
        setup: What the robot that reads it knows.
        envelope: The entry.

    Returns:
        Announcement, withdrawal or refusal.

    Raises:
        InvalidInputError: If it is malformed, or its objective or models are not the reader's.
    """
    if envelope.content is not None:
        kept = cast(Content, envelope.content)
        if isinstance(kept, Announcement):
            _check_terms(setup, kept)
        return kept
    message: Content
    if envelope.kind == "refusal":
        message = decode_refusal(envelope.payload, envelope.robot)
    elif envelope.kind in ENTRIES:
        message = decode_message(envelope.payload, envelope.robot)
        _check_message(setup, envelope, message)
    else:
        raise InvalidInputError(
            f"turn {envelope.sequence} of robot {envelope.robot!r}: kind: expected announcement, "
            f"withdrawal or refusal, got {envelope.kind!r}"
        )
    envelope.keep(message)
    return message


def _check_message(setup: RobotSetup, envelope: Envelope, message: Message) -> None:
    """Check a teammate's announcement against what this robot knows."""
    name = f"announcement {message.sequence} of robot {message.robot!r}"
    author = message.by if isinstance(message, Withdrawal) else message.robot
    # A robot that opens late knows the ledger, but its first path was computed from nothing.
    if author != envelope.robot or message.basis not in (envelope.basis, {}):
        raise InvalidInputError(
            f"{name}: robot and basis: expected those of the envelope, {envelope.robot!r} and "
            f"{envelope.basis}, got {author!r} and {message.basis}"
        )
    if message.prior_digest != setup.sender.prior_digest:
        raise InvalidInputError(
            f"{name}: prior_digest: expected {setup.sender.prior_digest!r}, got "
            f"{message.prior_digest!r}; all robots must hold the same prior"
        )
    if (envelope.kind == "withdrawal") != isinstance(message, Withdrawal):
        raise InvalidInputError(
            f"{name}: kind: expected what the envelope says, {envelope.kind}, got a "
            f"{type(message).__name__.lower()}"
        )
    if isinstance(message, Withdrawal):
        if message.by != message.robot and setup.options.drop_after_s == float("inf"):
            raise InvalidInputError(
                f"{name}: by: expected the robot itself, got {message.by!r}; paths of lost robots "
                "are kept here (drop_after_s says otherwise)"
            )
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
