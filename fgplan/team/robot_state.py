"""What a robot knows before a planning session, and where it stands in the middle of one."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from fgplan.announcement.announcement import Sender
from fgplan.announcement.ledger import Ledger
from fgplan.announcement.term_data import TermData
from fgplan.errors import NoCandidatePathError
from fgplan.evaluation.evaluations import AbstractEvaluator
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath
from fgplan.team.decision import Decision
from fgplan.team.envelope import Envelope
from fgplan.team.options import CoordinationOptions
from fgplan.team.order import round_order


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSetup:
    """What a robot knows before the session and does not change.

    Attributes:
        robot: Name.
        robots: All names, in the order of the team.
        problem: Prior, objective and models.
        candidates: Its candidate paths; may be empty where it may stay.
        evaluator: How it evaluates them.
        options: How the team comes to agree.
        sender: Session, prior digest, goal and terms that its messages carry.
        expected_terms: Objective terms that each robot must announce.
        carried: What its evaluator carries over from an earlier session, or None; only for
            evaluators that have ``carry``.
    """

    robot: str
    robots: tuple[str, ...]
    problem: PlanningProblem
    candidates: tuple[CandidatePath, ...]
    evaluator: AbstractEvaluator
    options: CoordinationOptions
    sender: Sender
    expected_terms: Mapping[str, tuple[TermData, ...]]
    carried: Any = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnRecord:
    """What a robot did on one of its turns.

    Attributes:
        turn: Number of the turn.
        robot: Name.
        announced: Whether it announced; otherwise it refused.
        decision: What it found, or None where nothing had changed and nothing was evaluated.
    """

    turn: int
    robot: str
    announced: bool
    decision: Decision | None


class RobotState(msgspec.Struct, frozen=True, kw_only=True):
    """A robot in the middle of a planning session; a value (a struct, because it copies fast).

    Attributes:
        setup: What does not change.
        evaluator_state: The evaluator's own.
        ledger: Accepted announcements.
        turn: Number of the turn that is open.
        order: Order of the round that the turn is in.
        writers: Robots that write in it.
        written: Entries of the turn that are here, by robot.
        ahead: Entries of later turns, by turn and robot.
        log: Entries of closed turns.
        refused: Robots that have refused since the last acceptance.
        incumbent: Index of the candidate that the ledger holds, or None.
        proposed: Sequence and index of the last announcement written.
        evaluated: What the others had announced at the last evaluation.
        first_value: Common objective at the end of round 0, once somebody has said it.
        records: What it did on its turns.
        stale: Announcements that lost against another with the same basis.
        dropped: Envelopes that were not for this session or out of bounds.
        asks: Asks sent for the open turn.
        wake_s: When it wants to be woken; infinite once it has finished.
        finished: Whether its session has ended.
        agreed: Whether it ended by refusals of all.
    """

    setup: RobotSetup
    evaluator_state: Any
    ledger: Ledger
    order: tuple[str, ...]
    writers: tuple[str, ...]
    turn: int = 0
    written: dict[str, Envelope] = {}
    ahead: dict[tuple[int, str], Envelope] = {}
    log: tuple[Envelope, ...] = ()
    refused: frozenset[str] = frozenset()
    incumbent: int | None = None
    proposed: tuple[int, int] | None = None
    evaluated: dict[str, int] | None = None
    first_value: float | None = None
    records: tuple[TurnRecord, ...] = ()
    stale: int = 0
    dropped: int = 0
    asks: int = 0
    wake_s: float = 0.0
    finished: bool = False
    agreed: bool = False


def start_robot(setup: RobotSetup) -> RobotState:
    """Start a robot on a planning session.

    Args:
        setup: What it knows.

    Returns:
        Its state before the first step.

    Raises:
        NoCandidatePathError: If it has no candidate path and may not stay.
    """
    options = setup.options
    if not setup.candidates and options.without_path == "refuse":
        raise NoCandidatePathError(
            f"robot {setup.robot!r}: expected at least one candidate path, got none; check that "
            "its goal is reachable, or go on without it by without_path='stay'"
        )
    prepared = None
    if setup.candidates:
        evaluator: Any = setup.evaluator
        known = {"carried": setup.carried} if hasattr(evaluator, "carry") else {}
        prepared = evaluator.start(setup.problem, setup.robot, setup.candidates, **known)
    return RobotState(
        setup=setup,
        evaluator_state=prepared,
        ledger=Ledger(
            order=setup.robots,
            session=options.session,
            prior_digest=setup.sender.prior_digest,
            use_basis=options.use_basis,
            check_values=options.check_values,
        ),
        order=round_order(setup.robots, options, 0),
        writers=setup.robots,
        wake_s=options.repair_after_s,
    )
