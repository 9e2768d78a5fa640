"""Geometry for planning: workspaces, collision, roadmaps, trees, candidate paths, geodesics.

Knows no belief, no GTSAM and nothing of fgplan. A roadmap is a `networkx.Graph` with a `position`
on each vertex and a `length` on each edge. Lengths in metres, angles in radians, positions in the
world frame; randomness is a `numpy.random.Generator` argument.
"""

from roadmaps.candidate_paths import PathMethod, find_candidate_paths, grow_candidate_paths
from roadmaps.collision import CollisionChecker, SampledChecker, check_position_valid
from roadmaps.connection import Connection, KNearest, WithinRadius, optimal_neighbor_count
from roadmaps.diverse_paths import find_penalty_paths, find_perturbed_paths
from roadmaps.errors import (
    InvalidPositionError,
    MapFileError,
    MissingDependencyError,
    NoCandidatePathError,
    ParameterError,
    RoadmapError,
    SamplingError,
    UnknownVertexError,
    UnreachableError,
    WorkspaceError,
)
from roadmaps.geodesic import DistanceField, GeodesicGrid, build_geodesic_grid
from roadmaps.growth import AbstractGrowth
from roadmaps.movingai_map import read_movingai_map
from roadmaps.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from roadmaps.pose_spacing import headings, space_positions
from roadmaps.prm import build_prm
from roadmaps.roadmap import (
    RoadmapMatrix,
    build_roadmap,
    connect_positions,
    positions_of,
    read_roadmap,
)
from roadmaps.ros_map import read_ros_map
from roadmaps.rrg import RRG
from roadmaps.rrt import RRT
from roadmaps.rrt_star import RRTStar
from roadmaps.sampling import sample_positions
from roadmaps.shortest_path import find_shortest_path
from roadmaps.steering import Steering, euclidean_steering, steer_straight
from roadmaps.tree import Tree
from roadmaps.vertex_path import VertexPath
from roadmaps.workspace import PolygonEngine, Workspace, build_grid_workspace
from roadmaps.yen import find_k_shortest_paths

__all__ = [
    "FREE",
    "OCCUPIED",
    "RRG",
    "RRT",
    "UNKNOWN",
    "AbstractGrowth",
    "CollisionChecker",
    "Connection",
    "DistanceField",
    "GeodesicGrid",
    "InvalidPositionError",
    "KNearest",
    "MapFileError",
    "MissingDependencyError",
    "NoCandidatePathError",
    "OccupancyGrid",
    "ParameterError",
    "PathMethod",
    "PolygonEngine",
    "RRTStar",
    "RoadmapError",
    "RoadmapMatrix",
    "SampledChecker",
    "SamplingError",
    "Steering",
    "Tree",
    "UnknownVertexError",
    "UnreachableError",
    "VertexPath",
    "WithinRadius",
    "Workspace",
    "WorkspaceError",
    "build_geodesic_grid",
    "build_grid_workspace",
    "build_prm",
    "build_roadmap",
    "check_position_valid",
    "connect_positions",
    "euclidean_steering",
    "find_candidate_paths",
    "find_k_shortest_paths",
    "find_penalty_paths",
    "find_perturbed_paths",
    "find_shortest_path",
    "grow_candidate_paths",
    "headings",
    "optimal_neighbor_count",
    "positions_of",
    "read_movingai_map",
    "read_roadmap",
    "read_ros_map",
    "sample_positions",
    "space_positions",
    "steer_straight",
]
