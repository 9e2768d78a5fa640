"""Who announced what: the accepted messages of a planning session, in the order of acceptance.

The rule (DESIGN section 5): a message is accepted only if its basis is what the ledger holds. Of
two messages with one basis the robot earlier in the order of the team wins, whichever arrives
first; the other must evaluate again. Accepted messages therefore form one sequence, each computed
from all before it, and each lowers the common objective.

Round 0 is different: everybody announces with an empty basis, nobody competes, and the objective
counts from its end. So does the opening of a robot that comes late, or comes back after its path
was withdrawn: the objective counts anew from there.

A ledger is a value: ``accept`` returns a new one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import msgspec

from fgplan.announcement.announcement import Announcement, Message, Withdrawal
from fgplan.errors import InvalidInputError, StaleAnnouncementError, UnknownNameError
from fgplan.message_reader import MessageReader
from fgplan.paths.candidate_path import CandidatePath

RISE_TOLERANCE = 1e-9
"""Relative; evaluators of different robots agree this far."""


@dataclass(frozen=True, slots=True)
class Accepted:
    """One line of the history.

    Attributes:
        sequence: Place in the common sequence of accepted messages, from 1.
        robot: Who announced.
        value: Common objective after it; None in round 0 and for a withdrawal.
    """

    sequence: int
    robot: str
    value: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ledger:
    """The accepted messages of one planning session.

    Attributes:
        order: Names of the robots; the earlier wins where two compete.
        session: Planning session.
        prior_digest: Digest of the prior that everybody must hold.
        use_basis: Whether the basis decides; without it two robots can swap for ever.
        check_values: Whether a value above the last accepted one is an error. Switch it off for
            an evaluator that is not exact.
        messages: Accepted messages in order.
        current: Last message of each robot.
    """

    order: tuple[str, ...]
    session: int = 0
    prior_digest: str = ""
    use_basis: bool = True
    check_values: bool = True
    messages: tuple[Message, ...] = ()
    current: Mapping[str, Message] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the order."""
        if not self.order or len(set(self.order)) != len(self.order):
            raise InvalidInputError(
                f"ledger: expected the names of all robots, none twice, got {self.order}"
            )

    @property
    def value(self) -> float | None:
        """Common objective after the last accepted announcement, or None in round 0."""
        for message in reversed(self.messages):
            if isinstance(message, Announcement):
                return message.value
            if message.basis:
                return None
        return None

    @property
    def history(self) -> tuple[Accepted, ...]:
        """Accepted messages as (sequence, robot, value)."""
        return tuple(
            Accepted(
                place, message.robot, message.value if isinstance(message, Announcement) else None
            )
            for place, message in enumerate(self.messages, start=1)
        )

    def basis(self) -> dict[str, int]:
        """Sequence of each robot's message that the ledger holds, in the order of the team."""
        return {r: self.current[r].sequence for r in self.order if r in self.current}

    def paths(self, without: str | None = None) -> dict[str, CandidatePath]:
        """Announced paths in the order of the team.

        Args:
            without: A robot to leave out.

        Returns:
            Path of each robot that has announced one and not withdrawn it.
        """
        found = {}
        for robot in self.order:
            message = self.current.get(robot)
            if robot != without and isinstance(message, Announcement):
                found[robot] = message.path()
        return found

    def next_sequence(self, robot: str) -> int:
        """Sequence for the next message of a robot."""
        return self.current[robot].sequence + 1 if robot in self.current else 1

    def accept(self, message: Message) -> "Ledger":
        """Accept a message.

        Args:
            message: An announcement or a withdrawal.

        Returns:
            The ledger with it. If it competes with the last accepted message (same basis) and its
            robot is earlier in the order, the last one is taken back.

        Raises:
            UnknownNameError: If a robot is not in the team.
            StaleAnnouncementError: If the basis is not what the ledger holds, or the sequence is
                not new.
            InvalidInputError: If session, prior or path are wrong, or the objective rises.
        """
        self._check(message)
        ledger = self
        if message.basis and self.use_basis and message.basis != self.basis():
            ledger = self._without_last_if_it_yields(message)
        if message.basis and ledger.check_values and ledger.use_basis:
            ledger._check_value(message)
        return ledger._with(message)

    def _with(self, message: Message) -> "Ledger":
        """The ledger with one more message."""
        return replace(
            self,
            messages=(*self.messages, message),
            current={**self.current, message.robot: message},
        )

    def _check(self, message: Message) -> None:
        """Check who, when and on what prior."""
        name = f"announcement {message.sequence} of robot {message.robot!r}"
        for robot in (message.robot, *message.basis):
            if robot not in self.order:
                raise UnknownNameError(
                    f"{name}: robot {robot!r} is not in the team: {', '.join(self.order)}"
                )
        if message.session != self.session:
            raise InvalidInputError(
                f"{name}: session: expected {self.session}, got {message.session}"
            )
        if message.prior_digest != self.prior_digest:
            raise InvalidInputError(
                f"{name}: prior_digest: expected {self.prior_digest!r}, got "
                f"{message.prior_digest!r}; all robots must hold the same prior"
            )
        held = self.current.get(message.robot)
        if held is not None and message.sequence <= held.sequence:
            raise StaleAnnouncementError(
                f"{name}: sequence: expected more than {held.sequence}, which is accepted"
            )
        if not message.basis and isinstance(held, Announcement):
            raise StaleAnnouncementError(
                f"{name}: basis: empty, but round 0 is over for this robot; evaluate again"
            )
        if isinstance(message, Announcement):
            message.path()

    def _without_last_if_it_yields(self, message: Message) -> "Ledger":
        """The ledger without its last message if that has the same basis and a later robot."""
        name = f"announcement {message.sequence} of robot {message.robot!r}"
        held = self.basis()
        last = self.messages[-1] if self.messages else None
        competes = last is not None and bool(last.basis) and last.basis == message.basis
        if last is None or not competes:
            ahead = [r for r, sequence in message.basis.items() if sequence > held.get(r, 0)]
            hint = f"ask for the missing ones of {', '.join(ahead)}" if ahead else "evaluate again"
            raise StaleAnnouncementError(
                f"{name}: basis: computed from {dict(message.basis)}, but the ledger holds {held}; "
                f"{hint}"
            )
        if self.order.index(last.robot) <= self.order.index(message.robot):
            raise StaleAnnouncementError(
                f"{name}: basis: robot {last.robot!r} is earlier in the order and announced from "
                "the same basis; evaluate again"
            )
        current = dict(self.current)
        del current[last.robot]
        for older in self.messages[:-1]:
            if older.robot == last.robot:
                current[last.robot] = older
        return replace(self, messages=self.messages[:-1], current=current)

    def _check_value(self, message: Message) -> None:
        """Refuse an announcement that does not lower the common objective."""
        if isinstance(message, Withdrawal):
            return
        name = f"announcement {message.sequence} of robot {message.robot!r}"
        if message.value is None or message.incumbent_value is None:
            raise InvalidInputError(
                f"{name}: value: expected the objective with the new path and with the one before "
                "(only round 0 has none)"
            )
        before = message.incumbent_value
        if self.value is not None:
            before = min(before, self.value)
        if message.value > before + RISE_TOLERANCE * abs(before):
            raise InvalidInputError(
                f"{name}: value: expected at most {before!r}, the common objective so far, got "
                f"{message.value!r}; robots disagree about the objective, or the evaluator is not "
                "exact"
            )

    def encode(self, *, json: bool = False) -> bytes:
        """The accepted messages as msgpack (or JSON), with what is needed to check them again."""
        record = _LedgerData(
            self.order,
            self.session,
            self.prior_digest,
            self.use_basis,
            self.check_values,
            self.messages,
        )
        return msgspec.json.encode(record) if json else msgspec.msgpack.encode(record)


class _LedgerData(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="ledger.v1", tag_field="schema"
):
    """A ledger on disk."""

    order: tuple[str, ...]
    session: int
    prior_digest: str
    use_basis: bool
    check_values: bool
    messages: tuple[Message, ...]


_READER: MessageReader[_LedgerData] = MessageReader(_LedgerData)
_JSON_READER: MessageReader[_LedgerData] = MessageReader(_LedgerData, json=True)


def decode_ledger(data: bytes, *, json: bool = False) -> Ledger:
    """Read a ledger; every message is accepted again, so that every rule holds.

    Args:
        data: As written by ``Ledger.encode``.
        json: Whether it is JSON instead of msgpack.

    Returns:
        The ledger.

    Raises:
        InvalidInputError: If it is malformed or a message is not acceptable.
        StaleAnnouncementError: If the messages are not in the order of acceptance.
    """
    record = (_JSON_READER if json else _READER).read(data, "ledger")
    ledger = Ledger(
        order=record.order,
        session=record.session,
        prior_digest=record.prior_digest,
        use_basis=record.use_basis,
        check_values=record.check_values,
    )
    for message in record.messages:
        ledger = ledger.accept(message)
    return ledger
