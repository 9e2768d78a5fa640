"""What the team agreed on: figures 6b, 8b, 10b, 12b and 14b of Regev and Indelman 2017.

Paths, the covariance ellipse of each position along them, multi-robot factors and planned
observations of mapped landmarks in cyan.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from fgplan.checks import check_finite, check_positive
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.typing import ArrayLike, FloatArray, Key
from fgplan.viz.ellipse import magnification_to_see
from fgplan.viz.map_drawing import (
    Extent,
    MapPicture,
    draw_ellipses,
    draw_goals,
    draw_landmarks,
    draw_lines,
    draw_roadmap,
    draw_start,
    draw_workspace,
    draw_world,
    ellipse_entry,
    map_extent,
    path_positions,
    state_position,
)
from fgplan.viz.palette import UNCHANGED, robot_styles
from fgplan.viz.target_drawing import TARGET_COLOR, TARGET_SIGMAS, draw_targets
from roadmaps import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def chosen_paths_figure(
    paths: Mapping[str, CandidatePath],
    covariances: Mapping[str, ArrayLike],
    *,
    joined: Sequence[tuple[State, State]] = (),
    landmarks: Mapping[Key, ArrayLike] | None = None,
    workspace: Workspace | None = None,
    targets: Mapping[str, ArrayLike] | None = None,
    target_covariances: Mapping[str, ArrayLike] | None = None,
    roadmap: nx.Graph | None = None,
    goals: Mapping[str, ArrayLike] | None = None,
    current_goals: Mapping[str, int] | None = None,
    true_landmarks: ArrayLike = (),
    team: Sequence[str] = (),
    extent: Extent | None = None,
    sigmas: float = 3.0,
    magnification: float | None = None,
    title: str = "Chosen paths and what the robots will know",
) -> "Figure":
    """Draw chosen paths with covariance ellipses and the factors that shape them.

    Args:
        paths: By robot, in the order of the team.
        covariances: Shape (L + 1, 2, 2) by robot, square metres, world frame
            (``world_position_covariances`` makes them from pose covariances); a robot may be left
            out.
        joined: Pairs of states with a multi-robot factor.
        landmarks: Position of each mapped landmark by key, metres; the paths' planned
            observations are drawn to them.
        workspace: Bounds and obstacles; None takes the extent of the paths.
        targets: Shape (S, 2) by target: where it is expected at each step, metres, world frame.
        target_covariances: Shape (K, 2, 2) by target, square metres: the earlier drawn the paler,
            the last at its last place; to scale, ``TARGET_SIGMAS`` standard deviations.
        roadmap: Drawn in the background.
        goals: Shape (G, 2) or (2,) by robot; None marks the paths' ends.
        current_goals: Number of the goal that a robot heads for, from 1; its disc is filled.
        true_landmarks: Shape (N, 2), metres: where landmarks truly are, as tiny dots.
        team: Names in the order of the team, for the colours; empty takes those of `paths`.
        extent: What the map shows; None takes the workspace or the paths.
        sigmas: Size of the ellipses in standard deviations; the legend says so.
        magnification: Ellipses are drawn so much larger; None picks a round factor at which the
            largest shows. The legend says so.
        title: Title of the figure.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no path or a covariance does not fit its path.
        UnknownNameError: If covariances are of a robot without a path.
        MissingExtraError: If matplotlib is not installed.
    """
    if not paths:
        raise InvalidInputError("figure: expected at least one chosen path, got none")
    check_positive(sigmas, "figure sigmas")
    lines = {robot: path_positions(path) for robot, path in paths.items()}
    blocks = _checked(covariances, lines)
    styles = robot_styles(tuple(dict.fromkeys((*team, *paths))))
    if extent is None:
        extent = map_extent(workspace, list(lines.values()))
    if magnification is None:
        every = np.concatenate([np.zeros((1, 2, 2)), *blocks.values()])
        magnification = magnification_to_see(every, sigmas, float((extent[1] - extent[0]).max()))
    check_positive(magnification, "figure magnification")
    picture = MapPicture(extent)
    axes = picture.axes[0]
    for robot, line in lines.items():
        style = styles[robot]
        axes.plot(*line.T, ls=style.dash, color=style.color, lw=2.2, marker=".", ms=7, zorder=5)
        picture.entry(robot, color=style.color, ls=style.dash, lw=2.2, marker=".")
    for robot, line in lines.items():
        draw_start(picture, axes, robot, line[0], styles[robot])
    for robot, each in blocks.items():
        draw_ellipses(axes, lines[robot], each, sigmas * magnification, styles[robot].color)
    if blocks:
        ellipse_entry(picture, "position covariance", sigmas, magnification)
    if joined:
        pairs = [(state_position(one), state_position(other)) for one, other in joined]
        draw_lines(axes, pairs, color=UNCHANGED, lw=0.9, alpha=0.75, zorder=3.5)
        picture.entry(f"multi-robot factor ({len(pairs)})", color=UNCHANGED, lw=1.4)
    if landmarks:
        _draw_observations(picture, axes, paths, lines, landmarks)
    if targets:
        _draw_targets(picture, axes, targets, target_covariances or {})
    ends = {robot: line[-1] for robot, line in lines.items()}
    draw_goals(picture, axes, ends if goals is None else goals, styles, current_goals)
    if len(np.asarray(true_landmarks)):
        draw_world(picture, axes, true_landmarks)
    if roadmap is not None:
        draw_roadmap(picture, axes, roadmap)
    if workspace is not None:
        draw_workspace(picture, axes, workspace)
    return picture.finish(title)


def _checked(
    covariances: Mapping[str, ArrayLike], lines: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Covariances as arrays that fit their paths."""
    checked = {}
    for robot, given in covariances.items():
        if robot not in lines:
            known = ", ".join(lines)
            raise UnknownNameError(f"figure: covariances of robot {robot!r}, expected of {known}")
        name = f"position covariances of robot {robot!r}"
        checked[robot] = check_finite(given, name, (len(lines[robot]), 2, 2))
    return checked


