"""What a robot writes on its turn: an opening, an announcement, a withdrawal or a refusal.

It evaluates only if somebody else's path has changed since its last evaluation; otherwise it knows
the answer and refuses at once.
"""

import msgspec
import numpy as np

from fgplan.announcement.announcement import (
    Announcement,
    Message,
    Withdrawal,
    announcement_of,
)
from fgplan.team.decision import Decision, decide
from fgplan.team.envelope import Envelope
from fgplan.team.known_logs import take_in
from fgplan.team.refusal import Refusal
from fgplan.team.robot_state import RobotState, TurnRecord


def write_entry(state: RobotState, turn: int) -> tuple[RobotState, Envelope]:
    """Write this robot's entry of a turn.

    Args:
        state: The robot, on a turn of its own.
        turn: Number of the turn: the open one, or a later one if those between are of lost robots.

    Returns:
        The robot with the entry in its log, and the entry to send.

    Raises:
        NoCandidatePathError: If no candidate has a finite value.
        InvalidInputError: If the evaluator gives no finite value for the announced path.
    """
    setup = state.setup
    held = state.ledger.current.get(setup.robot)
    if held is None or (isinstance(held, Withdrawal) and setup.candidates):
        return _open(state, turn)
    for robot in due_withdrawals(state):
        lost_s = f"not heard of for {setup.options.drop_after_s:g} s"
        return _written(state, turn, _withdrawal(state, robot, lost_s))
    if not isinstance(held, Announcement):
        return _written(state, turn, Refusal())
    incumbent = state.incumbent
    if incumbent is None:
        reason = "announced before a restart, and not a candidate any more"
        return _written(state, turn, _withdrawal(state, setup.robot, reason))
    others = {robot: m for robot, m in state.ledger.current.items() if robot != setup.robot}
    if (others, incumbent) == state.evaluated:
        return _written(state, turn, Refusal())
    prepared, decision = decide(
        setup.evaluator,
        state.evaluator_state,
        state.ledger.paths(without=setup.robot),
        incumbent,
        robot=setup.robot,
        tolerance=setup.options.tolerance,
        choose=setup.options.choose,
    )
    best = decision.index if decision.improves else incumbent
    state = msgspec.structs.replace(state, evaluator_state=prepared, evaluated=(others, best))
    if not decision.improves:
        return _written(state, turn, Refusal(decision.incumbent_value), decision)
    return _announce(state, turn, best, decision)


def due_withdrawals(state: RobotState) -> tuple[str, ...]:
    """Teammates that have been lost for so long that their paths are to be withdrawn.

    Args:
        state: The robot.

    Returns:
        Those whose paths the ledger holds, in the order of the team.
    """
    options = state.setup.options
    gone = state.presence.lost(options.drop_after_s, options.hung_after_s)
    held = state.ledger.current
    return tuple(
        r for r in state.setup.robots if r in gone and isinstance(held.get(r), Announcement)
    )


def _open(state: RobotState, turn: int) -> tuple[RobotState, Envelope]:
    """First entry: announce the shortest candidate, or say that there is none."""
    setup = state.setup
    if not setup.candidates:
        reason = "no candidate path: it stays at its start"
        return _written(state, turn, _withdrawal(state, setup.robot, reason))
    index = int(np.argmin([path.length_m for path in setup.candidates]))
    return _announce(state, turn, index, None)


def _announce(
    state: RobotState, turn: int, index: int, decision: Decision | None
) -> tuple[RobotState, Envelope]:
    """Announce a candidate; without a decision as an opening, whose basis is empty."""
    setup = state.setup
    # A number that no ledger of this session has seen: one that lost is not used again.
    used = max(state.proposed, default=0)
    sequence = max(state.ledger.next_sequence(setup.robot), used + 1)
    announcement = announcement_of(
        setup.candidates[index],
        sequence=sequence,
        basis=state.ledger.basis() if decision else {},
        sender=setup.sender,
        value=decision.value if decision else None,
        incumbent_value=decision.incumbent_value if decision else None,
    )
    state = msgspec.structs.replace(state, proposed={**state.proposed, sequence: index})
    return _written(state, turn, announcement, decision)


def _withdrawal(state: RobotState, robot: str, reason: str) -> Withdrawal:
    """Withdraw a path, or say that there never was one."""
    setup, ledger = state.setup, state.ledger
    return Withdrawal(
        robot=robot,
        session=setup.sender.session,
        sequence=ledger.next_sequence(robot),
        basis=ledger.basis() if robot in ledger.current else {},
        prior_digest=setup.sender.prior_digest,
        by=setup.robot,
        reason=reason,
    )


def _written(
    state: RobotState, turn: int, content: Message | Refusal, decision: Decision | None = None
) -> tuple[RobotState, Envelope]:
    """Wrap an entry, put it into the log and note it."""
    setup, kind = state.setup, type(content).__name__.lower()
    envelope = Envelope(
        robot=setup.robot,
        session=setup.options.session,
        sequence=turn,
        kind=kind,
        basis=state.ledger.basis(),
        parent=state.log.head,
        payload=content.encoded,
    ).keep(content)
    record = TurnRecord(
        turn=turn, robot=setup.robot, announced=kind == "announcement", decision=decision
    )
    return msgspec.structs.replace(
        state,
        logs=take_in(state.logs, setup, envelope),
        records=(*state.records, record),
    ), envelope
