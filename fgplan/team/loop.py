"""The loop that runs robots of one process over a simulated transport.

It calls nothing but each robot's own step; what processes run is the same step over a transport
of theirs. It steps the robots that have mail, in the order of the team; if none has, it moves the
clock to the next arrival or to the next time at which a robot wants to be woken.
"""

import math
from collections.abc import Callable, Mapping
from typing import Protocol, TypeVar

from fgplan.team.envelope import Inbox, Outbox
from fgplan.team.transport import SimulatedTransport


class Steppable(Protocol):
    """What the loop reads of a robot's state."""

    @property
    def finished(self) -> bool:
        """Whether it has nothing more to do, though it still answers."""
        ...

    @property
    def wake_s(self) -> float:
        """When it wants to be stepped at the latest; infinite if only by mail."""
        ...


State = TypeVar("State", bound=Steppable)
Step = Callable[[State, Inbox], tuple[State, Outbox]]


def run_robots(
    states: Mapping[str, State],
    step: Step[State],
    transport: SimulatedTransport,
    *,
    time_limit_s: float = math.inf,
) -> dict[str, State]:
    """Step robots until all have finished.

    Args:
        states: State of each robot, in the order of the team.
        step: The robots' step function.
        transport: What carries their messages.
        time_limit_s: Seconds on the transport's clock after which to stop.

    Returns:
        The states at the end; not all finished if the time ran out or nothing can happen any
        more.
    """
    current = dict(states)
    due = list(current)
    while True:
        for robot in due:
            inbox = Inbox(transport.now(), transport.receive(robot), transport.present(robot))
            current[robot], outbox = step(current[robot], inbox)
            for outgoing in outbox:
                transport.send(robot, outgoing.envelope, outgoing.to)
        if all(state.finished for state in current.values()):
            return current
        due = list(transport.waiting())
        if due:
            continue
        wake_s = min(state.wake_s for state in current.values())
        next_s = min(wake_s, transport.next_arrival_s())
        if next_s > time_limit_s or next_s == math.inf:
            return current
        transport.advance(next_s)
        arrived = set(transport.waiting())
        now_s = transport.now()
        due = [name for name in current if name in arrived or current[name].wake_s <= now_s]
