"""Figures of the Victoria Park demo, drawn with fgplan.viz; the park's bounds and trees on each."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fgplan.demos.arrival import Arrival
from fgplan.demos.evaluator_times import EvaluatorTimes
from fgplan.demos.victoria_log import TeamPast
from fgplan.demos.victoria_team import VictoriaTeam
from fgplan.io.run_record import ImpactRecord, Pairs
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import FloatArray
from fgplan.viz.chosen_paths import chosen_paths_figure
from fgplan.viz.ellipse import world_position_covariances
from fgplan.viz.figure import save
from fgplan.viz.impacted_paths import impacted_paths_figure
from fgplan.viz.map_drawing import (
    MapPicture,
    draw_goals,
    draw_landmarks,
    draw_lines,
    draw_roadmap,
    draw_start,
    draw_workspace,
    map_extent,
    path_positions,
    state_position,
)
from fgplan.viz.palette import robot_styles
from fgplan.viz.running_times import running_time_bars_figure
from roadmaps import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRIVEN = "#C4B59A"
"""Past ways on figures that are about what is to come."""

DETAIL_MARGIN_M = 8.0
"""Around the factors that changed, where a figure shows those alone."""


def draw_figures(
    folder: Path,
    past: TeamPast,
    team: VictoriaTeam,
    paths: Mapping[str, CandidatePath],
    joined: Pairs,
    arrival: Arrival,
    impact: ImpactRecord | None,
    times: Sequence[EvaluatorTimes],
) -> tuple[Path, ...]:
    """Draw and write all figures.

    Args:
        folder: Where to.
        past: What was driven.
        team: Candidates, goals, roadmap.
        paths: What was chosen.
        joined: States that multi-robot factors join along the chosen paths.
        arrival: What the robots will know.
        impact: One re-evaluation, or None.
        times: Of the evaluators.

    Returns:
        The files.

    Raises:
        MissingExtraError: If matplotlib is not installed.
    """
    figures = {
        "park_and_candidate_paths": _park_figure(past, team),
        "chosen_paths": _chosen_figure(past, team, paths, joined, arrival),
    }
    if impact is not None:
        figures["impacted_paths"] = _impact_figure(past, team, impact)
    figures["evaluator_times"] = _times_figure(times)
    return tuple(save(figure, folder / f"{name}.png") for name, figure in figures.items())


def _bounds(team: VictoriaTeam) -> Workspace:
    """The park without its trees, which are drawn as landmarks."""
    return Workspace(lower=team.workspace.lower, upper=team.workspace.upper)


def _park_figure(past: TeamPast, team: VictoriaTeam) -> "Figure":
    """The log by robot, mapped trees, roadmap, candidate paths."""
    bounds = _bounds(team)
    picture = MapPicture(map_extent(bounds, []))
    axes = picture.axes[0]
    styles = robot_styles(tuple(team.candidates))
    for robot in team.candidates:
        color = styles[robot].color
        axes.plot(*past.trajectory(robot)[:, :2].T, color=color, lw=2.2, alpha=0.45, zorder=3.2)
        picture.entry(f"{robot}: driven", color=color, lw=2.2, alpha=0.45)
    for robot, candidates in team.candidates.items():
        color = styles[robot].color
        lines = [path_positions(path) for path in candidates]
        draw_lines(axes, lines, color=color, lw=0.9, alpha=0.75, zorder=4)
        picture.entry(f"{robot}: {len(lines)} candidates", color=color, lw=0.9)
    for robot, candidates in team.candidates.items():
        draw_start(picture, axes, robot, candidates[0].poses[0, :2], styles[robot])
    draw_goals(picture, axes, team.goals, styles)
    _draw_trees(picture, axes, team)
    draw_roadmap(picture, axes, team.roadmap)
    draw_workspace(picture, axes, bounds)
    return picture.finish("Victoria Park: what was driven, and where the robots may go")


def _chosen_figure(
    past: TeamPast,
    team: VictoriaTeam,
    paths: Mapping[str, CandidatePath],
    joined: Pairs,
    arrival: Arrival,
) -> "Figure":
    """Chosen paths, ellipses, multi-robot factors and planned observations."""
    figure = chosen_paths_figure(
        paths,
        {
            robot: world_position_covariances(path.poses, arrival.covariances[robot])
            for robot, path in paths.items()
        },
        joined=joined,
        landmarks=past.belief.landmarks(),
        workspace=_bounds(team),
        goals=team.goals,
        title="Chosen paths and what the robots will know (pale brown: driven)",
    )
    _draw_driven(figure.axes[0], past)
    return figure


def _impact_figure(past: TeamPast, team: VictoriaTeam, impact: ImpactRecord) -> "Figure":
    """What one change of announcements impacted, where it changed."""
    count, all_of = len(impact.impacted), len(team.candidates[impact.robot])
    figure = impacted_paths_figure(
        team.candidates[impact.robot],
        impact.impacted,
        impact.before,
        impact.after,
        kept=impact.kept,
        removed=impact.removed,
        added=impact.added,
        team=tuple(team.candidates),
        workspace=_bounds(team),
        title=f"{impact.robot} re-evaluates: {count} of {all_of} candidate paths are impacted "
        "(detail; pale brown: driven)",
    )
    changed = [state_position(state) for pair in (*impact.removed, *impact.added) for state in pair]
    for axes in figure.axes:
        _draw_driven(axes, past)
        if changed:
            _zoom(axes, np.array(changed))
    return figure


def _zoom(axes: "Axes", points: FloatArray) -> None:
    """Show some points with a margin; the proportions of the map stay, and it never grows."""
    left, right, bottom, top = *axes.get_xlim(), *axes.get_ylim()
    lower, upper = points.min(axis=0) - DETAIL_MARGIN_M, points.max(axis=0) + DETAIL_MARGIN_M
    width, height = right - left, top - bottom
    share = min(1.0, float(((upper - lower) / (width, height)).max()))
    half = 0.5 * share * np.array([width, height])
    low = np.clip(0.5 * (lower + upper) - half, (left, bottom), (right, top) - 2.0 * half)
    axes.set_xlim(low[0], low[0] + 2.0 * half[0])
    axes.set_ylim(low[1], low[1] + 2.0 * half[1])


def _times_figure(times: Sequence[EvaluatorTimes]) -> "Figure":
    """Milliseconds a candidate of each evaluator as bars."""
    sessions = list(times[0].seconds)
    figure = running_time_bars_figure(
        sessions,
        {
            item.label: np.array([item.milliseconds(session) for session in sessions])
            for item in times
        },
        reference="from_scratch",
        title="Evaluators on Victoria Park, same candidates and announced paths",
    )
    figure.axes[0].set_ylabel("running time (ms a candidate)")
    for axes in figure.axes:
        axes.set_xlabel("")
    return figure


def _draw_driven(axes: "Axes", past: TeamPast) -> None:
    """What was driven, in the background."""
    lines = [past.trajectory(robot)[:, :2] for robot in past.parts]
    draw_lines(axes, lines, color=DRIVEN, lw=1.0, alpha=0.8, zorder=1.8)


def _draw_trees(picture: MapPicture, axes: "Axes", team: VictoriaTeam) -> None:
    """Mapped trees."""
    draw_landmarks(picture, axes, np.array(list(team.problem.prior.landmarks().values())))
