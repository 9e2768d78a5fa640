"""What a run leaves for its figures: enough to draw them again without running again."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.typing import FloatArray, IntArray, Key
from roadmaps import OccupancyGrid, Workspace

Pairs = tuple[tuple[State, State], ...]
"""States of two robots that a multi-robot factor joins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GridRecord:
    """An occupancy grid as plain arrays.

    Attributes:
        occupancy: Shape (rows, columns): 0 free, 100 occupied, -1 unknown.
        resolution_m: Side of a cell.
        origin: Outer corner of cell (0, 0), shape (2,), metres, world frame.
        yaw_rad: Rotation in the world.
    """

    occupancy: IntArray
    resolution_m: float
    origin: FloatArray
    yaw_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceRecord:
    """A workspace as plain arrays.

    Attributes:
        lower: Least coordinates, shape (2,), metres.
        upper: Greatest coordinates, shape (2,), metres.
        obstacles: Polygons, each of shape (corners, 2), metres.
        robot_radius_m: Radius of the robots' discs.
        unknown_is_free: What unknown cells count as.
        grid: Occupancy grid, or None.
    """

    lower: FloatArray
    upper: FloatArray
    obstacles: tuple[FloatArray, ...] = ()
    robot_radius_m: float = 0.0
    unknown_is_free: bool = False
    grid: GridRecord | None = None

    def workspace(self) -> Workspace:
        """The workspace that was recorded."""
        grid = None
        if self.grid is not None:
            grid = OccupancyGrid(
                occupancy=self.grid.occupancy,
                resolution_m=self.grid.resolution_m,
                origin=self.grid.origin,
                yaw_rad=self.grid.yaw_rad,
            )
        return Workspace(
            lower=self.lower,
            upper=self.upper,
            obstacles=self.obstacles,
            grid=grid,
            robot_radius_m=self.robot_radius_m,
            unknown_is_free=self.unknown_is_free,
        )


def record_workspace(workspace: Workspace) -> WorkspaceRecord:
    """Record a workspace as plain arrays."""
    grid = None
    if workspace.grid is not None:
        grid = GridRecord(
            occupancy=workspace.grid.occupancy.astype("int64"),
            resolution_m=workspace.grid.resolution_m,
            origin=workspace.grid.origin,
            yaw_rad=workspace.grid.yaw_rad,
        )
    return WorkspaceRecord(
        lower=workspace.lower,
        upper=workspace.upper,
        obstacles=tuple(workspace.obstacles),  # type: ignore[arg-type]  # arrays once checked
        robot_radius_m=workspace.robot_radius_m,
        unknown_is_free=workspace.unknown_is_free,
        grid=grid,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ImpactRecord:
    """One re-evaluation: what a new announcement changed for one robot.

    Attributes:
        robot: Who re-evaluated.
        impacted: Indices of its impacted candidates.
        before: Others' announced paths before, by robot.
        after: Others' announced paths after.
        kept: Joined states before and after.
        removed: Joined states before alone.
        added: Joined states after alone.
    """

    robot: str
    impacted: tuple[int, ...]
    before: Mapping[str, CandidatePath]
    after: Mapping[str, CandidatePath]
    kept: Pairs
    removed: Pairs
    added: Pairs


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """Everything that the figures of a run show.

    Attributes:
        name: Title.
        workspace: Bounds and obstacles.
        goals: Shape (G, 2) or (G, 3) by robot, metres, in the order of the team.
        candidates: Candidate paths by robot.
        chosen: Path of each robot that has one.
        covariances: Shape (L + 1, 2, 2) by robot: position along the chosen path, square metres,
            world frame.
        joined: States that multi-robot factors join along the chosen paths.
        targets: Shape (S, 2) by target: where it is expected at each step, metres, world frame.
        target_covariances: Shape (K, 2, 2) by target, square metres: at start and end, or at the
            end alone.
        landmarks: Position of each mapped landmark by key, metres.
        values: Objective after round 0 and after each accepted announcement.
        announced_by: Robot that made each, as many names as values.
        impacts: Re-evaluations to draw.
    """

    name: str
    workspace: WorkspaceRecord
    goals: Mapping[str, FloatArray]
    candidates: Mapping[str, tuple[CandidatePath, ...]]
    chosen: Mapping[str, CandidatePath]
    covariances: Mapping[str, FloatArray] = field(default_factory=dict)
    joined: Pairs = ()
    targets: Mapping[str, FloatArray] = field(default_factory=dict)
    target_covariances: Mapping[str, FloatArray] = field(default_factory=dict)
    landmarks: Mapping[Key, FloatArray] = field(default_factory=dict)
    values: tuple[float, ...] = ()
    announced_by: tuple[str, ...] = ()
    impacts: tuple[ImpactRecord, ...] = ()
