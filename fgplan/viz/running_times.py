"""Running times: against the number of candidates (figure 6a), and by session (16, 19).

Times span orders of magnitude between evaluators, so their axes are logarithmic. Lines are
medians, bands hold the middle half of the runs.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.typing import ArrayLike, FloatArray
from fgplan.viz.figure import new_figure
from fgplan.viz.palette import ROBOT_COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARKERS = "os^Dv<>P"
_BESIDE = 16
"""Bars whose numbers have room beside one another."""


def running_time_figure(
    counts: Sequence[int],
    seconds: Mapping[str, Mapping[str, ArrayLike]],
    *,
    published: Mapping[str, Mapping[str, Sequence[tuple[float, float]]]] | None = None,
    title: str = "Running time of planning until agreement",
) -> "Figure":
    """Draw running time against the number of candidate paths, one panel a team.

    Args:
        counts: Numbers of candidates, C in all.
        seconds: By panel ("2 robots") and evaluator: shape (C, repeats), seconds.
        published: By panel and label, points (candidates, seconds) of a paper, drawn beside.
        title: Title of the figure.

    Returns:
        A matplotlib Figure.

    Raises:
        InvalidInputError: If there is no panel, or times do not fit or are not above zero.
        UnknownNameError: If a published curve is for a panel that is not there.
        MissingExtraError: If matplotlib is not installed.
    """
    if not seconds:
        raise InvalidInputError("figure: expected running times of at least one team, got none")
    beside = published or {}
    for panel in beside:
        if panel not in seconds:
            known = ", ".join(seconds)
            raise UnknownNameError(f"figure: published times for {panel!r}, expected of {known}")
    names = list(dict.fromkeys(name for each in seconds.values() for name in each))
    looks = {name: (_color(place), _MARKERS[place % 8]) for place, name in enumerate(names)}
    extra = list(dict.fromkeys(name for each in beside.values() for name in each))
    figure = new_figure(height_px=560)
    panels = figure.subplots(1, len(seconds), sharey=True, squeeze=False)[0]
    for axes, (panel, by_name) in zip(panels, seconds.items(), strict=True):
        for name, given in by_name.items():
            times = _check_times(given, f"{panel}, {name}", (len(counts), None))
            color, marker = looks[name]
            low, middle, high = np.percentile(times, [25, 50, 75], axis=1)
            axes.fill_between(counts, low, high, color=color, alpha=0.25, lw=0)
            axes.plot(counts, middle, color=color, marker=marker, lw=2, ms=7, label=name)
        for name, points in beside.get(panel, {}).items():
            x, y = _check_times(points, f"{panel}, {name}", (None, 2)).T
            dash = ("--", ":", "-.")[extra.index(name) % 3]
            marker = "XPdp"[extra.index(name) % 4]
            axes.plot(x, y, color="#606060", ls=dash, marker=marker, ms=9, lw=1.6, label=name)
        axes.set_yscale("log")
        axes.set_title(panel, fontsize=12)
        axes.set_xticks(list(counts))
        axes.set_xlabel("candidate paths a robot")
        _grid(axes)
    panels[0].set_ylabel("running time (s)")
    handles, labels = [], []
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            if label not in labels:
                handles.append(handle)
                labels.append(label)
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(f"{title}\n(median; bands: middle half of the runs)", fontsize=13)
    return figure


def running_time_bars_figure(
    sessions: Sequence[str],
    seconds: Mapping[str, ArrayLike],
    *,
    reference: str | None,
    title: str = "Running time by planning session",
) -> "Figure":
    """Draw bars of running times by session and evaluator, and how much slower the reference is.

    Args:
        sessions: Names of the planning sessions, S in all.
        seconds: By evaluator: shape (S,), seconds.
        reference: Evaluator that the others are compared with; None leaves the ratios out.
        title: Title of the figure.

    Returns:
        A matplotlib Figure with two panels: seconds, and ratio reference over evaluator (seconds
        alone without a reference).

    Raises:
        InvalidInputError: If times do not fit or are not above zero.
        UnknownNameError: If the reference has no times.
        MissingExtraError: If matplotlib is not installed.
    """
    if reference is not None and reference not in seconds:
        known = ", ".join(seconds) or "none"
        raise UnknownNameError(f"figure: reference {reference!r} is not one of: {known}")
    times = {name: _check_times(given, name, (len(sessions),)) for name, given in seconds.items()}
    # Many bars have a panel of full width each.
    panels = 1 if reference is None else 2
    below = panels == 2 and len(sessions) * len(times) > _BESIDE
    figure = new_figure(height_px=820 if below else 520)
    colors = {name: _color(place) for place, name in enumerate(times)}
    grid = figure.subplots(panels if below else 1, 1 if below else panels, squeeze=False)
    left, *others = grid.ravel()
    draw_bars(left, sessions, times, colors, "planning session")
    left.set_yscale("log")
    left.set_ylabel("running time (s)")
    left.set_title("Running time", fontsize=12)
    if reference is not None:
        right = others[0]
        ratios = {n: times[reference] / each for n, each in times.items() if n != reference}
        draw_bars(right, sessions, ratios, colors, "planning session", unit="×")
        right.axhline(1.0, color="#404040", lw=1.0, ls="--")
        right.set_ylabel(f"ratio: {reference} / evaluator (no unit)")
        right.set_title(f"How many times faster than {reference}", fontsize=12)
    figure.legend(
        *left.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False
    )
    figure.suptitle(title, fontsize=14)
    return figure


def draw_bars(
    axes: "Axes",
    groups: Sequence[str],
    values: Mapping[str, FloatArray],
    colors: Mapping[str, str],
    label: str,
    *,
    unit: str = "",
) -> None:
    """Draw groups of bars with their values above.

    Args:
        axes: Where to.
        groups: Names of the groups, S in all.
        values: By series: shape (S,); nan leaves a bar out.
        colors: Colour of each series.
        label: What a group is.
        unit: Behind each value.
    """
    width = 0.8 / max(len(values), 1)
    upright = len(groups) * len(values) > _BESIDE
    places = np.arange(len(groups))
    for index, (name, each) in enumerate(values.items()):
        offset = (index - 0.5 * (len(values) - 1)) * width
        bars = axes.bar(places + offset, each, 0.92 * width, color=colors[name], label=name)
        texts = ["" if np.isnan(v) else _short(v) + unit for v in each]
        axes.bar_label(bars, texts, fontsize=8, padding=2, rotation=90 if upright else 0)
    axes.set_xticks(places, list(groups))
    axes.set_xlabel(label)
    axes.margins(x=0.02, y=0.2 if upright else 0.12)
    _grid(axes)


def _short(value: float) -> str:
    """A number above a bar."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _color(place: int) -> str:
    """Colour of the evaluator at a place."""
    return ROBOT_COLORS[place % len(ROBOT_COLORS)]


def _grid(axes: "Axes") -> None:
    """Light horizontal lines behind the data."""
    axes.grid(axis="y", color="#E0E0E0", lw=0.8)
    axes.set_axisbelow(True)


def _check_times(given: ArrayLike, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    """Check that times are finite and above zero: a logarithmic axis shows no other."""
    times = check_finite(given, f"running times of {name}", shape)
    if times.size == 0 or (times <= 0).any():
        raise InvalidInputError(
            f"running times of {name}: expected at least one, all above zero, got {given!r}"
        )
    return times
