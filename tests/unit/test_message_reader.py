"""Reading messages: one struct or a choice, with or without a schema."""

import msgspec
import pytest

from fgplan.errors import InvalidInputError
from fgplan.message_reader import MessageReader


class Place(msgspec.Struct, forbid_unknown_fields=True, tag="place.v1", tag_field="schema"):
    x: float
    inside: "Place | None" = None


class Bare(msgspec.Struct):
    x: float


def pack(**fields):
    return msgspec.msgpack.encode(fields)


def test_what_was_written_is_read():
    assert MessageReader(Place).read(msgspec.msgpack.encode(Place(1.0)), "place") == Place(1.0)
    assert MessageReader(Bare).read(pack(x=1.0), "place") == Bare(1.0)
    assert MessageReader(Place, json=True).read(msgspec.json.encode(Place(1.0)), "p") == Place(1.0)


NESTED = msgspec.msgpack.encode({"schema": "place.v1", "x": 1.0, "inside": 0})[:-1] * 100_000


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (pack(x=1.0), "schema"),
        (pack(schema="place.v2", x=1.0), "place of 'ann': .*schema"),
        (pack(schema="", x=1.0), "schema: expected 'place.v1'"),
        (pack(schema="place.v1", x="1"), r"float.*\$\.x"),
        (pack(schema="place.v1", x=1.0, y=2.0), "unknown field"),
        (b"", "truncated"),
        (b"\xff\xfe", "place of 'ann'"),
        (pack(schema="place.v1", x=1.0)[:-1], "truncated"),
        (NESTED, "place of 'ann'"),
        (b"\x82\xa6schema\xa8place.v1\xa1x\xa2\xff\xfe", "place of 'ann'"),
    ],
)
def test_what_is_malformed_is_one_error_with_a_name(data, match):
    with pytest.raises(InvalidInputError, match=match):
        MessageReader(Place).read(data, "place of 'ann'")
