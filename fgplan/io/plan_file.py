"""``plans.json``: what each robot is to do, in the shape of ROS messages.

    {"schema": "plans.v1", "convention": "...", "plans": [
      {"robot": "ann",
       "path": {"header": HEADER, "poses": [{"header": HEADER, "pose": POSE}, ...]},
       "covariances": [[36 numbers], ...]}, ...]}

    HEADER  {"stamp": {"sec": 12, "nanosec": 500000000}, "frame_id": "map"}
    POSE    {"position": {"x", "y", "z"}, "orientation": {"x", "y", "z", "w"}}

``path`` is a nav_msgs/Path field by field, so that
``rosidl_runtime_py.set_message_fields(Path(), plan["path"])`` fills the message. ``covariances``
holds one geometry_msgs/PoseWithCovariance.covariance a pose (fgplan/io/ros_covariance.py says of
which frame and order), none where the planner computes none. The stamp is when the robot is to be
there: that of the plan's beginning plus the time along the path; the header of the path has the
beginning. Times are kept to a nanosecond.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.io.graph_text import spatial_pose
from fgplan.io.plain_value import plain_value
from fgplan.io.result_file import replace_file
from fgplan.io.ros_covariance import ros_covariance
from fgplan.io.tum import pose_numbers, spatial_matrix
from fgplan.planners.plan import Plan
from fgplan.typing import FloatArray

PLAN_FILE_SCHEMA = "plans.v1"
PLANS = "plans.json"
"""Name of the file in a run folder."""

FRAME_ID = "map"
"""Frame of everything that fgplan plans: the world."""

CONVENTION = (
    "path: nav_msgs/Path. covariances: geometry_msgs/PoseWithCovariance.covariance, one a pose: "
    "6 x 6 by rows, order x y z rotation_x rotation_y rotation_z about the fixed axes of frame_id; "
    "metres, radians, seconds; a planar robot has zeros for z, rotation_x and rotation_y"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedTrajectory:
    """What one robot is to do.

    Attributes:
        robot: Name.
        frame_id: Frame of poses and covariances.
        start_s: When the plan begins, seconds.
        times_s: When the robot is to be at each pose, shape (n,), seconds.
        poses: Shape (n, 4, 4).
        covariances: Shape (n, 6, 6), ROS order and frame; (0, 6, 6) where none were computed.
    """

    robot: str
    frame_id: str
    start_s: float
    times_s: FloatArray
    poses: FloatArray
    covariances: FloatArray

    def __post_init__(self) -> None:
        """Check shapes."""
        name = f"trajectory of robot {self.robot!r}"
        times = check_finite(self.times_s, f"{name}: times_s", (None,))
        poses = check_finite(self.poses, f"{name}: poses", (len(times), 4, 4))
        covariances = check_finite(self.covariances, f"{name}: covariances", (None, 6, 6))
        if len(covariances) not in (0, len(times)):
            raise InvalidInputError(
                f"{name}: expected {len(times)} covariances or none, got {len(covariances)}"
            )
        for field, value in (("times_s", times), ("poses", poses), ("covariances", covariances)):
            object.__setattr__(self, field, value)


def planned_trajectories(plan: Plan, start_s: float = 0.0) -> tuple[PlannedTrajectory, ...]:
    """Trajectories of a plan, in the frame and order of ROS.

    Args:
        plan: The plan.
        start_s: When it begins, seconds: the stamp of every robot's first pose (after a past the
            latest of their last stamps, ``plan_start_s``).

    Returns:
        One a robot, in the order of the team; a robot that stays has its current pose alone.
    """
    found = []
    for item in plan.robots:
        times = np.zeros(1) if item.path is None else np.asarray(item.path.times_s)
        covariances = [
            ros_covariance(pose, covariance)
            for pose, covariance in zip(item.poses, item.covariances, strict=False)
        ]
        found.append(
            PlannedTrajectory(
                robot=item.robot,
                frame_id=FRAME_ID,
                start_s=start_s,
                times_s=start_s + times,
                poses=np.array([spatial_matrix(pose) for pose in item.poses]),
                covariances=np.array(covariances).reshape(-1, 6, 6),
            )
        )
    return tuple(found)


def write_plans(path: Path | str, plan: Plan, start_s: float = 0.0) -> Path:
    """Write a plan in the shape of ROS messages.

    Args:
        path: The file; overwritten.
        plan: The plan.
        start_s: When it begins, seconds.

    Returns:
        The file.

    Raises:
        InvalidInputError: If it cannot be written.
    """
    content = {
        "schema": PLAN_FILE_SCHEMA,
        "convention": CONVENTION,
        "plans": [_plan_data(item) for item in planned_trajectories(plan, start_s)],
    }
    replace_file(Path(path), msgspec.json.encode(plain_value(content)))
    return Path(path)


def read_plans(path: Path | str) -> tuple[PlannedTrajectory, ...]:
    """Read ``plans.json``.

    Args:
        path: The file.

    Returns:
        One trajectory a robot, in the order of the file.

    Raises:
        InvalidInputError: If it is no such file, or a field is missing or malformed.
    """
    try:
        content = msgspec.json.decode(Path(path).read_bytes())
        if content["schema"] != PLAN_FILE_SCHEMA:
            raise InvalidInputError(
                f"{path}: schema: expected {PLAN_FILE_SCHEMA!r}, got {content['schema']!r}"
            )
        return tuple(_trajectory(Path(path), item) for item in content["plans"])
    except InvalidInputError:
        raise
    except (OSError, msgspec.DecodeError, KeyError, TypeError, ValueError) as error:
        raise InvalidInputError(
            f"{path}: expected plans as fgplan run writes them: {type(error).__name__}: {error}"
        ) from error


def _plan_data(item: PlannedTrajectory) -> dict[str, Any]:
    """One robot's plan as plain data."""
    poses = []
    for time_s, pose in zip(item.times_s, item.poses, strict=True):
        numbers = pose_numbers(pose)
        poses.append(
            {
                "header": _header(float(time_s), item.frame_id),
                "pose": {
                    "position": dict(zip("xyz", numbers[:3], strict=True)),
                    "orientation": dict(zip("xyzw", numbers[3:], strict=True)),
                },
            }
        )
    return {
        "robot": item.robot,
        "path": {"header": _header(item.start_s, item.frame_id), "poses": poses},
        "covariances": item.covariances.reshape(-1, 36),
    }


