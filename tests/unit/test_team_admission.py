"""What a message must pass, and where it waits until then."""

import threading
import time

import msgspec
import pytest

from fgplan.team.admission import KINDS_LIMIT, Admission
from fgplan.team.envelope import Envelope
from fgplan.team.mailbox import Mailbox
from fgplan.team.network_options import NetworkOptions

ROBOTS = ("ann", "bob", "carl")


def letter(robot="bob", number=0, kind="note", session=0, payload=b""):
    return Envelope(robot=robot, session=session, sequence=number, kind=kind, payload=payload)


def admission(session=None, **limits):
    return Admission("ann", ROBOTS, NetworkOptions(**limits), session=session)


def test_good_messages_pass_unchanged():
    gate = admission(session=0)
    for envelope in (letter(), letter("bob", kind="announcement"), letter(payload=b"x" * 10_000)):
        assert gate.admit("bob", envelope.encoded, 0.0) == envelope
    passed_on = letter("bob", kind="refusal")
    assert gate.admit("carl", passed_on.encoded, 0.0) == passed_on
    assert gate.refused.total == 0


@pytest.mark.parametrize(
    ("reason", "sender", "data"),
    [
        ("sender", "zoe", letter("zoe").encoded),
        ("sender", "ann", letter("ann").encoded),
        ("size", "bob", letter(payload=b"x" * 2000).encoded),
        ("form", "bob", letter().encoded[:-2]),
        ("form", "bob", b""),
        ("form", "bob", b"\x91" * 900),
        ("form", "bob", letter().encoded.replace(b"envelope.v1", b"envelope.v2")),
        ("robot", "bob", letter("zoe").encoded),
        ("session", "bob", letter(session=1).encoded),
        ("passed on", "bob", letter("carl").encoded),
    ],
)
def test_the_rest_is_refused_counted_by_reason_and_logged_once(reason, sender, data, caplog):
    gate = admission(session=0, largest_message_bytes=1000)
    for _ in range(3):
        assert gate.admit(sender, data, 0.0) is None
    assert gate.refused.counts == {reason: 3}
    assert gate.refused.total == 3
    assert len(caplog.records) == 1
    assert f"({reason}) from robot {sender!r}" in caplog.text
    assert msgspec.json.encode(gate.refused)  # plain data


def test_a_flood_is_refused_and_leaves_the_others_alone():
    gate = admission(messages_per_s=10.0, kept_per_sender=4)
    taken = [gate.admit("bob", letter().encoded, 0.0) is not None for _ in range(20)]
    assert taken == [True] * 10 + [False] * 10  # what can wait, 2 x 4 + 2, may come at once
    assert gate.refused.counts == {"rate": 10}
    assert gate.admit("carl", letter("carl").encoded, 0.0) is not None
    assert gate.admit("bob", letter().encoded, 0.1) is not None
    assert gate.admit("bob", letter().encoded, 0.1) is None


def test_kinds_are_bounded():
    gate = admission()
    for number in range(KINDS_LIMIT):
        assert gate.admit("bob", letter(kind=f"kind {number}").encoded, 0.0) is not None
    assert gate.admit("bob", letter(kind="one more").encoded, 0.0) is None
    assert gate.admit("bob", letter(kind="kind 3").encoded, 0.0) is not None
    assert gate.refused.counts == {"kind": 1}


def test_senders_are_served_in_turn():
    box = Mailbox(("bob", "carl"), 10, 1000)
    for number in range(4):
        box.put("bob", b"b%d" % number)
    box.put("carl", b"c0")
    assert box.wait(0.0)
    taken = box.take(3)
    assert taken == [("bob", b"b0"), ("carl", b"c0"), ("bob", b"b1")]
    assert [data for _, data in box.take(10)] == [b"b2", b"b3"]
    assert box.take(10) == []
    assert not box.wait(0.0)


@pytest.mark.parametrize(("kept", "kept_bytes"), [(2, 1000), (100, 3)])
def test_a_full_box_waits_until_something_is_taken(kept, kept_bytes):
    box = Mailbox(("bob",), kept, kept_bytes)
    given = iter([b"12", b"34", b"56", b"78"])
    box.fill("bob", lambda: next(given, None))
    until_s = time.monotonic() + 60.0
    while len(box._waiting["bob"]) < 2 and time.monotonic() < until_s:
        time.sleep(0.005)
    time.sleep(0.05)  # in which a box that does not wait would take more
    assert [data for _, data in box.take(10)] == [b"12", b"34"]
    found = []
    while len(found) < 2:
        box.wait(1.0)
        found += box.take(10)
    box.close()
    assert [data for _, data in found] == [b"56", b"78"]


def test_closing_lets_who_waits_go():
    box = Mailbox(("bob",), 1, 1000)
    box.put("bob", b"1")
    threading.Timer(0.05, box.close).start()
    assert not box.put("bob", b"2")
