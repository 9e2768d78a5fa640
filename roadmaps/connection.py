"""Which vertices of a roadmap it is tried to join.

The k nearest (an edge is tried if either end has the other among its k nearest) or all within a
radius. Distances are Euclidean; pairs come sorted, so the same positions give the same edges in
the same order. Pairs of equal positions are left out: an edge has a length.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from roadmaps.checks import check_count, check_positive
from roadmaps.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class KNearest:
    """Try the nearest `count` vertices of each vertex.

    Attributes:
        count: Number of neighbours, at least 1.
    """

    count: int = 10

    def __post_init__(self) -> None:
        check_count(self.count, "KNearest.count")


@dataclass(frozen=True, slots=True)
class WithinRadius:
    """Try all vertices at most `radius_m` away.

    Attributes:
        radius_m: Greatest distance, metres.
    """

    radius_m: float

    def __post_init__(self) -> None:
        check_positive(self.radius_m, "WithinRadius.radius_m")


Connection = KNearest | WithinRadius


def optimal_neighbor_count(vertex_count: int, dimension: int) -> int:
    """Number of neighbours that makes a PRM asymptotically optimal (k-nearest PRM*).

    Args:
        vertex_count: Number of vertices.
        dimension: Number of coordinates.

    Returns:
        e (1 + 1 / dimension) log(vertex_count), rounded up.

    Raises:
        ParameterError: If an argument is less than 1.

    References:
        Karaman and Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR
        30(7), 2011, doi:10.1177/0278364911406761.
    """
    check_count(vertex_count, "vertex_count")
    check_count(dimension, "dimension")
    return max(1, math.ceil(math.e * (1.0 + 1.0 / dimension) * math.log(vertex_count)))


def neighbor_pairs(
    positions: FloatArray, connection: Connection, *, first_new: int = 0
) -> IntArray:
    """Find the pairs of positions that a connection rule joins.

    Args:
        positions: Shape (n, d), metres.
        connection: The rule.
        first_new: Only pairs with an end at or after this row, and for `KNearest` only the
            neighbours of such rows.

    Returns:
        Row pairs (smaller, greater), sorted, none twice, shape (pairs, 2).
    """
    total = len(positions)
    if total < 2 or first_new >= total:
        return np.zeros((0, 2), dtype=np.int64)
    tree = cKDTree(positions)
    if isinstance(connection, WithinRadius):
        pairs = tree.query_pairs(connection.radius_m, output_type="ndarray").astype(np.int64)
        pairs = pairs[(pairs >= first_new).any(axis=1)]
        pairs.sort(axis=1)
        keys = pairs[:, 0] * total + pairs[:, 1]
    else:
        wanted = min(connection.count + 1, total)
        _, near = tree.query(positions[first_new:], k=wanted)
        near = np.asarray(near, dtype=np.int64).reshape(total - first_new, wanted)
        row = np.repeat(np.arange(first_new, total), wanted)
        column = near.ravel()
        keys = np.minimum(row, column) * total + np.maximum(row, column)
    keys = np.unique(keys)
    pairs = np.stack([keys // total, keys % total], axis=1)
    apart = (positions[pairs[:, 0]] != positions[pairs[:, 1]]).any(axis=1)
    return np.asarray(pairs[apart])
