"""``fgplan bench team``: time to agreement and bytes, in process and over zenoh.

The scenes are those of ``bench impacted``. In process all robots step in one loop; over zenoh each
is a process of its own on this machine, connected over the loopback. Agreement is counted from when
the last robot sees its whole team until every robot knows that all hold the same log; making
candidates and preparing the evaluators come before and are the same in both. Robots plan in turn,
so the seconds of their evaluations add up to the planning seconds of the team; what is left of the
agreement is everything else: decoding and checking, the ledger, and the transport. The overhead of
the transport is what that comes to more over zenoh than in process, over the planning seconds.
"""

import argparse
import os
import subprocess
import time
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np

from fgplan.bench.open_world import draw_world
from fgplan.bench.team_robot import RobotRun, TeamRun
from fgplan.errors import FgplanError, InvalidInputError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_most, require_true
from fgplan.processes.child import child_environment, python_module
from fgplan.team.agreement import Agreement
from fgplan.team.coordination import coordinate
from fgplan.team.network_options import free_endpoint

SIZES = (2, 4, 8)
SCENES = 7
MOST_OVERHEAD = 0.1
_DEADLINE_S = 600.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of this bench."""
    parser.add_argument("--robots", default="2,4,8", help="team sizes (default 2,4,8)")
    parser.add_argument("--candidates", type=int, default=50, help="candidates a robot (50)")


def run(options: CommandOptions) -> CommandOutcome:
    """Run the bench.

    Args:
        options: Arguments ``robots`` and ``candidates``.

    Returns:
        ``results.rows``: a row for each size and transport, and what is required of them.

    Raises:
        InvalidInputError: If sizes or candidates are not usable.
        FgplanError: If a robot's process failed.
    """
    sizes, count = _sizes(options.arguments["robots"]), options.arguments["candidates"]
    if options.quick:
        sizes, count = sizes[:1], min(count, 8)
    seeds = options.seed_range(SCENES, quick=1)
    world = draw_world(2, min(count, 4), np.random.default_rng(0))
    coordinate(world.problem, world.candidates)  # compiles, before several processes would
    rows: list[dict[str, Any]] = []
    for size in sizes:
        options.progress(len(rows), 2 * len(sizes), f"{size} robots in process")
        agreements = [_in_process(size, count, seed) for seed in seeds]
        rows.append(_in_process_row(size, agreements))
        options.progress(len(rows), 2 * len(sizes), f"{size} processes")
        runs = _over_zenoh(size, count, seeds)
        rows.append(_zenoh_row(size, runs, agreements))
        options.record({"rows": rows})
    overhead = {row["robots"]: row["transport_overhead"] for row in rows if "processes" in row}
    results: dict[str, Any] = {
        "rows": rows,
        "candidates": count,
        "scenes": len(seeds),
        "cores": os.cpu_count(),
    }
    if 4 in overhead:
        results["transport_overhead_at_4"] = overhead[4]
    return CommandOutcome(
        results=results,
        requirements=_requirements(results, quick=options.quick),
        seeds=seeds,
        summary=_summary(rows),
    )


def _sizes(text: str) -> tuple[int, ...]:
    """Team sizes asked for."""
    try:
        sizes = tuple(int(part) for part in text.split(","))
    except ValueError:
        sizes = ()
    if not sizes or min(sizes) < 2:
        raise InvalidInputError(f"--robots: expected sizes of 2 or more as 2,4,8, got {text!r}")
    return sizes


def _in_process(size: int, count: int, seed: int) -> Agreement:
    """One scene in this process."""
    world = draw_world(size, count, np.random.default_rng(seed))
    return coordinate(world.problem, world.candidates)


def _over_zenoh(size: int, count: int, seeds: Sequence[int]) -> list[list[RobotRun]]:
    """All scenes with a process a robot; by scene, the runs of all robots."""
    firsts = tuple(free_endpoint() for _ in seeds)
    anywhere = ("tcp/127.0.0.1:0",) * len(seeds)
    processes = []
    try:
        for robot in range(size):
            told = TeamRun(
                robot=robot,
                robots=size,
                candidates=count,
                seeds=tuple(seeds),
                listen=anywhere if robot else firsts,
                connect=firsts if robot else ("",) * len(seeds),
            )
            process = subprocess.Popen(
                python_module("fgplan.bench.team_robot"),
                env=child_environment(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
            processes.append(process)
            assert process.stdin is not None
            process.stdin.write(msgspec.json.encode(told) + b"\n")
            process.stdin.flush()
        deadline_s = time.monotonic() + _DEADLINE_S
        told_lines = []
        for robot, process in enumerate(processes):
            out, _ = process.communicate(timeout=max(deadline_s - time.monotonic(), 1.0))
            if process.returncode != 0:
                raise FgplanError(f"bench team: process of robot {robot} ended with an error")
            told_lines.append([msgspec.json.decode(one, type=RobotRun) for one in out.splitlines()])
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
                process.wait()
    return [list(scene) for scene in zip(*told_lines, strict=True)]


def _in_process_row(size: int, agreements: Sequence[Agreement]) -> dict[str, Any]:
    """The row of the in-process transport."""
    planning = [a.seconds["evaluation"] for a in agreements]
    rest = [a.seconds["coordination"] for a in agreements]
    kinds = [list(a.traffic.kinds.values()) for a in agreements]
    return {
        "robots": size,
        "transport": "in process",
        "agreement_seconds": float(np.median(np.add(planning, rest))),
        "planning_seconds": float(np.median(planning)),
        "rest_of_planning": float(np.median(np.divide(rest, planning))),
        "turns": float(np.median([a.turns for a in agreements])),
        "bytes": float(np.median([sum(k.delivered_bytes for k in one) for one in kinds])),
        "messages": float(np.median([sum(k.delivered for k in one) for one in kinds])),
        "same_result": True,
    }


def _zenoh_row(
    size: int, runs: Sequence[Sequence[RobotRun]], agreements: Sequence[Agreement]
) -> dict[str, Any]:
    """The row of zenoh, beside what the same scenes gave in process."""
    planning = [sum(robot.planning_s for robot in scene) for scene in runs]
    agreement = [
        max(robot.ended_s for robot in scene) - max(robot.began_s for robot in scene)
        for scene in runs
    ]
    rest = np.subtract(agreement, planning)
    in_process = np.array([a.seconds["coordination"] for a in agreements])
    by_kind: dict[str, dict[str, float]] = {}
    for kind in sorted({kind for scene in runs for robot in scene for kind in robot.traffic}):
        counts = [[robot.traffic.get(kind, {}) for robot in scene] for scene in runs]
        by_kind[kind] = {
            name: float(np.median([sum(c.get(key, 0) for c in scene) for scene in counts]))
            for name, key in (("messages", "delivered"), ("bytes", "delivered_bytes"))
        }
    return {
        "robots": size,
        "transport": "zenoh",
        "processes": size,
        "agreement_seconds": float(np.median(agreement)),
        "planning_seconds": float(np.median(planning)),
        "rest_of_planning": float(np.median(np.divide(rest, planning))),
        "transport_overhead": float(np.median(np.divide(rest - in_process, planning))),
        **_turn_times(runs),
        "turns": float(np.median([scene[0].turns for scene in runs])),
        "bytes": sum(kind["bytes"] for kind in by_kind.values()),
        "messages": sum(kind["messages"] for kind in by_kind.values()),
        "by_kind": by_kind,
        "same_result": all(_same(s, a) for s, a in zip(runs, agreements, strict=True)),
    }


def _turn_times(runs: Sequence[Sequence[RobotRun]]) -> dict[str, float]:
    """What a turn costs besides planning, medians over all turns after round 0, milliseconds.

    ``hop_ms`` from the end of the step that wrote an entry to the beginning of the step that writes
    the next one: sending, zenoh, waking the receiver, reading the envelope. ``checking_ms`` is the
    rest of that step: reading and checking the entry, the ledger, writing.
    """
    hops, checking = [], []
    for scene in runs:
        steps = sorted((one for robot in scene for one in robot.written), key=lambda one: one.turn)
        later = [one for one in steps if one.turn > 0]
        hops += [1e3 * (b.began_s - a.ended_s) for a, b in pairwise(later)]
        checking += [1e3 * (one.ended_s - one.began_s - one.planning_s) for one in later]
    return {"hop_ms": float(np.median(hops)), "checking_ms": float(np.median(checking))}


def _same(scene: Sequence[RobotRun], agreement: Agreement) -> bool:
    """Whether robots over zenoh hold one log, with the paths and values of one process."""
    chosen = tuple(agreement.chosen.values())
    return (
        len({robot.head for robot in scene}) == 1
        and all(robot.values == agreement.values for robot in scene)
        and tuple(robot.chosen for robot in scene) == chosen
    )


def _requirements(results: dict[str, Any], *, quick: bool) -> tuple[Requirement, ...]:
    """What must hold."""
    same = all(row["same_result"] for row in results["rows"])
    needs = [require_true("same_result", same)]
    if "transport_overhead_at_4" in results and not quick:
        overhead = results["transport_overhead_at_4"]
        needs.append(require_at_most("transport_overhead_at_4", overhead, MOST_OVERHEAD))
    return tuple(needs)


def _summary(rows: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """Lines to print."""
    head = "robots  transport   agreement  planning  rest/planning  messages     kB  same result"
    lines = (
        f"{row['robots']:6d}  {row['transport']:<10} {row['agreement_seconds']:9.3f}s"
        f" {row['planning_seconds']:8.3f}s {row['rest_of_planning']:14.1%}"
        f" {row['messages']:9.0f} {row['bytes'] / 1e3:6.0f}  {row['same_result']}"
        for row in rows
    )
    turns = (
        f"{row['robots']} processes: a turn costs {row['hop_ms']:.1f} ms from writer to writer and "
        f"{row['checking_ms']:.1f} ms of checking, beside "
        f"{1e3 * row['planning_seconds'] / row['turns']:.1f} ms of planning"
        for row in rows
        if "hop_ms" in row
    )
    return (head, *lines, *turns)
