"""The short message of a robot that keeps its path on its turn."""

import math

import msgspec

from fgplan.errors import InvalidInputError
from fgplan.message_reader import MessageReader


class Refusal(
    msgspec.Struct,
    frozen=True,
    forbid_unknown_fields=True,
    tag="refusal.v1",
    tag_field="schema",
):
    """A robot keeps its path.

    Attributes:
        value: Common objective as it stands, or None where nothing had to be evaluated.
    """

    value: float | None = None

    @property
    def encoded(self) -> bytes:
        """The message as msgpack."""
        return msgspec.msgpack.encode(self)


_READER: MessageReader[Refusal] = MessageReader(Refusal)


def decode_refusal(data: bytes, sender: str) -> Refusal:
    """Read a refusal.

    Args:
        data: As received.
        sender: Robot that it came from.

    Returns:
        The refusal.

    Raises:
        InvalidInputError: If it is malformed or its value is not finite.
    """
    refusal = _READER.read(data, f"refusal of robot {sender!r}")
    if refusal.value is not None and not math.isfinite(refusal.value):
        raise InvalidInputError(
            f"refusal of robot {sender!r}: value: expected a finite number, got {refusal.value}"
        )
    return refusal
