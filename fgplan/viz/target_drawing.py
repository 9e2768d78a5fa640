"""Targets on a map: where they are taken to be, and ellipses to scale of how well that is known."""

from typing import TYPE_CHECKING

from fgplan.typing import FloatArray
from fgplan.viz.ellipse import ellipse_outlines

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TARGET_SIGMAS = 2.0
"""Size of the ellipses in standard deviations."""

TARGET_COLOR = "#444444"


def draw_targets(
    axes: "Axes", places: FloatArray, covariances: FloatArray, alpha: float = 1.0
) -> None:
    """Draw targets with their ellipses.

    Args:
        axes: Where.
        places: Shape (M, 2), metres, world frame.
        covariances: Shape (M, 2, 2), square metres.
        alpha: Opacity.
    """
    for outline in ellipse_outlines(places, covariances, TARGET_SIGMAS):
        axes.plot(*outline.T, color=TARGET_COLOR, lw=0.9, alpha=alpha, zorder=6)
    axes.plot(*places.T, ".", color=TARGET_COLOR, ms=4, alpha=alpha, zorder=6)
