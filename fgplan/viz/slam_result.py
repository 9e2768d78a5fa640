"""What SLAM knows beside the truth: figures 9a, 11a, 13a, 15a, 17a and 18a of Regev and Indelman.

Estimated trajectories with covariance ellipses over true ones, estimated landmarks over true ones,
and a line for each measurement of a landmark. Ellipses too small to see are drawn larger, and the
legend says by how much.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fgplan.checks import check_finite, check_positive
from fgplan.closed_loop.records import SlamRecord
from fgplan.errors import InvalidInputError
from fgplan.typing import ArrayLike, FloatArray
from fgplan.viz.ellipse import magnification_to_see, world_position_covariances
from fgplan.viz.map_drawing import (
    Extent,
    MapPicture,
    draw_ellipses,
    draw_goals,
    draw_lines,
    draw_workspace,
    draw_world,
    ellipse_entry,
    map_extent,
    pose_positions,
)
from fgplan.viz.palette import LANDMARK, RobotStyle, robot_styles
from roadmaps import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ELLIPSES = 25
"""Ellipses along one trajectory at most; more of them hide one another."""


def slam_result_figure(
    result: SlamRecord,
    *,
    truth: Mapping[str, ArrayLike],
    true_landmarks: ArrayLike = (),
    sightings: Mapping[str, ArrayLike] | None = None,
    goals: Mapping[str, ArrayLike] | None = None,
    workspace: Workspace | None = None,
    team: Sequence[str] = (),
    extent: Extent | None = None,
    sigmas: float = 3.0,
    magnification: float | None = None,
    title: str = "Multi-robot SLAM",
) -> "Figure":
    """Draw estimated trajectories and landmarks over the true ones.

    Args:
        result: Trajectories, landmarks and their covariances.
        truth: True positions by robot, shape (n, 2), metres, world frame; dashed.
        true_landmarks: Shape (N, 2), metres; tiny dots.
        sightings: By robot, shape (n, 2, 2): lines from robot to landmark, metres.
        goals: Shape (G, 2) or (G, 3) by robot, metres, world frame.
        workspace: Bounds and obstacles; None takes the extent of all that is drawn.
        team: Names in the order of the team, for the colours; empty takes those of the result.
        extent: What the map shows; None takes the workspace or all that is drawn.
        sigmas: Size of the ellipses in standard deviations.
        magnification: Ellipses are drawn so much larger; None picks a round factor at which the
            largest shows, one for robots and one for landmarks.
        title: Title of the figure.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no trajectory, one is empty or without covariances, shapes do
            not fit, or sightings or goals are those of another robot.
        MissingExtraError: If matplotlib is not installed.
    """
    if not result.trajectories:
        raise InvalidInputError("figure: expected at least one trajectory, got none")
    check_positive(sigmas, "figure sigmas")
    for robot, poses in result.trajectories.items():
        if not len(poses) or robot not in result.covariances:
            raise InvalidInputError(
                f"figure: robot {robot!r}: expected at least one pose, and covariances"
            )
    styles = robot_styles(tuple(dict.fromkeys((*team, *result.trajectories))))
    for robot in (*(sightings or {}), *(goals or {})):
        if robot not in styles:
            raise InvalidInputError(
                f"figure: robot {robot!r}: expected sightings and goals of {', '.join(styles)}"
            )
    lines = {robot: pose_positions(poses) for robot, poses in result.trajectories.items()}
    true_lines = {
        robot: check_finite(given, f"true positions of robot {robot!r}", (None, 2))
        for robot, given in truth.items()
    }
    points = np.array([where[:2] for where in result.landmarks.values()]).reshape(-1, 2)
    blocks = {
        robot: world_position_covariances(poses, result.covariances[robot])
        for robot, poses in result.trajectories.items()
    }
    spreads = np.array([result.landmark_covariances[key][:2, :2] for key in result.landmarks])
    spreads = spreads.reshape(-1, 2, 2)
    if extent is None:
        extent = map_extent(workspace, [*lines.values(), *true_lines.values(), points])
    span = float((extent[1] - extent[0]).max())
    every = np.concatenate(list(blocks.values()))
    # Landmarks may be far less certain than robots: each kind has a factor of its own.
    if magnification is None:
        larger: float = magnification_to_see(every, sigmas, span)
        larger_landmarks: float = magnification_to_see(spreads, sigmas, span)
    else:
        larger = larger_landmarks = check_positive(magnification, "figure magnification")
    picture = MapPicture(extent)
    axes = picture.axes[0]
    for robot, line in lines.items():
        style = styles[robot]
        axes.plot(*line.T, ls=style.dash, color=style.color, lw=2.0, zorder=5)
        axes.plot(*line[-1], "o", color=style.color, mec="white", mew=1.0, ms=9, zorder=8)
        picture.entry(f"{robot}, estimated", color=style.color, ls=style.dash, lw=2.0)
    for line in true_lines.values():
        axes.plot(*line.T, ls=(0, (4.0, 2.5)), color="black", lw=1.1, zorder=6)
        picture.entry("true trajectory", color="black", ls=(0, (4.0, 2.5)), lw=1.1)
    picture.entry("where a robot is", color="#404040", mec="white", marker="o", ls="", ms=10)
    for robot, each in blocks.items():
        some = _some(len(each))
        where, color = lines[robot][some], styles[robot].color
        draw_ellipses(axes, where, each[some], sigmas * larger, color)
    ellipse_entry(picture, "covariance of a robot", sigmas, larger)
    if len(points):
        draw_ellipses(axes, points, spreads, sigmas * larger_landmarks, LANDMARK)
        ellipse_entry(picture, "covariance of a landmark", sigmas, larger_landmarks)
    _draw_landmarks(picture, axes, result, points)
    _draw_sightings(picture, axes, sightings or {}, styles)
    draw_goals(picture, axes, goals or {}, styles)
    if len(np.asarray(true_landmarks)):
        draw_world(picture, axes, true_landmarks)
    if workspace is not None:
        draw_workspace(picture, axes, workspace)
    return picture.finish(title)


def _some(count: int) -> list[int]:
    """Places of the ellipses that are drawn, the last always among them."""
    stride = -(-count // _ELLIPSES)
    return list(range((count - 1) % stride, count, stride))


def _draw_landmarks(
    picture: MapPicture, axes: "Axes", result: SlamRecord, points: FloatArray
) -> None:
    """Draw estimated landmarks; those that several robots saw, which join them, stand out."""
    shared = np.array(
        [len(result.seen_by.get(key, ())) > 1 for key in result.landmarks], dtype=bool
    )
    looks: tuple[tuple[Any, dict[str, Any], str], ...] = (
        (~shared, {"marker": "+", "ms": 6, "mew": 1.0}, "estimated landmark"),
        (shared, {"marker": "P", "ms": 7, "mew": 0.0}, "the same, seen by several"),
    )
    for mask, look, label in looks:
        if mask.any():
            axes.plot(*points[mask].T, color=LANDMARK, ls="", zorder=6.5, **look)
            picture.entry(f"{label} ({int(mask.sum())})", color=LANDMARK, ls="", **look)


def _draw_sightings(
    picture: MapPicture,
    axes: "Axes",
    sightings: Mapping[str, ArrayLike],
    styles: Mapping[str, RobotStyle],
) -> None:
    """Draw a thin line in the robot's colour for each measurement of a landmark."""
    count = 0
    for robot, given in sightings.items():
        lines = check_finite(given, f"sightings of robot {robot!r}", (None, 2, 2))
        draw_lines(axes, list(lines), color=styles[robot].color, lw=0.6, alpha=0.35, zorder=3)
        count += len(lines)
    if count:
        picture.entry(f"landmark measurement ({count})", color="#707070", lw=0.8)
