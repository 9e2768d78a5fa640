"""How numbers change: the objective by announcement, position covariance by pose index.

Every accepted announcement lowers the common objective, so the first curve only falls. The other
two are figures 9b, 11b, 13b, 15b, 17b and 18b of Regev and Indelman 2017: by pose index for a pose
graph, by time with sessions and arrivals for a closed loop.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.typing import ArrayLike, FloatArray
from fgplan.viz.figure import matplotlib_module, new_figure
from fgplan.viz.palette import robot_styles

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def objective_history_figure(
    values: ArrayLike,
    announced_by: Sequence[str],
    *,
    team: Sequence[str] = (),
    title: str = "Objective of the team by accepted announcement",
) -> "Figure":
    """Draw the objective after every accepted announcement.

    Args:
        values: Shape (K,), objective after each, in order; round 0 comes first.
        announced_by: Robot that made each announcement, K names.
        team: Names in the order of the team, for the colours.
        title: Title of the figure.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no value, or not one robot a value.
        MissingExtraError: If matplotlib is not installed.
    """
    history = check_finite(values, "objective values", (len(announced_by),))
    if history.size == 0:
        raise InvalidInputError("figure: expected at least one objective value, got none")
    styles = robot_styles(tuple(dict.fromkeys((*team, *announced_by))))
    figure = new_figure(height_px=480)
    axes = figure.subplots()
    places = np.arange(1, history.size + 1)
    axes.step(places, history, where="post", color="#808080", lw=1.4, zorder=2)
    for robot in styles:
        mine = [place for place, name in enumerate(announced_by) if name == robot]
        if mine:
            face = styles[robot].color if styles[robot].dash == "-" else "white"
            axes.plot(
                places[mine],
                history[mine],
                "o",
                mfc=face,
                mec=styles[robot].color,
                mew=2,
                ms=10,
                label=f"announced by {robot}",
                zorder=3,
            )
    # The first value stands above its disc, the last below: the curve falls in between.
    for place, offset in {0: 11, history.size - 1: -19}.items():
        axes.annotate(
            f"{history[place]:.6g}",
            (float(places[place]), float(history[place])),
            (0, offset),
            textcoords="offset points",
            ha="center",
        )
    axes.xaxis.set_major_locator(matplotlib_module("ticker").MaxNLocator(integer=True))
    axes.set_xlabel("accepted announcement (number)")
    axes.set_ylabel("objective (no unit)")
    axes.margins(x=0.05, y=0.15)
    axes.grid(axis="y", color="#E0E0E0", lw=0.8)
    axes.legend(frameon=False)
    axes.set_title(title, fontsize=14)
    return figure


def position_covariance_figure(
    covariances: Mapping[str, ArrayLike],
    *,
    sessions: Sequence[int] = (),
    title: str = "Position covariance along the way",
) -> "Figure":
    """Draw the trace of every robot's position covariance by pose index.

    Args:
        covariances: Shape (T, 2, 2) or (T, 3, 3) by robot, square metres, in any frame: a rotation
            leaves the trace as it is.
        sessions: Pose indices at which planning sessions took place; drawn as vertical lines.
        title: Title of the figure.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no robot, or a trace is not above zero.
        MissingExtraError: If matplotlib is not installed.
    """
    if not covariances:
        raise InvalidInputError("figure: expected covariances of at least one robot, got none")
    styles = robot_styles(tuple(covariances))
    figure = new_figure(height_px=480)
    axes = figure.subplots()
    for place, index in enumerate(sessions):
        label = "planning session" if place == 0 else None
        axes.axvline(index, color="#B0B0B0", ls=":", lw=1.2, label=label)
    for robot, given in covariances.items():
        blocks = check_finite(given, f"position covariances of robot {robot!r}", (None, None, None))
        traces = np.trace(blocks, axis1=1, axis2=2)
        if not (traces > 0).all():
            raise InvalidInputError(
                f"position covariances of robot {robot!r}: expected traces above zero, got "
                f"{traces.min():g}"
            )
        axes.plot(traces, color=styles[robot].color, ls=styles[robot].dash, lw=1.8, label=robot)
    axes.set_yscale("log")
    axes.set_xlabel("pose index")
    axes.set_ylabel("trace of the position covariance (m²)")
    axes.grid(axis="y", color="#E0E0E0", lw=0.8)
    axes.legend(frameon=False)
    axes.set_title(title, fontsize=14)
    return figure


def covariance_over_time_figure(
    times_s: ArrayLike,
    traces: Mapping[str, ArrayLike],
    *,
    sessions: Mapping[int, float] | None = None,
    arrivals: Mapping[str, Sequence[float]] | None = None,
    title: str = "Position covariance over time",
) -> "Figure":
    """Draw the trace of every robot's position covariance against time.

    The axis at the right has the square root of the trace, metres, a size that can be compared
    with the map.

    Args:
        times_s: Shape (T,), seconds, increasing.
        traces: Trace of the position covariance by robot, shape (T,), square metres.
        sessions: Time of each planning session by its number, seconds.
        arrivals: Times at which each robot reached a goal, all among `times_s`.
        title: Title of the figure.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no robot, a trace is negative, or shapes do not fit.
        MissingExtraError: If matplotlib is not installed.
    """
    if not traces:
        raise InvalidInputError("figure: expected covariances of at least one robot, got none")
    times = check_finite(times_s, "times", (None,))
    styles = robot_styles(tuple(traces))
    figure = new_figure(height_px=500)
    axes = figure.subplots()
    for number, when in (sessions or {}).items():
        axes.axvline(when, color="#A0A0A0", ls=":", lw=1.2)
        axes.annotate(
            str(number),
            (when, 1.0),
            (0, 3),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            color="#606060",
        )
    if sessions:
        axes.plot([], [], color="#A0A0A0", ls=":", lw=1.2, label="planning session (number above)")
    for robot, given in traces.items():
        curve = check_finite(given, f"traces of robot {robot!r}", (times.size,))
        if (curve < 0).any():
            raise InvalidInputError(
                f"traces of robot {robot!r}: expected none below zero, got {curve.min():g}"
            )
        color = styles[robot].color
        axes.plot(times, curve, color=color, ls=styles[robot].dash, lw=1.8, label=robot)
        reached = np.isin(times, np.asarray((arrivals or {}).get(robot, ())))
        axes.plot(times[reached], curve[reached], "o", mfc="white", mec=color, mew=1.8, ms=8)
    if arrivals:
        axes.plot([], [], "o", mfc="white", mec="#404040", mew=1.8, ms=8, label="goal reached")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("trace of the position covariance (m²)")
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.02)
    axes.grid(axis="y", color="#E0E0E0", lw=0.8)
    right = axes.secondary_yaxis("right", functions=(_signed_root, _signed_square))
    right.set_ylabel("square root of it (m)")
    handles, labels = axes.get_legend_handles_labels()
    # Robots first, in the order of the team.
    order = sorted(range(len(labels)), key=lambda place: labels[place] not in traces)
    handles, labels = [handles[place] for place in order], [labels[place] for place in order]
    figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False)
    axes.set_title(title, fontsize=14, pad=18 if sessions else 6)
    return figure


def _signed_root(values: ArrayLike) -> FloatArray:
    """Square root that matplotlib may ask for below zero too."""
    return np.sign(values) * np.sqrt(np.abs(values))


def _signed_square(values: ArrayLike) -> FloatArray:
    """The inverse of ``_signed_root``."""
    return np.sign(values) * np.square(values)
