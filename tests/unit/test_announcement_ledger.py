"""The ledger: which announcements are accepted, in which order, and what that adds up to."""

import itertools

import msgspec
import numpy as np
import pytest

from fgplan.announcement.announcement import Sender, Withdrawal, announcement_of
from fgplan.announcement.ledger import Accepted, Ledger, decode_ledger
from fgplan.errors import InvalidInputError, StaleAnnouncementError, UnknownNameError
from fgplan.paths.candidate_path import CandidatePath

SENDER = Sender(session=2, prior_digest="prior")


def say(robot, sequence=1, basis=None, value=None, before=None, sender=SENDER, length=3.0):
    path = CandidatePath(
        robot=robot,
        poses=np.array([[0.0, 0.0, 0.0], [length, 0.0, 0.0]]),
        times_s=np.array([0.0, 1.0]),
        motion_covariances=np.eye(3)[None],
    )
    return announcement_of(
        path,
        sequence=sequence,
        basis=basis or {},
        sender=sender,
        value=value,
        incumbent_value=before,
    )


def opened(**options):
    """A ledger after round 0."""
    ledger = Ledger(order=("ann", "bob", "carl"), session=2, prior_digest="prior", **options)
    for robot in ledger.order:
        ledger = ledger.accept(say(robot))
    return ledger


def test_accept_returns_a_new_ledger():
    empty = Ledger(order=("ann", "bob"), session=2, prior_digest="prior")
    one = empty.accept(say("ann"))
    assert empty.messages == ()
    assert empty.basis() == {}
    assert one.basis() == {"ann": 1}
    assert one.next_sequence("ann") == 2
    assert one.next_sequence("bob") == 1
    assert one.value is None


def test_round_zero_gives_one_ledger_in_any_order_of_arrival():
    for order in itertools.permutations(("ann", "bob", "carl")):
        ledger = Ledger(order=("ann", "bob", "carl"), session=2, prior_digest="prior")
        for robot in order:
            ledger = ledger.accept(say(robot))
        assert ledger.basis() == {"ann": 1, "bob": 1, "carl": 1}
        assert list(ledger.paths()) == ["ann", "bob", "carl"]
        assert list(ledger.paths(without="bob")) == ["ann", "carl"]


def test_basis_must_be_what_the_ledger_holds():
    ledger = opened()
    basis = ledger.basis()
    after = ledger.accept(say("bob", 2, basis, 9.0, 10.0))
    assert after.basis() == {"ann": 1, "bob": 2, "carl": 1}
    assert after.value == 9.0
    with pytest.raises(StaleAnnouncementError, match="'bob' is earlier in the order"):
        after.accept(say("carl", 2, basis, 8.0, 10.0))
    again = after.accept(say("carl", 2, after.basis(), 8.0, 9.0))
    with pytest.raises(StaleAnnouncementError, match=r"announcement 2 of robot 'ann'.*evaluate"):
        again.accept(say("ann", 2, basis, 7.0, 10.0))
    with pytest.raises(StaleAnnouncementError, match="ask for the missing ones of bob"):
        ledger.accept(say("ann", 2, {**basis, "bob": 2}, 7.0, 9.0))


def test_of_two_with_one_basis_the_earlier_robot_wins_in_any_order_of_arrival():
    ledger = opened()
    basis = ledger.basis()
    first, second = say("ann", 2, basis, 9.5, 10.0), say("carl", 2, basis, 9.0, 10.0)
    with pytest.raises(StaleAnnouncementError):
        ledger.accept(first).accept(second)
    late = ledger.accept(second).accept(first)
    assert late == ledger.accept(first)
    assert late.basis() == {"ann": 2, "bob": 1, "carl": 1}
    assert late.current["carl"] == ledger.current["carl"]


def test_winner_that_others_built_on_stays():
    ledger = opened()
    basis = ledger.basis()
    built = ledger.accept(say("carl", 2, basis, 9.0, 10.0))
    built = built.accept(say("bob", 2, built.basis(), 8.0, 9.0))
    with pytest.raises(StaleAnnouncementError, match="evaluate again"):
        built.accept(say("ann", 2, basis, 9.5, 10.0))


