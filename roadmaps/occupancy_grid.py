"""Occupancy grids: square cells that are free, occupied or unknown.

Row 0 is the row of least y in the grid's frame and column 0 that of least x, as in ROS's
`nav_msgs/OccupancyGrid`; the readers flip image files, whose first row is the top one. With the
grid's origin o (the outer corner of cell (0, 0)), yaw and resolution s, position p is in cell

    (column, row) = floor(R(yaw)^T (p - o) / s)

Everything outside the grid is unknown.

Robot radius: a cell is blocked iff a robot of that radius, standing at its centre, touches a
blocking cell (closed square). The nearest point of another cell's square is one of its corners
or edge midpoints, so a distance transform on the grid of half cells gives this exactly. Away
from its cell's centre, by at most half a diagonal, a robot may be that much nearer.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from roadmaps.checks import as_position, as_positions, check_non_negative, check_positive
from roadmaps.errors import ParameterError, WorkspaceError
from roadmaps.typing import BoolArray, FloatArray, IntArray

FREE, OCCUPIED, UNKNOWN = 0, 100, -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OccupancyGrid:
    """A map of square cells.

    Attributes:
        occupancy: 0 free, 100 occupied, -1 unknown; shape (rows, columns), row 0 at least y.
        resolution_m: Side of a cell, metres.
        origin: Outer corner of cell (0, 0), shape (2,), metres, world frame.
        yaw_rad: Rotation of the grid's frame in the world, radians, about `origin`.

    Raises:
        WorkspaceError: If the array is empty, not two-dimensional or has other values, or the
            origin or yaw is not finite.
        ParameterError: If the resolution is not positive.
    """

    occupancy: np.ndarray
    resolution_m: float
    origin: FloatArray
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        given = np.asarray(self.occupancy)
        if given.ndim != 2 or given.size == 0:
            raise WorkspaceError(
                f"occupancy: expected shape (rows, columns), both at least 1, got {given.shape}"
            )
        if not np.isin(given, (FREE, OCCUPIED, UNKNOWN)).all():
            raise WorkspaceError(
                "occupancy: expected only 0 (free), 100 (occupied) and -1 (unknown), got "
                f"{np.unique(given)[:5].tolist()}...; threshold probabilities first"
            )
        check_positive(self.resolution_m, "resolution_m")
        try:
            origin = as_position(self.origin, 2, "origin").copy()
        except ParameterError as error:
            raise WorkspaceError(str(error)) from error
        if not np.isfinite(self.yaw_rad):
            raise WorkspaceError(f"yaw_rad: expected a finite angle, got {self.yaw_rad!r}")
        cells = np.array(given, dtype=np.int8, order="C")
        cells.flags.writeable = False
        origin.flags.writeable = False
        object.__setattr__(self, "occupancy", cells)
        object.__setattr__(self, "origin", origin)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.occupancy.shape[0], self.occupancy.shape[1]

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest world coordinates of the grid's corners, each (2,), metres."""
        rows, columns = self.shape
        corners = np.array([(0, 0), (columns, 0), (0, rows), (columns, rows)], dtype=np.float64)
        world = self.to_world(corners)
        return world.min(axis=0), world.max(axis=0)

    def to_cells(self, positions: ArrayLike) -> FloatArray:
        """Express world positions in cell units along columns and rows.

        Args:
            positions: Shape (n, 2) or (2,), metres, world frame.

        Returns:
            Column and row coordinates, not rounded, shape (n, 2); cell (0, 0) is [0, 1) x [0, 1).
        """
        offset = as_positions(positions, 2, "positions") - self.origin
        return np.asarray(offset @ self._rotation() / self.resolution_m)

    def to_world(self, coordinates: ArrayLike) -> FloatArray:
        """Express cell coordinates in the world; the inverse of `to_cells`.

        Args:
            coordinates: Column and row coordinates, shape (n, 2); a centre is at + 0.5.

        Returns:
            Positions, shape (n, 2), metres, world frame.
        """
        scaled = as_positions(coordinates, 2, "coordinates") * self.resolution_m
        return np.asarray(scaled @ self._rotation().T + self.origin)

    def centers(self, cells: IntArray) -> FloatArray:
        """Give the centres of cells.

        Args:
            cells: Column and row indices, shape (n, 2).

        Returns:
            Positions, shape (n, 2), metres, world frame.
        """
        return self.to_world(np.asarray(cells, dtype=np.float64) + 0.5)

    def blocked(self, robot_radius_m: float, unknown_is_free: bool) -> BoolArray:
        """Tell at which cells' centres a robot of the given radius does not fit.

        Args:
            robot_radius_m: Radius of the robot, metres; 0 gives the blocking cells themselves.
            unknown_is_free: Whether unknown cells count as free.

        Returns:
            True where it does not, shape (rows, columns).

        Raises:
            ParameterError: If the radius is negative.
        """
        check_non_negative(robot_radius_m, "robot_radius_m")
        blocking = self.occupancy == OCCUPIED
        if not unknown_is_free:
            blocking |= self.occupancy == UNKNOWN
        if robot_radius_m == 0.0 or not blocking.any():
            return blocking
        # Half cells: centres at odd indices, edges and corners at even ones.
        rows, columns = self.shape
        clear = np.ones((2 * rows + 1, 2 * columns + 1), dtype=np.bool_)
        for row_offset in (0, 1, 2):
            for column_offset in (0, 1, 2):
                target = clear[
                    row_offset : row_offset + 2 * rows : 2,
                    column_offset : column_offset + 2 * columns : 2,
                ]
                target &= ~blocking
        distance = ndimage.distance_transform_edt(clear, sampling=0.5 * self.resolution_m)
        return np.asarray(blocking | (distance[1::2, 1::2] <= robot_radius_m))

    def _rotation(self) -> FloatArray:
        """Rotation from the grid's frame to the world's, shape (2, 2)."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.array([[cos, -sin], [sin, cos]])
