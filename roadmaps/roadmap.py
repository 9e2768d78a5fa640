"""A roadmap is a `networkx.Graph`: vertices are ints with `position`, edges have `length`.

`position` is a NumPy array of shape (d,), metres, world frame, read-only; `length` is a positive
number of metres. Nothing else is required of the graph, so a user's own serves as well.

Searching reads the graph once into `RoadmapMatrix` (adjacency in compressed rows); whoever
searches one roadmap many times makes it once and passes it in the graph's place.
"""

from collections.abc import Hashable
from dataclasses import dataclass, field
from numbers import Real

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from roadmaps.checks import as_positions, read_only
from roadmaps.collision import CollisionChecker, check_position_valid
from roadmaps.connection import Connection, KNearest, neighbor_pairs
from roadmaps.errors import ParameterError, UnknownVertexError, UnreachableError
from roadmaps.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RoadmapMatrix:
    """A roadmap laid out for searching; row i stands for `vertices[i]`.

    Attributes:
        vertices: Vertex ids in the graph's order, length n.
        row_of: Row of each vertex id.
        positions: Shape (n, d), metres, world frame, read-only.
        first_entry: Start of each row's entries, shape (n + 1,).
        neighbors: Row of the neighbour, sorted within each row, shape (2 * edges,). These two
            are int32, which is what scipy's csgraph takes as it is.
        lengths: Edge lengths, metres, shape (2 * edges,), read-only.
        keys: row * n + neighbour of each entry, ascending, shape (2 * edges,).
        reverse: Entry of the same edge in the other direction, shape (2 * edges,).
    """

    vertices: tuple[int, ...]
    row_of: dict[Hashable, int] = field(repr=False)
    positions: FloatArray = field(repr=False)
    first_entry: NDArray[np.int32] = field(repr=False)
    neighbors: NDArray[np.int32] = field(repr=False)
    lengths: FloatArray = field(repr=False)
    keys: IntArray = field(repr=False)
    reverse: IntArray = field(repr=False)

    def row(self, vertex: int, name: str) -> int:
        """Find the row of a vertex.

        Args:
            vertex: Vertex id.
            name: What the message calls it, such as "goal".

        Returns:
            The row.

        Raises:
            UnknownVertexError: If the roadmap has no such vertex.
            ParameterError: If it is no vertex id at all, such as a position.
        """
        if not isinstance(vertex, Hashable):
            raise ParameterError(
                f"{name}: expected the id of a vertex, got {vertex!r}; make a position a vertex by "
                "build_prm(required_positions=...) or connect_positions"
            )
        if vertex not in self.row_of:
            raise UnknownVertexError(
                f"{name}: expected a vertex of the roadmap, got {vertex!r}; it has "
                f"{len(self.vertices)} vertices, such as {list(self.vertices[:5])}; "
                "connect_positions adds new ones"
            )
        return self.row_of[vertex]

    def entries(self, rows: IntArray) -> IntArray:
        """Find the entries of the edges that a path walks.

        Args:
            rows: Rows of the path's vertices in order, shape (L + 1,).

        Returns:
            Entry of each edge in walking direction, shape (L,).
        """
        wanted = rows[:-1] * len(self.vertices) + rows[1:]
        return np.asarray(np.searchsorted(self.keys, wanted))

    def sparse(self, weights: FloatArray) -> sparse.csr_array:
        """Put weights on the edges.

        Args:
            weights: Weight of each entry, shape (2 * edges,).

        Returns:
            Shape (n, n).
        """
        size = len(self.vertices)
        return sparse.csr_array((weights, self.neighbors, self.first_entry), shape=(size, size))


def build_roadmap(
    positions: ArrayLike, edges: ArrayLike, lengths: ArrayLike | None = None
) -> nx.Graph:
    """Make a roadmap from arrays; vertex ids are 0, 1, 2, ...

    Args:
        positions: Shape (n, d), metres, world frame.
        edges: Vertex pairs, shape (m, 2).
        lengths: Lengths of the edges, shape (m,), metres; None means Euclidean.

    Returns:
        The roadmap.

    Raises:
        ParameterError: If an edge names no vertex, is a loop, or has no positive length.
    """
    points = read_only(as_positions(positions, None, "positions"))
    pairs = np.asarray(edges, dtype=np.int64).reshape(-1, 2)
    wrong = (pairs < 0).any(axis=1) | (pairs >= len(points)).any(axis=1)
    wrong |= pairs[:, 0] == pairs[:, 1]
    if wrong.any():
        raise ParameterError(
            f"edges: expected pairs of different vertices from 0 to {len(points) - 1}, "
            f"got {pairs[wrong][0].tolist()}"
        )
    if lengths is None:
        measured = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    else:
        measured = np.asarray(lengths, dtype=np.float64)
    if measured.shape != (len(pairs),) or not (np.isfinite(measured) & (measured > 0)).all():
        raise ParameterError(
            f"lengths: expected {len(pairs)} positive numbers of metres; edges between equal "
            "positions have none: merge such vertices"
        )
    roadmap = nx.Graph()
    roadmap.add_nodes_from((row, {"position": point}) for row, point in enumerate(points))
    roadmap.add_edges_from(
        (one, other, {"length": length})
        for (one, other), length in zip(pairs.tolist(), measured.tolist(), strict=True)
    )
    return roadmap