def _draw_targets(
    picture: MapPicture,
    axes: "Axes",
    targets: Mapping[str, ArrayLike],
    covariances: Mapping[str, ArrayLike],
) -> None:
    """Draw each target's expected way and how well its place is known, from pale to dark."""
    moments = 0
    for name, given in targets.items():
        track = check_finite(given, f"track of target {name!r}", (None, 2))
        blocks = np.zeros((0, 2, 2))
        if name in covariances:
            blocks = check_finite(
                covariances[name], f"covariances of target {name!r}", (None, 2, 2)
            )
        moments = max(moments, len(blocks))
        axes.plot(*track.T, color=TARGET_COLOR, lw=0.6, alpha=0.6, zorder=3.6)
        for place, block in enumerate(blocks, start=1):
            where = track[-1 if place == len(blocks) else 0]
            draw_targets(axes, where[None], block[None], 0.4 if place < len(blocks) else 1.0)
        axes.plot(*track[-1], ".", color=TARGET_COLOR, ms=6, zorder=6)
        axes.annotate(
            name, track[-1], (4.0, 4.0), textcoords="offset points", fontsize=8, color=TARGET_COLOR
        )
    when = {0: "", 1: f",\n{TARGET_SIGMAS:g}σ at the end"}
    text = when.get(moments, f",\n{TARGET_SIGMAS:g}σ at start and end")
    picture.entry(f"target{text}", color=TARGET_COLOR, marker="o", ls="", ms=5)


def _draw_observations(
    picture: MapPicture,
    axes: "Axes",
    paths: Mapping[str, CandidatePath],
    lines: Mapping[str, FloatArray],
    landmarks: Mapping[Key, ArrayLike],
) -> None:
    """Draw landmarks, and dashed lines from where they would be observed."""
    points = {key: np.asarray(where, dtype=np.float64)[:2] for key, where in landmarks.items()}
    draw_landmarks(picture, axes, np.array(list(points.values())))
    seen = [
        (lines[robot][one.step], points[one.landmark])
        for robot, path in paths.items()
        for one in path.observations
        if one.landmark in points
    ]
    if seen:
        draw_lines(axes, seen, color=UNCHANGED, lw=0.8, alpha=0.9, zorder=3.4, dash=(0, (2.0, 2.0)))
        picture.entry(f"landmark observation ({len(seen)})", color=UNCHANGED, lw=1.2, ls=":")
