"""Four robots, each a process of its own, agree over Eclipse Zenoh on what one process finds too.

Run it from anywhere: `python examples/19_four_processes.py` (needs the extra `net`). On robots,
`fgplan robot SCENARIO --name ann --listen tcp/... --connect tcp/...` runs what `robot` does here.
"""

import multiprocessing
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.io.mission_file import load_mission
from fgplan.planners.program import DistributedPlanner
from fgplan.planners.registry import find_planner
from fgplan.team.endpoint import run_robot
from fgplan.team.network_options import NetworkOptions, free_endpoint
from fgplan.team.zenoh_transport import ZenohTransport

SCENARIO = Path(__file__).parent / "scenarios" / "rooms.toml"
ANYWHERE = "tcp/127.0.0.1:0"


def robot(name: str, listen: str, connect: tuple[str, ...], reports: Any) -> None:
    """One robot: everything it knows comes from the scenario and from messages."""
    mission = load_mission(SCENARIO)
    planner = find_planner("impacted_paths")
    assert isinstance(planner, DistributedPlanner)
    program = planner.program(mission, name, np.random.default_rng(mission.seed))
    network = NetworkOptions(name="example-19", listen=(listen,), connect=connect)
    with ZenohTransport(name, program.participants, network) as transport:
        transport.wait_for_team(90.0)
        state = run_robot(program.state, program.step, transport, time_limit_s=60.0)
        sent = sum(counts.sent for counts in transport.traffic.kinds.values())
    reports.put((name, program.report(state), sent))


def main() -> None:
    """Plan in this process, then with four, and compare."""
    mission = load_mission(SCENARIO)
    planner = find_planner("impacted_paths")
    assert isinstance(planner, DistributedPlanner)
    # Also compiles what robots need: two processes that compile at once get in the way.
    alone = planner.plan(mission, np.random.default_rng(mission.seed))

    spawn = multiprocessing.get_context("spawn")
    reports = spawn.Queue()
    first = free_endpoint()
    processes = []
    for one in mission.robots:
        where = (ANYWHERE, (first,)) if processes else (first, ())
        process = spawn.Process(target=robot, args=(one.name, *where, reports), daemon=True)
        process.start()
        processes.append(process)
    gathered = {}
    for _ in processes:
        name, report, sent = reports.get(timeout=110.0)
        gathered[name] = report
        print(f"{name}: done, {sent} messages sent")
    for process in processes:
        process.join()

    ordered = {one.name: gathered[one.name] for one in mission.robots}
    team = planner.team_plan(mission, ordered, np.random.default_rng(mission.seed))
    for mine, theirs in zip(team.robots, alone.robots, strict=True):
        assert mine.candidate == theirs.candidate
        print(f"{mine.robot}: candidate {mine.candidate} of {mine.candidates}")
    values = [item.value for item in team.objective]
    assert values == [item.value for item in alone.objective]
    print(f"objective {values[0]:.4f} -> {values[-1]:.4f}, the same as in one process")


if __name__ == "__main__":
    main()
