"""Paths over roadmap vertices from every robot's start over its goals.

A PRM is made once for the team, with all starts and goals as vertices; an RRG grows from where one
robot's leg starts to where it ends. A robot with several goals visits them in order: its i-th
candidate joins the i-th path of every leg (starting over where a leg has fewer).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import networkx as nx
import numpy as np

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.typing import FloatArray
from roadmaps import (
    RRG,
    KNearest,
    RoadmapError,
    UnreachableError,
    VertexPath,
    Workspace,
    build_prm,
    find_candidate_paths,
    read_roadmap,
)
from roadmaps import NoCandidatePathError as NoRoadmapPathError


@dataclass(frozen=True, slots=True, kw_only=True)
class VertexPaths:
    """Paths of the team over vertices.

    Attributes:
        paths: Candidates of each robot, the shortest first; empty where there are none.
        reasons: Why a robot has none.
        roadmaps: The team's PRM under the empty name, or each robot's RRG.
    """

    paths: Mapping[str, tuple[VertexPath, ...]]
    reasons: Mapping[str, str]
    roadmaps: Mapping[str, nx.Graph]


def find_vertex_paths(
    workspace: Workspace,
    stops: Mapping[str, FloatArray],
    options: CandidateOptions,
    generator: np.random.Generator,
) -> VertexPaths:
    """Find candidate paths of every robot.

    Args:
        workspace: Bounds and obstacles.
        stops: By robot, its start and then its goals, shape (G + 1, 2), metres, world frame.
        options: Kind of roadmap, number of candidates and so on.
        generator: Source of randomness.

    Returns:
        Paths by robot; a robot whose goal cannot be reached has none and a reason.

    Raises:
        InvalidInputError: If the workspace has too little free space for a roadmap.
    """
    reasons = {}
    for robot, places in stops.items():
        free = workspace.are_positions_valid(places)
        if not free.all():
            which = int(np.argmin(free))
            what = "its start" if which == 0 else f"goal {which}"
            reasons[robot] = (
                f"{what} at {places[which].tolist()} is outside the bounds, touches an obstacle or "
                "is nearer to one than the robot's radius"
            )
    usable = {robot: places for robot, places in stops.items() if robot not in reasons}
    paths: dict[str, tuple[VertexPath, ...]] = dict.fromkeys(stops, ())
    try:
        if options.roadmap == "prm":
            found, graphs = _by_prm(workspace, usable, options, generator)
        else:
            found, graphs = _by_rrg(workspace, usable, options, generator)
    except RoadmapError as error:
        raise InvalidInputError(f"roadmap: {error}") from error
    for robot, item in found.items():
        if isinstance(item, str):
            reasons[robot] = item
        else:
            paths[robot] = item
    return VertexPaths(paths=paths, reasons=reasons, roadmaps=graphs)


Found = dict[str, tuple[VertexPath, ...] | str]


def _by_prm(
    workspace: Workspace,
    stops: Mapping[str, FloatArray],
    options: CandidateOptions,
    generator: np.random.Generator,
) -> tuple[Found, dict[str, nx.Graph]]:
    """Paths on one PRM of the team."""
    if not stops:
        return {}, {}
    required = np.concatenate(list(stops.values()))
    graph = build_prm(
        workspace,
        max(options.vertices, len(required)),
        generator,
        connection=KNearest(options.neighbours),
        required_positions=required,
    )
    matrix = read_roadmap(graph)
    found: Found = {}
    first = 0
    for robot, places in stops.items():
        legs: list[tuple[VertexPath, ...]] = []
        try:
            for vertex in range(first, first + len(places) - 1):
                legs.append(  # noqa: PERF401 - which leg failed is told by the exception
                    find_candidate_paths(
                        matrix,
                        vertex,
                        vertex + 1,
                        options.candidates,
                        method=options.paths,
                        rng=generator,
                    )
                )
            found[robot] = _joined(legs, options, robot)
        except UnreachableError as error:
            found[robot] = _unreached(places, len(legs) + 1, str(error))
        except (NoRoadmapPathError, NoCandidatePathError) as error:
            found[robot] = str(error)
        first += len(places)
    return found, {"": graph}


def _by_rrg(
    workspace: Workspace,
    stops: Mapping[str, FloatArray],
    options: CandidateOptions,
    generator: np.random.Generator,
) -> tuple[Found, dict[str, nx.Graph]]:
    """Paths on one RRG a robot and leg; vertex ids go on from leg to leg."""
    diagonal = float(np.linalg.norm(workspace.upper - workspace.lower))
    step_m = diagonal / 20.0 if options.step_m is None else options.step_m
    found: Found = {}
    graphs: dict[str, nx.Graph] = {}
    for robot, places in stops.items():
        legs: list[tuple[VertexPath, ...]] = []
        team_graph, offset = nx.Graph(), 0
        try:
            for start, goal in pairwise(places):
                growth = RRG(workspace, start, generator, step_m=step_m, goal=goal)
                growth.grow(sample_count=options.vertices)
                if growth.goal_vertex is None:
                    raise NoCandidatePathError(
                        _unreached(
                            places,
                            len(legs) + 1,
                            f"{options.vertices} samples did not reach it; draw more (vertices), "
                            "or use longer steps (step_m)",
                        )
                    )
                graph = nx.relabel_nodes(
                    growth.roadmap(), {vertex: vertex + offset for vertex in range(len(growth))}
                )
                legs.append(
                    find_candidate_paths(
                        graph,
                        offset,
                        growth.goal_vertex + offset,
                        options.candidates,
                        method=options.paths,
                        rng=generator,
                    )
                )
                team_graph = nx.compose(team_graph, graph)
                offset += len(growth)
            found[robot] = _joined(legs, options, robot)
        except (UnreachableError, NoRoadmapPathError, NoCandidatePathError) as error:
            found[robot] = str(error)
        graphs[robot] = team_graph
    return found, graphs


def _unreached(places: FloatArray, goal: int, why: str) -> str:
    """That a goal, counted from one, cannot be reached."""
    return f"goal {goal} at {places[goal].tolist()} cannot be reached: {why}"


def _joined(
    legs: Sequence[tuple[VertexPath, ...]], options: CandidateOptions, robot: str
) -> tuple[VertexPath, ...]:
    """Candidates over all legs, distinct, the shortest first."""
    if not legs:
        raise NoCandidatePathError(f"robot {robot!r}: expected at least one goal, got none")
    candidates = []
    for place in range(max(len(leg) for leg in legs)):
        parts = [leg[place % len(leg)] for leg in legs]
        vertices, positions = list(parts[0].vertices), [parts[0].positions]
        for part in parts[1:]:
            vertices += part.vertices[1:]
            positions.append(part.positions[1:])
        length_m = sum(part.length_m for part in parts)
        candidates.append(VertexPath(tuple(vertices), np.concatenate(positions), length_m))
    distinct = dict.fromkeys(candidates)
    limit = np.inf if options.max_length_m is None else options.max_length_m
    kept = [path for path in distinct if path.length_m <= limit]
    if not kept:
        shortest = min(path.length_m for path in distinct)
        raise NoCandidatePathError(
            f"the shortest path is {shortest:.6g} m, longer than max_length_m = {limit:g}"
        )
    return tuple(sorted(kept, key=lambda path: path.length_m)[: options.candidates])
