"""The team's plan from what its participants handed in, with traffic and seconds."""

from collections.abc import Mapping
from dataclasses import asdict, replace

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.mission import Mission
from fgplan.planners.plan import Plan
from fgplan.planners.program import DistributedPlanner, participants, run_programs
from fgplan.processes.robot_file import RobotFile
from fgplan.team.in_process import InProcessTransport
from fgplan.threads import one_blas_thread


@one_blas_thread()
def run_in_process(planner: DistributedPlanner, mission: Mission) -> Plan:
    """Run the programs of all participants in this process: the reference for processes.

    Args:
        planner: The planner.
        mission: The mission.

    Returns:
        The plan.

    Raises:
        NoCandidatePathError: If there is no feasible plan.
    """
    names = participants(planner, mission)
    programs = {
        name: planner.program(mission, name, np.random.default_rng(mission.seed)) for name in names
    }
    transport = InProcessTransport(names)
    ended = run_programs(programs, transport)
    reports = {name: program.report(program.state) for name, program in ended.items()}
    plan = planner.team_plan(mission, reports, np.random.default_rng(mission.seed))
    setup_s = sum(sum(program.seconds.values()) for program in programs.values())
    kinds = transport.traffic.kinds
    return replace(
        plan,
        traffic={kind: asdict(counts) for kind, counts in kinds.items()},
        seconds={**plan.seconds, "setup": setup_s},
    )


def plan_of_files(
    planner: DistributedPlanner,
    mission: Mission,
    files: Mapping[str, RobotFile],
    lost: Mapping[str, str] | None = None,
) -> Plan:
    """The plan of what the participants handed in.

    Args:
        planner: The planner.
        mission: The mission.
        files: By participant; of those that were not lost.
        lost: Why a participant handed in nothing, where it is known.

    Returns:
        The plan. ``details`` names in ``lost`` who handed in nothing, if anybody; ``traffic`` sums
        over participants; ``seconds`` is the longest of any of them by stage: ``setup``, ``wait``
        for the team, ``run``.

    Raises:
        NoCandidatePathError: If there is no feasible plan.
        InvalidInputError: If a file is of another scenario, seed or planner, or malformed.
    """
    names = participants(planner, mission)
    there = {name: files[name] for name in names if name in files}
    for name, file in there.items():
        for what, wanted, got in (
            ("planner", planner.name, file.planner),
            ("scenario", mission.digest, file.scenario_digest),
            ("seed", str(mission.seed), str(file.seed)),
        ):
            if wanted != got:
                raise InvalidInputError(
                    f"file of robot {name!r}: expected {what} {wanted}, got {got}: all robots "
                    "need the same scenario"
                )
    reports = {name: file.report for name, file in there.items()}
    plan = planner.team_plan(mission, reports, np.random.default_rng(mission.seed))
    seconds: dict[str, float] = {}
    traffic: dict[str, dict[str, int]] = {}
    for file in there.values():
        for stage, value in file.seconds.items():
            seconds[stage] = max(seconds.get(stage, 0.0), value)
        for kind, counts in file.traffic.items():
            sums = traffic.setdefault(kind, dict.fromkeys(counts, 0))
            for count, value in counts.items():
                sums[count] = sums.get(count, 0) + value
    gone = [name for name in names if name not in there]
    return replace(
        plan,
        traffic=traffic,
        seconds={**plan.seconds, **seconds},
        details={**plan.details, "lost": gone} if gone else plan.details,
        warnings=(*plan.warnings, *_warnings(names, there, lost or {})),
    )


def _warnings(
    names: tuple[str, ...], there: Mapping[str, RobotFile], lost: Mapping[str, str]
) -> list[str]:
    """What did not go as it should."""
    lines = []
    for name in names:
        if name not in there:
            lines.append(f"robot {name!r} was lost: {lost.get(name, 'it handed in nothing')}")
            continue
        file = there[name]
        if not file.finished:
            lines.append(f"robot {name!r} did not come to its end")
        if file.missing:
            lines.append(f"robot {name!r} began without {', '.join(file.missing)}")
        for reason, count in file.refused.items():
            lines.append(
                f"robot {name!r} refused {count} messages ({reason}), the first "
                f"{file.first_refused[reason]}"
            )
    return lines
