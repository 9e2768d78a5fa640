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

import msgspec
import numpy as np

from fgplan.team.entry import write_entry
from fgplan.team.envelope import Inbox, Outbox, Outgoing
from fgplan.team.repair import answer, ask_for_missing
from fgplan.team.robot_state import RobotState
from fgplan.team.turn import close_turn, take_in

BACK_OFF = 3
"""Asks are at most 2^3 times ``repair_after_s`` apart."""


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
            outgoing += answer(state, envelope)
        else:
            state = take_in(state, envelope)
    robot = state.setup.robot
    while not state.finished:
        if len(state.written) == len(state.writers):
            state = close_turn(state)
        elif robot in state.writers and robot not in state.written:
            state, envelope = write_entry(state)
            outgoing.append(Outgoing(envelope))
        else:
            break
    if state.finished:
        state = msgspec.structs.replace(state, wake_s=np.inf)
    elif before != (state.turn, len(state.written)):
        wake_s = inbox.now_s + state.setup.options.repair_after_s
        state = msgspec.structs.replace(state, asks=0, wake_s=wake_s)
    elif inbox.now_s >= state.wake_s:
        outgoing += ask_for_missing(state)
        pause = state.setup.options.repair_after_s * 2 ** min(state.asks + 1, BACK_OFF)
        state = msgspec.structs.replace(state, asks=state.asks + 1, wake_s=inbox.now_s + pause)
    return state, tuple(outgoing)
