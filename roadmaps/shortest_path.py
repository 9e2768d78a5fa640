"""Shortest paths on a roadmap laid out in rows: one compiled Dijkstra a search.

Every candidate search is a sequence of these under different edge weights.
"""

from collections.abc import Sequence

import networkx as nx
import numpy as np
from scipy.sparse.csgraph import dijkstra

from roadmaps.errors import UnreachableError
from roadmaps.roadmap import RoadmapMatrix, read_roadmap
from roadmaps.typing import FloatArray, IntArray
from roadmaps.vertex_path import VertexPath


def find_shortest_path(roadmap: nx.Graph | RoadmapMatrix, start: int, goal: int) -> VertexPath:
    """Find the shortest path between two vertices.

    Args:
        roadmap: The roadmap.
        start: Vertex id.
        goal: Vertex id.

    Returns:
        The path; of one vertex if start is goal.

    Raises:
        UnknownVertexError: If `start` or `goal` is not in the roadmap.
        UnreachableError: If no path joins them.
    """
    matrix = read_roadmap(roadmap)
    first, last = matrix.row(start, "start"), matrix.row(goal, "goal")
    return make_path(matrix, find_rows(matrix, first, last, matrix.lengths))


def find_rows(matrix: RoadmapMatrix, first: int, last: int, weights: FloatArray) -> IntArray:
    """Find the rows along the path of least weight.

    Args:
        matrix: The roadmap.
        first: Row of the start.
        last: Row of the goal.
        weights: Weight of each entry, positive, shape (2 * edges,).

    Returns:
        Rows from start to goal, shape (L + 1,).

    Raises:
        UnreachableError: If no path joins them.
    """
    # From the goal, so that following the predecessors walks from the start.
    _, successors = dijkstra(matrix.sparse(weights), indices=last, return_predecessors=True)
    following = successors.tolist()
    rows = [first]
    while rows[-1] != last:
        row = following[rows[-1]]
        if row < 0:
            raise unreachable(matrix, first, last)
        rows.append(row)
    return np.array(rows, dtype=np.int64)


def make_path(matrix: RoadmapMatrix, rows: Sequence[int] | IntArray) -> VertexPath:
    """Make the product from rows.

    Args:
        matrix: The roadmap.
        rows: Rows from start to goal, shape (L + 1,).

    Returns:
        The path, with its true length whatever weights found it.
    """
    walked = np.asarray(rows, dtype=np.int64)
    return VertexPath(
        vertices=tuple(matrix.vertices[row] for row in walked.tolist()),
        positions=matrix.positions[walked],
        length_m=float(matrix.lengths[matrix.entries(walked)].sum()),
    )


def unreachable(matrix: RoadmapMatrix, first: int, last: int) -> UnreachableError:
    """Make the error for two vertices that no path joins.

    Args:
        matrix: The roadmap.
        first: Row of the start.
        last: Row of the goal.

    Returns:
        The error, to be raised.
    """
    start, goal = matrix.vertices[first], matrix.vertices[last]
    return UnreachableError(
        f"expected a path from vertex {start} at {matrix.positions[first].tolist()} to vertex "
        f"{goal} at {matrix.positions[last].tolist()}, but they lie in different components of "
        "the roadmap; use more vertices, more neighbours, or a smaller robot radius"
    )
