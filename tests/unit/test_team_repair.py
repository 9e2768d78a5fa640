"""How quickly a log is repaired: who asks whom, when again, and what needs no asking at all."""

import msgspec
import numpy as np
from faulty_teams import Fault, FaultyTeam
from table_teams import make_team

from fgplan.team.coordination import set_up_team
from fgplan.team.envelope import Inbox
from fgplan.team.in_process import InProcessTransport, NetworkFaults
from fgplan.team.known_logs import close_turn, know_nothing, take_in
from fgplan.team.options import CoordinationOptions
from fgplan.team.refusal import Refusal
from fgplan.team.robot import step
from fgplan.team.robot_state import start_robot
from fgplan.team.status import STATUS, decode_status, status_of

REPAIR_S = 5.0
ROBOTS = ("r0", "r1", "r2", "r3")


def setups_of(count=4):
    problem, candidates, evaluator = make_team(count, seed=1)
    options = CoordinationOptions(repair_after_s=REPAIR_S, lost_after_s=20.0)
    return set_up_team(problem, candidates, evaluator, options=options)


def settled_team(**given):
    """A team that the network tells who is there, over links of 0.1 s."""
    delay = NetworkFaults(delay_s=(0.1, 0.1))
    network = InProcessTransport(ROBOTS, delay, np.random.default_rng(0))
    return FaultyTeam(setups_of(), network=network, tell_presence=True, **given)


def entries_of_a_session():
    return settled_team().run(60.0).states["r0"].log.all_entries()


def test_without_faults_the_end_is_known_before_anybody_asks():
    team = settled_team().run(60.0)
    turns = next(iter(team.states.values())).turn
    # Every turn is one message long, and the end is known one message after the last.
    assert turns * 0.1 - 1e-9 <= team.settled_s <= (turns + 1) * 0.1 + 1e-9


def test_late_robot_is_told_at_once_and_has_the_log_without_waiting():
    team = settled_team(faults=(Fault("r3", 0.0, 30.0),)).run(29.9)
    head = team.states["r0"].log.head
    team = settled_team(faults=(Fault("r3", 0.0, 30.0),)).run(30.45)
    # Its opening, their statuses, its ask, their entries: four messages, and no repair_after_s.
    assert head in team.states["r3"].logs.known


def test_robot_asks_again_for_a_better_log_if_the_answer_is_lost():
    setups = setups_of()
    ahead = know_nothing(setups["r1"])
    for entry in entries_of_a_session():
        ahead = take_in(ahead, setups["r1"], entry)
    status = status_of(setups["r1"], ahead)
    state, _ = step(start_robot(setups["r0"]), Inbox(0.0, (), frozenset(ROBOTS[1:])))

    def asked(state, now_s):
        state, out = step(state, Inbox(now_s, (status,), frozenset(ROBOTS[1:])))
        sent = [one for one in out if one.envelope.kind == STATUS and one.to == "r1"]
        return state, [decode_status(one.envelope).ask for one in sent]

    state, first = asked(state, 0.5)
    assert first == ["r1"]
    state, second = asked(state, 1.0)  # the first answer may be under way
    assert second == []
    for now_s in (0.5 + REPAIR_S, 0.5 + 2 * REPAIR_S):
        state, again = asked(state, now_s)
        assert "r1" in again


def test_any_order_of_entries_gives_the_log_without_asking():
    setups, entries = setups_of(), entries_of_a_session()
    expected = know_nothing(setups["r1"])
    for entry in entries:
        expected = take_in(expected, setups["r1"], entry)
    for seed in range(20):
        logs = know_nothing(setups["r1"])
        for place in np.random.default_rng(seed).permutation(len(entries)):
            logs = take_in(logs, setups["r1"], entries[place])
        assert logs.current.head == expected.current.head


def test_any_order_gives_the_log_of_a_team_that_opened_without_one_robot():
    late = settled_team(faults=(Fault("r3", 0.0, 40.0),)).run(80.0)
    entries = late.states["r0"].log.all_entries()
    assert late.states["r0"].log.changes == 1
    for seed in range(20):
        logs = know_nothing(late.setups["r1"])
        for place in np.random.default_rng(seed).permutation(len(entries)):
            logs = take_in(logs, late.setups["r1"], entries[place])
        assert logs.current.head == late.states["r0"].log.head


def test_round_zero_that_was_closed_without_a_robot_stays_closed():
    setups = setups_of()
    openings = [entry for entry in entries_of_a_session() if entry.sequence == 0]
    logs = know_nothing(setups["r1"])
    for entry in openings[:3]:
        logs = take_in(logs, setups["r1"], entry)
    logs = close_turn(logs, setups["r1"], logs.current)
    after = take_in(logs, setups["r1"], openings[3])
    assert after.current is logs.current
    assert set(after.known) == set(logs.known)
    assert set(after.current.ledger.paths()) == {"r0", "r1", "r2"}


def test_other_branches_do_not_grow_for_ever(monkeypatch):
    entries = entries_of_a_session()
    setup = setups_of()["r1"]
    monkeypatch.setattr("fgplan.team.known_logs.KNOWN_LIMIT", 5)
    logs = know_nothing(setup)
    for entry in entries:
        logs = take_in(logs, setup, entry)
    assert len(logs.known) > 5  # its own log goes on
    before = logs
    other = msgspec.structs.replace(entries[4], basis=dict(entries[4].basis))
    other = msgspec.structs.replace(other, payload=Refusal(1.5).encoded, kind="refusal")
    logs = take_in(logs, setup, other)
    assert logs.known == before.known
    assert logs.dropped == before.dropped + 1


def test_asks_that_queued_up_are_answered_once():
    setups = setups_of()
    asking = start_robot(setups["r0"])
    asking, _ = step(asking, Inbox(0.0))
    busy, (opening,) = step(start_robot(setups["r1"]), Inbox(0.0))
    ask = status_of(setups["r0"], asking.logs, ask="r1")
    busy, answers = step(busy, Inbox(1.0, (ask, ask, ask)))
    assert [one.envelope for one in answers if one.to == "r0"] == [opening.envelope]
    _, again = step(busy, Inbox(1.0 + REPAIR_S, (ask,)))  # the first answer may have been lost
    assert opening.envelope in [one.envelope for one in again]
