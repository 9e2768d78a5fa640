"""Envelopes and the simulated network."""

import msgspec
import numpy as np
import pytest

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.team.envelope import Envelope, decode_envelope
from fgplan.team.in_process import InProcessTransport, NetworkFaults, Partition

ROBOTS = ("ann", "bob", "carl")


def letter(number=0, robot="ann", kind="note"):
    return Envelope(robot=robot, session=1, sequence=number, kind=kind, payload=b"x" * 10)


def drained(network, robot, until_s=1e6):
    network.advance(until_s)
    return [envelope.sequence for envelope in network.receive(robot)]


def test_envelope_round_trip_without_what_was_kept():
    envelope = letter(3).keep("content")
    back = decode_envelope(envelope.encoded)
    assert back == envelope
    assert envelope.content == "content"
    assert back.content is None
    assert back.byte_size == len(envelope.encoded)


def test_envelope_faults_are_named(monkeypatch):
    data = msgspec.msgpack.decode(letter().encoded)
    untagged = {key: value for key, value in data.items() if key != "schema"}
    for wrong in (
        {**data, "schema": "envelope.v2"},
        {**data, "schema": ""},
        {**data, "session": -1},
        {**data, "robot": ""},
        {**data, "more": 1},
        untagged,
    ):
        with pytest.raises(InvalidInputError, match="envelope"):
            decode_envelope(msgspec.msgpack.encode(wrong))
    for garbage in (b"", letter().encoded[:-3], b"\x91" * 100_000):
        with pytest.raises(InvalidInputError, match="envelope"):
            decode_envelope(garbage)
    monkeypatch.setattr("fgplan.team.envelope.MAX_ENVELOPE_BYTES", 5)
    with pytest.raises(InvalidInputError, match="at most 5 bytes"):
        decode_envelope(letter().encoded)


def test_perfect_network_hands_over_at_once_by_reference():
    network = InProcessTransport(ROBOTS)
    envelope = letter()
    network.send("ann", envelope)
    assert network.waiting() == ["bob", "carl"]
    assert network.receive("bob")[0] is envelope
    assert network.receive("bob") == ()
    assert network.receive("ann") == ()
    network.send("bob", envelope, "carl")
    assert len(network.receive("carl")) == 2
    counts = network.traffic.of("note")
    assert (counts.sent, counts.delivered, counts.lost) == (2, 3, 0)
    assert counts.sent_bytes == 2 * envelope.byte_size
    assert counts.delivered_bytes == 3 * envelope.byte_size
    assert network.next_arrival_s() == np.inf


def test_delay_follows_the_clock():
    faults = NetworkFaults(delay_s=(0.5, 0.5))
    network = InProcessTransport(ROBOTS, faults, np.random.default_rng(0))
    network.send("ann", letter(), "bob")
    assert network.waiting() == []
    assert network.next_arrival_s() == 0.5
    network.advance(0.4)
    assert network.receive("bob") == ()
    network.advance(0.5)
    assert network.now() == 0.5
    assert network.receive("bob") == (letter(),)


def test_loss_and_duplication_have_their_rates():
    faults = NetworkFaults(loss=0.3, duplication=0.2)
    network = InProcessTransport(ROBOTS, faults, np.random.default_rng(0))
    for number in range(4000):
        network.send("ann", letter(number), "bob")
    counts = network.traffic.of("note")
    copies = counts.delivered + counts.lost
    # Binomial: sigma of either rate is below 0.008.
    assert copies / 4000 - 1.0 == pytest.approx(0.2, abs=0.03)
    assert counts.lost / copies == pytest.approx(0.3, abs=0.03)
    assert len(drained(network, "bob")) == counts.delivered


def test_reordering_swaps_some_and_order_is_kept_without():
    for share, swapped in ((0.0, False), (0.5, True)):
        faults = NetworkFaults(reordering=share)
        network = InProcessTransport(ROBOTS, faults, np.random.default_rng(0))
        for number in range(50):
            network.send("ann", letter(number), "bob")
        arrived = drained(network, "bob")
        assert sorted(arrived) == list(range(50))
        assert (arrived != sorted(arrived)) == swapped


def test_partition_parts_groups_and_heals():
    partition = Partition(1.0, 2.0, (("ann", "bob"), ("carl",)))
    faults = NetworkFaults(partitions=(partition,))
    network = InProcessTransport(ROBOTS, faults, np.random.default_rng(0))
    for number, time_s in enumerate((0.0, 1.0, 1.9, 2.0)):
        network.advance(time_s)
        network.send("ann", letter(number))
    assert drained(network, "bob") == [0, 1, 2, 3]
    assert drained(network, "carl") == [0, 3]
    assert network.traffic.of("note").lost == 2


def test_same_seed_same_faults():
    fates = []
    for seed in (1, 1, 2):
        faults = NetworkFaults(loss=0.5, duplication=0.3, reordering=0.5, delay_s=(0.0, 1.0))
        network = InProcessTransport(ROBOTS, faults, np.random.default_rng(seed))
        for number in range(30):
            network.send("ann", letter(number))
        fates.append((drained(network, "bob"), drained(network, "carl")))
    assert fates[0] == fates[1]
    assert fates[0] != fates[2]


def test_wrong_faults_and_names_are_refused():
    for wrong in ({"loss": 1.0}, {"duplication": -0.1}, {"reordering": 2.0}):
        with pytest.raises(InvalidInputError, match=f"network faults {next(iter(wrong))}"):
            NetworkFaults(**wrong)
    for delay in ((0.5, 0.1), (-1.0, 0.1), (0.0, np.inf)):
        with pytest.raises(InvalidInputError, match="network faults delay_s"):
            NetworkFaults(delay_s=delay)
    with pytest.raises(InvalidInputError, match="need a generator"):
        InProcessTransport(ROBOTS, NetworkFaults())
    partition = Partition(0.0, 1.0, (("ann",), ("eve",)))
    with pytest.raises(UnknownNameError, match="robot 'eve' is not one of ann, bob, carl"):
        InProcessTransport(ROBOTS, NetworkFaults(partitions=(partition,)), np.random.default_rng(0))
    network = InProcessTransport(ROBOTS)
    for sender, receiver in (("eve", "ann"), ("ann", "eve")):
        with pytest.raises(UnknownNameError, match="robot 'eve'"):
            network.send(sender, letter(), receiver)
