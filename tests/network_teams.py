"""Robots on the loopback for tests: transports in this process and children in their own."""

import json
import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("zenoh")

from fgplan.team.envelope import Envelope
from fgplan.team.network_options import NetworkOptions, free_endpoint
from fgplan.team.zenoh_transport import ZenohTransport

TESTS = Path(__file__).parent
LONG_S = 60.0
"""What must happen is waited for so long: far more than the slowest machine needs."""


def options_of(robots, first=None, **changes):
    """Options by robot: the first listens on a free port, the others connect to it."""
    secure = {"scheme": "tls"} if "ca" in changes else {}
    first = first or free_endpoint(**secure)
    return {
        robot: NetworkOptions(
            **({"connect": (first,)} if number else {"listen": (first,)}), **changes
        )
        for number, robot in enumerate(robots)
    }


@contextmanager
def open_team(robots, **changes):
    """Transports of a team in this process, all connected."""
    transports = {
        robot: ZenohTransport(robot, robots, options)
        for robot, options in options_of(robots, **changes).items()
    }
    try:
        for transport in transports.values():
            transport.__enter__()
        for transport in transports.values():
            assert len(transport.wait_for_team(LONG_S)) == len(robots) - 1
        yield transports
    finally:
        for transport in transports.values():
            transport.close()


def letter(robot, number=0, kind="note", payload=b""):
    return Envelope(robot=robot, session=0, sequence=number, kind=kind, payload=payload)


def received(transport, count, timeout_s=LONG_S):
    """Envelopes, once so many have arrived."""
    found = []
    until_s = time.monotonic() + timeout_s
    while len(found) < count and time.monotonic() < until_s:
        transport.wait(0.1)
        found += transport.receive(transport.robot)
    return found


def eventually(says, timeout_s=LONG_S):
    """Seconds until something holds."""
    began = time.monotonic()
    while not says():
        assert time.monotonic() < began + timeout_s, "did not happen in time"
        time.sleep(0.005)
    return time.monotonic() - began


class Child:
    """A robot in a process of its own."""

    def __init__(self, role, robot, robots, network, **given):
        told = {"role": role, "robot": robot, "robots": robots, "network": network, **given}
        paths = [str(TESTS), str(TESTS.parent), os.environ.get("PYTHONPATH", "")]
        self.process = subprocess.Popen(
            [sys.executable, str(TESTS / "network_child.py"), json.dumps(told)],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        )

    def says(self):
        """The next line that it prints."""
        line = self.process.stdout.readline()
        assert line, "the child ended"
        return json.loads(line)

    def signal(self, number):
        self.process.send_signal(number)

    def end(self):
        """End it if it has not ended."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(10.0)
        self.process.stdout.close()


@contextmanager
def children():
    """Start children by the call; all end with the block."""
    started = []

    def start(*args, **kwargs):
        started.append(Child(*args, **kwargs))
        return started[-1]

    try:
        yield start
    finally:
        for child in started:
            child.end()
