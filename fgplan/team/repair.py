"""Asking for entries that did not arrive, and answering.

Entries never change, so whoever has one may send it on; a robot that has finished still answers.
"""

from fgplan.team.envelope import Envelope, Outgoing
from fgplan.team.robot_state import RobotState

ANSWER_LIMIT = 256
"""Entries that one answer holds at most; the next ask gets the rest."""


def ask_for_missing(state: RobotState) -> list[Outgoing]:
    """Ask for the missing entries of the open turn.

    Args:
        state: The robot, still waiting.

    Returns:
        Asks: first to the writers, then in turn to teammates that may have what they wrote.
    """
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


def answer(state: RobotState, ask: Envelope) -> list[Outgoing]:
    """Send on, as they were written, the entries from the turn asked for.

    Args:
        state: The robot that is asked.
        ask: Who misses which turn.

    Returns:
        What this robot has from there on, to the one who asked.
    """
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
