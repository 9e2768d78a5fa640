"""Figures of a closed loop: figures 8 to 19 of Regev and Indelman 2017 from its records.

For each planning session the candidates (8a, 10a, 12a, 14a), what was chosen (8b, 10b, 12b, 14b)
and what SLAM made of following it (9a, 11a, 13a, 15a); for the loop position covariance over time
(9b to 15b, 17b, 18b) and running times by session (16, 19). All maps of a loop show the same
extent, and a robot has one colour in all of them.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fgplan.closed_loop.records import LoopHistory, SessionRecord
from fgplan.errors import InvalidInputError
from fgplan.viz.candidate_paths import candidate_paths_figure
from fgplan.viz.chosen_paths import chosen_paths_figure
from fgplan.viz.ellipse import world_position_covariances
from fgplan.viz.figure import save
from fgplan.viz.histories import covariance_over_time_figure
from fgplan.viz.loop_tracks import (
    loop_extent,
    loop_tracks,
    result_of_session,
    sightings,
    true_landmarks,
)
from fgplan.viz.running_times import running_time_bars_figure
from fgplan.viz.slam_result import slam_result_figure
from roadmaps import Workspace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REFERENCE = "from_scratch"
"""Evaluator that running times are compared with: the paper's Standard approach."""


def draw_loop_figures(
    history: LoopHistory, folder: str | Path, workspace: Workspace | None = None
) -> tuple[Path, ...]:
    """Write all figures of a closed loop.

    ``session_<number>_candidates.png``, ``session_<number>_chosen.png`` and
    ``session_<number>_slam.png`` for each session, ``position_covariance.png``,
    ``running_times.png`` and ``final_slam.png``. Of a loop that still runs, the result of the last
    session and the final one are left out; running times where no session was timed by all.

    Args:
        history: The loop.
        folder: Made if missing.
        workspace: Bounds and obstacles; None takes the extent of all there is in the loop.

    Returns:
        The paths in the order written.

    Raises:
        InvalidInputError: If there is no step to draw.
        MissingExtraError: If matplotlib is not installed.
    """
    folder = Path(folder)
    written = []
    for place, session in enumerate(history.sessions):
        stem = f"session_{session.session}"
        figure = session_candidates_figure(history, place, workspace)
        written.append(save(figure, folder / f"{stem}_candidates.png"))
        figure = session_chosen_figure(history, place, workspace)
        written.append(save(figure, folder / f"{stem}_chosen.png"))
        if result_of_session(history, place) is not None:
            figure = session_slam_figure(history, place, workspace)
            written.append(save(figure, folder / f"{stem}_slam.png"))
    written.append(save(loop_covariance_figure(history), folder / "position_covariance.png"))
    if _timed(history)[1]:
        written.append(save(loop_running_times_figure(history), folder / "running_times.png"))
    if history.final is not None:
        written.append(save(final_slam_figure(history, workspace), folder / "final_slam.png"))
    return tuple(written)


def session_candidates_figure(
    history: LoopHistory, place: int, workspace: Workspace | None = None
) -> "Figure":
    """Draw what could be done: candidate paths, goals, the map so far.

    Args:
        history: The loop.
        place: Place of the session, from 0.
        workspace: Bounds and obstacles; None takes the extent of all there is in the loop.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no such session.
        MissingExtraError: If matplotlib is not installed.
    """
    session = _session(history, place)
    return candidate_paths_figure(
        session.candidates,
        current_goals=session.goal_numbers,
        landmarks=session.estimate.landmarks,
        **_map_of(history, workspace),
        title=f"Session {session.session} at {session.time_s:g} s: candidate paths",
    )


def session_chosen_figure(
    history: LoopHistory, place: int, workspace: Workspace | None = None
) -> "Figure":
    """Draw what was agreed: chosen paths, their beliefs, factors and planned observations.

    Args:
        history: The loop.
        place: Place of the session, from 0.
        workspace: Bounds and obstacles; None takes the extent of all there is in the loop.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no such session.
        MissingExtraError: If matplotlib is not installed.
    """
    session = _session(history, place)
    return chosen_paths_figure(
        session.chosen,
        {
            robot: world_position_covariances(session.chosen[robot].poses, each)
            for robot, each in session.covariances.items()
        },
        joined=session.joined,
        current_goals=session.goal_numbers,
        landmarks=session.estimate.landmarks,
        **_map_of(history, workspace),
        title=f"Session {session.session} at {session.time_s:g} s: chosen paths",
    )


