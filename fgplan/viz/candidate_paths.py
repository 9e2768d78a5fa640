"""Candidate paths of every robot over the map: figure 5 of Regev and Indelman 2017."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import networkx as nx

from fgplan.errors import InvalidInputError
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import ArrayLike
from fgplan.viz.map_drawing import (
    MapPicture,
    draw_goals,
    draw_lines,
    draw_roadmap,
    draw_start,
    draw_workspace,
    map_extent,
    path_positions,
)
from fgplan.viz.palette import robot_styles
from roadmaps import Workspace

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def candidate_paths_figure(
    candidates: Mapping[str, Sequence[CandidatePath]],
    *,
    workspace: Workspace | None = None,
    roadmap: nx.Graph | None = None,
    goals: Mapping[str, ArrayLike] | None = None,
    title: str = "Candidate paths",
) -> "Figure":
    """Draw all candidate paths; starts are stars, goals ringed discs.

    Args:
        candidates: By robot, in the order of the team.
        workspace: Bounds and obstacles; None takes the extent of the paths.
        roadmap: Drawn in the background.
        goals: Shape (G, 2) or (2,) by robot, metres, world frame; None marks the paths' ends.
        title: Title of the figure.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is nothing to draw.
        MissingExtraError: If matplotlib is not installed.
    """
    if not any(candidates.values()):
        raise InvalidInputError("figure: expected at least one candidate path, got none")
    lines = {name: [path_positions(p) for p in paths] for name, paths in candidates.items()}
    styles = robot_styles(tuple(candidates))
    picture = MapPicture(map_extent(workspace, [line for each in lines.values() for line in each]))
    axes = picture.axes[0]
    for robot, each in lines.items():
        style = styles[robot]
        draw_lines(axes, each, color=style.color, lw=1.4, alpha=0.6, zorder=4, dash=style.dash)
        label = f"{robot}: {len(each)} candidate{'' if len(each) == 1 else 's'}"
        picture.entry(label, color=style.color, ls=style.dash, lw=2)
    for robot, each in lines.items():
        if each:
            draw_start(picture, axes, robot, each[0][0], styles[robot])
    ends = {robot: each[0][-1] for robot, each in lines.items() if each}
    draw_goals(picture, axes, ends if goals is None else goals, styles)
    if roadmap is not None:
        draw_roadmap(picture, axes, roadmap)
    if workspace is not None:
        draw_workspace(picture, axes, workspace)
    return picture.finish(title)
