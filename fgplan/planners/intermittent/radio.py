"""Radio of limited range over any simulated transport: who is too far away hears nothing."""

from collections.abc import Mapping, Sequence

import numpy as np

from fgplan.team.envelope import Envelope, TrafficByKind
from fgplan.team.transport import SimulatedTransport
from fgplan.typing import FloatArray

_HAIR_M = 1e-9


def is_in_range(here: FloatArray, there: FloatArray, range_m: float) -> bool:
    """Whether two places are within range of radio, up to rounding.

    Args:
        here: Shape (2,), metres.
        there: Shape (2,), metres.
        range_m: R, metres.
    """
    return bool(np.hypot(*(there - here)) <= range_m + _HAIR_M)


class Radio:
    """A transport that delivers within range only; see ``fgplan.team.transport``.

    Args:
        inner: Carries what is in range.
        range_m: R, metres.
        positions: Of every robot by name, shape (2,) each; ``move`` changes them.
    """

    def __init__(
        self, inner: SimulatedTransport, range_m: float, positions: Mapping[str, FloatArray]
    ) -> None:
        self._inner = inner
        self._range_m = range_m
        self._positions = dict(positions)

    @property
    def traffic(self) -> TrafficByKind:
        """Messages and bytes so far, by kind; a message to three in range counts three times."""
        return self._inner.traffic

    def move(self, robot: str, position: FloatArray | None) -> None:
        """Say where a robot is.

        Args:
            robot: Name.
            position: Shape (2,), metres; None switches its radio off.
        """
        if position is None:
            self._positions.pop(robot, None)
        else:
            self._positions[robot] = position

    def send(self, robot: str, envelope: Envelope, to: str | None = None) -> None:
        """Send an envelope to one robot, or to all, as far as they are within range.

        Args:
            robot: Who sends.
            envelope: The message.
            to: One robot, or None for all others.
        """
        here = self._positions.get(robot)
        if here is None:
            return
        for other, there in self._positions.items():
            wanted = other != robot and to in (None, other)
            if wanted and is_in_range(here, there, self._range_m):
                self._inner.send(robot, envelope, other)

    def receive(self, robot: str) -> tuple[Envelope, ...]:
        """What has arrived for a robot since the last call, in order of arrival."""
        return self._inner.receive(robot)

    def now(self) -> float:
        """Seconds on the inner clock."""
        return self._inner.now()

    def present(self, robot: str) -> frozenset[str] | None:
        """Teammates that the inner transport sees now; None where it cannot tell."""
        return self._inner.present(robot)

    def waiting(self) -> Sequence[str]:
        """Robots for which something has arrived."""
        return self._inner.waiting()

    def next_arrival_s(self) -> float:
        """Time of the next arrival; infinite if nothing is under way."""
        return self._inner.next_arrival_s()

    def advance(self, until_s: float) -> None:
        """Move the clock."""
        self._inner.advance(until_s)