def _header(time_s: float, frame_id: str) -> dict[str, Any]:
    """A std_msgs/Header."""
    seconds, nanoseconds = divmod(round(time_s * 1e9), 10**9)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}


def _seconds(header: Mapping[str, Any]) -> float:
    """Time of a header."""
    return float(header["stamp"]["sec"]) + 1e-9 * float(header["stamp"]["nanosec"])


def _trajectory(path: Path, item: Mapping[str, Any]) -> PlannedTrajectory:
    """One robot's plan of plain data."""
    robot, stated = item["robot"], item["path"]
    frames = {
        stated["header"]["frame_id"],
        *(pose["header"]["frame_id"] for pose in stated["poses"]),
    }
    if len(frames) != 1:
        raise InvalidInputError(
            f"{path}: robot {robot!r}: expected one frame_id, got {', '.join(sorted(frames))}"
        )
    poses = []
    for place, stamped in enumerate(stated["poses"]):
        position, orientation = stamped["pose"]["position"], stamped["pose"]["orientation"]
        numbers = [position[axis] for axis in "xyz"] + [orientation[axis] for axis in "xyzw"]
        poses.append(spatial_pose(f"{path}: robot {robot!r}", f"pose {place}", numbers).matrix())
    return PlannedTrajectory(
        robot=robot,
        frame_id=frames.pop(),
        start_s=_seconds(stated["header"]),
        times_s=np.array([_seconds(stamped["header"]) for stamped in stated["poses"]]),
        poses=np.array(poses),
        covariances=np.array(item["covariances"], dtype=np.float64).reshape(-1, 6, 6),
    )
