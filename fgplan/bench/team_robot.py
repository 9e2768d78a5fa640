"""One robot of ``fgplan bench team`` in its own process: ``python -m fgplan.bench.team_robot``.

It reads one line of JSON from standard input, plans every scene of it over zenoh with teammates
that do the same, and writes one line of JSON a scene to standard output.
"""

import dataclasses
import sys
import time
from typing import Any

import msgspec
import numpy as np

from fgplan.bench.open_world import draw_world
from fgplan.team.coordination import set_up_team
from fgplan.team.endpoint import run_robot
from fgplan.team.envelope import Inbox, Outbox
from fgplan.team.network_options import NetworkOptions
from fgplan.team.options import CoordinationOptions
from fgplan.team.report import report_of
from fgplan.team.robot import step
from fgplan.team.robot_state import RobotState, start_robot
from fgplan.team.zenoh_transport import ZenohTransport
from fgplan.threads import one_blas_thread

START_WAIT_S = 120.0
TIME_LIMIT_S = 120.0
LOST_AFTER_S = 30.0


class TeamRun(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot of the bench is told.

    Attributes:
        robot: Its number.
        robots: R.
        candidates: Candidates a robot.
        seeds: Of the scenes.
        listen: Endpoint by scene.
        connect: Endpoint of robot 0 by scene; empty for robot 0 itself.
    """

    robot: int
    robots: int
    candidates: int
    seeds: tuple[int, ...]
    listen: tuple[str, ...]
    connect: tuple[str, ...]


class TurnTimes(msgspec.Struct, frozen=True, kw_only=True):
    """The step in which a robot wrote an entry.

    Attributes:
        turn: Number of the turn.
        began_s: When the step began, seconds of the machine's monotonic clock.
        ended_s: When it ended; the entry is sent then.
        planning_s: Seconds of evaluation in it.
    """

    turn: int
    began_s: float
    ended_s: float
    planning_s: float


class RobotRun(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one scene, as one robot tells it.

    Attributes:
        seed: Of the scene.
        began_s: When it saw its whole team, seconds of the machine's monotonic clock.
        ended_s: When it knew that all had agreed.
        planning_s: Seconds of its evaluations.
        written: Steps in which it wrote an entry.
        turns: Turns taken.
        head: Digest of its log.
        chosen: Index of the path that it announced last.
        values: Common objective by accepted announcement.
        traffic: Counts by kind of message.
    """

    seed: int
    began_s: float
    ended_s: float
    planning_s: float
    written: tuple[TurnTimes, ...]
    turns: int
    head: str
    chosen: int | None
    values: tuple[float, ...]
    traffic: dict[str, dict[str, int]]


@one_blas_thread()
def plan_scene(run: TeamRun, place: int) -> RobotRun:
    """Plan one scene with the team.

    Args:
        run: What the robot is told.
        place: Number of the scene.

    Returns:
        What came of it.
    """
    seed = run.seeds[place]
    world = draw_world(run.robots, run.candidates, np.random.default_rng(seed))
    options = CoordinationOptions(session=place, lost_after_s=LOST_AFTER_S)
    setups = set_up_team(world.problem, world.candidates, options=options)
    names = tuple(setups)
    name = names[run.robot]
    state = start_robot(setups[name])
    network = NetworkOptions(
        name=f"bench-{seed}",
        listen=(run.listen[place],),
        connect=(run.connect[place],) if run.connect[place] else (),
    )
    ended: list[float] = []
    written: list[TurnTimes] = []

    def timed(before: RobotState, inbox: Inbox) -> tuple[RobotState, Outbox]:
        """The step, and when it wrote something."""
        step_began_s = time.monotonic()
        after, outbox = step(before, inbox)
        step_ended_s = time.monotonic()
        for record in after.records[len(before.records) :]:
            planning_s = 0.0 if record.decision is None else record.decision.seconds
            written.append(
                TurnTimes(
                    turn=record.turn,
                    began_s=step_began_s,
                    ended_s=step_ended_s,
                    planning_s=planning_s,
                )
            )
        return after, outbox

    def note(now: RobotState) -> None:
        """When it has finished; anew where it had to go on."""
        if not now.finished:
            ended.clear()
        elif not ended:
            ended.append(time.monotonic())

    with ZenohTransport(name, names, network, session=place) as transport:
        transport.wait_for_team(START_WAIT_S)
        began_s = time.monotonic()
        limit_s = transport.now() + TIME_LIMIT_S
        state = run_robot(state, timed, transport, time_limit_s=limit_s, report=note, session=place)
        kinds = transport.traffic.kinds
    report = report_of(state)
    found = [item.value for item in report.ledger.history if item.value is not None]
    return RobotRun(
        seed=seed,
        began_s=began_s,
        ended_s=ended[0] if ended else np.inf,
        planning_s=sum(r.decision.seconds for r in report.records if r.decision),
        written=tuple(written),
        turns=report.turn - 1,
        head=report.head,
        chosen=report.chosen,
        values=(np.nan if report.first_value is None else report.first_value, *found),
        traffic={kind: dataclasses.asdict(counts) for kind, counts in kinds.items()},
    )


def main(line: str, write: Any) -> None:  # noqa: ANN401
    """Plan every scene.

    Args:
        line: A ``TeamRun`` as JSON.
        write: Takes bytes.
    """
    run = msgspec.json.decode(line, type=TeamRun)
    for place in range(len(run.seeds)):
        write(msgspec.json.encode(plan_scene(run, place)) + b"\n")


def _write(data: bytes) -> None:
    """To standard output at once."""
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main(sys.stdin.readline(), _write)
