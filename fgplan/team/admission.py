"""What a message from the network must pass before a robot's step sees it.

In this order, cheapest first: size, rate, form, a known writer, the session, who may pass it on,
the signature. The sender is not what the message says but the key that it came under, and with
certificates the network lets a robot write under its own key alone. What is refused is counted by
reason, and the first of each reason is logged.

A message whose writer is not its sender is one that a teammate passes on. That is allowed for the
kinds of message that are written once and never change. With signatures it is proof; without them
it is trust in the processes on this machine, not security.
"""

import logging
import threading
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from fgplan.errors import InvalidInputError
from fgplan.team.envelope import Envelope, decode_envelope
from fgplan.team.network_options import NetworkOptions

RELAYED = frozenset({"announcement", "withdrawal", "refusal"})
"""Kinds that a robot passes on as a teammate wrote them: entries of the log of a session."""

KINDS_LIMIT = 64
"""Kinds of message that are told apart; a kind beyond them is refused."""

REFUSED_TEXT = 300
"""Characters of a refusal that are kept and logged."""

_LOG = logging.getLogger(__name__)


class Verifier(Protocol):
    """Checks who wrote an envelope."""

    def verify(self, envelope: Envelope) -> None:
        """Raise InvalidInputError unless the envelope's robot has signed it."""
        ...


@dataclass(slots=True)
class Refused:
    """Counts of refused messages by reason.

    Attributes:
        counts: Messages by reason; ``step KIND`` are those that the robot's step refused.
        first: What was wrong with the first of each reason.
    """

    counts: dict[str, int] = field(default_factory=dict)
    first: dict[str, str] = field(default_factory=dict)

    @property
    def total(self) -> int:
        """Messages refused."""
        return sum(self.counts.values())

    def count(self, reason: str, sender: str, text: str) -> None:
        """Count a refused message; keep and log the first of its reason.

        Args:
            reason: In a word or two; callers draw it from a bounded set.
            sender: Robot that it came from.
            text: What was wrong.
        """
        self.counts[reason] = self.counts.get(reason, 0) + 1
        if reason not in self.first:
            self.first[reason] = f"from robot {sender!r}: {text}"[:REFUSED_TEXT]
            _LOG.warning("message refused (%s) %s", reason, self.first[reason])


class Admission:
    """Decides which messages one robot looks at."""

    def __init__(
        self,
        robot: str,
        robots: Sequence[str],
        options: NetworkOptions,
        *,
        relayed: Collection[str] = RELAYED,
        session: int | None = None,
        verifier: Verifier | None = None,
    ) -> None:
        """Start with nothing refused.

        Args:
            robot: Who receives.
            robots: All names, in the order of the team.
            options: Limits.
            relayed: Kinds that a teammate may pass on.
            session: The only planning session whose messages are looked at; None takes all.
            verifier: Checks signatures; None where the team does not sign.
        """
        self.refused = Refused()
        self._robot = robot
        self._robots = frozenset(robots)
        self._options = options
        self._relayed = frozenset(relayed)
        self._session = session
        self._verifier = verifier
        self._kinds: set[str] = set()
        self._allowance: dict[str, tuple[float, float]] = {}
        self._lock = threading.Lock()

    def admit(self, sender: str, data: bytes, now_s: float) -> Envelope | None:
        """Look at a message.

        Args:
            sender: Robot whose key it came under.
            data: As received.
            now_s: Time of the transport, seconds.

        Returns:
            The envelope, or None if it was refused; its payload is not looked at.
        """
        try:
            return self._checked(sender, data, now_s)
        except _RefusedError as refusal:
            self.refuse(refusal.reason, sender, str(refusal))
            return None

    def refuse(self, reason: str, sender: str, text: str) -> None:
        """Count a message that was refused elsewhere; any thread may.

        Args:
            reason: In a word or two; callers draw it from a bounded set.
            sender: Robot that it came from.
            text: What was wrong.
        """
        with self._lock:
            self.refused.count(reason, sender, text)

    def _checked(self, sender: str, data: bytes, now_s: float) -> Envelope:
        """The envelope, or _RefusedError."""
        if sender not in self._robots or sender == self._robot:
            raise _RefusedError("sender", "expected a teammate")
        if len(data) > self._options.largest_message_bytes:
            raise _RefusedError(
                "size",
                f"expected at most {self._options.largest_message_bytes} bytes, got {len(data)}",
            )
        if not self._within_rate(sender, now_s):
            raise _RefusedError(
                "rate", f"expected at most {self._options.messages_per_s:g} messages a second"
            )
        try:
            envelope = decode_envelope(data)
        except InvalidInputError as error:
            raise _RefusedError("form", str(error)) from error
        if envelope.robot not in self._robots:
            raise _RefusedError("robot", f"{envelope.robot!r} is not of the team")
        if self._session is not None and envelope.session != self._session:
            raise _RefusedError(
                "session", f"expected session {self._session}, got {envelope.session}"
            )
        if envelope.robot != sender and envelope.kind not in self._relayed:
            raise _RefusedError(
                "passed on",
                f"{envelope.kind!r} of robot {envelope.robot!r}; only its writer may send that",
            )
        if self._verifier is not None:
            try:
                self._verifier.verify(envelope)
            except InvalidInputError as error:
                raise _RefusedError("signature", str(error)) from error
        if envelope.kind not in self._kinds:
            if len(self._kinds) >= KINDS_LIMIT:
                raise _RefusedError("kind", f"{envelope.kind!r} is one kind too many")
            self._kinds.add(envelope.kind)
        return envelope

    def _within_rate(self, sender: str, now_s: float) -> bool:
        """Whether a teammate has not sent too much; it may save up what waits for it at most."""
        # As many as can wait, in the ring and in the mailbox.
        most = 2.0 * self._options.kept_per_sender + 2.0
        left, since_s = self._allowance.get(sender, (most, now_s))
        left = min(most, left + (now_s - since_s) * self._options.messages_per_s)
        self._allowance[sender] = (max(left - 1.0, 0.0), now_s)
        return left >= 1.0


class _RefusedError(Exception):
    """A message is refused for a reason."""

    def __init__(self, reason: str, text: str) -> None:
        """Keep the reason."""
        super().__init__(text)
        self.reason = reason
