"""One participant in this process, over the network: from its program to what it hands in."""

import dataclasses
import math
import time
from collections.abc import Callable, Collection
from typing import Any

from fgplan.planners.mission import Mission
from fgplan.planners.planner import Progress
from fgplan.planners.program import RobotProgram
from fgplan.processes.robot_file import RobotFile
from fgplan.team.endpoint import run_robot
from fgplan.team.network_options import NetworkOptions
from fgplan.team.zenoh_transport import ZenohTransport
from fgplan.threads import one_blas_thread

_PAUSE_S = 0.1


@one_blas_thread()
def run_participant(
    program: RobotProgram,
    mission: Mission,
    planner: str,
    network: NetworkOptions,
    *,
    start_wait_s: float,
    time_limit_s: float = math.inf,
    linger_s: float = 30.0,
    until: Callable[[], bool] | None = None,
    ended: Callable[[], Collection[str]] | None = None,
    progress: Progress | None = None,
) -> RobotFile:
    """Run one participant over the network to its end.

    Args:
        program: What it runs.
        mission: What the program was made of.
        planner: Name of the planner.
        network: How it reaches its team.
        start_wait_s: Seconds that it waits for the whole team before it begins without those who
            are not there; what a robot says before another is there is lost.
        time_limit_s: Seconds after which it gives up.
        linger_s: Seconds that it stays for others after it has finished.
        until: Asked between steps; true ends it at once.
        ended: Participants that have ended and are not waited for, where somebody knows.
        progress: Told how far it is.

    Returns:
        What it hands in.

    Raises:
        InvalidInputError: If the network cannot be opened.
        MissingExtraError: If the extra ``net`` is not installed.
    """
    tell = _throttled(program, progress)
    robots = program.participants
    transport = ZenohTransport(
        program.robot, robots, network, relayed=program.relayed, session=program.session
    )
    began = time.perf_counter()
    with transport:
        if progress is not None:
            progress(0, 0, "waiting for the team")
        here = transport.wait_for_team(start_wait_s, without=ended)
        missing = tuple(name for name in robots if name not in here and name != program.robot)
        started = time.perf_counter()
        state = run_robot(
            program.state,
            program.step,
            transport,
            until=None if until is None else lambda _: until(),
            time_limit_s=transport.now() + min(time_limit_s, program.time_limit_s),
            report=tell,
            linger_s=linger_s,
            session=program.session or 0,
        )
        stopped = time.perf_counter()
        kinds = transport.traffic.kinds
        return RobotFile(
            robot=program.robot,
            planner=planner,
            scenario_digest=mission.digest,
            seed=mission.seed,
            finished=bool(state.finished),
            report=program.report(state),
            traffic={kind: dataclasses.asdict(counts) for kind, counts in kinds.items()},
            refused=dict(transport.refused.counts),
            first_refused=dict(transport.refused.first),
            seconds={**program.seconds, "wait": started - began, "run": stopped - started},
            missing=missing,
        )


def _throttled(program: RobotProgram, progress: Progress | None) -> Callable[[Any], None] | None:
    """Tells progress of states, ten times a second at most."""
    if progress is None:
        return None
    next_s = 0.0

    def tell(state: Any) -> None:  # noqa: ANN401 - the program's
        nonlocal next_s
        now_s = time.monotonic()
        if now_s >= next_s:
            next_s = now_s + _PAUSE_S
            progress(*program.progress(state))

    return tell
