"""Robots that talk only when they are close: teams meet by a schedule, fuse what they know, go on.

Run it from anywhere: `python examples/17_intermittent.py [FOLDER]`; with a folder it writes a map
and a film there (these need matplotlib).
"""

import sys
from pathlib import Path

import numpy as np

from fgplan.bench.intermittent_methods import indoor_case, run_method
from fgplan.planners.intermittent.delay import team_delays

STEPS = 250


def main(folder: Path | None) -> None:
    """Four robots in a ring of four teams, four targets, 250 steps."""
    case = indoor_case("four", 0, STEPS)
    schedule = case.setup.schedule
    for robot in case.setup.robots:
        print(f"{robot}: meets team {[team + 1 for team in schedule.sequence(robot)]}, repeating")
    print(f"news reach everybody within {schedule.delay_bound} epochs")
    run = run_method(case, "intermittent")
    assert run.team is not None
    for snapshot in run.team.snapshots:
        print(f"step {snapshot.time}: team {snapshot.team + 1} meets (epoch {snapshot.epoch})")
    delays = [delay for team in range(4) for delay in team_delays(run.team, team)]
    print(f"oldest news at a meeting: {max(delay.age_epochs for delay in delays)} epochs")
    print(f"error {run.error_m[0]:.2f} m at first, {run.error_m[-50:].mean():.2f} m at the end")
    if folder is not None:
        from fgplan.viz.figure import save
        from fgplan.viz.intermittent import draw_team_run, film_team_run

        world, names = case.setup.workspace, case.setup.robots
        targets = np.reshape(case.truth.states, (STEPS + 1, -1, 3))[:, :, :2]
        save(draw_team_run(world, run.team, names, targets, "Four robots"), folder / "run.png")
        film_team_run(world, run.team, names, targets, folder / "run.gif")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
