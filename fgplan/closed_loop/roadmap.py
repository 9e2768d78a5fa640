"""The team's roadmap over a whole mission, and candidate paths from where a robot stands.

One PRM is drawn before anybody moves, with all goals as vertices; so a vertex is the same vertex in
every session. A robot joins it from its estimated position by straight free motions to the nearest
vertices. An obstacle that was not known takes away the edges that cross it, and nothing else.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import networkx as nx
import numpy as np

from fgplan.closed_loop.free_place import nearest_free_place
from fgplan.errors import NoCandidatePathError
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.typing import FloatArray
from roadmaps import (
    KNearest,
    RoadmapError,
    VertexPath,
    Workspace,
    build_prm,
    find_candidate_paths,
    positions_of,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamRoadmap:
    """Roadmap and goals.

    Attributes:
        graph: The PRM; the distinct goals are its first vertices.
        workspace: What is known of bounds and obstacles.
        goal_vertices: Vertex of each goal of each robot; robots may share one.
        options: How candidate paths are made.
    """

    graph: nx.Graph
    workspace: Workspace
    goal_vertices: Mapping[str, tuple[int, ...]]
    options: CandidateOptions

    def paths(
        self, robot: str, position: FloatArray, goal: int, count: int, rng: np.random.Generator
    ) -> tuple[VertexPath, ...]:
        """Candidate paths of one robot to one of its goals.

        Args:
            robot: Name of the robot.
            position: Where it is thought to be, shape (2,), metres, world frame.
            goal: Place of the goal among the robot's goals.
            count: Number of paths wanted.
            rng: Source of randomness.

        Returns:
            Paths from the position on, the shortest first.

        Raises:
            NoCandidatePathError: If the goal cannot be reached; names the robot.
        """
        end = self.goal_vertices[robot][goal]
        try:
            graph, start = self._joined(position)
            return find_candidate_paths(
                graph,
                start,
                end,
                count,
                method=self.options.paths,
                rng=rng,
                max_length_m=self.options.max_length_m,
            )
        except RoadmapError as error:
            where = np.round(position, 1).tolist()
            raise NoCandidatePathError(
                f"robot {robot!r} at {where}: expected a way to its goal {goal + 1}: {error}"
            ) from error

    def with_obstacles(self, obstacles: Sequence[FloatArray]) -> "TeamRoadmap":
        """The roadmap after obstacles were seen: edges that cross them are gone.

        Args:
            obstacles: New polygons, each of shape (corners, 2), metres, world frame.

        Returns:
            A new roadmap with the same vertices.
        """
        workspace = replace(self.workspace, obstacles=(*self.workspace.obstacles, *obstacles))
        graph = self.graph.copy()
        edges = list(graph.edges)
        points = positions_of(graph)
        rows = {vertex: row for row, vertex in enumerate(graph)}
        ends = np.array([[rows[one], rows[other]] for one, other in edges], np.int64).reshape(-1, 2)
        free = workspace.are_motions_valid(points[ends[:, 0]], points[ends[:, 1]])
        graph.remove_edges_from(edge for edge, fine in zip(edges, free, strict=True) if not fine)
        return replace(self, graph=graph, workspace=workspace)

    def _joined(self, position: FloatArray) -> tuple[nx.Graph, int]:
        """The roadmap with a position as one more vertex; from a free place it joins the others."""
        graph = self.graph.copy()
        points, vertices = positions_of(graph), list(graph)
        start = gate = 1 + max(vertices)
        graph.add_node(start, position=position)
        free = nearest_free_place(self.workspace, position)
        if free is None:
            return graph, start
        if (free != position).any():
            gate = start + 1
            graph.add_node(gate, position=free)
            graph.add_edge(start, gate, length=float(np.linalg.norm(free - position)))
        distances = np.linalg.norm(points - free, axis=1)
        near = np.argsort(distances, kind="stable")[: self.options.neighbours]
        near = near[distances[near] > 0.0]
        ends = points[near]
        fine = self.workspace.are_motions_valid(np.broadcast_to(free, ends.shape), ends)
        for row in near[fine].tolist():
            graph.add_edge(gate, vertices[row], length=float(distances[row]))
        return graph, start


def build_team_roadmap(
    workspace: Workspace,
    goals: Mapping[str, FloatArray],
    options: CandidateOptions,
    rng: np.random.Generator,
) -> TeamRoadmap:
    """Draw the roadmap of a mission.

    Args:
        workspace: Bounds and known obstacles.
        goals: Goals of each robot, shape (G, 2) or (G, 3), metres; places in the plane count.
        options: Vertices, neighbours, candidates.
        rng: Source of randomness.

    Returns:
        The roadmap.

    Raises:
        NoCandidatePathError: If the workspace has too little free space; says so.
    """
    vertices: dict[bytes, int] = {}
    required: list[FloatArray] = []
    goal_vertices: dict[str, tuple[int, ...]] = {}
    for robot, places in goals.items():
        for place in places[:, :2]:
            if vertices.setdefault(place.tobytes(), len(required)) == len(required):
                required.append(place)
        goal_vertices[robot] = tuple(vertices[place.tobytes()] for place in places[:, :2])
    try:
        graph = build_prm(
            workspace,
            max(options.vertices, len(required)),
            rng,
            connection=KNearest(options.neighbours),
            required_positions=np.array(required),
        )
    except RoadmapError as error:
        raise NoCandidatePathError(f"roadmap of the team: {error}") from error
    return TeamRoadmap(
        graph=graph, workspace=workspace, goal_vertices=goal_vertices, options=options
    )
