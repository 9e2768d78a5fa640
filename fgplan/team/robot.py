"""A robot that agrees with its team, as a value: ``step(state, inbox) -> (state, outbox)``.

The planning session is a sequence of turns, and every turn has writers: turn 0 everybody, a later
turn the robot whose turn it is (or everybody, where all answer at the same moment). A writer
writes one entry: an announcement, or a refusal. A turn is closed when the entries of all its
writers are there, taken in the order of the team; so all robots close the same turns with the
same entries, whatever the network does, and hold the same ledger. The session ends when every
robot has refused since the last announcement was accepted; each robot sees that by itself.

Network faults: an entry never changes, so repair is simple. A robot that has heard nothing for
too long tells how far it has come and asks; whoever has more sends it on as it was written. Faults
change how long agreement takes, not what is agreed.

Robot faults: there is no master, and a lost robot stops nobody. The turns of robots that count as
lost are passed over, and the session ends when all others have refused. A robot that comes late,
or comes back, asks like any other, and opens on its turn if the ledger holds no path of its own.
Robots that were parted for longer may have logs that parted too; they keep the preferred one
(``fgplan.team.log``), and the others announce again after it.
"""

import math

import msgspec

from fgplan.team.entry import due_withdrawals, write_entry
from fgplan.team.envelope import Envelope, Inbox, Outbox, Outgoing
from fgplan.team.known_logs import close_turn, take_in
from fgplan.team.order import most_passed, writers_of
from fgplan.team.presence import look_round
from fgplan.team.robot_state import RobotState
from fgplan.team.status import STATUS, Status, answer, decode_status, lacks, status_of

BACK_OFF = 3
"""Asks are at most 2^3 times ``repair_after_s`` apart."""
BEATS = 10
"""Signs of life until a robot counts as lost: with 30 % loss, all are lost once in 10^5 times."""


def step(state: RobotState, inbox: Inbox) -> tuple[RobotState, Outbox]:
    """Take in what arrived, write what is due, ask for what is missing.

    Args:
        state: The robot; not changed.
        inbox: Time, envelopes, and who is there if the network tells.

    Returns:
        The robot afterwards and what it sends.

    Raises:
        InvalidInputError: If a teammate's entry is malformed, or its prior or objective differ.
        StaleAnnouncementError: If a teammate's entry was computed from another ledger.
    """
    before = state
    presence, appeared = look_round(state.presence, state.setup, inbox)
    state = msgspec.structs.replace(state, presence=presence)
    outgoing: list[Outgoing] = []
    for envelope in inbox.envelopes:
        state = _take_in(state, envelope, outgoing)
    state = _write_due(state, outgoing)
    moved = state.log is not before.log
    ended = state.over and (moved or not before.over)
    if ended and presence.told:
        outgoing.append(Outgoing(status_of(state.setup, state.logs)))
    elif before.presence.now_s is not None:
        outgoing += [Outgoing(status_of(state.setup, state.logs), robot) for robot in appeared]
    began = before.presence.now_s is None
    happened = began or moved or len(state.pending) != len(before.pending)
    return _set_timer(state, outgoing, happened=happened), tuple(outgoing)


def _take_in(state: RobotState, envelope: Envelope, outgoing: list[Outgoing]) -> RobotState:
    """One message: a status is answered, an entry goes into the logs."""
    setup, sender = state.setup, envelope.robot
    # An entry of its own that comes back is news to a robot that has lost its memory.
    known = setup.others if envelope.kind == STATUS else setup.robots
    if envelope.session != setup.options.session or sender not in known:
        return msgspec.structs.replace(state, dropped=state.dropped + 1)
    if envelope.kind == STATUS:
        status, now_s = decode_status(envelope), state.presence.now_s or 0.0
        if lacks(state.logs, envelope, status):
            # One ask at a time: the first answer may be all that is lacking.
            if now_s >= state.asked_s + setup.options.repair_after_s:
                state = msgspec.structs.replace(state, asked_s=now_s)
                outgoing.append(Outgoing(status_of(setup, state.logs, ask=sender), sender))
        elif status.ask == setup.robot:
            state = _answer_once(state, envelope, status, outgoing)
        heads = {**state.heads, sender: envelope.parent}
        return msgspec.structs.replace(state, heads=heads, presence=state.presence.hear(sender))
    before = (state.log, len(state.pending))
    state = msgspec.structs.replace(state, logs=take_in(state.logs, setup, envelope))
    if sender != setup.robot and before != (state.log, len(state.pending)):
        state = msgspec.structs.replace(state, presence=state.presence.hear(sender))
    return state


