"""Pictures of teams that meet: figures 5 to 9 of Khodayi-mehr et al. 2019, and a film.

Robots in their colours from a star to a square; a ring where a team meets, with its number; targets
grey, from a dot to a cross. Curves share their time axis.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.team_run import TeamRun
from fgplan.typing import FloatArray
from fgplan.viz.figure import new_figure
from fgplan.viz.map_drawing import MapPicture, draw_workspace, map_extent
from fgplan.viz.palette import ROBOT_COLORS, RobotStyle, robot_styles
from roadmaps import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TARGET = "#777777"
_ERROR, _EIGENVALUE = "error (m)", "largest eigenvalue (m²)"


def draw_two_series(
    series: Mapping[str, tuple[FloatArray, FloatArray]],
    title: str,
    *,
    marks: Sequence[float] = (),
    bound: float | None = None,
) -> "Figure":
    """Error above, largest eigenvalue below, against time: figures 5, 6 and 9.

    Args:
        series: Error and eigenvalue of every step, by label.
        title: Of the figure.
        marks: Times of thin dashed lines (epochs).
        bound: Time of the thick dashed line (the lower bound of Proposition III.2).

    Returns:
        The figure.
    """
    figure = new_figure(height_px=700)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for place, (label, (error, eigenvalue)) in enumerate(series.items()):
        color, dash = ROBOT_COLORS[place], ("-", "--", ":")[place % 3]
        width = 1.2 if dash == "-" else 1.7  # gaps make a line look thinner
        upper.plot(1 + np.arange(len(error)), error, color=color, ls=dash, lw=width, label=label)
        lower.plot(1 + np.arange(len(eigenvalue)), eigenvalue, color=color, ls=dash, lw=width)
    for axes, name in ((upper, _ERROR), (lower, _EIGENVALUE)):
        for time in marks:
            axes.axvline(time, color="#AA88CC", ls="--", lw=0.8)
        if bound is not None:
            axes.axvline(bound, color="#6A3D9A", ls="--", lw=2.2)
        axes.set_ylabel(name)
        axes.set_ylim(bottom=0.0)
    if len(marks):
        upper.plot([], [], color="#AA88CC", ls="--", lw=0.8, label="an epoch passed by all")
    if bound is not None:
        upper.plot([], [], color="#6A3D9A", ls="--", lw=2.2, label="bound of Proposition III.2")
    upper.set_title(title, fontsize=14)
    upper.legend(frameon=False)
    lower.set_xlabel("step")
    return figure


def draw_delays(
    delays: Mapping[str, tuple[FloatArray, FloatArray, FloatArray]], title: str
) -> "Figure":
    """t*(t) above, the delay error (14) below: figure 7.

    Args:
        delays: Times of meetings, t* and error of each, shape (meetings,), by label.
        title: Of the figure.

    Returns:
        The figure.
    """
    figure = new_figure(height_px=700)
    upper, lower = figure.subplots(2, 1, sharex=True)
    last = max((float(times.max(initial=0.0)) for times, _, _ in delays.values()), default=0.0)
    upper.plot([0.0, last], [0.0, last], color="#888888", ls="--", label="no delay")
    for place, (label, (times, agrees, errors)) in enumerate(delays.items()):
        color, marker = ROBOT_COLORS[place], ("D", "s")[place % 2]
        upper.plot(times, agrees, color=color, marker=marker, ms=5, lw=1.2, label=label)
        lower.plot(times, errors, color=color, marker=marker, ms=5, lw=1.2)
    upper.set_ylabel("t*(t) (step)")
    lower.set_ylabel("delay error (m)")
    lower.set_xlabel("step t of a meeting")
    upper.set_title(title, fontsize=14)
    upper.legend(frameon=False)
    return figure


def draw_team_paths(
    workspace: Workspace,
    panels: Mapping[str, tuple[Mapping[str, FloatArray], FloatArray]],
    names: Sequence[str],
    title: str,
) -> "Figure":
    """Paths of teams to a meeting, and of the targets in that time, a map each: figure 8.

    Args:
        workspace: Bounds and obstacles.
        panels: Places of each robot, shape (S, 2), and of the targets, shape (S, M, 2), by title
            of the map.
        names: Robots in the order of the team: each has its colour in every map.
        title: Of the figure.

    Returns:
        The figure.
    """
    picture = MapPicture(map_extent(workspace, []), len(panels))
    for axes, (name, (ways, targets)) in zip(picture.axes, panels.items(), strict=True):
        draw_workspace(picture, axes, workspace)
        axes.set_title(name, fontsize=11)
        _draw_ways(axes, ways, robot_styles(names))
        for robot, way in ways.items():
            at = (float(way[0, 0]), float(way[0, 1]))
            axes.annotate(robot, at, (7, 5), textcoords="offset points", fontsize=9, zorder=9)
        _draw_targets(axes, targets)
    _explain(picture)
    return picture.finish(title)


def draw_team_run(
    workspace: Workspace,
    run: TeamRun,
    names: Sequence[str],
    targets: FloatArray,
    title: str,
    *,
    since: int = 0,
    until: int | None = None,
) -> "Figure":
    """Paths, meetings and targets over time on one map.

    Args:
        workspace: Bounds and obstacles.
        run: The run.
        names: Robots in the order of the team.
        targets: True places, shape (steps + 1, M, 2), metres.
        title: Of the figure.
        since: First step shown.
        until: Last step shown; the end if left out.

    Returns:
        The figure.
    """
    until = len(run.positions) - 1 if until is None else until
    picture = MapPicture(map_extent(workspace, []))
    axes = picture.axes[0]
    draw_workspace(picture, axes, workspace)
    ways = {name: run.positions[since : until + 1, row] for row, name in enumerate(names)}
    _draw_ways(axes, ways, robot_styles(names))
    _draw_targets(axes, targets[since : until + 1])
    for snapshot in run.snapshots:
        if since <= snapshot.time <= until:
            row = list(names).index(snapshot.robot)
            _draw_meeting(axes, run.positions[snapshot.time, row], snapshot.team)
    for name, style in robot_styles(names).items():
        picture.entry(name, color=style.color, ls=style.dash)
    picture.entry("meeting, team", color="black", marker="o", mfc="none", ls="", ms=9)
    _explain(picture)
    return picture.finish(title)


def film_team_run(
    workspace: Workspace,
    run: TeamRun,
    names: Sequence[str],
    targets: FloatArray,
    file: str | Path,
    *,
    frames: int = 80,
    tail: int = 40,
) -> Path:
    """An animated GIF: robots with the last of their ways, meetings as they happen, targets.

    Args:
        workspace: Bounds and obstacles.
        run: The run.
        names: Robots in the order of the team.
        targets: True places, shape (steps + 1, M, 2), metres.
        file: Ends in .gif.
        frames: Most frames.
        tail: Steps of each way that are shown.

    Returns:
        The path of the file.

    Raises:
        InvalidInputError: If the name ends otherwise.
    """
    file = Path(file)
    if file.suffix != ".gif":
        raise InvalidInputError(f"film {file.name!r}: expected a name that ends in .gif")
    last = len(run.positions) - 1
    steps = np.unique(np.linspace(0, last, min(frames, last + 1)).round()).astype(int).tolist()
    file.parent.mkdir(parents=True, exist_ok=True)
    images = list(_frames(workspace, run, names, targets, steps, tail))
    images[0].save(file, save_all=True, append_images=images[1:], duration=120, loop=0)
    return file


def _frames(
    workspace: Workspace,
    run: TeamRun,
    names: Sequence[str],
    targets: FloatArray,
    steps: Sequence[int],
    tail: int,
) -> Iterator[Any]:
    """One picture a step."""
    from PIL import Image

    before = -1
    for step in steps:
        picture = MapPicture(map_extent(workspace, []))
        axes = picture.axes[0]
        draw_workspace(picture, axes, workspace)
        begin = max(0, step - tail)
        ways = {name: run.positions[begin : step + 1, row] for row, name in enumerate(names)}
        _draw_ways(axes, ways, robot_styles(names), start=False)
        _draw_targets(axes, targets[begin : step + 1])
        for snapshot in run.snapshots:
            if before < snapshot.time <= step:
                row = list(names).index(snapshot.robot)
                _draw_meeting(axes, run.positions[snapshot.time, row], snapshot.team)
        for name, style in robot_styles(names).items():
            picture.entry(name, color=style.color, ls=style.dash)
        picture.entry("meeting, team", color="black", marker="o", mfc="none", ls="", ms=9)
        _explain(picture, start=False)
        figure = picture.finish(f"step {step}")
        figure.canvas.draw()
        pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
        before = step
        yield Image.fromarray(np.ascontiguousarray(pixels)).convert("P")


def _draw_ways(
    axes: "Axes",
    ways: Mapping[str, FloatArray],
    styles: Mapping[str, RobotStyle],
    *,
    start: bool = True,
) -> None:
    """Ways of robots from a star to a square."""
    for name, way in ways.items():
        style = styles[name]
        axes.plot(*way.T, color=style.color, ls=style.dash, lw=1.3, zorder=5)
        if start:
            axes.plot(*way[0], "*", color=style.color, mec="white", mew=0.5, ms=11, zorder=7)
        axes.plot(*way[-1], "s", color=style.color, mec="white", mew=0.5, ms=6, zorder=7)


def _draw_targets(axes: "Axes", targets: FloatArray) -> None:
    """Ways of targets from a dot to a cross."""
    for column in range(targets.shape[1]):
        axes.plot(*targets[:, column].T, color=_TARGET, lw=0.8, zorder=4)
    axes.plot(*targets[0].T, ".", color=_TARGET, ms=5, zorder=4)
    axes.plot(*targets[-1].T, "x", color="black", ms=6, zorder=6)


def _draw_meeting(axes: "Axes", place: FloatArray, team: int) -> None:
    """A ring and the number of the team, which the paper counts from one."""
    axes.plot(*place, "o", mfc="none", mec="black", ms=13, zorder=8)
    at = (float(place[0]), float(place[1]))
    axes.annotate(str(team + 1), at, (9, 5), textcoords="offset points", fontsize=9, zorder=9)


def _explain(picture: MapPicture, *, start: bool = True) -> None:
    """Legend entries of all maps; a film shows ends of ways only: where robots are."""
    if start:
        picture.entry("start of a way", color="#888888", marker="*", ms=11, ls="")
    picture.entry("end of a way" if start else "robot", color="#888888", marker="s", ms=6, ls="")
    picture.entry("target: way and end", color="black", marker="x", ms=6, ls="")
