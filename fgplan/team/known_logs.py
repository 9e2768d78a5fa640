"""All logs that a robot has heard of: a tree whose best branch is its own.

An entry that arrives is checked against the log that it names and closes a turn after it at once,
or, in a turn that belongs to everybody, once all its writers are there. What names a log that is
not known yet waits for it. The robot's own log goes on with every turn that is closed after it; it
changes to another branch only if that is preferred (``fgplan.team.log``).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from fgplan.errors import FgplanError, InvalidInputError
from fgplan.team.content import content_of
from fgplan.team.envelope import Envelope
from fgplan.team.log import Log, closed, empty_log, head_after
from fgplan.team.order import most_passed, writers_of
from fgplan.team.robot_setup import RobotSetup

WAITING_LIMIT = 4096
"""Entries that are kept although nobody knows yet what they go on from."""

KNOWN_LIMIT = 65_536
"""Logs that are remembered; beyond it a robot's own log goes on, but no other branch does."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownLogs:
    """What a robot has heard; a value.

    Attributes:
        current: The robot's own log.
        known: Logs by head.
        written: Entries of turns that belong to everybody, by head and robot.
        waiting: Entries that go on from logs that are not known, by head.
        dropped: Entries that were of no use, or too many.
    """

    current: Log
    known: Mapping[bytes, Log]
    written: Mapping[bytes, Mapping[str, Envelope]] = field(default_factory=dict)
    waiting: Mapping[bytes, tuple[Envelope, ...]] = field(default_factory=dict)
    dropped: int = 0

    @property
    def pending(self) -> Mapping[str, Envelope]:
        """Entries of the open turn of the robot's own log, by robot."""
        return self.written.get(self.current.head, {})


def know_nothing(setup: RobotSetup) -> KnownLogs:
    """Before the first entry.

    Args:
        setup: What the robot knows.

    Returns:
        The empty log alone.
    """
    log = empty_log(setup)
    return KnownLogs(current=log, known={log.head: log})


def take_in(logs: KnownLogs, setup: RobotSetup, envelope: Envelope) -> KnownLogs:
    """Take in an entry, a robot's own or a teammate's.

    Args:
        logs: What the robot has heard.
        setup: What it knows.
        envelope: An entry of this session and of a robot of the team.

    Returns:
        What it has heard with it.

    Raises:
        InvalidInputError: If the entry is malformed, of a robot whose turn it is not, or its prior
            or objective differ.
        StaleAnnouncementError: If it was computed from another ledger than that of its log.
    """
    content_of(setup, envelope)
    log = logs.known.get(envelope.parent)
    if log is None:
        return _wait_or_open(logs, setup, envelope)
    _check_writer(log, setup, envelope)
    if envelope.sequence > 0 and setup.options.turns:
        if head_after(log, (envelope,)) in logs.known:
            return logs
        return _add(logs, setup, closed(log, setup, (envelope,)))
    written = logs.written.get(log.head, {})
    if envelope.robot in written:
        return logs
    closed(log, setup, (envelope,))  # for its checks: what cannot be accepted is not kept
    written = {**written, envelope.robot: envelope}
    logs = replace(logs, written={**logs.written, log.head: written})
    # Round 0 that was closed without a lost robot stays closed when that robot opens late.
    if len(written) == len(setup.robots) and log is logs.current:
        return close_turn(logs, setup, log)
    for entries in tuple(logs.waiting.values()):
        logs = _open_as(logs, setup, entries[0])
    return logs


def close_turn(
    logs: KnownLogs, setup: RobotSetup, log: Log, robots: tuple[str, ...] | None = None
) -> KnownLogs:
    """Close a turn that belongs to everybody with the entries that are there.

    Args:
        logs: What the robot has heard.
        setup: What it knows.
        log: Whose open turn is meant.
        robots: Whose entries; None takes all.

    Returns:
        What it has heard with the turn closed.
    """
    written = logs.written[log.head]
    entries = tuple(
        written[robot]
        for robot in setup.robots
        if robot in written and (robots is None or robot in robots)
    )
    if head_after(log, entries) in logs.known:
        return logs
    return _add(logs, setup, closed(log, setup, entries))