def _answer_once(
    state: RobotState, envelope: Envelope, status: Status, outgoing: list[Outgoing]
) -> RobotState:
    """Answer, unless the same was answered just now: asks queue up while this robot evaluates."""
    setup, now_s = state.setup, state.presence.now_s or 0.0
    said = (envelope.parent, status.holds, state.log.head, tuple(state.pending))
    before, before_s = state.answered.get(envelope.robot, (None, -math.inf))
    if before == said and now_s < before_s + setup.options.repair_after_s:
        return state
    outgoing += answer(setup, state.logs, envelope, status)
    return msgspec.structs.replace(
        state, answered={**state.answered, envelope.robot: (said, now_s)}
    )


def _write_due(state: RobotState, outgoing: list[Outgoing]) -> RobotState:
    """Write and close turns as far as that goes."""
    setup = state.setup
    while True:
        agreed = _is_agreed(state)
        over = agreed or state.turn > setup.options.max_turns
        state = msgspec.structs.replace(state, agreed=agreed, over=over)
        turn = None if over else _own_turn(state)
        if turn is not None:
            state, envelope = write_entry(state, turn)
            outgoing.append(Outgoing(envelope))
        elif not over and state.turn == 0 and _all_opened(state):
            logs = close_turn(state.logs, setup, state.log)
            state = msgspec.structs.replace(state, logs=logs)
        else:
            return state


def _is_agreed(state: RobotState) -> bool:
    """Whether everybody who is not lost has refused since the last acceptance."""
    live = frozenset(state.setup.robots) - state.lost
    return live <= state.log.refused and not due_withdrawals(state)


def _all_opened(state: RobotState) -> bool:
    """Whether everybody who is not lost has opened, in round 0."""
    return frozenset(state.setup.robots) - state.lost <= frozenset(state.pending)


def _own_turn(state: RobotState) -> int | None:
    """Number of the turn that this robot writes in now, passing over those of lost robots."""
    setup, lost = state.setup, state.lost
    if state.turn == 0 or not setup.options.turns:
        return state.turn if setup.robot not in state.pending else None
    for turn in range(state.turn, state.turn + most_passed(setup.robots)):
        (writer,) = writers_of(setup.robots, setup.options, turn)
        if writer == setup.robot:
            return turn
        if writer not in lost:
            return None
    return None


def _set_timer(state: RobotState, outgoing: list[Outgoing], *, happened: bool) -> RobotState:
    """Tell how far it has come when that is due, and say when it wants to be woken."""
    setup, options = state.setup, state.setup.options
    now_s = state.presence.now_s or 0.0
    watchful = options.lost_after_s < math.inf
    beat_s = options.lost_after_s / BEATS
    must_beat = watchful and (options.hung_after_s < math.inf or not state.presence.told)
    if state.finished and not watchful:
        return msgspec.structs.replace(state, timer_s=math.inf, wake_s=math.inf)
    asks, timer_s = (0 if happened else state.asks), state.timer_s
    if (happened and not must_beat) or math.isinf(timer_s):
        timer_s = now_s + min(options.repair_after_s, beat_s)
    elif now_s >= timer_s and setup.others:
        if must_beat or not state.at_rest:
            outgoing.append(Outgoing(status_of(setup, state.logs, ask=_whom_to_ask(state, asks))))
        asks += 1
        pause_s = options.repair_after_s * 2 ** min(asks, BACK_OFF)
        timer_s = now_s + min(pause_s, beat_s)
    wake_s = min(timer_s, now_s + beat_s)
    return msgspec.structs.replace(state, asks=asks, timer_s=timer_s, wake_s=wake_s)


def _whom_to_ask(state: RobotState, asks: int) -> str:
    """First those who are to write, then in turn the others: they may have what was written."""
    setup = state.setup
    others = setup.others
    writers = writers_of(setup.robots, setup.options, state.turn)
    awaited = [r for r in writers if r in others and r not in state.pending and r not in state.lost]
    first = others.index(awaited[asks % len(awaited)]) if awaited else asks
    return others[(first + asks // 2 * (asks % 2)) % len(others)]
