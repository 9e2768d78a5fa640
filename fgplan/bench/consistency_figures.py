"""Figures of ``fgplan bench consistency``."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.viz.figure import new_figure, save
from fgplan.viz.palette import robot_styles


def draw_errors(results: Mapping[str, Any], folder: Path) -> Path:
    """Mean normalised error squared of each robot by step, with the interval.

    Args:
        results: Of ``judge_slam``.
        folder: Where to.

    Returns:
        The file.
    """
    rows = results["errors"]
    robots = tuple(results["inside_by_robot"])
    styles = robot_styles(robots)
    figure = new_figure(height_px=760)
    panels = figure.subplots(2, -(-len(robots) // 2), sharex=True, sharey=True, squeeze=False)
    for axes, robot in zip(panels.ravel(), robots, strict=False):
        own = [row for row in rows if row["robot"] == robot]
        steps = [row["step"] for row in own]
        low, high = np.array([row["interval"] for row in own]).T
        axes.fill_between(steps, low, high, color="#B0B0B0", alpha=0.5, lw=0, label="95 % interval")
        axes.axhline(results["dimensions"], color="#606060", lw=1.0, ls="--", label="expected")
        style = styles[robot]
        axes.plot(
            steps,
            [row["mean"] for row in own],
            color=style.color,
            lw=1.6,
            marker=".",
            label="mean over seeds",
        )
        inside = results["inside_by_robot"][robot]
        axes.set_title(f"{robot}: inside at {inside:.0%} of the steps", fontsize=12)
        axes.set_ylim(bottom=0.0)
        axes.grid(axis="y", color="#E0E0E0", lw=0.8)
    for axes in panels[-1]:
        axes.set_xlabel("step")
    for axes in panels[:, 0]:
        axes.set_ylabel("normalised error squared (no unit)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    seeds = max(row["seeds"] for row in rows)
    figure.suptitle(f"Consistency of SLAM: current poses, mean over {seeds} missions", fontsize=14)
    return save(figure, folder / "consistency.png")


def draw_plans(results: Mapping[str, Any], folder: Path) -> Path:
    """Scatter of planned against reported position covariance at arrival.

    Args:
        results: Of ``judge_slam`` and ``judge_plans``.
        folder: Where to.

    Returns:
        The file.
    """
    arrivals = results["arrivals"]
    styles = robot_styles(tuple(results["inside_by_robot"]))
    reported = np.array([each["reported"] for each in arrivals])
    titles = {"leg": "planned where the way began", "last": "planned last before the arrival"}
    figure = new_figure(height_px=560)
    panels = figure.subplots(1, len(titles), sharex=True, sharey=True)
    for axes, (which, title) in zip(panels, titles.items(), strict=True):
        planned = np.array([each["planned"][which] for each in arrivals])
        for robot, style in styles.items():
            own = np.array([each["robot"] == robot for each in arrivals])
            axes.scatter(
                planned[own], reported[own], s=18, color=style.color, alpha=0.7, label=robot
            )
        ends = [min(planned.min(), reported.min()), max(planned.max(), reported.max())]
        axes.plot(ends, ends, color="#606060", lw=1.0, ls="--", label="equal")
        ratio = results["planned_over_reported"][which]
        axes.set_title(
            f"{title}\nplanned / reported: mean {ratio['mean']:.2f}, geometric "
            f"{ratio['geometric_mean']:.2f}",
            fontsize=12,
        )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("planned trace (m²)")
        axes.grid(color="#E0E0E0", lw=0.8)
    panels[0].set_ylabel("trace that SLAM reports (m²)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    figure.suptitle("Position covariance at arrival", fontsize=14)
    return save(figure, folder / "planned_covariance.png")
