"""A robot that agrees with its team, as a value: ``step(state, inbox) -> (state, outbox)``.

The planning session is a sequence of turns, and every turn has writers: turn 0 everybody, a later
turn the robot whose turn it is (or everybody, where all answer at the same moment). A writer
writes one entry: an announcement, or a refusal. A robot closes a turn when it has the entries of
all its writers, taking them in the order of the team; so all robots close the same turns with the
same entries, whatever the network does, and hold the same ledger. The session ends when every
robot has refused since the last announcement was accepted; each robot sees that by itself.

Entries are written once and never change, so repair is simple: a robot that has waited too long
asks for the turn that it misses, and whoever has it sends it on as it was written. Faults change
how long agreement takes, not what is agreed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import msgspec
import numpy as np

from fgplan.announcement.announcement import (
    Announcement,
    Message,
    Sender,
    Withdrawal,
    announcement_of,
    decode_message,
)
from fgplan.announcement.ledger import Ledger
from fgplan.announcement.term_data import TermData
from fgplan.errors import InvalidInputError, NoCandidatePathError, StaleAnnouncementError
from fgplan.evaluation.evaluations import AbstractEvaluator
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath
from fgplan.team.decision import Decision, decide
from fgplan.team.envelope import Envelope, Inbox, Outbox, Outgoing
from fgplan.team.options import CoordinationOptions
from fgplan.team.order import round_order
from fgplan.team.refusal import Refusal, decode_refusal

ANSWER_LIMIT = 256
"""Entries that one answer to an ask holds at most; the next ask gets the rest."""

AHEAD_LIMIT = 4096
"""Entries of later turns that are kept."""

BACK_OFF = 3
"""Asks are at most 2^3 times ``repair_after_s`` apart."""


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
    """

    robot: str
    robots: tuple[str, ...]
    problem: PlanningProblem
    candidates: tuple[CandidatePath, ...]
    evaluator: AbstractEvaluator
    options: CoordinationOptions
    sender: Sender
    expected_terms: Mapping[str, tuple[TermData, ...]]


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
        prepared = setup.evaluator.start(setup.problem, setup.robot, setup.candidates)
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


def step(state: RobotState, inbox: Inbox) -> tuple[RobotState, Outbox]:
    """Take in what arrived, write what is due, ask for what is missing.

    Args:
        state: The robot; not changed.
        inbox: Time and envelopes.

    Returns:
        The robot afterwards and what it sends.

    Raises:
        InvalidInputError: If a teammate's entry is malformed, or its prior or objective differ.
        StaleAnnouncementError: If a teammate's entry was computed from another ledger.
    """
    before = (state.turn, len(state.written))
    outgoing: list[Outgoing] = []
    for envelope in inbox.envelopes:
        if envelope.kind == "ask":
            outgoing += _answer(state, envelope)
        else:
            state = _take_in(state, envelope)
    robot = state.setup.robot
    while not state.finished:
        if len(state.written) == len(state.writers):
            state = _close_turn(state)
        elif robot in state.writers and robot not in state.written:
            state, envelope = _write(state)
            outgoing.append(Outgoing(envelope))
        else:
            break
    if state.finished:
        state = msgspec.structs.replace(state, wake_s=np.inf)
    elif before != (state.turn, len(state.written)):
        wake_s = inbox.now_s + state.setup.options.repair_after_s
        state = msgspec.structs.replace(state, asks=0, wake_s=wake_s)
    elif inbox.now_s >= state.wake_s:
        outgoing += _ask(state)
        pause = state.setup.options.repair_after_s * 2 ** min(state.asks + 1, BACK_OFF)
        state = msgspec.structs.replace(state, asks=state.asks + 1, wake_s=inbox.now_s + pause)
    return state, tuple(outgoing)


def _take_in(state: RobotState, envelope: Envelope) -> RobotState:
    """Keep an entry of the open turn or of a later one; drop what is old or not ours."""
    setup, turn = state.setup, envelope.sequence
    if envelope.session != setup.options.session or envelope.robot not in setup.robots:
        return msgspec.structs.replace(state, dropped=state.dropped + 1)
    if state.finished or turn < state.turn:
        return state
    if turn > state.turn:
        if len(state.ahead) >= AHEAD_LIMIT:
            return msgspec.structs.replace(state, dropped=state.dropped + 1)
        ahead = {**state.ahead, (turn, envelope.robot): envelope}
        return msgspec.structs.replace(state, ahead=ahead)
    if envelope.robot not in state.writers:
        raise InvalidInputError(
            f"turn {turn}: expected entries of {', '.join(state.writers)}, got one of robot "
            f"{envelope.robot!r}; do all robots have the same order and seed?"
        )
    if envelope.robot in state.written:
        return state
    return msgspec.structs.replace(state, written={**state.written, envelope.robot: envelope})


