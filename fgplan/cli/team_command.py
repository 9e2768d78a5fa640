"""``fgplan team SCENARIO``: the robots of a scenario as participants that talk through messages.

In this process, or with ``--processes`` one process each over the network; with ``--gather`` from
what robots that ran elsewhere handed in. The run folder is that of ``fgplan run``, and in it
``robots`` with a file and a log of each participant.
"""

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.cli.open_run import OpenRun, begin_folder, distributed_planner, open_run, planning
from fgplan.cli.run_command import outcome_of
from fgplan.errors import InvalidInputError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.network_table import make_network
from fgplan.io.result_file import require_true
from fgplan.planners.program import DistributedPlanner, participants
from fgplan.processes.child import python_module
from fgplan.processes.robot_file import RobotFile, read_robot
from fgplan.processes.team_processes import loopback_endpoints, run_team_processes
from fgplan.processes.team_result import plan_of_files, run_in_process


def run_team(options: CommandOptions) -> CommandOutcome:
    """Plan a scenario by robots that talk through messages.

    Args:
        options: ``arguments``: ``scenario``, ``processes``, ``gather``, ``start_wait_s``,
            ``time_limit_s``.

    Returns:
        The plan under ``plans``, what each process did under ``processes``.

    Raises:
        ScenarioError: If the scenario is wrong, or its planner is not one of robots that talk.
        NoCandidatePathError: If there is no feasible plan.
        InvalidInputError: If no participant handed in anything.
    """
    run = open_run(Path(options.arguments["scenario"]), quick=options.quick)
    planner = distributed_planner(run)
    folder = options.out
    if folder is None:
        raise InvalidInputError("fgplan team: expected a run folder for what robots hand in")
    gathered = options.arguments["gather"]
    if gathered is not None and options.arguments["processes"]:
        raise InvalidInputError("fgplan team: expected --processes or --gather, got both")
    options.record({})
    begin_folder(run, folder)
    files: dict[str, RobotFile] = {}
    with planning(run):
        if gathered is not None:
            files = _read_all(planner, run, Path(gathered))
            plan = plan_of_files(planner, run.mission, files)
        elif options.arguments["processes"]:
            lost, seconds = _run_processes(planner, run, folder, options)
            files = _read_all(planner, run, folder, lost)
            plan = plan_of_files(planner, run.mission, files, lost)
            plan = dataclasses.replace(plan, seconds={**plan.seconds, **seconds})
        else:
            plan = run_in_process(planner, run.mission)
    outcome = outcome_of(
        run,
        [plan],
        folder,
        results={"processes": {name: _process_data(file) for name, file in files.items()}},
        lines=_traffic_lines(plan.traffic),
    )
    if not files:
        return outcome
    everybody = set(participants(planner, run.mission)) == set(files) and not any(
        file.missing for file in files.values()
    )
    needs = (*outcome.requirements, require_true("nobody_lost", everybody))
    return dataclasses.replace(outcome, requirements=needs)


def _run_processes(
    planner: DistributedPlanner, run: OpenRun, folder: Path, options: CommandOptions
) -> tuple[dict[str, str], dict[str, float]]:
    """Run all participants; why some were lost, and seconds by stage."""
    network = make_network(run.scenario, run.path)
    names = participants(planner, run.mission)
    began = time.perf_counter()
    options.progress(0, 0, "compiling")
    planner.rehearse(run.mission, np.random.default_rng(run.mission.seed))
    rehearsed = time.perf_counter()
    commands = {}
    for name, endpoints in loopback_endpoints(names, network.scheme).items():
        words = [*python_module("fgplan"), "robot", str(run.path), "--name", name]
        words += ["--listen", endpoints.listen, "--out", str(folder), "--child"]
        words += [word for end in endpoints.connect for word in ("--connect", end)]
        words += ["--quick"] if options.quick else []
        for option in ("start_wait_s", "time_limit_s"):
            seconds = options.arguments[option]
            word = f"--{option.replace('_', '-')}"
            words += [word, str(seconds)] if seconds is not None else []
        commands[name] = words
    ended = run_team_processes(commands, folder, progress=options.progress)
    lost = {name: one.why for name, one in ended.items() if one.why}
    return lost, {
        "compile": rehearsed - began,
        "processes": time.perf_counter() - rehearsed,
    }


def _read_all(
    planner: DistributedPlanner,
    run: OpenRun,
    folder: Path,
    lost: dict[str, str] | None = None,
) -> dict[str, RobotFile]:
    """What all participants handed in."""
    names = participants(planner, run.mission)
    found = {name: read_robot(folder, name) for name in names}
    files = {name: file for name, file in found.items() if file is not None}
    if not files:
        why = "; ".join(f"{name} {reason}" for name, reason in (lost or {}).items())
        raise InvalidInputError(
            f"{folder}: expected files of robots {', '.join(names)}, got none"
            + (f": {why}" if why else "")
        )
    return files


def _process_data(file: RobotFile) -> dict[str, Any]:
    """What one process did, without what the plan holds."""
    return {
        "finished": file.finished,
        "seconds": file.seconds,
        "traffic": file.traffic,
        "refused": file.refused,
        "missing": list(file.missing),
    }


def _traffic_lines(traffic: Any) -> list[str]:  # noqa: ANN401 - counts by kind
    """Messages and bytes by kind."""
    if not traffic:
        return []
    sent = ", ".join(
        f"{kind} {counts['sent']} ({counts['sent_bytes'] / 1000:.1f} kB)"
        for kind, counts in sorted(traffic.items())
    )
    return [f"messages sent: {sent}"]
