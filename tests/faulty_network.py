"""A transport with faults around a real one: loses, doubles, delays (so reorders), and parts.

Faults are drawn for every receiver by itself, when a message is sent. The team is parted while
there is a file ``parted`` in its folder: who is cut off neither sees nor hears the other side.
"""

import heapq
import time

import numpy as np


class FaultyNetwork:
    """Faults around the transport of one robot; the rest is the transport's own."""

    def __init__(self, transport, robots, folder, given):
        self.transport, self.robot = transport, transport.robot
        self.others = tuple(name for name in robots if name != self.robot)
        faults = given.get("faults", {})
        self.loss, self.doubled = faults.get("loss", 0.0), faults.get("doubled", 0.0)
        self.delay_s = faults.get("delay_s", (0.0, 0.0))
        place = robots.index(self.robot)
        self.generator = np.random.default_rng([faults.get("seed", 0), place])
        self.under_way, self.count = [], 0
        self.parted, self.looked_s = folder / "parted", 0.0
        self.side = frozenset(given.get("side", self.others))
        self.cut = frozenset()

    def __getattr__(self, name):
        return getattr(self.transport, name)

    def cut_off(self):
        """Teammates on the other side, while the team is parted."""
        now_s = time.monotonic()
        if now_s >= self.looked_s + 0.02:
            self.looked_s = now_s
            parted = self.parted.exists()
            self.cut = frozenset(self.others) - self.side if parted else frozenset()
        return self.cut

    def send(self, robot, envelope, to=None):
        for other in self.others if to is None else (to,):
            if self.generator.random() < self.loss:
                continue
            for _ in range(1 + (self.generator.random() < self.doubled)):
                due_s = time.monotonic() + self.generator.uniform(*self.delay_s)
                self.count += 1
                heapq.heappush(self.under_way, (due_s, self.count, envelope, other))
        self.deliver()

    def deliver(self):
        """Send what is due; what reaches a cut is lost."""
        while self.under_way and self.under_way[0][0] <= time.monotonic():
            _, _, envelope, other = heapq.heappop(self.under_way)
            if other not in self.cut_off():
                self.transport.send(self.robot, envelope, other)

    def receive(self, robot):
        self.deliver()
        return self.transport.receive(robot)

    def present(self, robot):
        return self.transport.present(robot) - self.cut_off()

    def wait(self, timeout_s):
        self.deliver()
        if self.under_way:
            timeout_s = min(timeout_s, max(self.under_way[0][0] - time.monotonic(), 0.0))
        return self.transport.wait(timeout_s)
