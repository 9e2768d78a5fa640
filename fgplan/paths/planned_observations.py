"""Which mapped landmarks would be observed from the poses of a path.

A landmark is planned to be observed from every pose after the first from which a sensor of the
robot sees it: range and field of view by the sensor, line of sight by the workspace.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import cKDTree

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.models.pose import position
from fgplan.models.sensor import AbstractSensor, SightLines
from fgplan.paths.candidate_path import Observation
from fgplan.typing import ArrayLike, Covariance, FloatArray, Key, Pose

Seen = list[tuple[Key, str, Covariance]]
"""Landmark, sensor and noise of what is seen from one pose."""


def planned_observations(
    poses: Sequence[FloatArray],
    sensors: Mapping[str, AbstractSensor],
    landmarks: Mapping[Key, ArrayLike],
    workspace: SightLines | None = None,
) -> list[tuple[Observation, ...]]:
    """Find what would be observed along some paths.

    Args:
        poses: Of each path, shape (L + 1, 3) or (L + 1, 4, 4), world frame.
        sensors: Sensors that the robot carries, by their names in the planning problem.
        landmarks: Position of each mapped landmark, shape (2,) or (3,), metres, world frame.
        workspace: What blocks the view; None blocks nothing.

    Returns:
        Observations of each path, by step, then sensor, then landmark in the given order.

    Raises:
        InvalidInputError: If a landmark or pose is not finite, or a landmark has another size.
    """
    if not sensors or not landmarks or not poses:
        return [()] * len(poses)
    points = {
        key: check_finite(point, f"landmark {key}", (None,)) for key, point in landmarks.items()
    }
    for key, point in points.items():
        if point.size not in (2, 3):
            raise InvalidInputError(
                f"landmark {key}: expected 2 or 3 coordinates, got {point.size}"
            )
    # Paths share most states: each distinct pose is looked at once.
    distinct = {state.tobytes(): state for path in poses for state in path[1:]}
    found = _seen_landmarks(list(distinct.values()), sensors, points, workspace)
    seen = dict(zip(distinct, found, strict=True))
    return [
        tuple(
            Observation(step=step, landmark=key, sensor=name, covariance=covariance)
            for step, state in enumerate(path[1:], start=1)
            for key, name, covariance in seen[state.tobytes()]
        )
        for path in poses
    ]


def _seen_landmarks(
    poses: Sequence[Pose],
    sensors: Mapping[str, AbstractSensor],
    landmarks: Mapping[Key, FloatArray],
    workspace: SightLines | None,
) -> list[Seen]:
    """Landmarks seen from each pose: by range from a tree, then by the sensor, then by sight."""
    keys = list(landmarks)
    flat = np.array([landmarks[key][:2] for key in keys])
    where = np.array([position(pose)[:2] for pose in poses]).reshape(-1, 2)
    check_finite(where, "positions of planned poses", (None, 2))
    tree = cKDTree(flat)
    pairs: list[tuple[int, int, str]] = []
    for name, sensor in sensors.items():
        if np.isfinite(sensor.max_range_m):
            reach = sensor.max_range_m * (1.0 + 1e-9)  # the sensor itself decides at the edge
            near = tree.query_ball_point(where, reach, return_sorted=True)
        else:
            near = [range(len(keys))] * len(poses)
        pairs += [
            (place, index, name)
            for place, indices in enumerate(near)
            for index in indices
            if sensor.visible(poses[place], landmarks[keys[index]])
        ]
    if workspace is not None and pairs:
        starts = where[[pair[0] for pair in pairs]]
        ends = flat[[pair[1] for pair in pairs]]
        free = workspace.has_line_of_sight(starts, ends)
        pairs = [pair for pair, in_sight in zip(pairs, free.tolist(), strict=True) if in_sight]
    seen: list[Seen] = [[] for _ in poses]
    for place, index, name in pairs:
        key = keys[index]
        noise = sensors[name].noise(poses[place], landmarks[key])
        seen[place].append((key, name, noise))
    return seen
