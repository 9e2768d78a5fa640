"""The workspace of a disc-shaped robot: bounds, polygon obstacles, an occupancy grid.

The bounds hold the robot's centre; obstacles are kept away from its whole disc. Line of sight
ignores the disc: a sensor ray has no width, and may leave the bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from roadmaps.checks import as_positions, check_non_negative
from roadmaps.collision import are_within, as_bounds, as_motions
from roadmaps.errors import ParameterError
from roadmaps.grid_traversal import points_touch, segments_touch
from roadmaps.occupancy_grid import OccupancyGrid
from roadmaps.polygon_tree import PolygonTree, build_polygon_tree, has_shapely
from roadmaps.polygons import PolygonSet, build_polygon_set
from roadmaps.typing import BoolArray, FloatArray

PolygonEngine = Literal["auto", "shapely", "numpy"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Workspace:
    """Where a robot may be in the plane.

    Attributes:
        lower: Least coordinates of the robot's centre, shape (2,), metres, world frame.
        upper: Greatest coordinates of the robot's centre, shape (2,), metres, world frame.
        obstacles: Simple polygons, each of shape (corners, 2), metres, world frame.
        grid: An occupancy grid, or None. Everything outside it is unknown.
        robot_radius_m: Radius of the robot's disc, metres.
        unknown_is_free: Whether unknown cells, and all outside the grid, count as free.
        polygon_engine: "shapely" (STR tree), "numpy", or "auto": shapely if installed. The
            answers are the same.
        polygons: The obstacles, checked and laid out; made here.
        blocked: Cells where the robot's centre may not be, shape (rows, columns); made here.
        opaque: Cells that block a line of sight, shape (rows, columns); made here.

    Raises:
        WorkspaceError: If bounds or a polygon are wrong; names which.
        ParameterError: If the radius is negative or the engine unknown.
        MissingDependencyError: If "shapely" is asked for and not installed.

    Example:
        >>> room = Workspace(lower=[0, 0], upper=[10, 10], robot_radius_m=0.5,
        ...                  obstacles=[[(4, 4), (6, 4), (6, 6), (4, 6)]])
        >>> room.are_positions_valid([[1, 1], [3.6, 5]])
        array([ True, False])
        >>> room.are_motions_valid([1, 5], [[3, 5], [9, 5]])
        array([ True, False])
    """

    lower: FloatArray
    upper: FloatArray
    obstacles: Sequence[ArrayLike] = ()
    grid: OccupancyGrid | None = None
    robot_radius_m: float = 0.0
    unknown_is_free: bool = False
    polygon_engine: PolygonEngine = "auto"
    polygons: PolygonSet | PolygonTree = field(init=False, repr=False)
    blocked: BoolArray | None = field(init=False, repr=False)
    opaque: BoolArray | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        lower, upper = as_bounds(self.lower, self.upper, 2)
        check_non_negative(self.robot_radius_m, "robot_radius_m")
        if self.polygon_engine not in get_args(PolygonEngine):
            raise ParameterError(
                f"polygon_engine: expected one of {', '.join(get_args(PolygonEngine))}, "
                f"got {self.polygon_engine!r}"
            )
        polygons: PolygonSet | PolygonTree = build_polygon_set(self.obstacles)
        rings = cast(PolygonSet, polygons).rings
        wants_tree = self.polygon_engine == "shapely" or (
            self.polygon_engine == "auto" and len(rings) > 0 and has_shapely()
        )
        if wants_tree:
            polygons = build_polygon_tree(cast(PolygonSet, polygons))
        blocked = opaque = None
        if self.grid is not None:
            blocked = self.grid.blocked(self.robot_radius_m, self.unknown_is_free)
            opaque = self.grid.blocked(0.0, self.unknown_is_free)
        for name, value in (
            ("lower", lower),
            ("upper", upper),
            ("obstacles", rings),
            ("polygons", polygons),
            ("blocked", blocked),
            ("opaque", opaque),
        ):
            object.__setattr__(self, name, value)

    def are_positions_valid(self, positions: ArrayLike) -> BoolArray:
        """Tell at which positions the robot's disc is free and its centre within the bounds.

        Args:
            positions: Shape (n, 2) or (2,), metres, world frame.

        Returns:
            True where valid, shape (n,).
        """
        points = as_positions(positions, 2, "positions")
        valid = are_within(self.lower, self.upper, points)
        if self.obstacles:
            valid[valid] = ~self.polygons.touch_points(points[valid], self.robot_radius_m)
        if self.grid is not None and self.blocked is not None:
            cells = self.grid.to_cells(points[valid])
            valid[valid] = ~points_touch(self.blocked, cells, not self.unknown_is_free)
        return valid

    def are_motions_valid(self, starts: ArrayLike, ends: ArrayLike) -> BoolArray:
        """Tell along which straight motions the robot's disc stays free.

        Args:
            starts: Shape (n, 2) or (2,), metres, world frame; one row serves all of `ends`.
            ends: Shape (n, 2) or (2,), metres, world frame; one row serves all of `starts`.

        Returns:
            True where valid, shape (n,).
        """
        first, last = as_motions(starts, ends, 2)
        valid = are_within(self.lower, self.upper, first)
        valid &= are_within(self.lower, self.upper, last)
        free = self._are_free(first[valid], last[valid], self.robot_radius_m, self.blocked)
        valid[valid] = free
        return valid

    def has_line_of_sight(self, starts: ArrayLike, ends: ArrayLike) -> BoolArray:
        """Tell between which positions nothing blocks the view; the robot's radius is ignored.

        Obstacles are closed: what lies on or in one is not seen. Put a landmark of a wall a hair
        in front of it.

        Args:
            starts: Shape (n, 2) or (2,), metres, world frame; one row serves all of `ends`.
            ends: Shape (n, 2) or (2,), metres, world frame; one row serves all of `starts`.

        Returns:
            True where the straight line touches no obstacle, shape (n,).
        """
        first, last = as_motions(starts, ends, 2)
        return self._are_free(first, last, 0.0, self.opaque)

    def _are_free(
        self, starts: FloatArray, ends: FloatArray, radius_m: float, cells: BoolArray | None
    ) -> BoolArray:
        """Tell which segments stay `radius_m` away from polygons and off the given cells."""
        free = np.ones(len(starts), dtype=np.bool_)
        if self.obstacles:
            free = ~self.polygons.touch_segments(starts, ends, radius_m)
        if self.grid is not None and cells is not None:
            first, last = self.grid.to_cells(starts[free]), self.grid.to_cells(ends[free])
            free[free] = ~segments_touch(cells, first, last, not self.unknown_is_free)
        return free


def build_grid_workspace(
    grid: OccupancyGrid, *, robot_radius_m: float = 0.0, unknown_is_free: bool = False
) -> Workspace:
    """Make a workspace whose bounds are those of a grid.

    Args:
        grid: The occupancy grid.
        robot_radius_m: Radius of the robot's disc, metres.
        unknown_is_free: Whether unknown cells, and all outside the grid, count as free.

    Returns:
        The workspace.

    Raises:
        ParameterError: If the radius is negative.
    """
    lower, upper = grid.bounds
    return Workspace(
        lower=lower,
        upper=upper,
        grid=grid,
        robot_radius_m=robot_radius_m,
        unknown_is_free=unknown_is_free,
    )
