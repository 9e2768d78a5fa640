"""The transport of one robot over Eclipse Zenoh: real processes, a real clock.

Nothing of Python runs in zenoh's own threads: messages wait in zenoh's rings, one for each sender
(see ``mailbox``). So a robot whose step holds the interpreter lock for seconds blocks nobody, stays
alive for the others, and finds its mail in order afterwards.
"""

import time
from collections.abc import Callable, Collection, Sequence
from types import ModuleType, TracebackType
from typing import Any

import msgspec

from fgplan.errors import FgplanError, InvalidInputError, MissingExtraError, UnknownNameError
from fgplan.team.admission import RELAYED, Admission, Refused
from fgplan.team.credentials import Credentials
from fgplan.team.envelope import Envelope, TrafficByKind
from fgplan.team.mailbox import Mailbox
from fgplan.team.network_options import NetworkOptions, check_key_chunk
from fgplan.team.zenoh_settings import key_prefix, zenoh_settings

BATCH = 256
"""Envelopes that one ``receive`` gives at most; the next gives more."""

_POLL_S = 0.01

_CHANGES = 64
"""Changes of one teammate's tokens that are kept between two looks."""


class ZenohTransport:
    """Carries the envelopes of one robot; a context manager; see the module header."""

    def __init__(
        self,
        robot: str,
        robots: Sequence[str],
        options: NetworkOptions | None = None,
        *,
        relayed: Collection[str] = RELAYED,
        session: int | None = None,
    ) -> None:
        """Prepare; nothing is opened before ``with``.

        Args:
            robot: Whose transport it is.
            robots: All names, in the order of the team.
            options: The network; None is a loopback without any teammate to connect to.
            relayed: Kinds of message that a teammate may pass on as another wrote them.
            session: The only planning session whose messages are taken; None takes all and leaves
                it to the robot's step.

        Raises:
            UnknownNameError: If the robot is not in the team.
            InvalidInputError: If a name cannot be part of a key, or a certificate is not there or
                not usable.
            MissingExtraError: If the extra ``net`` is not installed.
        """
        if robot not in robots:
            raise UnknownNameError(f"transport: robot {robot!r} is not one of {', '.join(robots)}")
        for name in robots:
            check_key_chunk(name, "transport: robot")
        self.robot = robot
        self.options = options or NetworkOptions()
        self._zenoh = _import_zenoh()
        self._others = tuple(name for name in robots if name != robot)
        self._settings = zenoh_settings(robot, robots, self.options)
        self._credentials = (
            Credentials.read(robot, robots, self.options) if self.options.secure else None
        )
        self._admission = Admission(
            robot,
            robots,
            self.options,
            relayed=relayed,
            session=session,
            verifier=self._credentials,
        )
        self._traffic = TrafficByKind()
        self._prefix = key_prefix(self.options)
        self._mailbox = Mailbox(self._others, self.options.kept_per_sender, self.options.kept_bytes)
        self._session: Any = None
        self._subscribers: list[Any] = []
        self._tokens: dict[str, Any] = {}
        self._sessions: dict[str, set[str]] = {}
        self._cut_since_s: float | None = None
        self._opened_s = 0.0
        self.relinked = 0
        """How often it had to open its session anew."""

    def __enter__(self) -> "ZenohTransport":
        """Open the session, listen, and show that this robot is there.

        Raises:
            InvalidInputError: If zenoh refuses, as where the port is taken.
        """
        self._open()
        self._opened_s = time.monotonic()
        return self

    def _open(self) -> None:
        """Open a session; see ``__enter__``."""
        zenoh = self._zenoh
        config = zenoh.Config()
        try:
            for path, value in self._settings.items():
                config.insert_json5(path, msgspec.json.encode(value).decode())
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise InvalidInputError(
                f"robot {self.robot!r}: could not listen on {', '.join(self.options.listen)}: "
                f"{error}"
            ) from error
        liveliness = self._session.liveliness()
        for other in self._others:
            key = f"{self._prefix}/{other}/to/{self.robot}"
            ring = zenoh.handlers.RingChannel(self.options.kept_per_sender)
            subscriber = self._session.declare_subscriber(key, ring)
            self._subscribers.append(subscriber)
            # The handler, not the subscriber: that cannot be closed while a thread waits in it.
            self._mailbox.fill(other, self._taking(other, subscriber.handler))
            watcher = liveliness.declare_subscriber(
                f"{self._prefix}/{other}/alive/*",
                zenoh.handlers.RingChannel(_CHANGES),
                history=True,
            )
            self._subscribers.append(watcher)
            self._tokens[other] = watcher.handler
            self._sessions[other] = set()
        # Last: whoever sees the token can already be heard.
        own = self._session.info.zid()
        self._token = liveliness.declare_token(f"{self._prefix}/{self.robot}/alive/{own}")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the network."""
        self.close()

    def close(self) -> None:
        """Leave the network; what has not been received is gone."""
        if self._session is None:
            return
        self._leave()
        self._mailbox.close()
        self._end()

    def _leave(self) -> None:
        """Say nothing and hear nothing more."""
        self._token.undeclare()
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._subscribers.clear()

    def _end(self) -> None:
        """Close the session."""
        self._session.close()
        self._session = None

    @property
    def traffic(self) -> TrafficByKind:
        """What this robot has sent and received so far, by kind."""
        return self._traffic

    @property
    def refused(self) -> Refused:
        """Messages that were refused so far, by reason."""
        return self._admission.refused

    def refuse(self, reason: str, sender: str, text: str) -> None:
        """Count a message that was refused after it was received.

        Args:
            reason: In a word or two, from a bounded set.
            sender: Robot that it came from.
            text: What was wrong.
        """
        self._admission.refuse(reason, sender, text)

    def send(self, robot: str, envelope: Envelope, to: str | None = None) -> None:
        """Send an envelope; waits only where the network itself is full.

        Args:
            robot: This robot.
            envelope: The message; signed here if this robot wrote it and the team signs.
            to: One robot, or None for all others.

        Raises:
            UnknownNameError: If the sender is another robot, or the receiver not in the team.
            InvalidInputError: If the message is too large for the team.
            FgplanError: If the transport is not open.
        """
        self._check_robot(robot)
        if to is not None and to not in self._others:
            raise UnknownNameError(
                f"transport: robot {to!r} is not one of {', '.join(self._others)}"
            )
        if self._session is None:
            raise FgplanError("transport: not open; use it in a with statement")
        if self._credentials is not None and envelope.robot == robot and not envelope.signature:
            envelope = self._credentials.sign(envelope)
        data = envelope.encoded
        if len(data) > self.options.largest_message_bytes:
            raise InvalidInputError(
                f"{envelope.kind} of robot {robot!r}: expected at most "
                f"{self.options.largest_message_bytes} bytes, got {len(data)}; raise "
                "largest_message_bytes of [team.network] for the whole team"
            )
        self._session.put(
            f"{self._prefix}/{robot}/to/{'*' if to is None else to}",
            data,
            congestion_control=self._zenoh.CongestionControl.BLOCK,
        )
        counts = self._traffic.of(envelope.kind)
        counts.sent += 1
        counts.sent_bytes += len(data)

    def receive(self, robot: str) -> tuple[Envelope, ...]:
        """What has arrived since the last call and was not refused; never waits.

        Args:
            robot: This robot.

        Returns:
            At most ``BATCH`` envelopes: in order of arrival from each sender, senders in turn.

        Raises:
            UnknownNameError: If it is another robot.
        """
        self._check_robot(robot)
        now_s = self.now()
        envelopes = []
        for sender, data in self._mailbox.take(BATCH):
            envelope = self._admission.admit(sender, data, now_s)
            if envelope is not None:
                counts = self._traffic.of(envelope.kind)
                counts.delivered += 1
                counts.delivered_bytes += len(data)
                envelopes.append(envelope)
        return tuple(envelopes)

    def now(self) -> float:
        """Seconds since this robot opened its transport; no robot knows another's clock."""
        return time.monotonic() - self._opened_s

    def present(self, robot: str) -> frozenset[str]:
        """Teammates that are there now.

        Args:
            robot: This robot.

        Returns:
            Names; one whose process has ended is missing at once, one that is frozen or cut off
            after ``lease_s``.

        Raises:
            UnknownNameError: If it is another robot.
        """
        self._check_robot(robot)
        links = {str(link) for link in self._session.info.peers_zid()}
        for other, handler in self._tokens.items():
            sessions = self._sessions[other]
            while (change := handler.try_recv()) is not None:
                session = str(change.key_expr).rpartition("/")[2]
                if change.kind == self._zenoh.SampleKind.PUT:
                    sessions.add(session)
                else:
                    sessions.discard(session)
        here = {other for other, sessions in self._sessions.items() if sessions & links}
        self._mend({other for other, sessions in self._sessions.items() if sessions} - here)
        return frozenset(here)

    def _mend(self, cut: set[str]) -> None:
        """Open the session anew where zenoh shows teammates to which it has no link.

        That happens after a teammate was frozen while much was on its way to it (zenoh 1.10.2, in
        four of ten such cases if only one of the two connects): its token is there, messages to it
        go nowhere, and nothing but a new session changes that.
        """
        now_s = time.monotonic()
        if not cut:
            self._cut_since_s = None
        elif self._cut_since_s is None:
            self._cut_since_s = now_s
        elif now_s > self._cut_since_s + 2.0 * self.options.lease_s:
            self._cut_since_s = None
            self.relinked += 1
            self._leave()
            self._end()
            self._open()

    def wait(self, timeout_s: float) -> bool:
        """Wait until something has arrived.

        Args:
            timeout_s: Seconds to wait at most.

        Returns:
            Whether something has.
        """
        return self._mailbox.wait(timeout_s)

    def wait_for_team(
        self, timeout_s: float, without: Callable[[], Collection[str]] | None = None
    ) -> frozenset[str]:
        """Wait until all teammates are there.

        Args:
            timeout_s: Seconds to wait at most.
            without: Says who will not come; None where nobody knows.

        Returns:
            Those that are.
        """
        until_s = time.monotonic() + timeout_s
        while True:
            here = self.present(self.robot)
            if here.issuperset(set(self._others).difference(without() if without else ())):
                break
            if time.monotonic() >= until_s:
                break
            time.sleep(_POLL_S)
        return here

    def _check_robot(self, robot: str) -> None:
        """This transport is one robot's alone."""
        if robot != self.robot:
            raise UnknownNameError(
                f"transport of robot {self.robot!r}: expected that robot, got {robot!r}"
            )

    def _taking(self, sender: str, handler: Any) -> Callable[[], bytes | None]:  # noqa: ANN401
        """What takes the next message of a sender out of its ring."""
        zenoh = self._zenoh
        keys = {f"{self._prefix}/{sender}/to/{to}" for to in ("*", self.robot)}

        def take() -> bytes | None:
            """The next message; None after the end."""
            while True:
                try:
                    sample = handler.recv()
                except zenoh.ZError:
                    return None
                # A key with a wildcard in the sender's place comes under everybody's name.
                if str(sample.key_expr) in keys and sample.kind == zenoh.SampleKind.PUT:
                    return bytes(sample.payload.to_bytes())
                self.refuse("key", sender, f"expected one of {sorted(keys)}")

        return take


def _import_zenoh() -> ModuleType:
    """The zenoh module, or how to get it."""
    try:
        import zenoh
    except ImportError as error:
        raise MissingExtraError(
            f"robots as processes need eclipse-zenoh, which could not be imported ({error}); "
            "install the extra: pip install 'fgplan[net]'"
        ) from error
    return zenoh
