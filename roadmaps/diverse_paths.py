"""Diverse candidate paths: shortest paths under weights that are changed on purpose.

Two ways. *Penalty*: after each search the weights of the edges walked are multiplied by a factor
greater than one, so the next path prefers others; weights grow by use only, nothing is forbidden.
*Perturbed*: each search draws new weights, length times (1 + spread * u), u uniform in [0, 1),
the same both ways along an edge. Both keep a path only if it is new, and know each path's true
length. The k shortest paths (see `yen`) are no substitute: on a PRM the 50 shortest share four
fifths of their edges with the best and differ in length by a few thousandths.
"""

from collections.abc import Callable

import networkx as nx
import numpy as np

from roadmaps.checks import check_count, check_generator, check_non_negative
from roadmaps.errors import ParameterError
from roadmaps.roadmap import RoadmapMatrix, read_roadmap
from roadmaps.shortest_path import find_rows, make_path
from roadmaps.typing import FloatArray, IntArray
from roadmaps.vertex_path import VertexPath

_SEARCHES_EACH = 20


def find_penalty_paths(
    roadmap: nx.Graph | RoadmapMatrix,
    start: int,
    goal: int,
    count: int,
    *,
    penalty_factor: float = 1.2,
    jitter: float = 0.0,
    rng: np.random.Generator | None = None,
    max_searches: int | None = None,
) -> tuple[VertexPath, ...]:
    """Find distinct paths, each avoiding the edges of those before.

    Args:
        roadmap: The roadmap.
        start: Vertex id.
        goal: Vertex id.
        count: Number of paths wanted.
        penalty_factor: What the weights of a walked edge are multiplied by, greater than 1.
        jitter: Each search multiplies each weight by 1 + jitter * u, u uniform in [0, 1).
        rng: Source of randomness, needed if `jitter` is not 0.
        max_searches: Gives up after so many searches; None means 20 a wanted path.

    Returns:
        Distinct paths, the shortest first, by length. Fewer than `count` if the searches found
        no more, at least one.

    Raises:
        UnknownVertexError: If `start` or `goal` is not in the roadmap.
        UnreachableError: If no path joins them.
        ParameterError: If a number is out of range, or `rng` is missing.
    """
    if not (np.isfinite(penalty_factor) and penalty_factor > 1.0):
        raise ParameterError(
            f"penalty_factor: expected a number greater than 1, got {penalty_factor!r}"
        )
    check_non_negative(jitter, "jitter")
    if jitter > 0.0 and rng is None:
        raise ParameterError("rng: expected a numpy.random.Generator, for jitter is not 0")
    if rng is not None:
        check_generator(rng)
    matrix = read_roadmap(roadmap)
    penalized = matrix.lengths.copy()

    def weights(walked: IntArray | None) -> FloatArray:
        if walked is not None:
            penalized[walked] *= penalty_factor
            penalized[matrix.reverse[walked]] = penalized[walked]
            if penalized[walked].max() > 1e100:  # only ratios matter
                penalized[:] /= 1e90
        if jitter > 0.0 and rng is not None and walked is not None:
            return penalized * _draw_factors(matrix, rng, jitter)
        return penalized

    return _collect(matrix, start, goal, count, max_searches, weights)


def find_perturbed_paths(
    roadmap: nx.Graph | RoadmapMatrix,
    start: int,
    goal: int,
    count: int,
    rng: np.random.Generator,
    *,
    spread: float = 1.0,
    max_searches: int | None = None,
) -> tuple[VertexPath, ...]:
    """Find distinct paths that are shortest under randomly lengthened edges.

    Args:
        roadmap: The roadmap.
        start: Vertex id.
        goal: Vertex id.
        count: Number of paths wanted.
        rng: Source of randomness.
        spread: Each search multiplies each edge's length by 1 + spread * u, u uniform in [0, 1).
        max_searches: Gives up after so many searches; None means 20 a wanted path.

    Returns:
        Distinct paths, by length, the shortest path of the roadmap first. Fewer than `count` if
        the searches found no more, at least one.

    Raises:
        UnknownVertexError: If `start` or `goal` is not in the roadmap.
        UnreachableError: If no path joins them.
        ParameterError: If a number is out of range.
    """
    check_generator(rng)
    check_non_negative(spread, "spread")
    matrix = read_roadmap(roadmap)

    def weights(walked: IntArray | None) -> FloatArray:
        if walked is None:
            return matrix.lengths
        return matrix.lengths * _draw_factors(matrix, rng, spread)

    return _collect(matrix, start, goal, count, max_searches, weights)


def _draw_factors(matrix: RoadmapMatrix, rng: np.random.Generator, spread: float) -> FloatArray:
    """1 + spread * u for each entry, the same in both directions of an edge."""
    drawn = 1.0 + spread * rng.random(len(matrix.lengths))
    entry = np.arange(len(drawn))
    return np.asarray(drawn[np.minimum(entry, matrix.reverse)])


def _collect(
    matrix: RoadmapMatrix,
    start: int,
    goal: int,
    count: int,
    max_searches: int | None,
    weights: Callable[[IntArray | None], FloatArray],
) -> tuple[VertexPath, ...]:
    """Search until enough distinct paths are found; the first search uses the true lengths."""
    check_count(count, "count")
    searches = _SEARCHES_EACH * count if max_searches is None else max_searches
    check_count(searches, "max_searches")
    first, last = matrix.row(start, "start"), matrix.row(goal, "goal")
    found: dict[bytes, VertexPath] = {}
    walked: IntArray | None = None
    for _ in range(searches):
        rows = find_rows(matrix, first, last, weights(walked))
        walked = matrix.entries(rows)
        key = rows.tobytes()
        if key not in found:
            found[key] = make_path(matrix, rows)
        if len(found) == count or first == last:
            break
    return tuple(sorted(found.values(), key=lambda path: (path.length_m, path.vertices)))
