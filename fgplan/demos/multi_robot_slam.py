"""``fgplan demo multi-robot-slam``: four robots map a world that nobody knows, planning as they go.

The mission is that of section 7.2 of Regev and Indelman 2017 as fgplan.closed_loop.unknown_world
draws it. Every record is on disk as it comes; the command given again goes on where it was stopped.
In some sessions every value of every candidate is compared with from scratch by QR.
"""

import argparse
import time
from pathlib import Path

from fgplan.closed_loop.records import LoopHistory, SessionRecord
from fgplan.closed_loop.summary import loop_lines, loop_results, session_line
from fgplan.closed_loop.unknown_world import draw_mission
from fgplan.errors import InvalidInputError, MissingExtraError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.loop_folder import read_loop, run_in_folder
from fgplan.io.loop_tracks import write_tracks
from fgplan.io.result_file import Requirement, require_at_least, require_at_most, require_true
from fgplan.viz.animation import animate_loop
from fgplan.viz.loop_figures import draw_loop_figures
from fgplan.viz.recording.loop_recording import record_loop
from roadmaps import Workspace

SEED = 0
COMPARED, QUICK_COMPARED = (1, 4, 7, 10), (1, 3)
"""Sessions in which all values are compared with from scratch."""

TOLERANCE = 1e-9
FILM = "mission.gif"
FRAMES, DPI = 90, 80
QUICK_FRAMES, QUICK_DPI = 20, 50
MOST_FILM_BYTES = 3_000_000
RECORDINGS = {"rerun": "mission.rrd", "mcap": "mission.mcap"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of this demo."""
    parser.add_argument(
        "--scenario",
        type=int,
        choices=(1, 2, 3),
        default=1,
        help="of Table 1 of Regev and Indelman 2017 (default: 1)",
    )
    parser.add_argument(
        "--record",
        choices=tuple(RECORDINGS),
        help="write a recording for Rerun or, as MCAP, for Foxglove as well",
    )


def multi_robot_slam(options: CommandOptions) -> CommandOutcome:
    """Run the mission, or go on with it, and draw what happened.

    Args:
        options: ``quick`` takes two goals, 8 candidates and 60 landmarks, in a folder of its own.

    Returns:
        Numbers of the mission and of each session.

    Raises:
        InvalidInputError: If the run folder holds another mission's records.
        MissingExtraError: If a recording is asked for and its package is not installed.
    """
    if options.out is None:
        raise InvalidInputError("demo multi-robot-slam: expected a run folder, got none")
    scenario = options.arguments.get("scenario", 1)
    mission = draw_mission(SEED, scenario)
    if options.quick:
        mission = draw_mission(SEED, scenario, goals=2, candidates=8, landmarks=60)
    folder = options.out / f"scenario-{scenario}{'-quick' if options.quick else ''}"
    compared = QUICK_COMPARED if options.quick else COMPARED
    began = time.perf_counter()
    new = 0
    for record in run_in_folder(mission, folder, compare=compared):
        new += 1
        if isinstance(record, SessionRecord):
            options.progress(0, 0, session_line(record).partition(";")[0])
    seconds = time.perf_counter() - began
    history, world = read_loop(folder)
    files = list(write_tracks(history, folder))
    figures, notes = _draw(options, history, folder, world.workspace())
    results = {"folder": str(folder), "new_records": new, **loop_results(history)}
    return CommandOutcome(
        results={**results, "seconds": seconds},
        requirements=_requirements(history, folder / FILM),
        seeds=(SEED,),
        summary=(
            f"{mission.name}: {history.steps[-1].step} steps, {len(history.sessions)} planning "
            f"sessions; {new} new records in {seconds:.1f} s",
            *loop_lines(history),
            *notes,
        ),
        figures=(*files, *figures),
    )


def _draw(
    options: CommandOptions, history: LoopHistory, folder: Path, workspace: Workspace
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Figures, film, and the recording that was asked for; a note where matplotlib is missing."""
    files: list[Path] = []
    notes: list[str] = []
    frames, dpi = (QUICK_FRAMES, QUICK_DPI) if options.quick else (FRAMES, DPI)
    try:
        options.progress(0, 0, "figures")
        files += draw_loop_figures(history, folder, workspace)
        options.progress(0, 0, "film")
        path = folder / FILM
        files.append(animate_loop(history, path, workspace=workspace, frames=frames, dpi=dpi))
    except MissingExtraError as error:
        notes.append(f"no figures: {error}")
    recording = options.arguments.get("record")
    if recording is not None:
        files.append(record_loop(history, folder / RECORDINGS[recording], workspace=workspace))
    return tuple(files), tuple(notes)


def _requirements(history: LoopHistory, film: Path) -> tuple[Requirement, ...]:
    """What the demo must show."""
    compared = [one.max_rel_diff for one in history.sessions if one.max_rel_diff is not None]
    reused = sum(sum(session.segments_reused.values()) for session in history.sessions)
    reached = all(history.reached[robot] == len(goals) for robot, goals in history.goals.items())
    required = [
        require_true("every_goal_is_reached", reached),
        require_at_least("sessions_compared", len(compared), 2),
        require_at_most("max_rel_diff", max(compared, default=float("nan")), TOLERANCE),
        require_at_least("messages_reused", reused, 1),
    ]
    if film.exists():
        required.append(require_at_most("film_bytes", film.stat().st_size, MOST_FILM_BYTES))
    return tuple(required)
