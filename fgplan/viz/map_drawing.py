"""The map under every picture of paths: bounds, obstacles, grid cells, roadmap, starts and goals.

Each function draws into axes that it is given and returns nothing; ``MapPicture`` makes a figure
of the map's proportions and collects legend entries in the order in which they are drawn.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import networkx as nx
import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.typing import ArrayLike, FloatArray
from fgplan.viz.ellipse import coverage, ellipse_outlines
from fgplan.viz.figure import DPI, WIDTH_PX, matplotlib_module, new_figure
from fgplan.viz.palette import LANDMARK, OBSTACLE, ROADMAP, UNKNOWN, UNMAPPED, RobotStyle
from roadmaps import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEFT_PX, _TOP_PX, _BOTTOM_PX, _GAP_PX = 76, 36, 52, 60
_HIGHEST_PX = 1000
"""Room for labels, and the largest height of a map, pixels."""

_NARROWEST = 0.3
"""Shorter side of a map at least, as a share of the longer."""

Extent = tuple[FloatArray, FloatArray]
"""Least and greatest coordinates, each of shape (2,), metres."""


def pose_positions(poses: FloatArray) -> FloatArray:
    """Positions of poses (n, 3) or (n, 4, 4) seen from above, shape (n, 2), metres."""
    return poses[:, :2] if poses.ndim == 2 else poses[:, :2, 3]


def path_positions(path: CandidatePath) -> FloatArray:
    """Positions of a path seen from above, shape (L + 1, 2), metres."""
    return pose_positions(path.poses)


def state_position(state: State) -> FloatArray:
    """Position of a state seen from above, shape (2,), metres."""
    return pose_positions(state.pose[None])[0]


def map_extent(workspace: Workspace | None, points: Sequence[FloatArray]) -> Extent:
    """What a map shows: the bounds of the workspace, or of all points, with a margin.

    Raises:
        InvalidInputError: If there is neither a workspace nor a point.
    """
    if workspace is not None:
        lower, upper, share = np.asarray(workspace.lower), np.asarray(workspace.upper), 0.03
    elif points:
        stacked = np.concatenate(points)
        lower, upper, share = stacked.min(axis=0), stacked.max(axis=0), 0.06
    else:
        raise InvalidInputError("figure: expected a workspace or a path to show, got neither")
    longer = float((upper - lower).max()) or 1.0
    # A corridor is shown with some room on both sides: a strip one pixel wide shows nothing.
    missing = np.maximum(_NARROWEST * longer - (upper - lower), 0.0) / 2.0
    return lower - missing - share * longer, upper + missing + share * longer


class Legend:
    """What marks mean, in the order in which they are drawn; the first of a label stays.

    Attributes:
        entries: Artist by label.
    """

    def __init__(self) -> None:
        self.entries: dict[str, Any] = {}

    def entry(self, label: str, **style: object) -> None:
        """Add an entry drawn as a line or marker."""
        line = matplotlib_module("lines").Line2D([], [], **style)
        self.entries.setdefault(label, line)

    def patch_entry(self, label: str, **style: object) -> None:
        """Add an entry drawn as a filled patch."""
        self.entries.setdefault(label, matplotlib_module("patches").Patch(**style))


class MapPicture(Legend):
    """A figure with one or more maps of the same extent, and one legend.

    One map has the legend at its right, several have it below. Matplotlib's own layouts cut off
    labels of axes with fixed proportions, so ``finish`` measures the legend and places the rest.
    """

    def __init__(self, extent: Extent, panels: int = 1) -> None:
        super().__init__()
        lower, upper = extent
        self._proportion = float((upper[1] - lower[1]) / (upper[0] - lower[0]))
        self.figure: Figure = new_figure(lays_itself_out=False)
        self.axes: list[Axes] = list(self.figure.subplots(1, panels, squeeze=False)[0])
        for place, axes in enumerate(self.axes):
            axes.set_xlim(lower[0], upper[0])
            axes.set_ylim(lower[1], upper[1])
            axes.set_aspect("equal")
            axes.set_xlabel("x (m)")
            if place == 0:
                axes.set_ylabel("y (m)")

    def finish(self, title: str) -> "Figure":
        """Put title and legend, place the maps, and hand out the figure."""
        panels = len(self.axes)
        beside = panels == 1
        legend = self.figure.legend(
            list(self.entries.values()),
            list(self.entries),
            loc="upper left" if beside else "lower center",
            bbox_to_anchor=(0.0, 0.0),
            ncols=1 if beside else 3,
            fontsize=10,
            frameon=False,
        )
        box = legend.get_window_extent()
        top_px = _TOP_PX if beside else _TOP_PX + 28
        bottom_px = _BOTTOM_PX + (0 if beside else box.height + 8)
        room = WIDTH_PX - _LEFT_PX - (box.width + 16 if beside else 12 + (panels - 1) * _GAP_PX)
        width = max(min(room / panels, _HIGHEST_PX / self._proportion), 0.2 * WIDTH_PX)
        height = width * self._proportion
        total = height + top_px + bottom_px
        if beside:
            total = max(total, box.height + 20)
        self.figure.set_size_inches(WIDTH_PX / DPI, total / DPI)
        # A narrow map moves to the middle of its room.
        spare = max(0.0, (room - panels * width) / 2)
        for place, axes in enumerate(self.axes):
            left = _LEFT_PX + spare + place * (width + _GAP_PX)
            bottom = total - top_px - height
            axes.set_position((left / WIDTH_PX, bottom / total, width / WIDTH_PX, height / total))
        if beside:
            self.axes[0].set_title(title, fontsize=14)
            right = (_LEFT_PX + spare + width + 8) / WIDTH_PX
            legend.set_bbox_to_anchor((right, 1.0 - (top_px - 8) / total))
        else:
            self.figure.suptitle(title, fontsize=14, y=1.0 - 18 / total)
            legend.set_bbox_to_anchor((0.5, 4 / total))
        return self.figure


def draw_workspace(legend: Legend, axes: "Axes", workspace: Workspace) -> None:
    """Draw bounds, polygons and grid cells.

    Args:
        legend: Takes the legend entries.
        axes: Axes of the map.
        workspace: Bounds and obstacles.
    """
    grid = workspace.grid
    if grid is not None:
        colors = matplotlib_module("colors").ListedColormap([UNKNOWN, "white", OBSTACLE])
        place = matplotlib_module("transforms").Affine2D().scale(grid.resolution_m)
        place = place.rotate(grid.yaw_rad).translate(*grid.origin)
        rows, columns = grid.shape
        axes.imshow(
            np.sign(grid.occupancy),
            cmap=colors,
            vmin=-1,
            vmax=1,
            origin="lower",
            extent=(0, columns, 0, rows),
            transform=place + axes.transData,
            interpolation="nearest",
            aspect="auto",
            zorder=0,
        )
        axes.set_aspect("equal")
        if (grid.occupancy < 0).any():
            legend.patch_entry("unknown cells", color=UNKNOWN)
    size = workspace.upper - workspace.lower
    axes.add_patch(
        matplotlib_module("patches").Rectangle(
            workspace.lower, size[0], size[1], fill=False, edgecolor="#606060", lw=1.2, zorder=1
        )
    )
    if workspace.obstacles:
        axes.add_collection(
            matplotlib_module("collections").PolyCollection(
                [np.asarray(polygon) for polygon in workspace.obstacles],
                facecolors=OBSTACLE,
                edgecolors="#606060",
                linewidths=0.6,
                zorder=1,
            ),
            autolim=False,
        )
    if workspace.obstacles or (grid is not None and (grid.occupancy > 0).any()):
        legend.patch_entry("obstacle", color=OBSTACLE)


def draw_roadmap(legend: Legend, axes: "Axes", roadmap: nx.Graph) -> None:
    """Draw vertices and edges in the background.

    Args:
        legend: Takes the legend entry.
        axes: Axes of the map.
        roadmap: Graph with `position` on its vertices, metres, world frame.

    Raises:
        InvalidInputError: If a vertex has no position.
    """
    positions = {}
    for vertex, where in roadmap.nodes(data="position"):
        if where is None:
            raise InvalidInputError(f"roadmap: vertex {vertex!r} has no `position`")
        positions[vertex] = np.asarray(where, dtype=np.float64)[:2]
    edges = [(positions[one], positions[other]) for one, other in roadmap.edges]
    draw_lines(axes, edges, color=ROADMAP, lw=0.5, zorder=1.5)
    points = np.array(list(positions.values())).reshape(-1, 2)
    axes.plot(points[:, 0], points[:, 1], ".", color=ROADMAP, ms=3, zorder=1.6)
    legend.entry("roadmap", color=ROADMAP, marker=".", lw=0.8)


def draw_lines(
    axes: "Axes",
    lines: Sequence[ArrayLike],
    *,
    color: str,
    lw: float,
    zorder: float,
    alpha: float = 1.0,
    dash: str | tuple[int, tuple[float, float]] = "-",
) -> None:
    """Draw many lines of one look as one artist.

    Args:
        axes: Where to.
        lines: Each of shape (n, 2), metres.
        color: Colour of all.
        lw: Width, points.
        zorder: Drawing order.
        alpha: Opacity.
        dash: Matplotlib line style.
    """
    if lines:
        collection = matplotlib_module("collections").LineCollection(
            [np.asarray(line) for line in lines],
            colors=color,
            linewidths=lw,
            linestyles=[dash],
            alpha=alpha,
            zorder=zorder,
        )
        axes.add_collection(collection, autolim=False)


def draw_landmarks(legend: Legend, axes: "Axes", positions: ArrayLike) -> None:
    """Draw mapped landmarks as small dots.

    Args:
        legend: Takes the legend entry.
        axes: Axes of the map.
        positions: Shape (N, 2), metres, world frame.
    """
    points = check_finite(positions, "landmark positions", (None, 2))
    if len(points):
        axes.plot(points[:, 0], points[:, 1], "+", color=LANDMARK, ms=5, mew=0.9, zorder=3)
        legend.entry(f"mapped landmark ({len(points)})", color=LANDMARK, marker="+", ls="", ms=6)


def draw_world(legend: Legend, axes: "Axes", positions: ArrayLike) -> None:
    """Draw true landmarks as tiny dots, mapped or not.

    Args:
        legend: Takes the legend entry.
        axes: Axes of the map.
        positions: Shape (N, 2), metres, world frame.
    """
    points = check_finite(positions, "true landmark positions", (None, 2))
    if len(points):
        axes.plot(points[:, 0], points[:, 1], ".", color=UNMAPPED, ms=4.5, mew=0, zorder=1.8)
        legend.entry(f"landmark, true ({len(points)})", color=UNMAPPED, marker=".", ls="", ms=6)


def draw_ellipses(
    axes: "Axes", centers: FloatArray, covariances: FloatArray, size: float, color: str
) -> None:
    """Draw covariance ellipses: a line in the colour over a pale fill.

    Args:
        axes: Where to.
        centers: Shape (n, 2), metres, world frame.
        covariances: Shape (n, 2, 2), square metres, world frame.
        size: Standard deviations times magnification.
        color: Colour of all.
    """
    outlines = ellipse_outlines(centers, covariances, size)
    polygon = matplotlib_module("patches").Polygon
    for outline in outlines:  # as artists: the map has its limits, which ``fill`` would update
        axes.add_artist(polygon(outline, facecolor=color, alpha=0.12, lw=0, zorder=3.8))
    broken = np.pad(outlines, ((0, 0), (0, 1), (0, 0)), constant_values=np.nan).reshape(-1, 2)
    axes.plot(*broken.T, color=color, lw=0.9, zorder=4)


def ellipse_entry(legend: Legend, of_what: str, sigmas: float, magnification: float) -> None:
    """Put into the legend what ellipses hold, and how much larger they are drawn."""
    larger = f",\ndrawn {magnification:g}× larger" if magnification != 1 else ""
    label = f"{of_what}, {sigmas:g}σ\n({coverage(sigmas):.1%} inside){larger}"
    legend.entry(label, color="#404040", marker="o", mfc="#DDDDDD", ls="", ms=13, mew=1.0)


def draw_start(
    legend: Legend, axes: "Axes", robot: str, position: FloatArray, style: RobotStyle
) -> None:
    """Draw a robot's start as a star with its name."""
    axes.plot(*position, "*", color=style.color, mec="white", mew=0.8, ms=19, zorder=8)
    label = axes.annotate(
        robot,
        (float(position[0]), float(position[1])),
        xytext=(9, 7),
        textcoords="offset points",
        color=style.color,
        fontsize=11,
        fontweight="bold",
        zorder=9,
    )
    halo = matplotlib_module("patheffects").withStroke(linewidth=2.5, foreground="white")
    label.set_path_effects([halo])
    legend.entry("start", color="#404040", marker="*", ls="", ms=13)


