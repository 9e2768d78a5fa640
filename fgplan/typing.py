"""Array names used in signatures.

Metres, radians and seconds throughout. A pose is an array: shape (3,) holds (x, y, heading) of a
planar robot in the world frame; shape (4, 4) holds the homogeneous matrix ``wTr`` of a robot in
space. Tangents follow GTSAM: increments act on the right, planar order (x, y, heading), spatial
order (rotation, translation).
"""

from collections.abc import Hashable

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Pose = FloatArray
Covariance = FloatArray
InformationMatrix = FloatArray
Jacobian = FloatArray

Key = int
"""A GTSAM key."""

__all__ = [
    "ArrayLike",
    "BoolArray",
    "Covariance",
    "FloatArray",
    "Hashable",
    "InformationMatrix",
    "IntArray",
    "Jacobian",
    "Key",
    "Pose",
]
