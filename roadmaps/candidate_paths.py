"""Candidate paths between two vertices by one name, whatever roadmap they come from.

`find_candidate_paths` searches a finished roadmap (a PRM, a user's graph); `grow_candidate_paths`
yields better and better sets from a graph that is still growing (an RRG), for as long as there
is time. Both hand on tuples of `VertexPath`, the shortest first.
"""

import time
from collections.abc import Iterator
from typing import Literal

import networkx as nx
import numpy as np

from roadmaps.checks import check_count, check_positive
from roadmaps.diverse_paths import find_penalty_paths, find_perturbed_paths
from roadmaps.errors import NoCandidatePathError, ParameterError
from roadmaps.growth import AbstractGrowth
from roadmaps.roadmap import RoadmapMatrix, read_roadmap
from roadmaps.vertex_path import VertexPath
from roadmaps.yen import find_k_shortest_paths

PathMethod = Literal["penalty", "perturbed", "shortest"]


def find_candidate_paths(
    roadmap: nx.Graph | RoadmapMatrix,
    start: int,
    goal: int,
    count: int,
    *,
    method: PathMethod = "penalty",
    rng: np.random.Generator | None = None,
    max_length_m: float | None = None,
) -> tuple[VertexPath, ...]:
    """Find candidate paths from start to goal.

    Args:
        roadmap: The roadmap; whoever asks many times makes a `RoadmapMatrix` once.
        start: Vertex id.
        goal: Vertex id.
        count: Number of paths wanted.
        method: "penalty" (edges walked cost 1.2 times as much from then on), "perturbed"
            (random edge weights; needs `rng`) or "shortest" (Yen: exact, little diversity).
        rng: Source of randomness of "perturbed".
        max_length_m: Longer paths are left out, metres.

    Returns:
        Distinct paths by length, the shortest first; fewer than `count` if there are no more.

    Raises:
        UnknownVertexError: If `start` or `goal` is not in the roadmap.
        UnreachableError: If no path joins them.
        NoCandidatePathError: If all paths are longer than `max_length_m`.
        ParameterError: If a number is out of range, the method unknown, or `rng` missing.

    Example:
        >>> import networkx as nx
        >>> square = nx.Graph()
        >>> for vertex, xy in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
        ...     square.add_node(vertex, position=np.array(xy, dtype=float))
        >>> square.add_edges_from([(0, 1), (1, 2), (2, 3), (3, 0)], length=1.0)
        >>> [path.vertices for path in find_candidate_paths(square, 0, 2, 2)]
        [(0, 1, 2), (0, 3, 2)]
    """
    if max_length_m is not None:
        check_positive(max_length_m, "max_length_m")
    matrix = read_roadmap(roadmap)
    if method == "penalty":
        paths = find_penalty_paths(matrix, start, goal, count)
    elif method == "perturbed":
        if rng is None:
            raise ParameterError(
                "rng: expected a numpy.random.Generator for method 'perturbed', got None; pass "
                "numpy.random.default_rng(seed)"
            )
        paths = find_perturbed_paths(matrix, start, goal, count, rng)
    elif method == "shortest":
        paths = find_k_shortest_paths(matrix, start, goal, count)
    else:
        raise ParameterError(
            f"method: expected 'penalty', 'perturbed' or 'shortest', got {method!r}"
        )
    if max_length_m is None:
        return paths
    kept = tuple(path for path in paths if path.length_m <= max_length_m)
    if not kept:
        raise NoCandidatePathError(
            f"expected a path of at most {max_length_m} m from vertex {start} to vertex {goal}, "
            f"but the shortest is {paths[0].length_m:.6g} m; raise max_length_m"
        )
    return kept


def grow_candidate_paths(
    growth: AbstractGrowth,
    count: int,
    *,
    samples_a_round: int = 200,
    sample_limit: int | None = None,
    time_limit_s: float | None = None,
    method: PathMethod = "penalty",
    rng: np.random.Generator | None = None,
) -> Iterator[tuple[VertexPath, ...]]:
    """Yield candidate paths from a growing roadmap, round by round, while there is time.

    Each round draws samples, then searches what has grown. Rounds before the goal is reached
    yield nothing. With `sample_limit` the result depends on the seed alone; with `time_limit_s`
    also on the machine. The caller may stop at any round.

    Args:
        growth: The builder, made with a goal; `RRG` for diverse paths. It is grown.
        count: Number of paths wanted a round.
        samples_a_round: Samples drawn a round.
        sample_limit: Samples drawn in all.
        time_limit_s: Seconds in all; a round is never cut short, so the last ends a little later.
        method: As in `find_candidate_paths`.
        rng: As in `find_candidate_paths`.

    Yields:
        Candidate paths, the shortest first.

    Raises:
        ParameterError: If the builder has no goal, or neither limit is given.
        NoCandidatePathError: If the goal has not been reached when the limit is.
    """
    check_count(samples_a_round, "samples_a_round")
    if growth.goal is None:
        raise ParameterError("growth: expected a builder with a goal, got one without")
    if sample_limit is None and time_limit_s is None:
        raise ParameterError("expected sample_limit or time_limit_s, got neither")
    if sample_limit is not None:
        check_count(sample_limit, "sample_limit")
    if time_limit_s is not None:
        check_positive(time_limit_s, "time_limit_s")
    stop_at = float("inf") if time_limit_s is None else time.perf_counter() + time_limit_s
    drawn = 0
    while time.perf_counter() < stop_at and (sample_limit is None or drawn < sample_limit):
        left = samples_a_round if sample_limit is None else sample_limit - drawn
        size = min(samples_a_round, left)
        growth.grow(sample_count=size)
        drawn += size
        if growth.goal_vertex is not None:
            yield find_candidate_paths(
                growth.roadmap(), 0, growth.goal_vertex, count, method=method, rng=rng
            )
    if growth.goal_vertex is None:
        raise NoCandidatePathError(
            f"expected the goal {growth.goal.tolist()} to be reached, but {drawn} samples did "
            "not; draw more, use longer steps, or check that it can be reached"
        )
