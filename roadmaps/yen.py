"""The k shortest loopless paths, exactly: Yen's algorithm with Lawler's restriction.

Every path but the shortest leaves an earlier one at a *spur vertex*: it shares the root before
that vertex and takes an edge there that no found path with the same root has taken. So for each
path found, and each spur vertex at or after the one where it left its own parent (Lawler), the
shortest detour is found and put in a heap; the least of the heap is the next path. A detour is
searched by A* with the exact distance to the goal in the whole roadmap, which stays a lower bound
when vertices and edges are taken away.
"""

import heapq
import math
from collections.abc import Set as AbstractSet
from itertools import pairwise

import networkx as nx
from scipy.sparse.csgraph import dijkstra

from roadmaps.checks import check_count
from roadmaps.roadmap import RoadmapMatrix, read_roadmap
from roadmaps.shortest_path import make_path, unreachable
from roadmaps.vertex_path import VertexPath

Adjacency = list[list[tuple[int, float]]]


def find_k_shortest_paths(
    roadmap: nx.Graph | RoadmapMatrix, start: int, goal: int, count: int
) -> tuple[VertexPath, ...]:
    """Find the `count` shortest paths without repeated vertices.

    Args:
        roadmap: The roadmap.
        start: Vertex id.
        goal: Vertex id.
        count: Number of paths wanted.

    Returns:
        Paths by length, the shortest first; fewer than `count` if there are no more.

    Raises:
        UnknownVertexError: If `start` or `goal` is not in the roadmap.
        UnreachableError: If no path joins them.
        ParameterError: If `count` is less than 1.

    References:
        Yen, "Finding the K shortest loopless paths in a network", Management Science 17(11),
        1971, doi:10.1287/mnsc.17.11.712.
        Lawler, "A procedure for computing the K best solutions to discrete optimization
        problems and its application to the shortest path problem", Management Science 18(7),
        1972, doi:10.1287/mnsc.18.7.401.
    """
    check_count(count, "count")
    matrix = read_roadmap(roadmap)
    first, last = matrix.row(start, "start"), matrix.row(goal, "goal")
    to_goal: list[float] = dijkstra(matrix.sparse(matrix.lengths), indices=last).tolist()
    if math.isinf(to_goal[first]):
        raise unreachable(matrix, first, last)
    adjacency = _adjacency(matrix)
    length_of = [dict(entries) for entries in adjacency]
    best = _search(adjacency, to_goal, first, last, frozenset(), frozenset())
    heap = [(best[0], best[1], 0)] if best else []
    taken: dict[tuple[int, ...], set[int]] = {}  # next vertices used after a root
    found: list[VertexPath] = []
    while heap and len(found) < count:
        _, rows, deviation = heapq.heappop(heap)
        found.append(make_path(matrix, rows))
        for place in range(len(rows) - 1):
            taken.setdefault(rows[: place + 1], set()).add(rows[place + 1])
        before = sum(length_of[rows[at]][rows[at + 1]] for at in range(deviation))
        for place in range(deviation, len(rows) - 1):
            root = rows[: place + 1]
            detour = _search(
                adjacency, to_goal, rows[place], last, frozenset(rows[:place]), taken[root]
            )
            if detour is not None:
                # Each (root, edges taken) waits in the heap once, so no path comes twice.
                heapq.heappush(heap, (before + detour[0], rows[:place] + detour[1], place))
            before += length_of[rows[place]][rows[place + 1]]
    return tuple(sorted(found, key=lambda path: (path.length_m, path.vertices)))


def _adjacency(matrix: RoadmapMatrix) -> Adjacency:
    """Neighbours and lengths of each row as Python lists."""
    neighbors, lengths = matrix.neighbors.tolist(), matrix.lengths.tolist()
    borders = matrix.first_entry.tolist()
    return [
        list(zip(neighbors[begin:stop], lengths[begin:stop], strict=True))
        for begin, stop in pairwise(borders)
    ]


def _search(
    adjacency: Adjacency,
    to_goal: list[float],
    spur: int,
    goal: int,
    removed: AbstractSet[int],
    used: AbstractSet[int],
) -> tuple[float, tuple[int, ...]] | None:
    """A* from the spur vertex without removed vertices and used first edges; None if no way."""
    if spur == goal:
        return 0.0, (goal,)
    from_spur = {spur: 0.0}
    parents: dict[int, int] = {}
    closed = set(removed)
    heap = [(to_goal[spur], spur)]
    while heap:
        _, row = heapq.heappop(heap)
        if row == goal:
            way = [goal]
            while way[-1] != spur:
                way.append(parents[way[-1]])
            return from_spur[goal], tuple(reversed(way))
        if row in closed:
            continue
        closed.add(row)
        here = from_spur[row]
        for neighbor, length in adjacency[row]:
            if neighbor in closed or (row == spur and neighbor in used):
                continue
            total = here + length
            if total < from_spur.get(neighbor, math.inf):
                from_spur[neighbor] = total
                parents[neighbor] = row
                heapq.heappush(heap, (total + to_goal[neighbor], neighbor))
    return None
