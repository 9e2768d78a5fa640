"""``fgplan run SCENARIO`` with ``[simulation]``: the closed loop into a run folder.

    loop.jsonl                  every record as it comes; a run that was stopped goes on from it
    *.png, mission.gif          figures and film; ``fgplan plot`` draws them again
    trajectories/ROBOT.tum      estimated poses at the end; truth/ROBOT.tum the true ones

Several runs (``runs``, ``--seeds``) have a folder each, ``seed-N``; pictures are of the first.
"""

from pathlib import Path
from typing import Any

import numpy as np

from fgplan.closed_loop.comparison import OURS
from fgplan.closed_loop.mission import LoopMission
from fgplan.closed_loop.records import LoopHistory, SessionRecord
from fgplan.closed_loop.summary import loop_lines, loop_results
from fgplan.errors import InvalidInputError, MissingExtraError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.loop_folder import check_loop_folder, read_loop, run_in_folder
from fgplan.io.loop_mission import make_loop_mission
from fgplan.io.loop_tracks import write_tracks
from fgplan.io.named_files import named_files
from fgplan.io.place import Place
from fgplan.io.result_file import Requirement, require_at_most, require_true
from fgplan.io.run_folder import begin_run
from fgplan.io.scenario import Scenario
from fgplan.io.simulation_table import SimulationTable
from fgplan.planners.mission import Mission
from fgplan.viz.animation import animate_loop
from fgplan.viz.loop_figures import draw_loop_figures

FILM = "mission.gif"
TOLERANCE = 1e-9
QUICK_FRAMES, QUICK_DPI = 20, 60


def run_loop_scenario(
    options: CommandOptions,
    scenario: Scenario,
    simulation: SimulationTable,
    mission: Mission,
    path: Path,
) -> CommandOutcome:
    """Run the closed loop of a scenario, or go on with one that was stopped.

    Args:
        options: ``seeds`` runs it with as many seeds instead of ``runs``, from ``first_seed`` or
            the scenario's on; ``quick`` makes a short
            film.
        scenario: The scenario.
        simulation: Its ``[simulation]``.
        mission: What ``make_mission`` makes of it.
        path: The file it was read from.

    Returns:
        Numbers of each run under ``runs``.

    Raises:
        ScenarioError: If the scenario asks for something that a closed loop does not do.
        InvalidInputError: If the run folder holds another mission's loop.
        NoCandidatePathError: If no robot can reach a goal.
    """
    first = scenario.seed if simulation.seed is None else simulation.seed
    first = first if options.first_seed is None else options.first_seed
    seeds = tuple(range(first, first + (options.seeds or simulation.runs)))
    missions = [
        make_loop_mission(scenario, simulation, mission, seed, Place(path)) for seed in seeds
    ]
    if options.out is None:
        raise InvalidInputError("closed loop: expected a run folder, got none")
    folders = [options.out if len(seeds) == 1 else options.out / f"seed-{seed}" for seed in seeds]
    for each, folder in zip(missions, folders, strict=True):
        check_loop_folder(each, folder)
    options.record({})
    begin_run(path, options.out, named_files(scenario, path))
    histories: list[LoopHistory] = []
    runs: list[dict[str, Any]] = []
    for seed, each, folder in zip(seeds, missions, folders, strict=True):
        histories.append(_run(each, folder, simulation.compare, options))
        runs.append({"seed": seed, **loop_results(histories[-1])})
        options.record({"runs": runs})
    files: list[Path] = []
    notes: list[str] = []
    for history, folder in zip(histories, folders, strict=True):
        files += write_tracks(history, folder)
    try:
        film = {"frames": QUICK_FRAMES, "dpi": QUICK_DPI} if options.quick else {}
        files += draw_loop_folder(folders[0], **film)
    except MissingExtraError as error:
        notes.append(f"no figures: {error}")
    return CommandOutcome(
        results={"runs": runs},
        requirements=_requirements(histories, simulation.compare),
        seeds=seeds,
        summary=(
            f"{mission.name}: closed loop, seed {seeds[0]}, {runs[0]['steps']} steps",
            *loop_lines(histories[0]),
            *_over_runs(runs),
            *notes,
        ),
        figures=tuple(files),
    )


def draw_loop_folder(folder: Path, *, frames: int = 100, dpi: int = 100) -> tuple[Path, ...]:
    """Draw figures and film of a loop's folder.

    Args:
        folder: A folder with a loop.
        frames: Motion takes about so many in the film.
        dpi: Dots an inch of the film.

    Returns:
        The files.

    Raises:
        InvalidInputError: If the folder holds no loop, or no step of it.
        MissingExtraError: If matplotlib is not installed.
    """
    history, record = read_loop(folder)
    workspace = record.workspace()
    figures = draw_loop_figures(history, folder, workspace)
    return (
        *figures,
        animate_loop(history, folder / FILM, workspace=workspace, frames=frames, dpi=dpi),
    )


def _run(mission: LoopMission, folder: Path, compare: bool, options: CommandOptions) -> LoopHistory:
    """Run one loop to its end; its history."""
    goals = sum(map(len, mission.goals.values()))
    for record in run_in_folder(mission, folder, contestants=OURS, compare=compare):
        if isinstance(record, SessionRecord):
            reached = sum(number - 1 for number in record.goal_numbers.values())
            options.progress(reached, goals, f"session {record.session}, goals")
    return read_loop(folder)[0]


def _requirements(histories: list[LoopHistory], compare: bool) -> tuple[Requirement, ...]:
    """What every loop must satisfy."""
    sessions = [session for history in histories for session in history.sessions]
    falls = all((np.diff(session.values) <= 0.0).all() for session in sessions)
    reached = all(
        history.reached[robot] == len(goals)
        for history in histories
        for robot, goals in history.goals.items()
    )
    required = [
        require_true("every_goal_is_reached", reached),
        require_true("objective_never_rises", falls),
    ]
    if compare:
        worst = max((session.max_rel_diff or 0.0 for session in sessions), default=0.0)
        required.append(require_at_most("max_rel_diff", worst, TOLERANCE))
    return tuple(required)


def _over_runs(runs: list[dict[str, Any]]) -> list[str]:
    """The largest error at the end over all runs, where there are several."""
    if len(runs) == 1:
        return []
    errors = np.array([max(run["position_error_m"].values()) for run in runs])
    steps = [run["steps"] for run in runs]
    return [
        f"{len(runs)} runs: {min(steps)} to {max(steps)} steps; largest position error at the end "
        f"median {np.median(errors):.3g} m, most {errors.max():.3g} m"
    ]
