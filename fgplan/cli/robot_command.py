"""``fgplan robot SCENARIO --name NAME``: one robot of a scenario in this process, over the network.

Exit status 0 where the robot came to its end, 1 where the time ran out first or there is no
feasible plan.
"""

import argparse
import dataclasses
import math
import sys
from collections.abc import Callable, Collection
from pathlib import Path

import msgspec
import numpy as np

from fgplan.cli.open_run import distributed_planner, open_run, planning
from fgplan.io.network_table import make_network
from fgplan.io.place import Place
from fgplan.planners.planner import Progress
from fgplan.processes.child import ProgressLine
from fgplan.processes.parent import Parent
from fgplan.processes.robot_file import RobotFile, write_robot
from fgplan.processes.robot_process import run_participant


def run_robot_command(arguments: argparse.Namespace, progress: Progress) -> tuple[list[str], bool]:
    """Run one robot.

    Args:
        arguments: ``scenario``, ``name``, ``listen``, ``connect``, ``out``, ``start_wait_s``,
            ``linger_s``, ``time_limit_s``, ``quick``, ``child``.
        progress: Told how far it is; with ``child`` lines on standard output take its place.

    Returns:
        Lines to print, and whether the robot came to its end.

    Raises:
        ScenarioError: If the scenario is wrong, or has no such robot.
        NoCandidatePathError: If there is no feasible plan, as far as this robot can tell alone.
        InvalidInputError: If the network cannot be opened.
        MissingExtraError: If the extra ``net`` is not installed.
    """
    path = Path(arguments.scenario)
    run = open_run(path, quick=arguments.quick)
    planner = distributed_planner(run)
    network = make_network(run.scenario, path)
    with Place(path).checking():
        # A child of fgplan team stays on this machine, wherever the scenario's robots are.
        network = dataclasses.replace(
            network,
            listen=tuple(arguments.listen or network.listen),
            connect=tuple(arguments.connect or (() if arguments.child else network.connect)),
            multicast=network.multicast and not arguments.child,
        )
    until: Callable[[], bool] | None = None
    ended: Callable[[], Collection[str]] | None = None
    if arguments.child:
        parent = Parent()
        progress, until, ended = _say_line, parent.has_gone, parent.ended
    else:
        progress(0, 0, "compiling")
        with planning(run):
            planner.rehearse(run.mission, np.random.default_rng(run.mission.seed))
    with planning(run):
        program = planner.program(
            run.mission, arguments.name, np.random.default_rng(run.mission.seed)
        )
    file = run_participant(
        program,
        run.mission,
        planner.name,
        network,
        start_wait_s=arguments.start_wait_s,
        time_limit_s=math.inf if arguments.time_limit_s is None else arguments.time_limit_s,
        linger_s=arguments.linger_s,
        until=until,
        ended=ended,
        progress=progress,
    )
    folder = Path(arguments.out or Path("runs") / f"robot-{path.stem}")
    written = write_robot(folder, file)
    lines = [*_summary(file), f"wrote {written}"]
    if arguments.child:  # standard error is its log
        sys.stderr.write("".join(f"{line}\n" for line in lines))
        lines = []
    return lines, file.finished


def _summary(file: RobotFile) -> list[str]:
    """What the robot did."""
    sent = sum(counts["sent"] for counts in file.traffic.values())
    size = sum(counts["sent_bytes"] for counts in file.traffic.values())
    got = sum(counts["delivered"] for counts in file.traffic.values())
    how = "came to its end" if file.finished else "did not come to its end"
    seconds = ", ".join(f"{name} {value:.3f}" for name, value in file.seconds.items())
    lines = [
        f"{file.robot}: {how}; sent {sent} messages ({size / 1000:.1f} kB), got {got}",
        f"seconds: {seconds}",
    ]
    if file.missing:
        lines.append(f"warning: began without {', '.join(file.missing)}")
    for reason, count in file.refused.items():
        lines.append(f"warning: refused {count} messages ({reason}): {file.first_refused[reason]}")
    return lines


def _say_line(done: int, total: int, doing: str) -> None:
    """One line of progress for the parent."""
    line = ProgressLine(done=done, total=total, doing=doing)
    sys.stdout.write(msgspec.json.encode(line).decode() + "\n")
    sys.stdout.flush()
