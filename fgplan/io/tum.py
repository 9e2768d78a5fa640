"""TUM trajectories: one pose a line, ``t x y z qx qy qz qw``, the form that evo and others read.

Seconds, metres, the position and orientation of the body in the world frame. A planar pose
(x, y, heading) is written as the spatial one at height zero that is turned about z. Quaternions are
written with qw >= 0; numbers so that they are read back to the last bit.
"""

from dataclasses import dataclass
from pathlib import Path

import gtsam
import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.io.graph_text import (
    finite_numbers,
    number_text,
    spatial_numbers,
    spatial_pose,
    text_lines,
    write_text_lines,
)
from fgplan.models.pose import check_pose
from fgplan.typing import ArrayLike, FloatArray, Pose


@dataclass(frozen=True, slots=True, eq=False)
class TumTrajectory:
    """Poses in the order of the file.

    Attributes:
        times_s: Shape (n,), seconds.
        poses: Shape (n, 4, 4), ``wTr``, world frame, metres.
    """

    times_s: FloatArray
    poses: FloatArray

    def __post_init__(self) -> None:
        """Check the shapes."""
        times = check_finite(self.times_s, "trajectory times_s", (None,))
        poses = check_finite(self.poses, "trajectory poses", (len(times), 4, 4))
        object.__setattr__(self, "times_s", times)
        object.__setattr__(self, "poses", poses)


def read_tum(path: Path | str) -> TumTrajectory:
    """Read a TUM trajectory.

    Args:
        path: The file; empty lines and lines that begin with # say nothing.

    Returns:
        Times and poses. A quaternion whose length is within 1e-3 of one is scaled to one.

    Raises:
        ScenarioError: At the first line that has not eight finite numbers or whose quaternion is
            of another length; names file and line. Also if there is no pose.
    """
    times, poses = [], []
    for where, words in text_lines(Path(path)):
        if len(words) != 8:
            raise ScenarioError(
                f"{where}: pose: expected 8 numbers, t x y z qx qy qz qw, got {len(words)}"
            )
        stamp, *numbers = finite_numbers(where, "pose", words)
        times.append(stamp)
        poses.append(spatial_pose(where, "pose", numbers).matrix())
    if not times:
        raise ScenarioError(f"{path}: expected poses, got none; is it a TUM trajectory?")
    return TumTrajectory(np.array(times), np.array(poses))


def write_tum(path: Path | str, times_s: ArrayLike, poses: ArrayLike) -> None:
    """Write a TUM trajectory.

    Args:
        path: The file; overwritten.
        times_s: Shape (n,), seconds.
        poses: Shape (n, 3) planar or (n, 4, 4) spatial, world frame, metres and radians.

    Raises:
        InvalidInputError: If the shapes do not fit or a pose is no rigid motion.
        ScenarioError: If the file cannot be written.
    """
    times = check_finite(times_s, "trajectory times_s", (None,))
    try:
        given = np.asarray(poses, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"trajectory: expected poses as numbers, got {poses!r}") from error
    if given.shape not in ((len(times), 3), (len(times), 4, 4)) or not len(times):
        raise InvalidInputError(
            "trajectory: expected a time a pose and at least one, poses of shape (n, 3) or "
            f"(n, 4, 4), got {len(times)} times and poses of shape {given.shape}"
        )
    lines = []
    for index, (time_s, pose) in enumerate(zip(times, given, strict=True)):
        numbers = pose_numbers(check_pose(pose, f"trajectory pose {index}"))
        lines.append(number_text([time_s, *numbers], f"trajectory pose {index}"))
    write_text_lines(path, lines)


def spatial_matrix(pose: Pose) -> FloatArray:
    """A pose in space: shape (4, 4); a planar one at height zero, turned about z."""
    if pose.ndim == 2:
        return pose
    x, y, heading = pose
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    matrix[:2, 3] = x, y
    return matrix


def pose_numbers(pose: Pose) -> list[float]:
    """Position and unit quaternion of a pose: x y z qx qy qz qw with qw >= 0."""
    if pose.ndim == 1:  # exact about z
        half = 0.5 * np.arctan2(np.sin(pose[2]), np.cos(pose[2]))
        return [float(pose[0]), float(pose[1]), 0.0, 0.0, 0.0, np.sin(half), np.cos(half)]
    numbers = np.array(spatial_numbers(gtsam.Pose3(pose)))
    numbers[3:] *= np.copysign(1.0, numbers[6]) / np.linalg.norm(numbers[3:])
    return [float(number) for number in numbers]
