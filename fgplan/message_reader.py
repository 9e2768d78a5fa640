"""Reading what came from outside: bytes in, a checked struct or one error out.

msgspec checks types and bounds. Two things are added: a struct with a schema must say it (msgspec
lets a single type leave its tag out, a choice of types not), and everything that bytes can do to a
decoder is one kind of error, with the name of what was read.
"""

from typing import Any, Generic, TypeVar

import msgspec

from fgplan.errors import InvalidInputError

Message = TypeVar("Message")

_UNREADABLE = (msgspec.MsgspecError, RecursionError, UnicodeDecodeError)


class _Other(msgspec.Struct, tag="", tag_field="schema"):
    """Never sent: the second choice where there is only one."""


class MessageReader(Generic[Message]):
    """Reads one type of message, or a choice of types."""

    def __init__(self, kind: Any, *, json: bool = False) -> None:  # noqa: ANN401 - a type or union
        """Prepare the decoder.

        Args:
            kind: Struct, or union of structs; those with a tag have it in the field ``schema``.
            json: Whether the bytes are JSON instead of msgpack.
        """
        config: msgspec.structs.StructConfig | None = getattr(kind, "__struct_config__", None)
        self._schema = None if config is None else config.tag
        module: Any = msgspec.json if json else msgspec.msgpack
        self._decoder = module.Decoder(kind if self._schema is None else kind | _Other)

    def read(self, data: bytes, name: str) -> Message:
        """Read a message.

        Args:
            data: As received.
            name: What it is and of whom, for the message of an error.

        Returns:
            The message; types and bounds of its fields checked.

        Raises:
            InvalidInputError: If it is malformed, nested too deeply, or of another schema.
        """
        try:
            message: Any = self._decoder.decode(data)
        except _UNREADABLE as error:
            raise InvalidInputError(f"{name}: {error}") from error
        if isinstance(message, _Other):
            raise InvalidInputError(f"{name}: schema: expected {self._schema!r}")
        read: Message = message
        return read
