"""A closed loop as MCAP with Foxglove's messages, as Foxglove and ROS tools read it.

Topics: ``/tf`` has frames "<robot>/estimate" and "<robot>/truth" in the frame "map";
``/<robot>/estimate`` and ``/<robot>/truth`` the same as poses; ``/scene`` everything drawn;
``/metrics`` numbers as JSON with a schema. Stamps are seconds since the start. Needs the extra
``mcap``.
"""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fgplan.closed_loop.records import LoopHistory
from fgplan.errors import MissingExtraError
from fgplan.typing import FloatArray
from fgplan.viz.recording.loop_layers import (
    FRAME,
    Layers,
    LineLayer,
    PointLayer,
    loop_layers,
    static_layers,
)
from roadmaps import Workspace

_NANOSECONDS = 1_000_000_000
_WIDTH_PX = 2.0
_POINT_SHARE = 0.008
"""Diameter of a point as a share of the longer side of all goals and landmarks."""

_METRICS_SCHEMA = {
    "title": "fgplan.Metrics",
    "description": "Numbers of a closed loop; by robot or evaluator. Metres and seconds.",
    "type": "object",
    "properties": {
        "step": {"type": "integer"},
        "time_s": {"type": "number"},
        "sigma_m": {"type": "object", "additionalProperties": {"type": "number"}},
        "error_m": {"type": "object", "additionalProperties": {"type": "number"}},
        "planning_s": {"type": "object", "additionalProperties": {"type": "number"}},
        "objective": {"type": "number"},
    },
}


def record_mcap(
    history: LoopHistory, path: str | Path, *, workspace: Workspace | None = None
) -> Path:
    """Write a recording for Foxglove.

    Args:
        history: The loop; at least one step.
        path: File to write; replaced if it is there.
        workspace: Bounds and obstacles, or None.

    Returns:
        The path.

    Raises:
        InvalidInputError: If there is no step, or a step lacks a robot; no file is made then.
        MissingExtraError: If foxglove-sdk is not installed.
    """
    try:
        foxglove = importlib.import_module("foxglove")
        channels = importlib.import_module("foxglove.channels")
        messages = importlib.import_module("foxglove.messages")
    except ImportError as error:
        raise MissingExtraError(
            f".mcap recordings need foxglove-sdk, which could not be imported ({error}); install "
            "the extra: pip install 'fgplan[mcap]'"
        ) from error
    told = (static_layers(history, workspace), *loop_layers(history))
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    context = foxglove.Context()
    scene = _Scene(messages, _point_size(history))
    frames = channels.FrameTransformsChannel("/tf", context=context)
    drawn = channels.SceneUpdateChannel("/scene", context=context)
    metrics = foxglove.Channel("/metrics", schema=_METRICS_SCHEMA, context=context)
    poses = {
        f"{robot}/{kind}": channels.PoseInFrameChannel(f"/{robot}/{kind}", context=context)
        for robot in history.robots
        for kind in ("estimate", "truth")
    }
    with foxglove.open_mcap(path, context=context, allow_overwrite=True):
        for layers in told:
            stamp = round(layers.time_s * _NANOSECONDS)
            if layers.lines or layers.points:
                drawn.log(scene.update(layers), log_time=stamp)
            if layers.poses:
                frames.log(scene.transforms(layers), log_time=stamp)
            for name, pose in layers.poses.items():
                poses[name].log(scene.pose(pose, layers), log_time=stamp)
            if layers.numbers:
                metrics.log(_metrics(layers), log_time=stamp)
    return path


