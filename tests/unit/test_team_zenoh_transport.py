"""Transports over zenoh on the loopback, in one process."""

import builtins
import threading

import pytest
from gathering import GatherState, gather_step
from network_teams import LONG_S, eventually, letter, open_team, options_of, received

from fgplan.errors import FgplanError, InvalidInputError, MissingExtraError, UnknownNameError
from fgplan.team.endpoint import run_robot
from fgplan.team.network_options import NetworkOptions, free_endpoint
from fgplan.team.zenoh_transport import BATCH, ZenohTransport

ROBOTS = ("ann", "bob", "carl")


def test_envelopes_to_one_and_to_all_arrive_in_order_and_are_counted():
    with open_team(ROBOTS) as team:
        for number in range(600):
            team["bob"].send("bob", letter("bob", number), "ann" if number % 2 else None)
        numbers = [envelope.sequence for envelope in received(team["ann"], 600)]
        assert numbers == list(range(600))
        assert len(received(team["carl"], 300)) == 300
        assert team["ann"].receive("ann") == ()
        assert not team["ann"].wait(0.0)
        sent, delivered = team["bob"].traffic.of("note"), team["ann"].traffic.of("note")
        assert (sent.sent, sent.delivered, delivered.delivered) == (600, 0, 600)
        assert sent.sent_bytes == delivered.delivered_bytes
        assert team["ann"].refused.total == 0
        assert team["ann"].now() > 0.0


def test_star_becomes_a_mesh_and_who_leaves_is_missed():
    with open_team(ROBOTS) as team:  # bob and carl know of ann only
        team["bob"].send("bob", letter("bob", 7), "carl")
        assert [envelope.sequence for envelope in received(team["carl"], 1)] == [7]
        team["ann"].close()
        eventually(lambda: team["bob"].present("bob") == {"carl"})
        team["bob"].send("bob", letter("bob", 8), "carl")
        assert [envelope.sequence for envelope in received(team["carl"], 1)] == [8]


def test_a_late_robot_and_one_that_comes_back_are_seen_and_heard():
    options = options_of(ROBOTS[:2])
    bob = ZenohTransport("bob", ROBOTS[:2], options["bob"])
    with bob:  # nobody is there to connect to
        bob.send("bob", letter("bob", 1))
        assert bob.present("bob") == frozenset()
        for number in (2, 3):
            with ZenohTransport("ann", ROBOTS[:2], options["ann"]) as ann:
                eventually(lambda: bob.present("bob") == {"ann"})
                assert ann.wait_for_team(LONG_S) == {"bob"}
                bob.send("bob", letter("bob", number))
                # What was sent before it came has gone nowhere.
                assert [envelope.sequence for envelope in received(ann, 1)] == [number]
            eventually(lambda: bob.present("bob") == frozenset())


def test_a_full_ring_loses_the_oldest_of_that_sender_and_blocks_nobody():
    # 60 MB: far more than the sockets hold, so most has come to the ring when sending ends.
    count, payload = 3000, bytes(20_000)
    with open_team(ROBOTS, kept_per_sender=50) as team:
        for number in range(count):
            team["bob"].send("bob", letter("bob", number, payload=payload), "ann")
        waiting = team["ann"]._mailbox._waiting
        assert len(waiting["bob"]) <= 50
        team["carl"].send("carl", letter("carl", 5), "ann")
        eventually(lambda: waiting["carl"])
        # Carl's may come before the rest of bob's, which goes on while these are read.
        found = []

        def newest_is_here():
            found.extend(team["ann"].receive("ann"))
            return any(envelope.sequence == count - 1 for envelope in found)

        eventually(newest_is_here)
        assert [envelope.sequence for envelope in found if envelope.robot == "carl"] == [5]
        numbers = [envelope.sequence for envelope in found if envelope.robot == "bob"]
        assert numbers == sorted(set(numbers))
        assert 50 < len(numbers) < count / 2


def test_a_batch_is_bounded_and_the_rest_is_still_there():
    with open_team(ROBOTS[:2]) as team:
        for number in range(BATCH + 1):
            team["bob"].send("bob", letter("bob", number))
        eventually(lambda: len(team["ann"]._mailbox._waiting["bob"]) == BATCH + 1)
        assert len(team["ann"].receive("ann")) == BATCH
        assert team["ann"].wait(0.0)
        assert len(team["ann"].receive("ann")) == 1


