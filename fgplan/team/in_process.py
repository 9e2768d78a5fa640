"""Robots in one process: a simulated network with a simulated clock.

Without faults an envelope is handed over by reference at once: it is immutable, and what its
writer decoded or checked is kept with it; bytes are counted all the same. With faults every copy
goes through its bytes, each copy has its own fate, and every fate is drawn from one seeded
generator in the order of sending.
"""

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from fgplan.checks import check_finite, check_generator, check_not_negative
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.team.envelope import Envelope, TrafficByKind, decode_envelope


@dataclass(frozen=True, slots=True)
class Partition:
    """A time in which groups of robots do not hear each other.

    Attributes:
        start_s: First second.
        end_s: When it heals.
        groups: Robots by group; a robot in no group hears nobody.
    """

    start_s: float
    end_s: float
    groups: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        """Check that it heals after it began."""
        check_not_negative(self.start_s, "network partition start_s")
        check_not_negative(self.end_s, "network partition end_s")
        if self.end_s <= self.start_s:
            raise InvalidInputError(
                f"network partition end_s: expected later than start_s = {self.start_s:g}, got "
                f"{self.end_s:g}"
            )
        object.__setattr__(self, "groups", tuple(tuple(group) for group in self.groups))

    def parts(self, sender: str, receiver: str, now_s: float) -> bool:
        """Whether it keeps two robots apart at a time."""
        if not self.start_s <= now_s < self.end_s:
            return False
        return not any(sender in group and receiver in group for group in self.groups)


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkFaults:
    """What goes wrong on the way.

    Attributes:
        loss: Probability that a copy is lost.
        duplication: Probability that a copy arrives twice.
        reordering: Probability that a copy is held back by up to ``reordering_s``.
        reordering_s: Longest time held back, seconds.
        delay_s: Shortest and longest delay of every copy, seconds.
        partitions: Times in which groups do not hear each other.
    """

    loss: float = 0.0
    duplication: float = 0.0
    reordering: float = 0.0
    reordering_s: float = 0.5
    delay_s: tuple[float, float] = (0.0, 0.0)
    partitions: tuple[Partition, ...] = ()

    def __post_init__(self) -> None:
        """Check probabilities and times."""
        for name in ("loss", "duplication", "reordering"):
            value = check_not_negative(getattr(self, name), f"network faults {name}")
            if value >= 1.0:
                raise InvalidInputError(
                    f"network faults {name}: expected a probability below one, got {value}"
                )
        check_not_negative(self.reordering_s, "network faults reordering_s")
        delays = check_finite(self.delay_s, "network faults delay_s", (2,)).tolist()
        if not 0.0 <= delays[0] <= delays[1]:
            raise InvalidInputError(
                "network faults delay_s: expected shortest and longest, zero or more, got "
                f"{self.delay_s}"
            )
        object.__setattr__(self, "delay_s", tuple(delays))
        object.__setattr__(self, "partitions", tuple(self.partitions))


def read_faults(given: Mapping[str, Any]) -> NetworkFaults:
    """Network faults from plain data, as a scenario gives them.

    Args:
        given: Fields of ``NetworkFaults`` by name; ``partitions`` as mappings too.

    Returns:
        The faults.

    Raises:
        UnknownNameError: If a field is not known; lists those that are.
        InvalidInputError: If a field is missing or has a value that is not usable.
    """
    known = {field.name for field in fields(NetworkFaults)}
    _check_fields("network faults", given, known)
    needed = {field.name for field in fields(Partition)}
    partitions = []
    for index, partition in enumerate(given.get("partitions", ())):
        _check_fields(f"network partition {index}", partition, needed)
        missing = sorted(needed - set(partition))
        if missing:
            raise InvalidInputError(f"network partition {index}: expected {missing[0]}, got none")
        partitions.append(Partition(**partition))
    return NetworkFaults(**{**given, "partitions": tuple(partitions)})


def _check_fields(what: str, given: Mapping[str, Any], known: set[str]) -> None:
    """Refuse what is no table, and fields that are not known."""
    if not isinstance(given, Mapping):
        raise InvalidInputError(f"{what}: expected a table, got {given!r}")
    for name in given:
        if name not in known:
            raise UnknownNameError(
                f"{what} {name}: expected one of {', '.join(sorted(known))}, got {name!r}"
            )