def read_roadmap(roadmap: nx.Graph | RoadmapMatrix) -> RoadmapMatrix:
    """Check a roadmap and lay it out for searching; a `RoadmapMatrix` is returned as it is.

    Args:
        roadmap: An undirected graph with `position` on vertices and `length` on edges.

    Returns:
        The roadmap as arrays.

    Raises:
        ParameterError: If it is directed, a multigraph or empty, or a position or length is
            missing or wrong; names the vertex or edge.
    """
    if isinstance(roadmap, RoadmapMatrix):
        return roadmap
    if not isinstance(roadmap, nx.Graph) or roadmap.is_directed() or roadmap.is_multigraph():
        raise ParameterError(
            f"roadmap: expected an undirected networkx.Graph, got {type(roadmap).__name__}"
        )
    vertices = tuple(roadmap.nodes)
    row_of: dict[Hashable, int] = {vertex: row for row, vertex in enumerate(vertices)}
    positions = positions_of(roadmap)
    edges = list(roadmap.edges(data="length"))
    for one, other, length in edges:
        if one == other or not (isinstance(length, Real) and 0.0 < float(length) < np.inf):
            raise ParameterError(
                f"edge ({one}, {other}): expected different ends and a finite `length` greater "
                f"than 0 (metres), got length {length!r}"
            )
    size = len(vertices)
    first = np.fromiter((row_of[edge[0]] for edge in edges), np.int64, len(edges))
    second = np.fromiter((row_of[edge[1]] for edge in edges), np.int64, len(edges))
    length_m = np.fromiter((edge[2] for edge in edges), np.float64, len(edges))
    keys = np.concatenate([first * size + second, second * size + first])
    order = np.argsort(keys)
    keys = keys[order]
    counts = np.bincount(keys // size, minlength=size)
    return RoadmapMatrix(
        vertices=vertices,
        row_of=row_of,
        positions=positions,
        first_entry=np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        neighbors=(keys % size).astype(np.int32),
        lengths=read_only(np.concatenate([length_m, length_m])[order]),
        keys=keys,
        reverse=np.searchsorted(keys, keys % size * size + keys // size),
    )


def positions_of(roadmap: nx.Graph) -> FloatArray:
    """Stack the positions of all vertices, in the graph's order.

    Args:
        roadmap: Graph with `position` on vertices.

    Returns:
        Shape (n, d), metres, world frame, read-only.

    Raises:
        ParameterError: If the graph is empty or a vertex has no position, or one of another
            dimension; names the vertex.
    """
    given = list(roadmap.nodes(data="position"))
    if not given:
        raise ParameterError("roadmap: expected at least one vertex, got an empty graph")
    dimension = np.size(given[0][1])
    for vertex, position in given:
        if position is None or np.shape(position) != (dimension,):
            raise ParameterError(
                f"vertex {vertex!r}: expected `position` of shape ({dimension},), metres, "
                f"got {position!r}"
            )
    stacked = np.array([position for _, position in given])
    return read_only(as_positions(stacked, dimension, "position of the vertices"))


def connect_positions(
    roadmap: nx.Graph,
    positions: ArrayLike,
    checker: CollisionChecker,
    *,
    connection: Connection | None = None,
) -> tuple[nx.Graph, tuple[int, ...]]:
    """Add positions, such as starts and goals, to a copy of a roadmap.

    Args:
        roadmap: The roadmap; not changed.
        positions: Shape (m, d) or (d,), metres, world frame.
        checker: The world.
        connection: Which vertices to try; None means the 10 nearest.

    Returns:
        The new roadmap and the ids of the new vertices, in the order of `positions`.

    Raises:
        InvalidPositionError: If a position is outside the bounds or touches an obstacle.
        UnreachableError: If a position cannot be joined to any vertex.
    """
    old = positions_of(roadmap)
    new = as_positions(positions, old.shape[1], "positions")
    for index, position in enumerate(new):
        check_position_valid(checker, position, f"positions[{index}]")
    points = read_only(np.concatenate([old, new]))
    pairs = neighbor_pairs(points, connection or KNearest(), first_new=len(old))
    pairs = pairs[checker.are_motions_valid(points[pairs[:, 0]], points[pairs[:, 1]])]
    joined = np.isin(np.arange(len(old), len(points)), pairs)
    if not joined.all():
        index = int(np.flatnonzero(~joined)[0])
        nearest = float(np.linalg.norm(old - new[index], axis=1).min())
        raise UnreachableError(
            f"positions[{index}] at {new[index].tolist()}: expected a free motion to one of the "
            f"vertices tried, found none (the nearest vertex is {nearest:.3g} m away); use a "
            "denser roadmap, more neighbours or a greater radius"
        )
    first_id = 1 + max((vertex for vertex in roadmap if isinstance(vertex, int)), default=-1)
    ids = [*roadmap.nodes, *range(first_id, first_id + len(new))]
    connected = roadmap.copy()
    for row in range(len(old), len(points)):
        connected.add_node(ids[row], position=points[row])
    lengths = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    for (one, other), length in zip(pairs.tolist(), lengths.tolist(), strict=True):
        connected.add_edge(ids[one], ids[other], length=length)
    return connected, tuple(ids[len(old) :])
