"""Covariances of poses as ROS writes them: fixed axes of the header's frame, position first.

fgplan, as GTSAM, moves a pose T = (R, t) by a tangent on the right, in the body's own frame:
Pose2 (v, w) in the order x, y, heading; Pose3 (w, v), rotation first. To first order

    t' = t + R v            R' = R exp(w^) = exp((R w)^) R

so in the frame of the header (the world, "map") the position moves by R v and the body turns by R w
about the fixed axes. geometry_msgs/PoseWithCovariance wants (x, y, z, rotation about X, about Y,
about Z) in that order, fixed axes, 6 x 6 by rows:

    spatial   J = [0 R; R 0]            planar   J = [R 0; 0 1] into rows and columns 0, 1, 5
    covariance for ROS = J S J'

In the plane z and the rotations about X and Y are not estimated: their rows are zero. Small
rotations about fixed axes add up, so no order of roll, pitch and yaw is meant.
"""

import numpy as np

from fgplan.checks import check_finite
from fgplan.models.pose import check_pose, rotation_matrix, tangent_dim
from fgplan.typing import ArrayLike, Covariance, FloatArray, Pose

ROS_ORDER = ("x", "y", "z", "rotation_x", "rotation_y", "rotation_z")
"""Rows of a spatial covariance; a planar one has x, y and rotation_z."""

PLANAR_ROWS = [0, 1, 5]
"""Rows of ROS's six that a planar pose has."""


def ros_jacobian(pose: Pose) -> FloatArray:
    """Derivative of (position, rotation about fixed axes), world frame, by the pose's tangent.

    Args:
        pose: Shape (3,) or (4, 4), world frame.

    Returns:
        Shape (3, 3), rows x, y, rotation_z; or (6, 6), rows ``ROS_ORDER``.
    """
    size, rotation = tangent_dim(pose), rotation_matrix(pose)
    jacobian = np.zeros((size, size))
    if size == 3:
        jacobian[:2, :2] = rotation
        jacobian[2, 2] = 1.0
    else:
        jacobian[:3, 3:] = rotation
        jacobian[3:, :3] = rotation
    return jacobian


def map_covariance(pose: ArrayLike, covariance: ArrayLike) -> Covariance:
    """Covariance of a pose in the world frame, position first.

    Args:
        pose: Shape (3,) or (4, 4), world frame.
        covariance: Tangent of the pose, GTSAM's order, shape (3, 3) or (6, 6).

    Returns:
        Shape (3, 3), rows x, y, rotation_z; or (6, 6), rows ``ROS_ORDER``.

    Raises:
        InvalidInputError: If the shapes do not fit.
    """
    where = check_pose(pose, "pose")
    size = tangent_dim(where)
    jacobian = ros_jacobian(where)
    return jacobian @ check_finite(covariance, "covariance", (size, size)) @ jacobian.T


def ros_covariance(pose: ArrayLike, covariance: ArrayLike) -> Covariance:
    """Covariance of a pose as geometry_msgs/PoseWithCovariance has it, not yet flattened.

    Args:
        pose: Shape (3,) or (4, 4), world frame.
        covariance: Tangent of the pose, GTSAM's order, shape (3, 3) or (6, 6).

    Returns:
        Shape (6, 6), rows ``ROS_ORDER``; ``reshape(-1)`` is the message's field.

    Raises:
        InvalidInputError: If the shapes do not fit.
    """
    found = map_covariance(pose, covariance)
    if len(found) == 6:
        return found
    full = np.zeros((6, 6))
    full[np.ix_(PLANAR_ROWS, PLANAR_ROWS)] = found
    return full
