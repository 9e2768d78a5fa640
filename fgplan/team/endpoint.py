"""The loop of one robot in real time: mail, clock and presence in, messages out.

The step is a black box, and its state is a value. So refusing a message is keeping the state from
before it: envelopes are fed one at a time, and what makes the step raise is counted and has not
happened. A step without mail is the robot's own doing; its errors are errors.

A robot that has finished still answers those that have not. Every robot tells whether it has
finished (``done``, handled here and never seen by the step): at the start, when it changes, to
teammates that come, and now and then while it lingers. It leaves when every teammate that is there
has finished too, or after ``linger_s``.
"""

import logging
import math
from collections import deque
from collections.abc import Callable
from typing import Generic, Protocol

import msgspec

from fgplan.errors import InvalidInputError
from fgplan.team.admission import Refused
from fgplan.team.envelope import Envelope, Inbox, Outbox
from fgplan.team.loop import State, Step
from fgplan.team.transport import Transport

DONE = "done"
"""Kind of the endpoints' own message; its payload is true or false."""

WATCH_S = 0.05
"""A robot without mail looks this often at who is there."""

REPEAT_S = 0.5
"""While it lingers it says this often that it has finished."""

_DECODER = msgspec.msgpack.Decoder(bool)
_LOG = logging.getLogger(__name__)


class RealTimeTransport(Transport, Protocol):
    """The transport of one robot, with a clock that goes on by itself."""

    @property
    def robot(self) -> str:
        """Whose it is."""
        ...

    @property
    def refused(self) -> Refused:
        """Messages that were refused so far, by reason."""
        ...

    def refuse(self, reason: str, sender: str, text: str) -> None:
        """Count a message that was refused after it was received."""
        ...

    def wait(self, timeout_s: float) -> bool:
        """Wait until something has arrived, at most so many seconds."""
        ...


def run_robot(
    state: State,
    step: Step[State],
    transport: RealTimeTransport,
    *,
    until: Callable[[State], bool] | None = None,
    time_limit_s: float = math.inf,
    report: Callable[[State], None] | None = None,
    linger_s: float = 30.0,
    session: int = 0,
) -> State:
    """Run one robot until it and all teammates that are there have finished.

    Args:
        state: The robot before its first step.
        step: Its step function; what it raises on a message refuses that message.
        transport: Its open transport.
        until: Says of a state whether to stop at once; None never.
        time_limit_s: Seconds on the transport's clock after which to stop.
        report: Called after each step with the state; what the robot shows while it runs.
        linger_s: Seconds that it stays for others after it has finished.
        session: Planning session that its ``done`` belongs to.

    Returns:
        The state at the end; not finished if the time ran out or ``until`` said so.

    Raises:
        Exception: What the step raises without mail.
    """
    return _Endpoint(state, step, transport, report, session).run(until, time_limit_s, linger_s)


class _Endpoint(Generic[State]):
    """Where one run stands."""

    def __init__(
        self,
        state: State,
        step: Step[State],
        transport: RealTimeTransport,
        report: Callable[[State], None] | None,
        session: int,
    ) -> None:
        """Start with no mail read and nothing told."""
        self.state = state
        self.step = step
        self.transport = transport
        self.robot = transport.robot
        self.report = report
        self.session = session
        self.present: frozenset[str] | None = None
        self.mail: deque[Envelope] = deque()
        self.done: dict[str, bool] = {}
        self.told: bool | None = None
        self.tells = 0
        self.tell_s = math.inf

    def run(
        self, until: Callable[[State], bool] | None, time_limit_s: float, linger_s: float
    ) -> State:
        """The loop; see ``run_robot``."""
        transport = self.transport
        own_turn = True  # a first step without mail
        finished_s = math.inf
        while True:
            now_s = transport.now()
            if now_s >= time_limit_s or (until is not None and until(self.state)):
                return self.state
            own_turn |= self.look()
            if not self.mail:
                self.mail.extend(transport.receive(self.robot))
            if own_turn or (not self.mail and now_s >= self.state.wake_s):
                self.advance(Inbox(now_s, (), self.present))
                own_turn = False
            elif self.mail:
                taken = self.take(self.mail.popleft(), now_s)
                # Refused mail must not keep the robot from what is due.
                own_turn = not taken and now_s >= self.state.wake_s
            else:
                due_s = min(self.state.wake_s, time_limit_s, self.tell_s, now_s + WATCH_S)
                transport.wait(max(due_s - now_s, 0.0))
            finished_s = min(finished_s, now_s) if self.state.finished else math.inf
            self.tell(now_s)
            if not self.mail and self.state.finished:
                if self.all_done() and not transport.wait(0.0):
                    return self.state
                if now_s >= finished_s + linger_s:
                    return self.state

    def look(self) -> bool:
        """See who is there; whether that has changed."""
        seen = self.transport.present(self.robot)
        if seen == self.present:
            return False
        before, self.present = self.present, seen
        for other in (before or frozenset()) - (seen or frozenset()):
            self.done.pop(other, None)
        if self.told is not None:
            for other in sorted((seen or frozenset()) - (before or frozenset())):
                self.send_done(self.told, other)
        return True

    def advance(self, inbox: Inbox) -> None:
        """One step, and what it sends."""
        self.state, outbox = self.step(self.state, inbox)
        self.post(outbox)

    def post(self, outbox: Outbox) -> None:
        """Send, then show."""
        for outgoing in outbox:
            self.transport.send(self.robot, outgoing.envelope, outgoing.to)
        if self.report is not None:
            self.report(self.state)

    def take(self, envelope: Envelope, now_s: float) -> bool:
        """Feed one envelope; whether it was taken."""
        if envelope.kind == DONE:
            return self.hear(envelope)
        try:
            after, outbox = self.step(self.state, Inbox(now_s, (envelope,), self.present))
        except Exception as error:  # noqa: BLE001 - whatever a message does to a step, it has not
            text = f"{type(error).__name__}: {error}"
            self.transport.refuse(f"step {envelope.kind}", envelope.robot, text)
            _LOG.debug("refused %s", envelope.kind, exc_info=True)
            return False
        self.state = after
        self.post(outbox)
        return True

    def hear(self, envelope: Envelope) -> bool:
        """Note whether a teammate has finished."""
        try:
            if envelope.session != self.session:
                raise InvalidInputError(f"expected session {self.session}, got {envelope.session}")
            self.done[envelope.robot] = _DECODER.decode(envelope.payload)
        except (InvalidInputError, msgspec.MsgspecError) as error:
            self.transport.refuse(f"step {DONE}", envelope.robot, str(error))
            return False
        return True

    def tell(self, now_s: float) -> None:
        """Tell all whether this robot has finished: when it changes, and again while it has."""
        if self.state.finished != self.told or now_s >= self.tell_s:
            self.told = self.state.finished
            self.send_done(self.told, None)
            self.tell_s = now_s + REPEAT_S if self.told else math.inf

    def send_done(self, finished: bool, to: str | None) -> None:
        """Say whether this robot has finished."""
        self.tells += 1
        envelope = Envelope(
            robot=self.robot,
            session=self.session,
            sequence=self.tells,
            kind=DONE,
            payload=msgspec.msgpack.encode(finished),
        )
        self.transport.send(self.robot, envelope, to)

    def all_done(self) -> bool:
        """Whether every teammate that is there has finished."""
        if self.present is None:
            return False
        return all(self.done.get(other, False) for other in self.present)
