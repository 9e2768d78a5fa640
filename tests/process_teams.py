"""Teams of robot processes as a test sees them: started, killed, frozen, parted, and looked at.

Times are those of the machine's monotonic clock, which all its processes share.
"""

import json
import math
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("zenoh")

from crossing_teams import NAMES, mission_with, program_of

from fgplan.evaluation.registry import find_evaluator
from fgplan.processes.team_processes import loopback_endpoints
from fgplan.team.replay import replay_turns
from fgplan.team.report import decode_report

TESTS = Path(__file__).parent
LEASE_S = 1.0


class RobotServer:
    """The process that starts robots (``robot_server.py``)."""

    def __init__(self, scenario):
        paths = [str(TESTS), str(TESTS.parent), os.environ.get("PYTHONPATH", "")]
        self.process = subprocess.Popen(
            [sys.executable, str(TESTS / "robot_server.py"), str(scenario)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        )
        self.ready = False

    def start(self, **given):
        """Start a robot; the number of its process."""
        if not self.ready:
            self.ready = json.loads(self.process.stdout.readline())["ready"]
        self.process.stdin.write(json.dumps(given) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())["pid"]

    def end(self):
        self.process.stdin.close()
        try:
            self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self.process.stdout.close()


class ProcessTeam:
    """A team of robots, each a process."""

    def __init__(self, server, folder, scenario, count, options, **given):
        self.server, self.folder, self.scenario = server, folder, scenario
        self.names = NAMES[:count]
        self.options, self.given = options, given
        self.ends = loopback_endpoints(self.names)
        self.pids, self.files, self.started = {}, {}, 0

    def start(self, *names, **given):
        """Start robots, those given or all; again with a new memory."""
        for name in names or self.names:
            self.started += 1
            self.files[name] = self.folder / f"{name}-{self.started}.jsonl"
            self.pids[name] = self.server.start(
                scenario=str(self.scenario),
                robot=name,
                folder=str(self.folder),
                file=str(self.files[name]),
                options=self.options,
                network={
                    "listen": [self.ends[name].listen],
                    "connect": self.ends[name].connect,
                    "lease_s": LEASE_S,
                    "name": self.folder.name,
                },
                **{**self.given, **given},
            )
        return self

    def lines(self, name):
        """All whole lines that a robot has written since it was started last."""
        try:
            text = self.files[name].read_text(encoding="utf-8")
        except FileNotFoundError:
            return []
        return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]

    def states(self, name):
        """What it has said about its log."""
        return [line for line in self.lines(name) if "head" in line]

    def said(self, name, word):
        """When it said a word; None if it has not."""
        return next((line["at_s"] for line in self.lines(name) if word in line), None)

    def signal(self, name, number):
        os.kill(self.pids[name], number)

    def kill(self, name):
        """SIGKILL; the time."""
        self.signal(name, signal.SIGKILL)
        return time.monotonic()

    def until(self, says, within_s):
        """Wait until something holds."""
        until_s = time.monotonic() + within_s
        while not says():
            assert time.monotonic() < until_s, self.told()
            time.sleep(0.02)

    def agreed(self, live, holds=None, lost=None):
        """When all live robots had finished with one log; None if they have not."""
        last = [states[-1] if (states := self.states(name)) else {} for name in live]
        if not all(state.get("finished") and state["agreed"] for state in last):
            return None
        if len({state["head"] for state in last}) > 1:
            return None
        if holds is not None and last[0]["holds"] != sorted(holds):
            return None
        if lost is not None and any(state["lost"] != sorted(lost) for state in last):
            return None
        return max(state["at_s"] for state in last)

    def until_agreed(self, *live, within_s=40.0, holds=None, lost=None):
        """Wait until all live robots hold one log and know it; when that was."""
        self.until(lambda: self.agreed(live, holds, lost) is not None, within_s)
        return self.agreed(live, holds, lost)

    def reports(self, *live, within_s=20.0):
        """Stop the team; the reports of live robots."""
        (self.folder / "stop").touch()
        self.until(lambda: all(self.said(name, "report") for name in live), within_s)
        return {name: self.report(name) for name in live}

    def report(self, name):
        (found,) = [line["report"] for line in self.lines(name) if "report" in line]
        return decode_report(bytes.fromhex(found))

    def now(self):
        return time.monotonic()

    def told(self):
        """What robots have said last, for a failure."""
        text = []
        for name, file in self.files.items():
            lines = [{k: v for k, v in one.items() if k != "report"} for one in self.lines(name)]
            errors = Path(f"{file}.err")
            said = errors.read_text(encoding="utf-8")[-1500:] if errors.exists() else ""
            text.append(f"{name}: {lines[-3:]}\n{said}")
        return "\n".join(text)

    def end(self):
        for pid in self.pids.values():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue


@contextmanager
def process_team(server, folder, scenario, count, options, **given):
    """A team that ends with the block."""
    team = ProcessTeam(server, folder, scenario, count, options, **given)
    try:
        yield team
    finally:
        team.end()


def checked(team, *live):
    """All that must hold of live robots; their reports and what the replay found."""
    reports = team.reports(*live)
    mission = mission_with(team.scenario, **team.options)
    setups = {name: program_of(mission, name).state.setup for name in team.names}
    assert len({report.head for report in reports.values()}) == 1
    one = reports[live[0]]
    assert all(report.finished and report.agreed for report in reports.values())
    for file in sorted(team.folder.glob("*.jsonl")):  # those of earlier lives too
        assert '"worse"' not in file.read_text(encoding="utf-8"), file.read_text(encoding="utf-8")
    exact = find_evaluator("from_scratch")
    paths = one.ledger.paths()
    team_value = None
    for name in live:
        setup = setups[name]
        state = exact.start(setup.problem, name, setup.candidates)
        others = {other: path for other, path in paths.items() if other != name}
        _, found = exact.evaluate(state, others)
        held = found.values[reports[name].chosen]
        team_value = held if team_value is None else team_value
        assert held == pytest.approx(team_value, rel=1e-9)
        assert found.values.min() >= held - setup.options.tolerance * abs(held)
    if one.ledger.value is not None:
        assert one.ledger.value == pytest.approx(team_value, rel=1e-9)
    log, turns = replay_turns(setups, one.entries)
    assert log.head.hex() == one.head
    assert log.ledger.basis() == one.ledger.basis()
    np.testing.assert_allclose(
        [turn.found for turn in turns], [turn.stated for turn in turns], rtol=1e-9
    )
    assert never_rose(one)
    return reports, turns


def never_rose(report):
    """Whether the objective fell at every acceptance, but for late openings and withdrawals."""
    last = math.inf
    for message in report.ledger.messages:
        value = getattr(message, "value", None)
        if value is None:
            last = math.inf
            continue
        if value > last:
            return False
        last = value
    return True
