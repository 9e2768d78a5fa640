"""What every message between robots is wrapped in, whatever the planner.

The envelope says who sends what, in which planning session, at which place, computed from what.
The payload is the planner's own; a transport never looks inside.
"""

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any

import msgspec

from fgplan.errors import InvalidInputError
from fgplan.message_reader import MessageReader

MAX_ENVELOPE_BYTES = 65 * 1024 * 1024
"""Largest envelope that is read at all."""

Name = Annotated[str, msgspec.Meta(min_length=1, max_length=256)]
Count = Annotated[int, msgspec.Meta(ge=0)]


class Envelope(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    dict=True,
    forbid_unknown_fields=True,
    omit_defaults=True,
    tag="envelope.v1",
    tag_field="schema",
):
    """A message on its way.

    Attributes:
        robot: Who wrote it; a teammate may pass it on unchanged.
        session: Planning session.
        sequence: Its place: the turn, or whatever the protocol of the kind counts.
        kind: What the payload is.
        basis: Sequence of each robot's announcement that the writer held.
        parent: Digest of the log that it goes on from, or empty where a kind keeps no log.
        payload: The message itself.
        signature: The writer's, over all the rest; empty where the team does not sign.
    """

    robot: Name
    session: Count
    sequence: Count
    kind: Name
    basis: dict[Name, Count] = {}
    parent: Annotated[bytes, msgspec.Meta(max_length=64)] = b""
    payload: bytes = b""
    signature: Annotated[bytes, msgspec.Meta(max_length=1024)] = b""

    @cached_property
    def encoded(self) -> bytes:
        """The envelope as msgpack."""
        return msgspec.msgpack.encode(self)

    @property
    def byte_size(self) -> int:
        """Bytes on the wire."""
        return len(self.encoded)

    @cached_property
    def signed_part(self) -> bytes:
        """What the signature is over: all but itself, as msgpack."""
        if not self.signature:
            return self.encoded
        return msgspec.msgpack.encode(msgspec.structs.replace(self, signature=b""))

    @cached_property
    def digest(self) -> bytes:
        """What it is known by: 16 bytes of BLAKE2b over all but the signature."""
        return hashlib.blake2b(self.signed_part, digest_size=16).digest()

    @property
    def content(self) -> Any:  # noqa: ANN401 - the payload is the planner's
        """The decoded payload where it was kept with the envelope, or None."""
        return self.__dict__.get("content_kept")

    def keep(self, content: Any) -> "Envelope":  # noqa: ANN401
        """Keep the decoded, checked payload with the envelope, so that it is read once.

        It does not travel: an envelope that was encoded and read again holds none.
        """
        self.__dict__["content_kept"] = content
        return self


_READER: MessageReader[Envelope] = MessageReader(Envelope)


def decode_envelope(data: bytes) -> Envelope:
    """Read an envelope.

    Args:
        data: As received.

    Returns:
        The envelope; its payload is not looked at.

    Raises:
        InvalidInputError: If it is malformed or too large.
    """
    if len(data) > MAX_ENVELOPE_BYTES:
        raise InvalidInputError(
            f"envelope: expected at most {MAX_ENVELOPE_BYTES} bytes, got {len(data)}"
        )
    return _READER.read(data, "envelope")


@dataclass(frozen=True, slots=True)
class Inbox:
    """What a robot is given for one step.

    Attributes:
        now_s: Time of the transport, seconds.
        envelopes: What arrived, in order of arrival.
        present: Teammates that the network sees now; None where it cannot tell.
    """

    now_s: float
    envelopes: tuple[Envelope, ...] = ()
    present: frozenset[str] | None = None


@dataclass(frozen=True, slots=True)
class Outgoing:
    """One message that a step wants sent.

    Attributes:
        envelope: The message.
        to: One robot, or None for all others.
    """

    envelope: Envelope
    to: str | None = None


Outbox = tuple[Outgoing, ...]


@dataclass(slots=True)
class Traffic:
    """Counts of one kind of message.

    Attributes:
        sent: Messages handed to the transport; one to all others counts once.
        sent_bytes: Their bytes.
        delivered: Copies handed to receivers.
        delivered_bytes: Their bytes.
        lost: Copies that faults took.
    """

    sent: int = 0
    sent_bytes: int = 0
    delivered: int = 0
    delivered_bytes: int = 0
    lost: int = 0


@dataclass(slots=True)
class TrafficByKind:
    """Counts of messages and bytes by kind of message."""

    kinds: dict[str, Traffic] = field(default_factory=dict)

    def copy(self) -> "TrafficByKind":
        """The counts as they are now."""
        return TrafficByKind({kind: replace(counts) for kind, counts in self.kinds.items()})

    def of(self, kind: str) -> Traffic:
        """Counts of one kind, made at its first message."""
        if kind not in self.kinds:
            self.kinds[kind] = Traffic()
        return self.kinds[kind]
