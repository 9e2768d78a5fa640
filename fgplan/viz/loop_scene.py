"""One frame of a closed loop: the map as it is at a step, and position uncertainty beside it.

All artists are made once and filled anew for each frame, so that a frame is a function of the
moment alone and frames may be drawn in any order.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fgplan.closed_loop.records import LoopHistory, SessionRecord
from fgplan.typing import FloatArray
from fgplan.viz.ellipse import ellipse_outlines, magnification_to_see
from fgplan.viz.figure import matplotlib_module, new_figure
from fgplan.viz.loop_tracks import first_seen, loop_extent, loop_tracks, true_landmarks
from fgplan.viz.map_drawing import (
    Legend,
    draw_goals,
    draw_workspace,
    draw_world,
    path_positions,
    state_position,
)
from fgplan.viz.palette import LANDMARK, UNCHANGED, robot_styles
from roadmaps import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.legend import Legend as MatplotlibLegend

WIDTH_PX, HEIGHT_PX = 800, 600
_SIGMAS = 3.0
_VISIBLE = 0.03
_TRUE_DASH = (0, (4.0, 2.5))
_LEFT_PX, _BOTTOM_PX, _TOP_PX, _RIGHT_PX, _GAP_PX = 56, 44, 30, 12, 66
_CURVE_PX = 250
"""Least width of the curves beside the map."""
_LEGEND_SIZE = 7.5
"""Size of the legend's letters where there is room for them."""


Box = tuple[float, float, float, float]
"""Left, bottom, width and height."""


@dataclass(frozen=True, slots=True)
class Moment:
    """What a frame shows.

    Attributes:
        place: Place of the step record.
        session: Place of the planning session whose paths are drawn; -1 before the first.
        candidates: Opacity of its candidate paths, 0 to 1.
        chosen: Whether its chosen paths are drawn.
        planning: Whether the session is being held: its multi-robot factors are drawn then.
    """

    place: int
    session: int
    candidates: float
    chosen: bool
    planning: bool


