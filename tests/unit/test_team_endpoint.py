"""The loop of one robot, over a transport of the test's own that counts time in waits."""

import math

import msgspec
import pytest
from gathering import GatherState, gather_step

from fgplan.errors import InvalidInputError
from fgplan.team.admission import Refused
from fgplan.team.endpoint import run_robot
from fgplan.team.envelope import Envelope, Outgoing, TrafficByKind

ROBOTS = ("ann", "bob")


class Script:
    """A transport for ann: what arrives and who is there, by time."""

    def __init__(self, arrivals=(), present=((0.0, ("bob",)),)):
        self.robot = "ann"
        self.refused = Refused()
        self.traffic = TrafficByKind()
        self.arrivals = sorted(arrivals, key=lambda item: item[0])
        self.presence = list(present)
        self.now_s = 0.0
        self.sent = []

    def refuse(self, reason, sender, text):
        self.refused.count(reason, sender, text)

    def send(self, robot, envelope, to=None):
        assert robot == "ann"
        self.sent.append((round(self.now_s, 6), envelope, to))

    def receive(self, robot):
        due = [envelope for at_s, envelope in self.arrivals if at_s <= self.now_s]
        self.arrivals = self.arrivals[len(due) :]
        return tuple(due)

    def now(self):
        return self.now_s

    def present(self, robot):
        seen = [names for at_s, names in self.presence if at_s <= self.now_s]
        return None if seen[-1] is None else frozenset(seen[-1])

    def wait(self, timeout_s):
        due_s = self.arrivals[0][0] if self.arrivals else math.inf
        if due_s > self.now_s + timeout_s:
            self.now_s += timeout_s
            return False
        self.now_s = max(self.now_s, due_s)
        return True

    def kinds(self):
        return [envelope.kind for _, envelope, _ in self.sent]


def number(value=5, robot="bob", payload=b"", kind="number"):
    return Envelope(robot=robot, session=0, sequence=value, kind=kind, payload=payload)


def done(said=True, robot="bob", session=0):
    payload = msgspec.msgpack.encode(said)
    return Envelope(robot=robot, session=session, sequence=1, kind="done", payload=payload)


def start():
    return GatherState(robot="ann", robots=ROBOTS)


def test_it_asks_until_it_has_finished_and_leaves_when_its_teammate_has():
    network = Script([(0.5, number()), (2.0, done())])
    end = run_robot(start(), gather_step, network, time_limit_s=60.0)
    assert end.numbers == {"ann": 113, "bob": 5}
    assert network.now_s == 2.0
    asks = [at_s for at_s, envelope, _ in network.sent if envelope.kind == "ask"]
    assert asks == pytest.approx([0.0, 0.2, 0.4])
    said = [
        (at_s, msgspec.msgpack.decode(envelope.payload))
        for at_s, envelope, _ in network.sent
        if envelope.kind == "done"
    ]
    assert said[0] == (0.0, False)
    assert [at_s for at_s, finished in said if finished] == pytest.approx([0.5, 1.0, 1.5, 2.0])


def test_it_lingers_no_longer_than_it_may_and_answers_meanwhile():
    network = Script([(0.0, number()), (1.0, number(kind="ask"))])
    end = run_robot(start(), gather_step, network, linger_s=3.0)
    assert end.finished
    assert network.now_s == pytest.approx(3.0, abs=0.06)
    assert [(at_s, to) for at_s, envelope, to in network.sent if envelope.kind == "number"] == [
        (0.0, None),
        (1.0, "bob"),
    ]


def test_time_limit_and_until_end_it_unfinished():
    network = Script()
    assert not run_robot(start(), gather_step, network, time_limit_s=1.5).finished
    assert network.now_s == pytest.approx(1.5)
    stopped = run_robot(start(), gather_step, Script(), until=lambda state: len(state.numbers) == 1)
    assert stopped.numbers == {"ann": 113}


def test_who_leaves_is_not_waited_for_and_who_comes_back_is_told_and_heard_anew():
    present = ((0.0, ("bob",)), (1.0, ()), (1.01, ("bob",)), (5.0, ()))
    network = Script([(0.0, number()), (0.5, done(False))], present)
    states = []
    end = run_robot(start(), gather_step, network, report=states.append)
    # It sees nobody there at 1.0 and has finished, so it leaves.
    assert network.now_s == pytest.approx(1.0, abs=0.06)
    assert end.present == ()
    assert states[-1] == end
    network = Script([(0.1, done())], ((0.0, ("bob",)), (1.0, ()), (1.2, ("bob",))))
    run_robot(start(), gather_step, network, time_limit_s=3.0)
    told = [(round(at_s, 1), to) for at_s, envelope, to in network.sent if envelope.kind == "done"]
    assert told == [(0.0, None), (1.2, "bob")]  # bob's "done" of before was forgotten with him


def test_without_a_presence_it_lingers():
    network = Script([(0.0, number()), (0.0, done())], ((0.0, None),))
    assert run_robot(start(), gather_step, network, linger_s=1.0).finished
    assert network.now_s == pytest.approx(1.0, abs=0.06)


def test_mail_that_the_step_cannot_take_has_not_happened(caplog):
    bad = [(0.0, number(payload=b"bad")) for _ in range(3)]
    bad += [(0.0, number(kind="other")), (0.0, done(session=3)), (0.0, done("yes"))]
    network = Script([*bad, (0.3, number()), (0.4, done())])
    seen = []

    def step(state, inbox):
        seen.append((state, len(inbox.envelopes)))
        if inbox.envelopes and inbox.envelopes[0].kind == "other":
            raise ZeroDivisionError("a bug that a message has found")
        return gather_step(state, inbox)

    end = run_robot(start(), step, network)
    assert end.numbers == {"ann": 113, "bob": 5}
    assert network.refused.counts == {"step number": 3, "step other": 1, "step done": 2}
    assert "ZeroDivisionError: a bug" in network.refused.first["step other"]
    assert len([record for record in caplog.records if record.levelname == "WARNING"]) == 3
    first_mail = [state for state, count in seen if count]
    assert first_mail[0] is first_mail[3]  # after three refusals the very same state
    assert {count for _, count in seen} == {0, 1}


def test_refused_mail_does_not_keep_it_from_what_is_due():
    network = Script([(0.01 * number_, number(payload=b"bad")) for number_ in range(200)])
    run_robot(start(), gather_step, network, time_limit_s=1.9)
    assert len([kind for kind in network.kinds() if kind == "ask"]) >= 9


def test_what_the_step_raises_by_itself_is_an_error():
    def step(state, inbox):
        raise InvalidInputError("no path")

    with pytest.raises(InvalidInputError, match="no path"):
        run_robot(start(), step, Script())


def test_what_a_step_sends_goes_out_in_order_and_to_whom_it_says():
    def step(state, inbox):
        outbox = [Outgoing(number(1, "ann"), "bob"), Outgoing(number(2, "ann"))]
        return msgspec.structs.replace(state, numbers={"ann": 1, "bob": 1}), tuple(outbox)

    network = Script([(0.0, done())])
    run_robot(start(), step, network)
    sent = [(envelope.sequence, to) for _, envelope, to in network.sent[:2]]
    assert sent == [(1, "bob"), (2, None)]
