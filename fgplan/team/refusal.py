"""The short message of a robot that keeps its path on its turn."""

import math

import msgspec

from fgplan.errors import InvalidInputError


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


class _Other(msgspec.Struct, tag="", tag_field="schema"):
    """Never sent: a choice of two is what makes msgspec insist on the schema."""


_DECODER = msgspec.msgpack.Decoder(Refusal | _Other)


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
    try:
        refusal = _DECODER.decode(data)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"refusal of robot {sender!r}: {error}") from error
    if isinstance(refusal, _Other):
        raise InvalidInputError(f"refusal of robot {sender!r}: schema: expected 'refusal.v1'")
    if refusal.value is not None and not math.isfinite(refusal.value):
        raise InvalidInputError(
            f"refusal of robot {sender!r}: value: expected a finite number, got {refusal.value}"
        )
    return refusal