class LoopScene:
    """A figure that shows any moment of a closed loop.

    Args:
        history: The loop; at least one step.
        workspace: Bounds and obstacles; None takes the extent of all there is in the loop.
        dpi: Dots an inch of a figure of 8 by 6 inches.

    Raises:
        InvalidInputError: If there is no step.
        MissingExtraError: If matplotlib is not installed.
    """

    def __init__(
        self, history: LoopHistory, workspace: Workspace | None = None, dpi: int = 100
    ) -> None:
        self._history = history
        self._tracks = loop_tracks(history)
        self._styles = robot_styles(history.robots)
        lower, upper = loop_extent(history, workspace)
        every = np.concatenate(list(self._tracks.covariances.values()))
        span = float((upper - lower).max())
        self._larger = magnification_to_see(every, _SIGMAS, span, _VISIBLE)
        self._first_seen = first_seen(history)
        self.figure = new_figure(WIDTH_PX, HEIGHT_PX, lays_itself_out=False)
        self.figure.set_dpi(dpi)
        self._map, self._curve = self._place_axes(lower, upper)
        self._legend = Legend()
        self._name_marks()
        self._draw_world(workspace)
        self._robots = {robot: self._robot_artists(robot) for robot in history.robots}
        self._make_curves()
        self._mapped = self._map.plot([], [], "+", color=LANDMARK, ms=6, mew=1.1, zorder=3)[0]
        lines = matplotlib_module("collections").LineCollection
        self._seen = lines([], colors=UNCHANGED, linewidths=0.8, alpha=0.8, zorder=3.2)
        self._joined = lines([], colors=UNCHANGED, linewidths=0.7, alpha=0.45, zorder=3.1)
        for one in (self._seen, self._joined):
            self._map.add_collection(one, autolim=False)
        self._clock = self.figure.text(
            _LEFT_PX / WIDTH_PX, 1 - 20 / HEIGHT_PX, "", fontsize=10, fontweight="bold"
        )
        self._put_legend()

    def pixels(self, moment: Moment) -> Any:  # noqa: ANN401
        """Draw a moment.

        Args:
            moment: What to show.

        Returns:
            Shape (height, width, 3), uint8; a copy.
        """
        record = self._history.steps[moment.place]
        session = self._history.sessions[moment.session] if moment.session >= 0 else None
        for robot, artists in self._robots.items():
            self._set_robot(robot, artists, moment, session)
        mapped = [
            self._history.landmarks[key][:2]
            for key, step in self._first_seen.items()
            if step <= record.step and key in self._history.landmarks
        ]
        self._mapped.set_data(*np.array(mapped).reshape(-1, 2).T)
        self._seen.set_segments(self._sight_lines(moment.place))
        holds = session is not None and moment.planning and moment.chosen
        joined = session.joined if session is not None and holds else ()
        self._joined.set_segments(
            [[state_position(one), state_position(other)] for one, other in joined]
        )
        self._now.set_xdata([record.time_s, record.time_s])
        number = 0 if session is None else session.session
        doing = "  planning" if moment.planning else ""
        self._clock.set_text(
            f"t = {record.time_s:.0f} s   step {record.step}   session {number}{doing}"
        )
        self.figure.canvas.draw()
        return np.asarray(self.figure.canvas.buffer_rgba())[..., :3].copy()  # type: ignore[attr-defined]

    def _place_axes(self, lower: FloatArray, upper: FloatArray) -> tuple["Axes", "Axes"]:
        """A map of true proportions at the left, the curve in the room that it leaves."""
        size = upper - lower
        room = WIDTH_PX - _LEFT_PX - _RIGHT_PX - _GAP_PX - _CURVE_PX
        tall = HEIGHT_PX - _BOTTOM_PX - _TOP_PX
        scale = min(room / size[0], tall / size[1])
        width, height = scale * size
        floor = _BOTTOM_PX + tall - height
        left = self.figure.add_axes(_share(_LEFT_PX, floor, width, height))
        left.set_xlim(lower[0], upper[0])
        left.set_ylim(lower[1], upper[1])
        start = _LEFT_PX + width + _GAP_PX
        right = self.figure.add_axes(
            _share(start, 0.5 * HEIGHT_PX, WIDTH_PX - start - _RIGHT_PX, 0.5 * HEIGHT_PX - _TOP_PX)
        )
        left.set_xlabel("x (m)", fontsize=9)
        left.set_ylabel("y (m)", fontsize=9, labelpad=1)
        for axes in (left, right):
            axes.tick_params(labelsize=8)
        return left, right

    def _draw_world(self, workspace: Workspace | None) -> None:
        """What stays as it is: bounds, obstacles, landmarks, goals."""
        draw_goals(self._legend, self._map, self._history.goals, self._styles)
        draw_world(self._legend, self._map, true_landmarks(self._history))
        if workspace is not None:
            draw_workspace(self._legend, self._map, workspace)

    def _robot_artists(self, robot: str) -> dict[str, Any]:
        """Everything of one robot that changes."""
        color = self._styles[robot].color
        lines = matplotlib_module("collections").LineCollection
        paths = lines([], colors=color, linewidths=1.0, zorder=2)
        self._map.add_collection(paths, autolim=False)
        fill = matplotlib_module("patches").Polygon(
            np.zeros((1, 2)), fc=(*matplotlib_module("colors").to_rgb(color), 0.2), ec=color, lw=1.2
        )
        fill.set_zorder(7.6)
        self._map.add_patch(fill)
        plot = self._map.plot
        return {
            "candidates": paths,
            "ellipse": fill,
            "chosen": plot([], [], ls=":", color=color, lw=2.0, zorder=2.5)[0],
            "trail": plot([], [], color=color, lw=1.8, zorder=5)[0],
            "true_trail": plot([], [], color="black", ls=_TRUE_DASH, lw=0.8, zorder=5.5)[0],
            "truth": plot([], [], "x", color="black", ms=5, mew=1.2, zorder=7.8)[0],
            "here": plot([], [], "o", color=color, mec="white", mew=0.8, ms=8, zorder=7.7)[0],
        }

    def _set_robot(
        self,
        robot: str,
        artists: dict[str, Any],
        moment: Moment,
        session: SessionRecord | None,
    ) -> None:
        """Put one robot where it is."""
        upto = slice(0, moment.place + 1)
        here = self._tracks.positions[robot][upto]
        true = self._tracks.true_positions[robot][upto]
        artists["trail"].set_data(*here.T)
        artists["true_trail"].set_data(*true.T)
        artists["here"].set_data(*here[-1:].T)
        artists["truth"].set_data(*true[-1:].T)
        covariance = self._tracks.covariances[robot][moment.place]
        outline = ellipse_outlines(here[-1:], covariance[None], _SIGMAS * self._larger)
        artists["ellipse"].set_xy(outline[0])
        paths = () if session is None else session.candidates.get(robot, ())
        shown = moment.candidates > 0
        artists["candidates"].set_segments(
            [path_positions(path) for path in paths] if shown else []
        )
        artists["candidates"].set_alpha(moment.candidates)
        path = None if session is None or not moment.chosen else session.chosen.get(robot)
        where = np.zeros((0, 2)) if path is None else path_positions(path)
        artists["chosen"].set_data(*where.T)
        sigma = np.sqrt(self._tracks.traces[robot][upto])
        self._sigmas[robot].set_data(self._tracks.times_s[upto], sigma)

    def _make_curves(self) -> None:
        """Axes of the curves, fixed for all frames."""
        axes, times = self._curve, self._tracks.times_s
        self._sigmas = {
            robot: axes.plot([], [], color=style.color, ls=style.dash, lw=1.6)[0]
            for robot, style in self._styles.items()
        }
        most = max(float(np.sqrt(each.max())) for each in self._tracks.traces.values())
        axes.set_xlim(times[0], times[-1] if times[-1] > times[0] else times[0] + 1.0)
        axes.set_ylim(0.0, 1.08 * most or 1.0)
        for session in self._history.sessions:
            axes.axvline(session.time_s, color="#B0B0B0", ls=":", lw=1.0)
        self._now = axes.axvline(times[0], color="#404040", lw=0.8)
        axes.set_xlabel("time (s)", fontsize=9)
        axes.set_title("position σ: root of trace (m)", fontsize=10)
        axes.grid(axis="y", color="#E8E8E8", lw=0.6)

    def _name_marks(self) -> None:
        """What the marks that change mean."""
        entry = self._legend.entry
        for robot, style in self._styles.items():
            entry(robot, color=style.color, ls=style.dash, lw=2, marker="o", mec="white")
        entry("estimated way", color="#404040", lw=1.8)
        entry("true way", color="black", ls=_TRUE_DASH, lw=0.8, marker="x", ms=5)
        entry("candidate path", color="#404040", lw=1.0, alpha=0.5)
        entry("chosen path", color="#404040", ls=":", lw=2.0)
        larger = f", {self._larger}× larger" if self._larger != 1 else ""
        label = f"{_SIGMAS:g}σ ellipse{larger}"
        entry(label, ls="", marker="o", mfc="#DDDDDD", mec="#404040", ms=10)
        entry("landmark in the map", ls="", marker="+", color=LANDMARK, ms=7)
        entry("measurement, factor", color=UNCHANGED, lw=1.2)

    def _put_legend(self) -> None:
        """Put the legend under the curves, in smaller letters where it would be cut off."""
        legend = self._make_legend(_LEGEND_SIZE)
        box, page = legend.get_window_extent(), self.figure.bbox
        fits = min((page.x1 - box.x0) / box.width, (box.y1 - page.y0) / box.height)
        if fits < 1.0:
            legend.remove()
            self._make_legend(0.98 * fits * _LEGEND_SIZE)

    def _make_legend(self, size: float) -> "MatplotlibLegend":
        """The legend in letters of a size."""
        left = self._curve.get_position().x0 - 36 / WIDTH_PX
        return self.figure.legend(
            list(self._legend.entries.values()),
            list(self._legend.entries),
            loc="upper left",
            bbox_to_anchor=(left, 0.5 - 44 / HEIGHT_PX),
            ncols=2,
            fontsize=size,
            frameon=False,
            columnspacing=0.8,
            handlelength=1.5,
            handletextpad=0.5,
        )

    def _sight_lines(self, place: int) -> list[FloatArray]:
        """True positions of who measures and what is measured, at one step."""
        lines = []
        for one in self._history.steps[place].measurements:
            start = self._tracks.true_positions[one.robot][place]
            if one.kind == "landmark" and one.target in self._history.landmarks:
                lines.append(np.stack([start, self._history.landmarks[int(one.target)][:2]]))
            elif one.kind == "robot" and one.target in self._tracks.true_positions:
                lines.append(np.stack([start, self._tracks.true_positions[str(one.target)][place]]))
        return lines


def _share(left: float, bottom: float, width: float, height: float) -> Box:
    """A box in pixels as shares of the figure."""
    return (left / WIDTH_PX, bottom / HEIGHT_PX, width / WIDTH_PX, height / HEIGHT_PX)
