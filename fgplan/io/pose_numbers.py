"""Poses as scenario files write them: [x, y, heading], or [x, y, z, qx, qy, qz, qw] as in TUM."""

import gtsam
import numpy as np

from fgplan.io.place import Place

MOST_HEADING_RAD = 4.0 * np.pi
"""A heading beyond two turns is taken for one in degrees."""

_UNIT_TOLERANCE = 1e-3


def gtsam_pose(numbers: tuple[float, ...], place: Place) -> gtsam.Pose2 | gtsam.Pose3:
    """Make a GTSAM pose from a scenario's numbers.

    Args:
        numbers: 3 or 7 numbers, metres and radians.
        place: Where they are, for messages.

    Returns:
        The pose ``wTr``.

    Raises:
        ScenarioError: If there are neither 3 nor 7, a heading cannot be radians, or the quaternion
            is not of unit length.
    """
    if len(numbers) == 3:
        if abs(numbers[2]) > MOST_HEADING_RAD:
            raise place.error(
                f"expected a heading within two turns, radians, got {numbers[2]:g}; is it in "
                "degrees?"
            )
        return gtsam.Pose2(*numbers)
    if len(numbers) != 7:
        raise place.error(
            f"expected [x, y, heading] or [x, y, z, qx, qy, qz, qw], got {len(numbers)} numbers"
        )
    quaternion = np.array(numbers[3:])
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise place.error(f"expected a quaternion of length one, got {length:.6g}")
    x, y, z, w = quaternion / length
    return gtsam.Pose3(gtsam.Rot3.Quaternion(w, x, y, z), np.array(numbers[:3]))