def entries_for(
    logs: KnownLogs, theirs: Log, holds: tuple[str, ...], limit: int
) -> tuple[Envelope, ...]:
    """What a teammate lacks to come to this robot's log.

    Args:
        logs: What this robot has heard.
        theirs: The teammate's log.
        holds: Robots whose entries of the open turn it has.
        limit: Entries at most; the earliest come first.

    Returns:
        Entries of closed turns from where the logs part, and of the open turn.
    """
    if theirs.head == logs.current.head:
        pending = [entry for robot, entry in logs.pending.items() if robot not in holds]
        return tuple(pending[:limit])
    shared = {log.head for log in theirs.history()}
    turns = []
    for log in logs.current.history():
        if log.head in shared:
            break
        turns.append(log.entries)
    lacking = [entry for entries in reversed(turns) for entry in entries]
    return (*lacking, *logs.pending.values())[:limit]


def _add(logs: KnownLogs, setup: RobotSetup, log: Log) -> KnownLogs:
    """One more log; the robot changes to it if it should, and what waited for it is taken in."""
    current = logs.current
    if len(logs.known) >= KNOWN_LIMIT and log.before is not current:
        return replace(logs, dropped=logs.dropped + 1)
    if log.before is current or log.preference > current.preference:
        current = log
    waiting = dict(logs.waiting)
    ready = waiting.pop(log.head, ())
    logs = replace(logs, current=current, known={**logs.known, log.head: log}, waiting=waiting)
    for envelope in ready:
        try:
            logs = take_in(logs, setup, envelope)
        except FgplanError:  # whoever brings a log is not to blame for what waited for it
            logs = replace(logs, dropped=logs.dropped + 1)
    return logs


def _wait_or_open(logs: KnownLogs, setup: RobotSetup, envelope: Envelope) -> KnownLogs:
    """Keep an entry until its log is known, unless it says who opened without the rest."""
    logs = _open_as(logs, setup, envelope)
    if envelope.parent in logs.known:
        return take_in(logs, setup, envelope)
    kept = logs.waiting.get(envelope.parent, ())
    if any(entry.digest == envelope.digest for entry in kept):
        return logs
    if sum(map(len, logs.waiting.values())) >= WAITING_LIMIT:
        return replace(logs, dropped=logs.dropped + 1)
    return replace(logs, waiting={**logs.waiting, envelope.parent: (*kept, envelope)})


def _open_as(logs: KnownLogs, setup: RobotSetup, envelope: Envelope) -> KnownLogs:
    """Close round 0 with those whom the basis of a later entry names, if that is its log."""
    start = logs.known[b""]
    openings = logs.written.get(start.head, {})
    openers = tuple(robot for robot in setup.robots if robot in envelope.basis)
    if not openers or any(robot not in openings for robot in openers):
        return logs
    if head_after(start, tuple(openings[robot] for robot in openers)) != envelope.parent:
        return logs
    return close_turn(logs, setup, start, openers)


def _check_writer(log: Log, setup: RobotSetup, envelope: Envelope) -> None:
    """Check that it was the robot's turn, or could be: turns of lost robots are passed over."""
    turn, robots = envelope.sequence, setup.robots
    over = 1 if turn == 0 or not setup.options.turns else most_passed(robots)
    if not log.turn <= turn < log.turn + over or (turn > 0) != (log.turn > 0):
        raise InvalidInputError(
            f"turn {turn} of robot {envelope.robot!r}: expected an entry of turn {log.turn}, which "
            "the log that it names has open"
        )
    writers = writers_of(robots, setup.options, turn)
    if envelope.robot not in writers:
        raise InvalidInputError(
            f"turn {turn}: expected entries of {', '.join(writers)}, got one of robot "
            f"{envelope.robot!r}; do all robots have the same order and seed?"
        )
