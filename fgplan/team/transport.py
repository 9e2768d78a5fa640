"""What carries envelopes between robots.

A transport promises nothing but this: what it delivers was sent, unchanged. It may lose, double,
reorder and delay. A robot never waits inside a step; it names the time at which it wants to be
woken, and whoever runs it sees to that.
"""

from collections.abc import Sequence
from typing import Protocol

from fgplan.team.envelope import Envelope, TrafficByKind


class Transport(Protocol):
    """Sends and receives for one robot or for several in one process."""

    @property
    def traffic(self) -> TrafficByKind:
        """Messages and bytes so far, by kind."""
        ...

    def send(self, robot: str, envelope: Envelope, to: str | None = None) -> None:
        """Send an envelope.

        Args:
            robot: Who sends; not always who wrote the envelope.
            envelope: The message.
            to: One robot, or None for all others.
        """
        ...

    def receive(self, robot: str) -> tuple[Envelope, ...]:
        """What has arrived for a robot since the last call, in order of arrival; never waits."""
        ...

    def now(self) -> float:
        """Seconds on the clock that time-outs count on."""
        ...

    def present(self, robot: str) -> frozenset[str] | None:
        """Teammates that the network sees now; None where it cannot tell."""
        ...


class SimulatedTransport(Transport, Protocol):
    """A transport whose clock is moved by whoever runs the robots."""

    def waiting(self) -> Sequence[str]:
        """Robots for which something has arrived, in the order of the team."""
        ...

    def next_arrival_s(self) -> float:
        """Time of the next arrival; infinite if nothing is under way."""
        ...

    def advance(self, until_s: float) -> None:
        """Move the clock; what is due by then arrives."""
        ...