def test_objective_never_rises():
    ledger = opened()
    ledger = ledger.accept(say("bob", 2, ledger.basis(), 9.0, 10.0))
    for value, before in ((9.1, 9.0), (9.0 + 1e-6, 9.5), (8.0, 7.0)):
        with pytest.raises(InvalidInputError, match="robot 'ann': value: expected at most"):
            ledger.accept(say("ann", 2, ledger.basis(), value, before))
    with pytest.raises(InvalidInputError, match="only round 0 has none"):
        ledger.accept(say("ann", 2, ledger.basis()))
    lower = ledger.accept(say("ann", 2, ledger.basis(), 8.0, 9.0))
    assert [item.value for item in lower.history] == [None, None, None, 9.0, 8.0]
    assert lower.history[-1] == Accepted(5, "ann", 8.0)
    loose = opened(check_values=False)
    loose = loose.accept(say("bob", 2, loose.basis(), 9.0, 10.0))
    assert loose.accept(say("ann", 2, loose.basis(), 9.5, 9.6)).value == 9.5


def test_without_the_basis_anything_goes_in():
    ledger = opened(use_basis=False)
    basis = ledger.basis()
    both = ledger.accept(say("ann", 2, basis, 9.0, 10.0)).accept(say("bob", 2, basis, 9.0, 10.0))
    assert both.basis() == {"ann": 2, "bob": 2, "carl": 1}


def test_sequence_session_prior_and_names_are_checked():
    ledger = opened()
    basis = ledger.basis()
    with pytest.raises(StaleAnnouncementError, match="sequence: expected more than 1"):
        ledger.accept(say("ann", 1, basis, 9.0, 10.0))
    with pytest.raises(StaleAnnouncementError, match="round 0 is over"):
        ledger.accept(say("ann", 2))
    with pytest.raises(InvalidInputError, match="session: expected 2, got 3"):
        ledger.accept(say("ann", 2, basis, 9, 10, sender=Sender(session=3, prior_digest="prior")))
    with pytest.raises(InvalidInputError, match="prior_digest: expected 'prior', got 'other'"):
        ledger.accept(say("ann", 2, basis, 9, 10, sender=Sender(session=2, prior_digest="other")))
    with pytest.raises(UnknownNameError, match="robot 'eve' is not in the team: ann, bob, carl"):
        ledger.accept(say("eve", 1, basis, 9, 10))
    with pytest.raises(UnknownNameError, match="robot 'eve' is not in the team"):
        ledger.accept(say("ann", 2, {**basis, "eve": 1}, 9, 10))
    for order in ((), ("ann", "ann")):
        with pytest.raises(InvalidInputError, match="names of all robots"):
            Ledger(order=order)


def test_withdrawal_removes_a_path_and_starts_the_values_anew():
    ledger = opened()
    ledger = ledger.accept(say("bob", 2, ledger.basis(), 9.0, 10.0))
    gone = ledger.accept(
        Withdrawal(
            robot="carl",
            session=2,
            sequence=2,
            basis=ledger.basis(),
            prior_digest="prior",
            by="ann",
            reason="silent",
        )
    )
    assert list(gone.paths()) == ["ann", "bob"]
    assert gone.basis() == {"ann": 1, "bob": 2, "carl": 2}
    assert gone.value is None
    # Without carl's path the objective is another one and may be higher.
    assert gone.accept(say("ann", 2, gone.basis(), 11.0, 12.0)).value == 11.0
    back = gone.accept(say("carl", 3, gone.basis(), 11.0, 12.0))
    assert list(back.paths()) == ["ann", "bob", "carl"]


@pytest.mark.parametrize("as_json", [False, True])
def test_round_trip_replays_every_rule(as_json):
    ledger = opened()
    ledger = ledger.accept(say("bob", 2, ledger.basis(), 9.0, 10.0))
    data = ledger.encode(json=as_json)
    assert decode_ledger(data, json=as_json) == ledger
    with pytest.raises(InvalidInputError, match="ledger"):
        decode_ledger(data[:-3], json=as_json)
    if not as_json:
        plain = msgspec.msgpack.decode(data)
        plain["messages"] = plain["messages"][::-1]
        with pytest.raises(StaleAnnouncementError):
            decode_ledger(msgspec.msgpack.encode(plain))
