"""Empirical probability of the optimal path and bound (7), against iterations."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from fgplan.typing import FloatArray
from fgplan.viz.figure import new_figure
from fgplan.viz.palette import ROBOT_COLORS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS = 600


def draw_convergence(
    curves: Mapping[str, Mapping[str, FloatArray]], seeds: int, horizon: int
) -> "Figure":
    """Draw both densities, one above the other.

    Args:
        curves: By the name of the densities: ``iteration``, ``empirical``, ``low``, ``high``,
            ``bound`` and ``printed``, each of shape (n,).
        seeds: Number of trees of each.
        horizon: F.

    Returns:
        The figure.
    """
    figure = new_figure(height_px=760)
    rows = figure.subplots(len(curves), 1, sharex=True)
    for axes, (name, curve) in zip(np.atleast_1d(rows), curves.items(), strict=True):
        # As many points as a logarithmic axis can show.
        last = len(curve["iteration"]) - 1
        shown = np.unique(np.geomspace(1, last + 1, _POINTS).astype(np.int64) - 1)
        x = curve["iteration"][shown]
        axes.fill_between(
            x,
            curve["low"][shown],
            curve["high"][shown],
            color=ROBOT_COLORS[0],
            alpha=0.2,
            lw=0,
            step="post",
            label="its 95 % interval (Clopper-Pearson)",
        )
        axes.step(
            x,
            curve["empirical"][shown],
            where="post",
            color=ROBOT_COLORS[0],
            lw=2,
            label=f"share of {seeds} seeds with the optimum",
        )
        axes.plot(
            x,
            curve["bound"][shown],
            color=ROBOT_COLORS[1],
            lw=2,
            ls="--",
            label="bound 1 - exp(-Σα/2 + F)",
        )
        axes.plot(
            x,
            curve["printed"][shown],
            color="#8A8A8A",
            lw=1.5,
            ls=":",
            label="(7) as printed, with a factor n",
        )
        axes.set_xscale("log")
        axes.set_xlim(1, x[-1])
        axes.set_ylim(-0.02, 1.05)
        axes.set_ylabel("probability")
        axes.set_title(f"densities: {name}", fontsize=11, loc="left")
        axes.grid(color="#E0E0E0", lw=0.8)
    np.atleast_1d(rows)[-1].set_xlabel("iteration n")
    np.atleast_1d(rows)[0].legend(frameon=False, loc="lower right", fontsize=9)
    figure.suptitle(
        f"Optimal path by iteration n against bound (7): 1 robot, 2 targets, F = {horizon}"
    )
    return figure
