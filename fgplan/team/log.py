"""The log of closed turns, which every robot keeps for itself.

A log goes on from another by the entries of one turn, and its *head* is a digest of both; an entry
names the head that it goes on from. So a log is known by 16 bytes, and robots with one head have
closed the same turns with the same entries and hold the same ledger.

While robots are lost, or parted for long, logs can part. Of two the *preferred* one has more late
openings and withdrawals (after which the objective counts anew), then the lower common objective,
then more turns; the head settles what is left. That is an order which all robots share, and going
on never makes a log worse: whoever hears of both ends with the same one, and between openings and
withdrawals the objective that a robot has accepted never rises, by a change of logs neither.
"""

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass

from fgplan.announcement.announcement import Announcement, Withdrawal
from fgplan.announcement.ledger import Ledger
from fgplan.errors import StaleAnnouncementError
from fgplan.team.content import content_of
from fgplan.team.envelope import Envelope
from fgplan.team.refusal import Refusal
from fgplan.team.robot_setup import RobotSetup

Preference = tuple[int, float, int, bytes]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Log:
    """Turns that are closed.

    Attributes:
        ledger: Accepted announcements.
        head: Digest of all entries; empty before the first turn is closed.
        turn: Number of the turn that is open.
        refused: Robots that have refused since the last acceptance.
        first_value: Common objective at the end of round 0, once somebody has said it.
        stale: Announcements that lost against another with the same basis.
        changes: Late openings and withdrawals accepted, after each of which the common objective
            counts anew.
        entries: Those of the turn closed last, in the order of the team.
        before: The log before that turn.
    """

    ledger: Ledger
    head: bytes = b""
    turn: int = 0
    refused: frozenset[str] = frozenset()
    first_value: float | None = None
    stale: int = 0
    changes: int = 0
    entries: tuple[Envelope, ...] = ()
    before: "Log | None" = None

    @property
    def preference(self) -> Preference:
        """Of two logs that parted the greater one is kept."""
        value = self.ledger.value
        return self.changes, -math.inf if value is None else -value, self.turn, self.head

    def history(self) -> Iterator["Log"]:
        """This log and those before it, the latest first."""
        log: Log | None = self
        while log is not None:
            yield log
            log = log.before

    def all_entries(self) -> tuple[Envelope, ...]:
        """Entries of all closed turns, in order."""
        closed = [log.entries for log in self.history()]
        return tuple(entry for entries in reversed(closed) for entry in entries)


def empty_log(setup: RobotSetup) -> Log:
    """The log before the first turn.

    Args:
        setup: Of any robot of the team.

    Returns:
        A log without entries.
    """
    options = setup.options
    return Log(
        ledger=Ledger(
            order=setup.robots,
            session=options.session,
            prior_digest=setup.sender.prior_digest,
            use_basis=options.use_basis,
            check_values=options.check_values,
        )
    )


def head_after(log: Log, entries: tuple[Envelope, ...]) -> bytes:
    """Head of the log that these entries of one turn make.

    Args:
        log: What they go on from.
        entries: In the order of the team.

    Returns:
        16 bytes.
    """
    digest = hashlib.blake2b(log.head, digest_size=16)
    for entry in entries:
        digest.update(entry.digest)
    return digest.digest()


def closed(log: Log, setup: RobotSetup, entries: tuple[Envelope, ...]) -> Log:
    """Close a turn: apply its entries in the order of the team.

    Args:
        log: What they go on from.
        setup: What this robot knows.
        entries: Of one turn, in the order of the team.

    Returns:
        The log with them; of several announcements that answered at the same moment with one basis
        the ledger accepts the earliest robot's.

    Raises:
        InvalidInputError: If an entry is malformed, or its prior or objective differ.
        StaleAnnouncementError: If an entry was computed from another ledger.
    """
    turn = entries[0].sequence
    ledger, stale, first, changes = log.ledger, log.stale, log.first_value, log.changes
    refused, accepted = set(log.refused), False
    basis = ledger.basis()
    for envelope in entries:
        message = content_of(setup, envelope)
        if turn > 0 and envelope.basis != basis:
            raise StaleAnnouncementError(
                f"turn {turn} of robot {envelope.robot!r}: computed from {envelope.basis}, "
                f"but the ledger holds {basis}"
            )
        if isinstance(message, Refusal):
            refused.add(envelope.robot)
            first = message.value if first is None else first
            continue
        try:
            ledger = ledger.accept(message)
        except StaleAnnouncementError:
            if setup.options.turns or turn == 0:
                raise
            stale += 1  # of those that answered at the same moment the earlier has won
            continue
        accepted = True
        late = turn > 0 and not message.basis
        changes += late or (turn > 0 and isinstance(message, Withdrawal))
        if isinstance(message, Announcement):
            first = message.incumbent_value if first is None else first
    return Log(
        ledger=ledger,
        head=head_after(log, entries),
        turn=turn + 1,
        refused=frozenset() if accepted else frozenset(refused),
        first_value=first,
        stale=stale,
        changes=changes,
        entries=entries,
        before=log,
    )
