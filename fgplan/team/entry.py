"""What a robot writes on its turn: an announcement, or a refusal.

It evaluates only if somebody else has announced since its last evaluation; otherwise it knows the
answer and refuses at once.
"""

import msgspec
import numpy as np

from fgplan.announcement.announcement import Message, Withdrawal, announcement_of
from fgplan.team.decision import Decision, decide
from fgplan.team.envelope import Envelope
from fgplan.team.refusal import Refusal
from fgplan.team.robot_state import RobotState, TurnRecord


def write_entry(state: RobotState) -> tuple[RobotState, Envelope]:
    """Write this robot's entry of the open turn.

    Args:
        state: The robot, on a turn of its own.

    Returns:
        The robot with the entry in its open turn, and the entry to send.

    Raises:
        NoCandidatePathError: If no candidate has a finite value.
        InvalidInputError: If the evaluator gives no finite value for the announced path.
    """
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
