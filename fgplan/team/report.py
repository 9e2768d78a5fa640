"""What a robot holds at the end of a planning session, as plain data that can travel."""

from dataclasses import dataclass, replace

import msgspec

from fgplan.announcement.ledger import Ledger, decode_ledger
from fgplan.message_reader import MessageReader
from fgplan.team.envelope import Envelope
from fgplan.team.robot_state import RobotState, TurnRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotReport:
    """The end of a session as one robot sees it.

    Attributes:
        robot: Name.
        ledger: Accepted announcements.
        head: Digest of its log, hexadecimal; robots with one head hold one ledger.
        turn: Number of the turn that is open.
        finished: Whether its session has ended.
        agreed: Whether it ended by refusals of all that are not lost.
        lost: Teammates that counted as lost.
        candidates: Number of its candidate paths.
        chosen: Index of the candidate that the ledger holds, or None.
        first_value: Common objective at the end of round 0, or None if nobody has evaluated.
        stale: Announcements that lost against another with the same basis.
        dropped: Envelopes that were of no use.
        clock_s: Seconds on the transport's clock since its first step.
        records: What it did on its turns.
        entries: All entries of its log, in order.
    """

    robot: str
    ledger: Ledger
    head: str
    turn: int
    finished: bool
    agreed: bool
    lost: tuple[str, ...]
    candidates: int
    chosen: int | None
    first_value: float | None
    stale: int
    dropped: int
    clock_s: float
    records: tuple[TurnRecord, ...]
    entries: tuple[Envelope, ...] = ()


def report_of(state: RobotState) -> RobotReport:
    """Report of a robot.

    Args:
        state: The robot.

    Returns:
        What it holds.
    """
    log = state.log
    return RobotReport(
        robot=state.setup.robot,
        ledger=log.ledger,
        head=log.head.hex(),
        turn=log.turn,
        finished=state.finished,
        agreed=state.agreed,
        lost=tuple(robot for robot in state.setup.robots if robot in state.lost),
        candidates=len(state.setup.candidates),
        chosen=state.incumbent,
        first_value=log.first_value,
        stale=log.stale,
        dropped=state.dropped + state.logs.dropped,
        clock_s=(state.presence.now_s or 0.0) - (state.presence.began_s or 0.0),
        records=state.records,
        entries=log.all_entries(),
    )


def encode_report(report: RobotReport) -> bytes:
    """A report as msgpack.

    Args:
        report: The report.

    Returns:
        Its bytes.
    """
    return msgspec.msgpack.encode(report)


_READER: MessageReader[RobotReport] = MessageReader(RobotReport)


def decode_report(data: bytes) -> RobotReport:
    """Read a report; every message of the ledger is accepted again.

    Args:
        data: As ``encode_report`` wrote it.

    Returns:
        The report.

    Raises:
        InvalidInputError: If it is malformed, or a message of its ledger is not acceptable.
        StaleAnnouncementError: If the messages are not in the order of acceptance.
    """
    report = _READER.read(data, "report")
    return replace(report, ledger=decode_ledger(report.ledger.encode()))
