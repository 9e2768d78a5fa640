"""Pictures of a team that gathers information: figures 3 and 4 of Kantaros et al. 2019, and a film.

Paths in the robots' colours from a star to a square; targets with their ellipses at the start, half
way and the end, the later the darker; what a robot senses at the end as a dotted circle of its
colour. Ellipses are to scale: at the end they may be no larger than the dot of their target.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.models.uncertainty import uncertainty_function
from fgplan.planners.aia.mission_problem import target_positions
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.team_path import TeamPath
from fgplan.typing import BoolArray, FloatArray
from fgplan.viz.figure import matplotlib_module, new_figure
from fgplan.viz.map_drawing import MapPicture, draw_lines, draw_workspace
from fgplan.viz.palette import robot_styles
from fgplan.viz.target_drawing import TARGET_COLOR, TARGET_SIGMAS, draw_targets
from fgplan.viz.uncertainty_label import uncertainty_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LINK = "#56B4E9"
_MOMENTS = ((0.0, 0.25), (0.5, 0.5), (1.0, 1.0))


def draw_team_path(
    problem: AcquisitionProblem, path: TeamPath, title: str, *, links: BoolArray | None = None
) -> "Figure":
    """The whole plan on a map.

    Args:
        problem: What was planned for, independent targets in the plane.
        path: The plan.
        title: Of the figure.
        links: Who hears whom at each step, shape (F + 1, N, N); those of the start are drawn.

    Returns:
        The figure.

    Raises:
        InvalidInputError: If the targets are not independent points in the plane.
    """
    _check(path)
    workspace = problem.workspace
    picture = MapPicture((workspace.lower, workspace.upper))
    axes = picture.axes[0]
    draw_workspace(picture, axes, workspace)
    places = target_positions(problem, path.horizon)
    _draw_robots(axes, problem, path.poses)
    picture.entry("start of a robot", color="#888888", marker="*", ms=12, ls="")
    picture.entry("end of its path", color="#888888", marker="s", ms=7)
    if links is not None and links[0].any():
        _draw_links(axes, path.poses[0], links[0])
        picture.entry("robots that hear\neach other at the start", color=_LINK, lw=0.9)
    reach = _reach_m(problem)
    if np.isfinite(reach):
        _draw_reach(axes, problem, path.poses[-1], reach)
        picture.entry(f"sensing range {reach:g} m,\nat the end", color="#888888", ls=":")
    for share, alpha in _MOMENTS:
        step = round(share * path.horizon)
        draw_targets(axes, places[step], path.covariances[step], alpha)
    picture.entry(
        f"target, {TARGET_SIGMAS:g}σ at start,\nhalf way and end",
        color=TARGET_COLOR,
        marker="o",
        ls="",
        ms=5,
    )
    if not problem.fixed:
        for i in range(problem.targets):
            axes.plot(*places[:, i].T, color="black", lw=0.8, zorder=4)
    return picture.finish(title)


def draw_uncertainty(problem: AcquisitionProblem, paths: dict[str, TeamPath]) -> "Figure":
    """The worst target's uncertainty against time, and the limit.

    Args:
        problem: What was planned for.
        paths: Plans by label.

    Returns:
        The figure.
    """
    figure = new_figure(height_px=500)
    axes = figure.add_subplot()
    function = uncertainty_function(problem.terminal.function)
    styles = robot_styles(list(paths))
    for label, path in paths.items():
        values = np.array(
            [
                function.evaluate(path.of_target(problem, i), problem.open_loop_of(i, path.horizon))
                for i in range(problem.targets)
            ]
        )
        worst = values.min(axis=0) if function.needs_prior else values.max(axis=0)
        axes.plot(worst, color=styles[label].color, lw=2, label=label)
    for limit in np.unique(np.asarray(problem.terminal.limit)):
        axes.axhline(float(limit), color="#888888", ls="--", label=f"limit {limit:.3g}")
    if function.positive and not function.needs_prior:
        axes.set_yscale("log")
    axes.set_xlabel("time (steps)")
    axes.set_ylabel(uncertainty_label(function.name, " of the worst target"))
    axes.grid(color="#E0E0E0", lw=0.8)
    axes.legend(frameon=False)
    return figure


def film_team_path(
    problem: AcquisitionProblem,
    path: TeamPath,
    file: str | Path,
    *,
    frames: int = 60,
    links: BoolArray | None = None,
) -> Path:
    """An animated GIF of a plan: robots move, ellipses shrink.

    Args:
        problem: What was planned for, independent targets in the plane.
        path: The plan.
        file: Ends in .gif.
        frames: Most frames.
        links: Who hears whom at each step, shape (F + 1, N, N); drawn between the robots as long
            as they are there.

    Returns:
        The path of the file.

    Raises:
        InvalidInputError: If the name ends otherwise, or the targets are of another kind.
    """
    _check(path)
    file = Path(file)
    if file.suffix != ".gif":
        raise InvalidInputError(f"film {file.name!r}: expected a name that ends in .gif")
    steps = np.unique(np.linspace(0, path.horizon, min(frames, path.horizon + 1)).round())
    file.parent.mkdir(parents=True, exist_ok=True)
    images = list(_frames(problem, path, steps.astype(int).tolist(), links))
    images[0].save(file, save_all=True, append_images=images[1:], duration=120, loop=0)
    return file


def _frames(
    problem: AcquisitionProblem, path: TeamPath, steps: Sequence[int], links: BoolArray | None
) -> Iterator[Any]:
    """One picture a step."""
    from PIL import Image

    places, reach = target_positions(problem, path.horizon), _reach_m(problem)
    for step in steps:
        workspace = problem.workspace
        picture = MapPicture((workspace.lower, workspace.upper))
        axes = picture.axes[0]
        draw_workspace(picture, axes, workspace)
        _draw_robots(axes, problem, path.poses[: step + 1])
        if np.isfinite(reach):
            _draw_reach(axes, problem, path.poses[step], reach)
            picture.entry(f"sensing range {reach:g} m", color="#888888", ls=":")
        draw_targets(axes, places[step], path.covariances[step], 1.0)
        picture.entry("start of a robot", color="#888888", marker="*", ms=12, ls="")
        picture.entry("robot, with its way", color="#888888", marker="s", ms=7)
        picture.entry(
            f"target with its {TARGET_SIGMAS:g}σ", color=TARGET_COLOR, marker="o", ls="", ms=5
        )
        if links is not None:
            _draw_links(axes, path.poses[step], links[step])
        figure = picture.finish(f"step {step} of {path.horizon}")
        figure.canvas.draw()
        pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
        yield Image.fromarray(np.ascontiguousarray(pixels)).convert("P")


def _draw_links(axes: "Axes", poses: FloatArray, links: BoolArray) -> None:
    """Thin lines between robots that hear each other at a step."""
    pairs = [poses[[i, j], :2] for i, j in np.argwhere(np.triu(links))]
    draw_lines(axes, pairs, color=_LINK, lw=0.9, zorder=4.5)


def _draw_robots(axes: "Axes", problem: AcquisitionProblem, poses: FloatArray) -> None:
    """Ways from a star to a square."""
    styles = robot_styles([robot.name for robot in problem.robots])
    for j, robot in enumerate(problem.robots):
        style = styles[robot.name]
        way = poses[:, j, :2]
        axes.plot(*way.T, color=style.color, ls=style.dash, lw=1.4, zorder=5)
        axes.plot(*way[0], "*", color=style.color, mec="white", mew=0.5, ms=10, zorder=7)
        axes.plot(*way[-1], "s", color=style.color, mec="white", mew=0.5, ms=6, zorder=7)


def _reach_m(problem: AcquisitionProblem) -> float:
    """Longest range of any sensor, metres; infinite where one has no limit."""
    return max(getattr(s, "max_range_m", np.inf) for r in problem.robots for s in r.sensors)


def _draw_reach(
    axes: "Axes", problem: AcquisitionProblem, poses: FloatArray, reach_m: float
) -> None:
    """What each robot senses, as a circle of its colour."""
    styles = robot_styles([robot.name for robot in problem.robots])
    for robot, pose in zip(problem.robots, poses, strict=True):
        circle = matplotlib_module("patches").Circle(
            pose[:2], reach_m, fill=False, ec=styles[robot.name].color, lw=0.8, ls=":", zorder=2
        )
        axes.add_patch(circle)


def _check(path: TeamPath) -> None:
    """Refuse covariances that are not one block a target."""
    if path.covariances.ndim != 4:
        raise InvalidInputError(
            "picture of targets: expected independent targets in the plane, got covariances of "
            f"shape {path.covariances.shape}"
        )