def session_slam_figure(
    history: LoopHistory, place: int, workspace: Workspace | None = None
) -> "Figure":
    """Draw the SLAM result once the paths of a session were followed, with what was measured.

    Args:
        history: The loop.
        place: Place of the session, from 0.
        workspace: Bounds and obstacles; None takes the extent of all there is in the loop.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no such session or it has not been followed to its end.
        MissingExtraError: If matplotlib is not installed.
    """
    session = _session(history, place)
    result = result_of_session(history, place)
    if result is None:
        raise InvalidInputError(
            f"closed loop {history.name!r}: session {session.session} has not been followed to "
            "its end; draw it when the loop has gone on"
        )
    tracks = loop_tracks(history)
    until = tracks.steps <= result.step
    return slam_result_figure(
        result,
        truth={robot: each[until] for robot, each in tracks.true_positions.items()},
        sightings=sightings(history, result, session.step + 1, result.step),
        **_map_of(history, workspace),
        title=f"SLAM after session {session.session}, step {result.step}",
    )


def final_slam_figure(history: LoopHistory, workspace: Workspace | None = None) -> "Figure":
    """Draw the final SLAM result over the truth.

    Args:
        history: A loop that has ended.
        workspace: Bounds and obstacles; None takes the extent of all there is in the loop.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If the loop has not ended.
        MissingExtraError: If matplotlib is not installed.
    """
    if history.final is None:
        raise InvalidInputError(
            f"closed loop {history.name!r}: expected a final SLAM result, got none: it still runs"
        )
    return slam_result_figure(
        history.final,
        truth=loop_tracks(history).true_positions,
        **_map_of(history, workspace),
        title=f"{history.name}: SLAM at the end, step {history.final.step}",
    )


def loop_covariance_figure(history: LoopHistory) -> "Figure":
    """Draw every robot's position covariance over time, with sessions and arrivals.

    Args:
        history: The loop.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no step.
        MissingExtraError: If matplotlib is not installed.
    """
    tracks = loop_tracks(history)
    return covariance_over_time_figure(
        tracks.times_s,
        tracks.traces,
        sessions={session.session: session.time_s for session in history.sessions},
        arrivals={
            robot: [record.time_s for record in history.steps if robot in record.arrived]
            for robot in history.robots
        },
        title=f"{history.name}: position covariance from SLAM",
    )


def loop_running_times_figure(history: LoopHistory, reference: str = REFERENCE) -> "Figure":
    """Draw running times by session and evaluator, and how much slower the reference is.

    Sessions that not every evaluator took part in are left out, and the title says which.

    Args:
        history: The loop.
        reference: Evaluator that the others are compared with; where none ran under this name,
            ratios are left out.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no session that all evaluators took part in.
        MissingExtraError: If matplotlib is not installed.
    """
    names, full = _timed(history)
    if not full:
        raise InvalidInputError(
            f"closed loop {history.name!r}: expected a planning session timed by every evaluator "
            f"({', '.join(names) or 'none is recorded'}), got none"
        )
    numbers = [one.session for one in full]
    missing = [str(one.session) for one in history.sessions if one.session not in numbers]
    note = f" (not timed by all: {', '.join(missing)})" if missing else ""
    return running_time_bars_figure(
        [str(number) for number in numbers],
        {name: np.array([one.runs[name].seconds for one in full]) for name in names},
        reference=reference if reference in names and len(names) > 1 else None,
        title=f"{history.name}: running time by planning session{note}",
    )


def _timed(history: LoopHistory) -> tuple[tuple[str, ...], list[SessionRecord]]:
    """Names of all evaluators, and the sessions that each of them took part in."""
    names = tuple(dict.fromkeys(name for one in history.sessions for name in one.runs))
    full = [one for one in history.sessions if names and all(name in one.runs for name in names)]
    return names, full


def _map_of(history: LoopHistory, workspace: Workspace | None) -> dict[str, Any]:
    """What all maps of a loop show alike."""
    return {
        "workspace": workspace,
        "goals": history.goals,
        "true_landmarks": true_landmarks(history),
        "team": history.robots,
        "extent": loop_extent(history, workspace),
    }


def _session(history: LoopHistory, place: int) -> SessionRecord:
    """The session at a place, or an error that says how many there are."""
    if not 0 <= place < len(history.sessions):
        raise InvalidInputError(
            f"closed loop {history.name!r}: expected the place of one of "
            f"{len(history.sessions)} sessions, from 0, got {place}"
        )
    return history.sessions[place]