def test_keys_that_are_not_the_senders_are_refused_and_counted():
    with open_team(ROBOTS[:2]) as team:
        prefix, session = "fgplan/team", team["bob"]._session
        session.put(f"{prefix}/*/to/ann", letter("bob").encoded)
        session.put(f"{prefix}/**", letter("bob").encoded)
        session.delete(f"{prefix}/bob/to/ann")
        session.put(f"{prefix}/stranger/to/ann", letter("bob").encoded)  # heard by nobody
        eventually(lambda: team["ann"].refused.counts.get("key") == 3)
        assert team["ann"].receive("ann") == ()


def test_too_large_a_message_is_refused_on_both_sides():
    with open_team(ROBOTS[:2], largest_message_bytes=1000) as team:
        large = letter("bob", payload=b"x" * 1000)
        with pytest.raises(InvalidInputError, match="at most 1000 bytes"):
            team["bob"].send("bob", large)
        team["bob"]._session.put("fgplan/team/bob/to/ann", large.encoded)
        eventually(lambda: team["ann"].wait(0.0))
        assert team["ann"].receive("ann") == ()
        assert team["ann"].refused.counts == {"size": 1}


def test_larger_than_zenoh_reads_ends_the_link_and_it_comes_back():
    with open_team(ROBOTS[:2], largest_message_bytes=1000) as team:
        team["bob"]._session.put("fgplan/team/bob/to/ann", b"x" * 10_000_000)
        eventually(lambda: team["ann"].present("ann") == {"bob"})

        def heard():
            team["bob"].send("bob", letter("bob", 3))
            return [envelope.sequence for envelope in received(team["ann"], 1, 0.2)]

        eventually(heard)


def test_what_is_asked_of_the_wrong_transport_is_refused():
    with pytest.raises(UnknownNameError, match="'dora' is not one of ann, bob, carl"):
        ZenohTransport("dora", ROBOTS)
    with pytest.raises(InvalidInputError, match="robot: expected 1 to 256 characters"):
        ZenohTransport("ann", ("ann", "b/c"))
    closed = ZenohTransport("ann", ROBOTS)
    with pytest.raises(FgplanError, match="not open"):
        closed.send("ann", letter("ann"))
    closed.close()
    with pytest.raises(UnknownNameError, match="expected that robot, got 'bob'"):
        closed.receive("bob")
    with pytest.raises(UnknownNameError, match="'dora' is not one of bob, carl"):
        closed.send("ann", letter("ann"), "dora")


def test_a_port_that_is_taken_is_named():
    listen = free_endpoint()
    with (
        ZenohTransport("ann", ROBOTS, NetworkOptions(listen=(listen,))),
        pytest.raises(InvalidInputError, match=f"robot 'bob': could not listen on {listen}"),
        ZenohTransport("bob", ROBOTS, NetworkOptions(listen=(listen,))),
    ):
        pass


@pytest.mark.parametrize("module", ["zenoh", "cryptography"])
def test_without_the_extra_the_error_says_how_to_install_it(module, monkeypatch, tmp_path):
    found = builtins.__import__

    def without(name, *args, **kwargs):
        if name.partition(".")[0] == module:
            raise ImportError(f"No module named {module!r}")
        return found(name, *args, **kwargs)

    options = NetworkOptions()
    if module == "cryptography":
        for name in ("ca", "certificate", "key"):
            (tmp_path / name).write_text("")
        options = NetworkOptions(
            ca=tmp_path / "ca", certificate=tmp_path / "certificate", key=tmp_path / "key"
        )
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match=r"pip install 'fgplan\[net\]'"):
        ZenohTransport("ann", ROBOTS, options)


def test_three_endpoints_gather_and_leave_together():
    ends, refused = {}, {}

    def run(transport):
        state = GatherState(robot=transport.robot, robots=ROBOTS)
        ends[transport.robot] = run_robot(state, gather_step, transport, time_limit_s=LONG_S)
        refused[transport.robot] = transport.refused.counts

    with open_team(ROBOTS) as team:
        threads = [threading.Thread(target=run, args=(transport,)) for transport in team.values()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(2 * LONG_S)
    assert {robot: end.finished for robot, end in ends.items()} == dict.fromkeys(ROBOTS, True)
    assert ends["ann"].numbers == ends["bob"].numbers == ends["carl"].numbers
    assert refused == {name: {} for name in ROBOTS}
