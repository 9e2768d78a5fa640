"""What a team has agreed on, and what it cost."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from fgplan.announcement.announcement import Announcement
from fgplan.announcement.ledger import RISE_TOLERANCE, Ledger
from fgplan.errors import StaleAnnouncementError
from fgplan.paths.candidate_path import CandidatePath
from fgplan.team.envelope import TrafficByKind
from fgplan.team.options import CoordinationOptions
from fgplan.team.report import RobotReport
from fgplan.team.robot_state import TurnRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """The end of a planning session.

    Attributes:
        agreed: Whether every robot refused; otherwise turns or time ran out, or robots that had
            lost each other ended apart.
        ledger: Accepted announcements, the same at every robot.
        paths: Path of each robot that has one, in the order of the team.
        chosen: Index of that path among the robot's candidates, where the robot has said it.
        values: Common objective at the end of round 0 and after each accepted announcement; the
            first is NaN if nobody has evaluated anything.
        turns: Turns taken after round 0.
        records: What robots did on their turns, by turn and order of the team.
        stale: Announcements that lost against another with the same basis.
        traffic: Messages and bytes by kind, of all that the transport has carried.
        clock_s: Seconds that it took on the transport's clock.
        seconds: Real seconds: ``start`` of the evaluators, ``evaluation``, ``coordination`` (all
            the rest).
        warnings: Plain sentences.
        evaluator_states: Last state of the evaluator of each robot that has candidates; an
            evaluator that has ``carry`` makes of it what the next session may use again.
    """

    agreed: bool
    ledger: Ledger
    paths: Mapping[str, CandidatePath]
    chosen: Mapping[str, int]
    values: tuple[float, ...]
    turns: int
    records: tuple[TurnRecord, ...]
    stale: int
    traffic: TrafficByKind
    clock_s: float
    seconds: Mapping[str, float]
    warnings: tuple[str, ...] = ()
    evaluator_states: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def value(self) -> float:
        """Common objective of what was agreed."""
        return self.values[-1]

    @property
    def evaluations(self) -> int:
        """Turns on which candidates were evaluated."""
        return sum(record.decision is not None for record in self.records)


def agreement_of(
    reports: Sequence[RobotReport],
    options: CoordinationOptions,
    *,
    traffic: TrafficByKind,
    clock_s: float,
    seconds: Mapping[str, float],
    evaluator_states: Mapping[str, Any] | None = None,
) -> Agreement:
    """Gather what the robots hold at the end.

    Args:
        reports: Of each robot that is still there, in the order of the team.
        options: How the team came to agree.
        traffic: Messages and bytes by kind.
        clock_s: Seconds that it took on the transport's clock.
        seconds: Real seconds by stage.
        evaluator_states: Last state of the evaluator of each robot, where it is at hand.

    Returns:
        What was agreed.

    Raises:
        StaleAnnouncementError: If robots that have finished hold different ledgers although nobody
            was lost.
    """
    finished = all(report.finished for report in reports)
    furthest = _representative(reports, finished=finished)
    ledger = furthest.ledger
    warnings, apart = [], False
    for report in reports:
        if finished and report.ledger.basis() != ledger.basis():
            if not (report.lost or furthest.lost):
                raise StaleAnnouncementError(
                    f"robot {report.robot!r}: ended with {report.ledger.basis()}, others with "
                    f"{ledger.basis()}; the robots were not given the same options"
                )
            apart = True
            warnings.append(
                f"robot {report.robot!r} ended apart, with {report.ledger.basis()}; the plan is "
                f"that of robot {furthest.robot!r}, with {ledger.basis()}: plan again together"
            )
        if not report.candidates:
            warnings.append(f"robot {report.robot!r} has no candidate path and stays at its start")
        if report.lost:
            warnings.append(f"robot {report.robot!r} ended without {', '.join(report.lost)}")
    agreed = finished and furthest.agreed and not apart
    if not finished:
        warnings.append(f"no agreement within {options.time_limit_s:g} s of the transport's clock")
    elif not furthest.agreed:
        warnings.append(f"no agreement within {options.max_turns} turns")
    rises = _rises(ledger, furthest.first_value)
    if rises:
        warnings.append(
            f"the common objective rose {rises} times: robots announced without a basis, or the "
            "evaluator is not exact"
        )
    order = {robot: place for place, robot in enumerate(ledger.order)}
    records = sorted(
        (record for report in reports for record in report.records),
        key=lambda record: (record.turn, order[record.robot]),
    )
    values = [item.value for item in ledger.history if item.value is not None]
    first = math.nan if furthest.first_value is None else furthest.first_value
    return Agreement(
        agreed=agreed,
        ledger=ledger,
        paths=ledger.paths(),
        chosen={
            report.robot: report.chosen
            for report in reports
            if report.chosen is not None and _holds_the_same(report, ledger)
        },
        values=(first, *values),
        turns=furthest.turn - 1,
        records=tuple(records),
        stale=furthest.stale,
        traffic=traffic,
        clock_s=clock_s,
        seconds=seconds,
        warnings=tuple(warnings),
        evaluator_states=evaluator_states or {},
    )


def _representative(reports: Sequence[RobotReport], *, finished: bool) -> RobotReport:
    """Whose ledger is the plan: of robots that ended apart most hold it; else it is furthest."""

    def place(report: RobotReport) -> tuple[int, int]:
        """How many hold it, and how far it is."""
        same = sum(other.ledger.basis() == report.ledger.basis() for other in reports)
        return (same if finished else 0, report.turn)

    return max(reports, key=place)


def _holds_the_same(report: RobotReport, ledger: Ledger) -> bool:
    """Whether a ledger holds of a robot what the robot's own does."""
    own, other = report.ledger.current.get(report.robot), ledger.current.get(report.robot)
    return own is not None and other is not None and own.encoded == other.encoded


def _rises(ledger: Ledger, first_value: float | None) -> int:
    """How often the objective rose; late openings and withdrawals make it count anew."""
    rises, before, opened = 0, first_value, False
    for message in ledger.messages:
        value = message.value if isinstance(message, Announcement) else None
        if value is None:
            before = None if opened else before
            continue
        opened = True
        rises += before is not None and value > before + RISE_TOLERANCE * abs(before)
        before = value
    return rises
