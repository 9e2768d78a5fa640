"""Candidate paths of every robot over the map.

Figures 5, 8a, 10a, 12a and 14a of Regev and Indelman 2017.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import ArrayLike, Key
from fgplan.viz.map_drawing import (
    Extent,
    MapPicture,
    draw_goals,
    draw_landmarks,
    draw_lines,
    draw_roadmap,
    draw_start,
    draw_workspace,
    draw_world,
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
    current_goals: Mapping[str, int] | None = None,
    landmarks: Mapping[Key, ArrayLike] | None = None,
    true_landmarks: ArrayLike = (),
    team: Sequence[str] = (),
    extent: Extent | None = None,
    title: str = "Candidate paths",
) -> "Figure":
    """Draw all candidate paths; starts are stars, goals ringed discs.

    Args:
        candidates: By robot, in the order of the team.
        workspace: Bounds and obstacles; None takes the extent of the paths.
        roadmap: Drawn in the background.
        goals: Shape (G, 2) or (2,) by robot, metres, world frame; None marks the paths' ends.
        current_goals: Number of the goal that a robot heads for, from 1; its disc is filled.
        landmarks: Estimated position of each mapped landmark by key, metres.
        true_landmarks: Shape (N, 2), metres: where landmarks truly are, as tiny dots.
        team: Names in the order of the team, for the colours; empty takes those of `candidates`.
        extent: What the map shows; None takes the workspace or the paths.
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
    styles = robot_styles(tuple(dict.fromkeys((*team, *candidates))))
    if extent is None:
        extent = map_extent(workspace, [line for each in lines.values() for line in each])
    picture = MapPicture(extent)
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
    draw_goals(picture, axes, ends if goals is None else goals, styles, current_goals)
    if landmarks:
        draw_landmarks(picture, axes, [np.asarray(where)[:2] for where in landmarks.values()])
    if len(np.asarray(true_landmarks)):
        draw_world(picture, axes, true_landmarks)
    if roadmap is not None:
        draw_roadmap(picture, axes, roadmap)
    if workspace is not None:
        draw_workspace(picture, axes, workspace)
    return picture.finish(title)
