"""Starts robots as processes quickly: ``python robot_server.py``, told by lines of JSON.

A new interpreter needs many seconds for its imports and kernels, so this process does that once,
stays single-threaded, and forks itself for every robot that it is told to start; the robot then
builds its problem from the scenario, opens its own zenoh session and runs like ``fgplan robot``.
What it does, it writes into its file as lines of JSON: each change of its log, and its end. With
standard input this process ends, and all its robots with it; no robot outlives its alarm.
"""

import json
import os
import select
import signal
import sys
import time
from pathlib import Path

from crossing_teams import mission_with, plan_of, program_of
from faulty_network import FaultyNetwork

from fgplan.team.endpoint import run_robot
from fgplan.team.network_options import NetworkOptions
from fgplan.team.report import encode_report, report_of
from fgplan.team.zenoh_transport import ZenohTransport
from fgplan.threads import one_blas_thread

ALARM_S = 150


class Kept:
    """A state that finishes only where its robot may leave; else it stays until it is stopped."""

    def __init__(self, state, leaves):
        self.state, self.leaves = state, leaves

    @property
    def finished(self):
        return self.leaves and self.state.finished

    @property
    def wake_s(self):
        return self.state.wake_s


class Robot:
    """One robot's run: slow, killed or frozen where it is told to be, and what it writes down."""

    def __init__(self, given, lines):
        self.given, self.lines = given, lines
        self.folder = Path(given["folder"])
        self.last = None
        self.after = None
        self.written = 0

    def say(self, **what):
        self.lines.write(json.dumps({"at_s": time.monotonic(), **what}) + "\n")
        self.lines.flush()

    def step(self, kept, inbox):
        """The robot's step; its log never gets worse, its objective never rises."""
        state = kept.state
        after, outbox = self.program.step(state, inbox)
        new = after.records[len(state.records) :]
        if any(record.decision for record in new):
            time.sleep(self.given.get("slow_s", 0.0))
        better = after.log is state.log or after.log.preference > state.log.preference
        before, value = state.ledger.value, after.ledger.value
        if after.log.changes == state.log.changes and before is not None:
            better &= value is not None and value <= before
        if not better:
            self.say(worse=[str(state.log.preference), str(after.log.preference)])
        self.written += len(new)
        self.after = self.given.get("after") if new else None
        if self.after and self.after["entries"] != self.written:
            self.after = None
        if self.after and self.after["what"] == "kill":  # before anything of it is sent
            self.say(killed=True)
            os.kill(os.getpid(), signal.SIGKILL)
        return Kept(after, kept.leaves), outbox

    def show(self, kept):
        """Called after every step, with all sent."""
        state = kept.state
        if self.after:
            self.say(**{self.after["what"]: True})
            if self.after["what"] == "part":
                (self.folder / "parted").touch()
            elif self.after["what"] == "hang":  # zenoh's own threads go on
                time.sleep(self.after["seconds"])
            else:
                number = {"sent_kill": signal.SIGKILL, "freeze": signal.SIGSTOP}
                os.kill(os.getpid(), number[self.after["what"]])
            self.after = None
        now = {
            "head": state.log.head.hex(),
            "turn": state.turn,
            "value": state.ledger.value,
            "changes": state.log.changes,
            "holds": sorted(state.ledger.paths()),
            "lost": sorted(state.lost),
            "finished": state.finished,
            "agreed": state.agreed,
        }
        if now != self.last:
            self.last = now
            self.say(**now)

    def run(self):
        """To its end, or until the file ``stop`` is there."""
        given, parent = self.given, os.getppid()
        mission = mission_with(given["scenario"], **given["options"])
        self.program = program = program_of(mission, given["robot"])
        network = NetworkOptions(
            **{k: tuple(v) if isinstance(v, list) else v for k, v in given["network"].items()}
        )
        looked_s = 0.0

        def stopped(_):
            nonlocal looked_s
            if time.monotonic() < looked_s + 0.05:
                return False
            looked_s = time.monotonic()
            return (self.folder / "stop").exists() or os.getppid() != parent

        with ZenohTransport(
            program.robot, program.participants, network, session=program.session
        ) as zenoh:
            transport = FaultyNetwork(zenoh, program.participants, self.folder, given)
            here = transport.wait_for_team(given.get("start_wait_s", 20.0))
            self.say(began=sorted(here), program_s=dict(program.seconds))
            with one_blas_thread():
                state = run_robot(
                    Kept(program.state, given.get("leaves", False)),
                    self.step,
                    transport,
                    until=stopped,
                    time_limit_s=100.0,
                    report=self.show,
                    session=program.session,
                ).state
            report = encode_report(report_of(state)).hex()
            kinds = transport.traffic.kinds
            sent = {kind: counts.sent for kind, counts in kinds.items()}
            self.say(report=report, refused=transport.refused.first, sent=sent)


def start(given):
    """Fork a robot; its number."""
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        return pid
    try:
        signal.alarm(ALARM_S)
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, 0)
        os.dup2(null, 1)
        errors = os.open(given["file"] + ".err", os.O_CREAT | os.O_WRONLY | os.O_APPEND, 0o600)
        os.dup2(errors, 2)
        with open(given["file"], "a", encoding="utf-8") as lines:  # noqa: PTH123
            Robot(given, lines).run()
    except BaseException:  # noqa: BLE001 - a fork never goes on in its parent's code
        import traceback

        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    os._exit(0)


def main():
    plan_of(mission_with(sys.argv[1]))  # kernels are loaded, and compiled if they must be
    running = set()
    print(json.dumps({"ready": True}), flush=True)  # noqa: T201
    buffered = b""
    try:
        while True:
            ready, _, _ = select.select([0], [], [], 0.1)
            for pid in tuple(running):
                if os.waitpid(pid, os.WNOHANG)[0]:
                    running.discard(pid)
            if not ready:
                continue
            data = os.read(0, 65536)
            if not data:
                return
            buffered += data
            *lines, buffered = buffered.split(b"\n")
            for line in lines:
                pid = start(json.loads(line))
                running.add(pid)
                print(json.dumps({"pid": pid}), flush=True)  # noqa: T201
    finally:
        for pid in running:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


if __name__ == "__main__":
    main()