class InProcessTransport:
    """Carries envelopes between robots of one process; see the module header."""

    def __init__(
        self,
        robots: Sequence[str],
        faults: NetworkFaults | None = None,
        generator: np.random.Generator | None = None,
    ) -> None:
        """Make an empty network.

        Args:
            robots: Names, in the order of the team.
            faults: What goes wrong; None hands over at once and by reference.
            generator: Source of the faults; needed where there are faults.

        Raises:
            InvalidInputError: If there are faults but no generator.
            UnknownNameError: If a partition names a robot that is not in the team.
        """
        if faults is not None and generator is None:
            raise InvalidInputError(
                "in-process transport: faults need a generator: numpy.random.default_rng(seed)"
            )
        if generator is not None:
            check_generator(generator, "in-process transport")
        for partition in faults.partitions if faults else ():
            for name in (name for group in partition.groups for name in group):
                if name not in robots:
                    raise UnknownNameError(
                        f"partition: robot {name!r} is not one of {', '.join(robots)}"
                    )
        self.traffic = TrafficByKind()
        self._faults = faults
        self._generator = generator
        self._arrived: dict[str, list[Envelope]] = {robot: [] for robot in robots}
        self._under_way: list[tuple[float, int, str, bytes]] = []
        self._count = 0
        self._now_s = 0.0

    def send(self, robot: str, envelope: Envelope, to: str | None = None) -> None:
        """Send an envelope to one robot, or to all others.

        Raises:
            UnknownNameError: If sender or receiver is not in the team.
        """
        for name in (robot, to or robot):
            if name not in self._arrived:
                known = ", ".join(self._arrived)
                raise UnknownNameError(f"transport: robot {name!r} is not one of {known}")
        counts = self.traffic.of(envelope.kind)
        size = envelope.byte_size
        counts.sent += 1
        counts.sent_bytes += size
        receivers = [to] if to is not None else [name for name in self._arrived if name != robot]
        if self._faults is None:
            counts.delivered += len(receivers)
            counts.delivered_bytes += size * len(receivers)
            for name in receivers:
                self._arrived[name].append(envelope)
            return
        for name in receivers:
            for due_s in self._fates(robot, name):
                if due_s is None:
                    counts.lost += 1
                    continue
                counts.delivered += 1
                counts.delivered_bytes += size
                self._count += 1
                heapq.heappush(self._under_way, (due_s, self._count, name, envelope.encoded))

    def receive(self, robot: str) -> tuple[Envelope, ...]:
        """What has arrived for a robot since the last call, in order of arrival."""
        arrived = self._arrived[robot]
        if not arrived:
            return ()
        self._arrived[robot] = []
        return tuple(arrived)

    def now(self) -> float:
        """Seconds on the simulated clock."""
        return self._now_s

    def present(self, robot: str) -> None:
        """Nothing: a simulated network does not tell who is there."""

    def waiting(self) -> list[str]:
        """Robots for which something has arrived, in the order of the team."""
        return [robot for robot, arrived in self._arrived.items() if arrived]

    def next_arrival_s(self) -> float:
        """Time of the next arrival; infinite if nothing is under way."""
        return self._under_way[0][0] if self._under_way else np.inf

    def advance(self, until_s: float) -> None:
        """Move the clock; what is due by then arrives."""
        self._now_s = max(self._now_s, until_s)
        while self._under_way and self._under_way[0][0] <= self._now_s:
            _, _, robot, data = heapq.heappop(self._under_way)
            self._arrived[robot].append(decode_envelope(data))

    def _fates(self, sender: str, receiver: str) -> list[float | None]:
        """Time of arrival of each copy of one message; None for a lost one."""
        faults, generator = self._faults, self._generator
        if faults is None or generator is None:
            return [self._now_s]
        copies = 2 if generator.random() < faults.duplication else 1
        apart = any(part.parts(sender, receiver, self._now_s) for part in faults.partitions)
        fates: list[float | None] = []
        for _ in range(copies):
            lost, held, delay, extra = generator.random(4)
            low, high = faults.delay_s
            due_s = self._now_s + low + (high - low) * delay
            if held < faults.reordering:
                due_s += faults.reordering_s * extra
            fates.append(None if lost < faults.loss or apart else due_s)
        return fates