def draw_goals(
    legend: Legend,
    axes: "Axes",
    goals: Mapping[str, ArrayLike],
    styles: Mapping[str, RobotStyle],
    current: Mapping[str, int] | None = None,
) -> None:
    """Draw goals as ringed discs; numbered in the order of visiting if a robot has several.

    Args:
        legend: Takes the legend entry.
        axes: Axes of the map.
        goals: Shape (G, 2), (G, 3) or one goal alone, by robot, metres, world frame.
        styles: Style by robot.
        current: Number of the goal that a robot heads for, from 1; its disc is filled.
    """
    for robot, given in goals.items():
        points = check_finite(
            np.atleast_2d(np.asarray(given)), f"goals of robot {robot!r}", (None, None)
        )[:, :2]
        color = styles[robot].color
        for number, point in enumerate(points, start=1):
            heads_for_it = current is not None and current.get(robot) == number
            ground, ink = (color, "white") if heads_for_it else ("white", color)
            axes.plot(*point, "o", mfc=ground, mec=color, mew=2.4, ms=13, zorder=7)
            axes.annotate(
                str(number) if len(points) > 1 else "",
                point,
                color=ink,
                fontsize=9,
                fontweight="bold",
                ha="center",
                va="center",
                zorder=7.5,
            )
        legend.entry("goal", mfc="white", mec="#404040", mew=2, marker="o", ls="", ms=10)
    if current:
        legend.entry("goal headed for", mfc="#404040", mec="#404040", marker="o", ls="", ms=11)
