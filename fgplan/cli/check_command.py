"""``fgplan check SCENARIO or LOG``: whether ``fgplan run`` and ``fgplan team`` would take it.

Everything is read and checked as they do it before they plan, and nothing is written. Not looked
at: whether there are paths (a goal behind a wall), memory and time.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fgplan.cli.open_run import OpenRun, open_run
from fgplan.io.loop_mission import make_loop_mission
from fgplan.io.network_table import make_network
from fgplan.io.place import Place
from fgplan.planners.mission import Mission, MissionRobot
from fgplan.planners.planner import CheckedPlanner
from fgplan.planners.program import DistributedPlanner

_MOST_NAMES = 8


def check_scenario(path: Path) -> list[str]:
    """Read a scenario or a log, and say what would be planned.

    Args:
        path: The file or folder.

    Returns:
        Lines to print.

    Raises:
        ScenarioError: If it would be refused; the message that ``fgplan run`` gives.
    """
    run = open_run(path)
    scenario, mission = run.scenario, run.mission
    loop = scenario.simulation
    if run.log is None:
        make_network(scenario, path)
        if loop is not None:
            make_loop_mission(scenario, loop, mission, scenario.seed, Place(path))
    lines = [
        f"{path}: {mission.name}",
        f"  prior: {len(mission.prior.keys)} variables",
        *(_robot_line(robot) for robot in mission.robots),
    ]
    if mission.targets:
        lines.append(_named("target", [target.name for target in mission.targets]))
    lines.append(f"  planner {scenario.planner_name}{_options(mission.options)}")
    if not isinstance(run.planner, CheckedPlanner):
        lines.append("  its options are not checked before it plans (it has no check_options)")
    lines += _ways(run, mission)
    return [*lines, "nothing wrong was found; whether there are paths was not looked at"]


def _robot_line(robot: MissionRobot) -> str:
    """A robot, its goals and its sensors."""
    goals = f"{len(robot.goals)} goal{'s' if len(robot.goals) > 1 else ''}"
    sensors = f", sensors {', '.join(robot.sensors)}" if robot.sensors else ", no sensor"
    return f"  robot {robot.name}: {goals}{sensors}"


def _named(what: str, names: list[str]) -> str:
    """How many there are and what they are called."""
    shown = ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
    return f"  {len(names)} {what}{'s' if len(names) > 1 else ''}: {shown}"


def _options(given: Mapping[str, Any]) -> str:
    """The options that are given."""
    if not given:
        return ", every option as it is by default"
    return ": " + ", ".join(f"{name} = {value}" for name, value in given.items())


def _ways(run: OpenRun, mission: Mission) -> list[str]:
    """What can be done with the scenario."""
    if mission.simulation is not None:
        return ["  fgplan run executes it in a closed loop ([simulation])"]
    if isinstance(run.planner, DistributedPlanner):
        return ["  fgplan team can run its robots as processes"]
    return ["  fgplan run plans it in one process; its planner has no robots that run alone"]