class _Scene:
    """Layers as Foxglove's messages."""

    def __init__(self, messages: Any, point_size_m: float) -> None:  # noqa: ANN401
        self._messages = messages
        self._point_size_m = point_size_m

    def update(self, layers: Layers) -> Any:  # noqa: ANN401
        """All lines and points; an entity of the same id replaces the one before."""
        entities = [self._entity(layers, n, lines=self._lines(e)) for n, e in layers.lines.items()]
        entities += [self._entity(layers, n, **self._marks(e)) for n, e in layers.points.items()]
        return self._messages.SceneUpdate(entities=entities)

    def transforms(self, layers: Layers) -> Any:  # noqa: ANN401
        """Frames of the robots."""
        made = [
            self._messages.FrameTransform(
                timestamp=self._stamp(layers),
                parent_frame_id=FRAME,
                child_frame_id=name,
                translation=self._vector(pose[:3, 3]),
                rotation=self._quaternion(pose),
            )
            for name, pose in layers.poses.items()
        ]
        return self._messages.FrameTransforms(transforms=made)

    def pose(self, pose: FloatArray, layers: Layers) -> Any:  # noqa: ANN401
        """One pose in the frame of the map."""
        return self._messages.PoseInFrame(
            timestamp=self._stamp(layers), frame_id=FRAME, pose=self._plain_pose(pose)
        )

    def _entity(self, layers: Layers, name: str, **primitives: Any) -> Any:  # noqa: ANN401
        return self._messages.SceneEntity(
            timestamp=self._stamp(layers), frame_id=FRAME, id=name, **primitives
        )

    def _lines(self, layer: LineLayer) -> list[Any]:
        color = self._color(layer.color, layer.alpha)
        return [
            self._messages.LinePrimitive(
                type=self._messages.LinePrimitiveLineType.LineStrip,
                thickness=_WIDTH_PX,
                scale_invariant=True,
                points=[self._messages.Point3(x=x, y=y, z=z) for x, y, z in line.tolist()],
                color=color,
            )
            for line in layer.lines
        ]

    def _marks(self, layer: PointLayer) -> dict[str, list[Any]]:
        color = self._color(layer.color, 1.0)
        size = self._vector(np.full(3, self._point_size_m))
        places = [self._plain_pose(_at(point)) for point in layer.points]
        spheres = [
            self._messages.SpherePrimitive(pose=place, size=size, color=color) for place in places
        ]
        texts = [
            self._messages.TextPrimitive(
                pose=place,
                billboard=True,
                font_size=14,
                scale_invariant=True,
                color=color,
                text=text,
            )
            for place, text in zip(places, layer.labels, strict=False)
        ]
        return {"spheres": spheres, "texts": texts}

    def _plain_pose(self, pose: FloatArray) -> Any:  # noqa: ANN401
        return self._messages.Pose(
            position=self._vector(pose[:3, 3]), orientation=self._quaternion(pose)
        )

    def _vector(self, values: FloatArray) -> Any:  # noqa: ANN401
        x, y, z = values.tolist()
        return self._messages.Vector3(x=x, y=y, z=z)

    def _quaternion(self, pose: FloatArray) -> Any:  # noqa: ANN401
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        return self._messages.Quaternion(x=x, y=y, z=z, w=w)

    def _color(self, color: str, alpha: float) -> Any:  # noqa: ANN401
        red, green, blue = (byte / 255.0 for byte in bytes.fromhex(color.removeprefix("#")))
        return self._messages.Color(r=red, g=green, b=blue, a=alpha)

    def _stamp(self, layers: Layers) -> Any:  # noqa: ANN401
        whole, rest = divmod(round(layers.time_s * _NANOSECONDS), _NANOSECONDS)
        return self._messages.Timestamp(sec=whole, nsec=rest)


def _at(point: FloatArray) -> FloatArray:
    """The pose at a point without rotation."""
    pose = np.eye(4)
    pose[:3, 3] = point
    return pose


def _point_size(history: LoopHistory) -> float:
    """Diameter of points in metres: Foxglove's spheres have no size in pixels."""
    places = [np.atleast_2d(goals)[:, :2] for goals in history.goals.values()]
    places += [np.atleast_2d(where)[:, :2] for where in history.landmarks.values()]
    if not places:
        return 1.0
    stacked = np.concatenate(places)
    return _POINT_SHARE * (float(np.ptp(stacked, axis=0).max()) or 1.0)


def _metrics(layers: Layers) -> dict[str, Any]:
    """Numbers nested by the parts of their names."""
    told: dict[str, Any] = {"step": layers.step, "time_s": layers.time_s}
    for name, number in layers.numbers.items():
        group, _, of = name.partition("/")
        if of:
            told.setdefault(group, {})[of] = number
        else:
            told[group] = number
    return told
