"""Teams whose robots fail: killed, started again, late, frozen, parted, over a network with faults.

Everything happens on the simulated clock; after every step of every robot the log that it keeps is
checked to be at least as good as before.
"""

import heapq
import math
from dataclasses import dataclass, field

import numpy as np

from fgplan.announcement.announcement import Announcement
from fgplan.team.envelope import Inbox
from fgplan.team.in_process import InProcessTransport
from fgplan.team.robot import step
from fgplan.team.robot_state import start_robot


@dataclass(frozen=True)
class Fault:
    """A robot that is away from ``start_s`` to ``end_s``; killed, or frozen with its memory.

    Of a frozen one that hangs the network still tells that it is there.
    """

    robot: str
    start_s: float
    end_s: float = math.inf
    frozen: bool = False
    hangs: bool = False


@dataclass
class FaultyTeam:
    """Runs robots to a time, whatever happens to them."""

    setups: dict
    faults: tuple = ()
    network: object = None
    tell_presence: bool = False
    states: dict = field(default_factory=dict)
    settled_s: float = math.inf
    values: dict = field(default_factory=dict)

    def run(self, until_s):
        """Step until a time; robots that are away from second 0 on start late."""
        transport = self.network or InProcessTransport(tuple(self.setups))
        times = {0.0, until_s}
        times |= {t for fault in self.faults for t in (fault.start_s, fault.end_s) if t < until_s}
        queue = sorted(times)
        frozen = {}
        while queue:
            now_s = heapq.heappop(queue)
            transport.advance(now_s)
            for name, setup in self.setups.items():
                away = self.away(name, now_s)
                if away is not None and not away.frozen:
                    self.states.pop(name, None)
                    frozen.pop(name, None)
                    transport.receive(name)
                elif away is not None and name in self.states:
                    frozen[name] = self.states.pop(name)
                elif away is None and name not in self.states:
                    self.states[name] = frozen.pop(name, None) or start_robot(setup)
                    self.step(transport, name, now_s)
            busy = True
            while busy:
                waiting = set(transport.waiting())
                busy = [n for n, s in self.states.items() if n in waiting or s.wake_s <= now_s]
                for name in busy:
                    self.step(transport, name, now_s)
            if now_s >= until_s:
                break
            if self.is_settled():
                self.settled_s = min(self.settled_s, now_s)
            else:
                self.settled_s = math.inf
            wake_s = min((s.wake_s for s in self.states.values()), default=math.inf)
            next_s = min(wake_s, transport.next_arrival_s())
            if next_s < (queue[0] if queue else math.inf):
                heapq.heappush(queue, next_s)
        return self

    def step(self, transport, name, now_s):
        """One robot's step; its log never gets worse, its objective never rises."""
        before = self.states[name]
        present = None
        if self.tell_presence:
            hanging = {f.robot for f in self.faults if f.hangs and f is self.away(f.robot, now_s)}
            present = (frozenset(self.states) | hanging) - {name}
        inbox = Inbox(now_s, transport.receive(name), present)
        after, outbox = step(before, inbox)
        if after.log is not before.log:
            assert after.log.preference > before.log.preference
        if after.log.changes == before.log.changes and before.ledger.value is not None:
            assert after.ledger.value <= before.ledger.value
        self.states[name] = after
        for outgoing in outbox:
            transport.send(name, outgoing.envelope, outgoing.to)

    def away(self, name, now_s):
        """The fault that keeps a robot away now, or None."""
        for fault in self.faults:
            if fault.robot == name and fault.start_s <= now_s < fault.end_s:
                return fault
        return None

    def is_settled(self):
        """Whether all live robots have finished with one log."""
        states = list(self.states.values())
        return (
            bool(states)
            and all(state.finished and state.agreed for state in states)
            and len({state.log.head for state in states}) == 1
        )


def can_improve(team, evaluator, tolerance):
    """Robots that could lower the objective alone by more than the tolerance, from scratch."""
    found = []
    for name, state in team.states.items():
        paths = state.ledger.paths()
        before = evaluator.team_value(paths)
        best = min(evaluator.team_value({**paths, name: path}) for path in state.setup.candidates)
        if name not in paths or best < before - tolerance * abs(before) - 1e-9:
            found.append(name)
    return found


def openings_of(ledger):
    """Names in the order in which paths were announced first."""
    return [m.robot for m in ledger.messages if isinstance(m, Announcement) and not m.basis]


def random_faults(robots, generator, horizon_s):
    """One to three robot faults, at most all but one robot away for good."""
    faults = []
    names = list(generator.permutation(robots))
    gone = 0
    for name in names[: generator.integers(1, len(names) + 1)]:
        kind = generator.integers(4)
        start_s = 0.0 if kind == 0 else float(generator.uniform(0.0, horizon_s))
        end_s = start_s + float(generator.uniform(0.1, horizon_s))
        if kind == 1 and gone < len(robots) - 1:
            gone, end_s = gone + 1, math.inf
        faults.append(Fault(str(name), start_s, end_s, frozen=bool(kind == 3)))
    return tuple(faults)


def seeded(seed):
    """A generator."""
    return np.random.default_rng(seed)
