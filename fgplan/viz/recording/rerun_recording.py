"""A closed loop as a recording for the Rerun viewer (.rrd); needs the extra ``rerun``.

Two time lines: "step" counts, "time" is seconds since the start. The map is a 3D view even of a
planar loop, because Rerun's 2D views have y down.
"""

import importlib
from pathlib import Path
from typing import Any

from fgplan.closed_loop.records import LoopHistory
from fgplan.errors import MissingExtraError
from fgplan.viz.palette import robot_styles
from fgplan.viz.recording.loop_layers import FRAME, Layers, loop_layers, static_layers
from roadmaps import Workspace

_LINE_UI = -2.0
_POINT_UI = -4.0
"""Radii below zero are in points of the screen."""


def record_rerun(
    history: LoopHistory, path: str | Path, *, workspace: Workspace | None = None
) -> Path:
    """Write a recording for Rerun.

    Args:
        history: The loop; at least one step.
        path: File to write; replaced if it is there.
        workspace: Bounds and obstacles, or None.

    Returns:
        The path.

    Raises:
        InvalidInputError: If there is no step, or a step lacks a robot; no file is made then.
        MissingExtraError: If rerun-sdk is not installed.
    """
    try:
        rr = importlib.import_module("rerun")
        blueprint = importlib.import_module("rerun.blueprint")
    except ImportError as error:
        raise MissingExtraError(
            f".rrd recordings need rerun-sdk, which could not be imported ({error}); install the "
            "extra: pip install 'fgplan[rerun]'"
        ) from error
    told = (static_layers(history, workspace), *loop_layers(history))
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with rr.RecordingStream("fgplan") as stream:
        stream.save(path, default_blueprint=_blueprint(blueprint))
        stream.send_recording_name(history.name)
        stream.set_log_time_enabled(False)
        stream.set_log_tick_enabled(False)
        stream.log(FRAME, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        _log_looks(rr, stream, history)
        for layers in told:
            stream.set_time("step", sequence=layers.step)
            stream.set_time("time", duration=layers.time_s)
            _log(rr, stream, layers)
    return path


def _log(rr: Any, stream: Any, layers: Layers) -> None:  # noqa: ANN401
    """Log all that is new."""
    for name, lines in layers.lines.items():
        color = _rgba(lines.color, lines.alpha)
        strips = rr.LineStrips3D(list(lines.lines), colors=[color], radii=[_LINE_UI / 2])
        stream.log(_path(name), strips)
    for name, points in layers.points.items():
        cloud = rr.Points3D(
            points.points,
            colors=[_rgba(points.color, 1.0)],
            radii=[_POINT_UI],
            labels=list(points.labels) or None,
        )
        stream.log(_path(name), cloud)
    for name, pose in layers.poses.items():
        stream.log(_path(name), rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
    for name, number in layers.numbers.items():
        stream.log(["metrics", *name.split("/")], rr.Scalars(number))


def _log_looks(rr: Any, stream: Any, history: LoopHistory) -> None:  # noqa: ANN401
    """How poses and curves of each robot look: its colour, the truth black."""
    styles = robot_styles(history.robots)
    for robot, style in styles.items():
        color = _rgba(style.color, 1.0)
        for name, look in (("estimate", color), ("truth", [0, 0, 0, 255])):
            body = rr.Points3D([[0.0, 0.0, 0.0]], colors=[look], radii=[2 * _POINT_UI])
            stream.log(_path(f"{robot}/{name}/body"), body, static=True)
        for metric in ("sigma_m", "error_m"):
            curve = rr.SeriesLines(colors=[color], names=[robot], widths=[2.0])
            stream.log(["metrics", metric, *robot.split("/")], curve, static=True)


def _blueprint(blueprint: Any) -> Any:  # noqa: ANN401
    """The map at the left, curves at the right, played along "time"."""
    curves = [
        blueprint.TimeSeriesView(origin="/metrics/sigma_m", name="position sigma (m)"),
        blueprint.TimeSeriesView(origin="/metrics/error_m", name="position error (m)"),
        blueprint.TimeSeriesView(origin="/metrics/planning_s", name="planning (s)"),
    ]
    view = blueprint.Spatial3DView(origin=f"/{FRAME}", name="map")
    return blueprint.Blueprint(
        blueprint.Horizontal(view, blueprint.Vertical(*curves), column_shares=[2, 1]),
        blueprint.TimePanel(timeline="time"),
    )


def _path(name: str) -> list[str]:
    """Entity path of a layer; parts in a list are escaped by Rerun."""
    return [FRAME, *name.split("/")]


def _rgba(color: str, alpha: float) -> list[int]:
    """A hexadecimal colour as bytes."""
    return [*bytes.fromhex(color.removeprefix("#")), round(255 * alpha)]