def _close_turn(state: RobotState) -> RobotState:
    """Apply the entries of a turn in the order of the team, and open the next turn."""
    setup, options = state.setup, state.setup.options
    ledger, stale, incumbent = state.ledger, state.stale, state.incumbent
    first, accepted = state.first_value, False
    refused = set(state.refused)
    basis = ledger.basis()
    entries = [state.written[robot] for robot in setup.robots if robot in state.written]
    for envelope in entries:
        message = _content(state, envelope)
        if state.turn > 0 and envelope.basis != basis:
            raise StaleAnnouncementError(
                f"turn {state.turn} of robot {envelope.robot!r}: computed from {envelope.basis}, "
                f"but the ledger holds {basis}"
            )
        if isinstance(message, Refusal):
            refused.add(envelope.robot)
            first = message.value if first is None else first
            continue
        try:
            ledger = ledger.accept(message)
        except StaleAnnouncementError:
            if options.turns or state.turn == 0:
                raise
            stale += 1  # of those that answered at the same moment the earlier has won
            continue
        accepted = True
        if isinstance(message, Announcement):
            first = message.incumbent_value if first is None else first
            if message.robot == setup.robot and state.proposed is not None:
                incumbent = state.proposed[1]
    turn = state.turn + 1
    refused = set() if accepted else refused
    place, order = (turn - 1) % len(setup.robots), state.order
    if place == 0:
        order = round_order(setup.robots, options, (turn - 1) // len(setup.robots))
    agreed = len(refused) == len(setup.robots)
    waiting = {key: envelope for key, envelope in state.ahead.items() if key[0] == turn}
    state = msgspec.structs.replace(
        state,
        ledger=ledger,
        stale=stale,
        incumbent=incumbent,
        first_value=first,
        refused=frozenset(refused),
        turn=turn,
        order=order,
        writers=(order[place],) if options.turns else setup.robots,
        log=(*state.log, *entries),
        written={},
        agreed=agreed,
        finished=agreed or turn > options.max_turns,
    )
    if waiting:
        rest = {key: envelope for key, envelope in state.ahead.items() if key not in waiting}
        state = msgspec.structs.replace(state, ahead=rest)
        for envelope in waiting.values():
            state = _take_in(state, envelope)
    return state


def _content(state: RobotState, envelope: Envelope) -> Message | Refusal:
    """The decoded payload; checked where it came as bytes, and kept with the envelope."""
    if envelope.content is not None:
        return cast(Message | Refusal, envelope.content)
    name = f"turn {envelope.sequence} of robot {envelope.robot!r}"
    message: Message | Refusal
    if envelope.kind == "refusal":
        message = decode_refusal(envelope.payload, envelope.robot)
    elif envelope.kind in ("announcement", "withdrawal"):
        message = decode_message(envelope.payload, envelope.robot)
        _check_message(state.setup, envelope, message)
    else:
        raise InvalidInputError(
            f"{name}: kind: expected announcement, withdrawal or refusal, got {envelope.kind!r}"
        )
    envelope.keep(message)
    return message


def _check_message(setup: RobotSetup, envelope: Envelope, message: Message) -> None:
    """Check a teammate's announcement against what this robot knows."""
    name = f"announcement {message.sequence} of robot {message.robot!r}"
    author = message.by if isinstance(message, Withdrawal) else message.robot
    if author != envelope.robot or message.basis != envelope.basis:
        raise InvalidInputError(
            f"{name}: robot and basis: expected those of the envelope, {envelope.robot!r} and "
            f"{envelope.basis}, got {author!r} and {message.basis}"
        )
    if isinstance(message, Withdrawal):
        return
    if message.terms != setup.expected_terms[message.robot]:
        raise InvalidInputError(
            f"{name}: terms: expected {setup.expected_terms[message.robot]}, got {message.terms}; "
            "all robots must have the same objective"
        )
    setup.problem.check_path(message.path())


def _write(state: RobotState) -> tuple[RobotState, Envelope]:
    """Write this robot's entry of the open turn."""
    if state.turn == 0:
        return _open(state)
    setup, basis = state.setup, state.ledger.basis()
    decision = None
    others = {robot: number for robot, number in basis.items() if robot != setup.robot}
    if state.incumbent is not None and others != state.evaluated:
        prepared, decision = decide(
            setup.evaluator,
            state.evaluator_state,
            state.ledger.paths(without=setup.robot),
            state.incumbent,
            robot=setup.robot,
            tolerance=setup.options.tolerance,
            choose=setup.options.choose,
        )
        state = msgspec.structs.replace(state, evaluator_state=prepared, evaluated=others)
    if decision is None or not decision.improves:
        refusal = Refusal(None if decision is None else decision.incumbent_value)
        return _written(state, "refusal", refusal, basis, decision)
    # A number that no ledger of this session has seen: one that lost is not used again.
    used = 0 if state.proposed is None else state.proposed[0]
    sequence = max(state.ledger.next_sequence(setup.robot), used + 1)
    announcement = announcement_of(
        setup.candidates[decision.index],
        sequence=sequence,
        basis=basis,
        sender=setup.sender,
        value=decision.value,
        incumbent_value=decision.incumbent_value,
    )
    state = msgspec.structs.replace(state, proposed=(sequence, decision.index))
    return _written(state, "announcement", announcement, basis, decision)


def _open(state: RobotState) -> tuple[RobotState, Envelope]:
    """Round 0: announce the shortest candidate, or say that there is none."""
    setup = state.setup
    if not setup.candidates:
        withdrawal = Withdrawal(
            robot=setup.robot,
            session=setup.sender.session,
            sequence=1,
            basis={},
            prior_digest=setup.sender.prior_digest,
            by=setup.robot,
            reason="no candidate path: it stays at its start",
        )
        return _written(state, "withdrawal", withdrawal, {}, None)
    index = int(np.argmin([path.length_m for path in setup.candidates]))
    announcement = announcement_of(
        setup.candidates[index], sequence=1, basis={}, sender=setup.sender
    )
    state = msgspec.structs.replace(state, proposed=(1, index))
    return _written(state, "announcement", announcement, {}, None)


def _written(
    state: RobotState,
    kind: str,
    content: Message | Refusal,
    basis: dict[str, int],
    decision: Decision | None,
) -> tuple[RobotState, Envelope]:
    """Wrap an entry, put it into the open turn and note it."""
    robot = state.setup.robot
    envelope = Envelope(
        robot=robot,
        session=state.setup.options.session,
        sequence=state.turn,
        kind=kind,
        basis=basis,
        payload=content.encoded,
    ).keep(content)
    record = TurnRecord(
        turn=state.turn, robot=robot, announced=kind == "announcement", decision=decision
    )
    written = {**state.written, robot: envelope}
    return msgspec.structs.replace(
        state, written=written, records=(*state.records, record)
    ), envelope


def _ask(state: RobotState) -> list[Outgoing]:
    """Ask for the missing entries: first their writers, then teammates that may have them."""
    setup = state.setup
    others = [robot for robot in setup.robots if robot != setup.robot]
    asks = []
    for writer in state.writers:
        if writer not in state.written:
            peer = others[(others.index(writer) + state.asks // 2 * (state.asks % 2)) % len(others)]
            asks.append(peer)
    envelope = Envelope(
        robot=setup.robot, session=setup.options.session, sequence=state.turn, kind="ask"
    )
    return [Outgoing(envelope, peer) for peer in dict.fromkeys(asks)]


def _answer(state: RobotState, ask: Envelope) -> list[Outgoing]:
    """Send on, as they were written, the entries from the turn asked for."""
    setup = state.setup
    if ask.session != setup.options.session or ask.robot not in setup.robots:
        return []
    size = len(setup.robots)
    if ask.sequence == 0:
        start = 0
    else:
        start = size + (ask.sequence - 1) * (1 if setup.options.turns else size)
    entries = [*state.log[start:], *state.written.values()]
    wanted = [entry for entry in entries if entry.robot != ask.robot]
    wanted = [entry for entry in wanted if entry.sequence >= ask.sequence]
    return [Outgoing(entry, ask.robot) for entry in wanted[:ANSWER_LIMIT]]
