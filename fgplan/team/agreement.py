"""What a team has agreed on, and what it cost."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fgplan.announcement.ledger import Ledger
from fgplan.paths.candidate_path import CandidatePath
from fgplan.team.envelope import TrafficByKind
from fgplan.team.robot_state import TurnRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """The end of a planning session.

    Attributes:
        agreed: Whether every robot refused; otherwise turns or time ran out.
        ledger: Accepted announcements, the same at every robot.
        paths: Path of each robot that has one, in the order of the team.
        chosen: Index of that path among the robot's candidates.
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
