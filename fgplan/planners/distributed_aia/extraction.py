"""A team's path across the trees, hop by hop, from a goal node of one robot.

Robot i's way ends in its goal node q_i(F). Its covariance there was made with node S_i(F)[j] of
each neighbour j, whose depth is F - 1 or, where it lags, less; that node's with S_j[l] of j's
neighbours; and so on. A robot is fixed by the first claim on it: over the fewest hops, of equal
ones by the robot that is earlier in the team. The graph decides that alone, so every robot knows
who claims it.

Claims over other routes may name other nodes, and covariances that lagged do not lag when the path
is followed. So the path is replayed through the filter before it counts.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.replay_kernels import replay_path
from fgplan.planners.distributed_aia.team_plan import TeamPlan
from fgplan.planners.distributed_aia.way import Way, way_through
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.typing import FloatArray


def claim_order(graph: CommunicationGraph, origin: int) -> list[tuple[int, int]]:
    """Robots that a plan of one robot reaches, each with the robot that claims it.

    Args:
        graph: Who hears whom.
        origin: The robot, in the order of the team.

    Returns:
        (robot, claimed by), first the origin, claimed by itself.
    """
    order = [(origin, origin)]
    reached = {origin}
    ring = [origin]
    while ring:
        further: dict[int, int] = {}
        for robot in sorted(ring):
            for other in graph.ever(robot):
                if other not in reached:
                    further.setdefault(other, robot)
        ring = sorted(further)
        reached.update(ring)
        order += [(robot, further[robot]) for robot in ring]
    return order


def team_parts(graph: CommunicationGraph) -> tuple[tuple[int, ...], ...]:
    """Robots that communicate with each other, over others or not.

    Args:
        graph: Who hears whom.

    Returns:
        Each part in the order of the team.
    """
    parts: list[tuple[int, ...]] = []
    for robot in range(len(graph.robots)):
        if not any(robot in part for part in parts):
            parts.append(tuple(sorted(one for one, _ in claim_order(graph, robot))))
    return tuple(parts)


def extra_steps(graph: CommunicationGraph, origin: int, constraint_at: str) -> int:
    """Steps beyond a goal node: until all are satisfied, knowledge must come to the last one.

    Args:
        graph: Who hears whom.
        origin: The robot with the goal node.
        constraint_at: ``one`` or ``all``.

    Returns:
        Number of steps.
    """
    return 0 if constraint_at == "one" else 2 * (len(claim_order(graph, origin)) - 1)


def extract(growth: ForestGrowth, origin: int, node: int) -> dict[int, Way]:
    """Ways of all robots that a goal node needs; every tree grows in this process.

    Args:
        growth: All trees.
        origin: The robot with the goal node; its row.
        node: The goal node.

    Returns:
        Way of each robot reached.
    """
    forest = growth.forest
    born_by = int(forest.born[origin, node])
    extra = extra_steps(growth.graph, origin, growth.options.constraint_at)
    steps = int(forest.trees.depth[origin, node]) + extra
    ways: dict[int, Way] = {}
    for robot, by in claim_order(growth.graph, origin):
        claimed = node if robot == origin else claimed_node(growth.graph, ways[by], by, robot)
        ways[robot] = way_through(growth, robot, claimed, steps, born_by)
    return ways


def claimed_node(graph: CommunicationGraph, way: Way, by: int, robot: int) -> int:
    """Node of a robot's tree that another's way needs.

    Args:
        graph: Who hears whom.
        way: The other's way.
        by: The other.
        robot: The robot.

    Returns:
        Its number, or -1 where none was fused yet: then the root.
    """
    return way.sources[list(graph.ever(by)).index(robot)]


def replayed(
    growth: ForestGrowth,
    ways: Mapping[int, Way],
    origins: Sequence[tuple[int, int]],
) -> TeamPlan | None:
    """The plan of ways, if the terminal constraint holds on them in every part of the team.

    Args:
        growth: Problem, graph and options.
        ways: Way of each robot of some parts of the team; others stay where they are.
        origins: (robot, goal node) of each part.

    Returns:
        The plan, cut where the constraint holds first; None where it never does.
    """
    problem = growth.problem
    steps = max(len(way.poses) for way in ways.values()) - 1
    poses = np.empty((steps + 1, len(problem.robots), 3))
    assigned = np.zeros((steps + 1, len(problem.robots)), dtype=np.int64)
    for j, robot in enumerate(problem.robots):
        own = ways[j].poses if j in ways else np.asarray(robot.pose)[None]
        poses[:, j] = own[np.minimum(np.arange(steps + 1), len(own) - 1)]
        if j in ways:
            held = ways[j].assigned
            assigned[:, j] = held[np.minimum(np.arange(steps + 1), len(held) - 1)]
    covariances, terms, shortfalls = replay(growth, poses)
    horizons = np.zeros(len(problem.robots), dtype=np.int64)
    every = growth.options.constraint_at == "all"
    cost = 0.0
    for part in team_parts(growth.graph):
        if part[0] not in ways:
            continue
        met = shortfalls[:, list(part)] <= 1.0
        holds = np.flatnonzero(met.all(axis=1) if every else met.any(axis=1))
        if len(holds) == 0:
            return None
        horizons[list(part)] = holds[0]
        cost += float(terms[: holds[0] + 1, list(part)].sum())
    last = int(horizons.max())
    for j, horizon in enumerate(horizons):
        poses[horizon:, j] = poses[horizon, j]
    if (horizons != last).any():
        covariances, _, shortfalls = replay(growth, poses)
    rows = covariances[: last + 1].reshape(last + 1, len(problem.robots), problem.targets, 3)
    return TeamPlan(
        poses=poses[: last + 1],
        covariances=rows[..., [0, 1, 1, 2]].reshape(*rows.shape[:3], 2, 2),
        horizons=horizons,
        satisfied=shortfalls[horizons, np.arange(len(problem.robots))] <= 1.0,
        cost=cost,
        assigned=assigned[: last + 1],
        origins=tuple(origins),
    )


def replay(growth: ForestGrowth, poses: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The filter along a team's path, see ``replay_kernels``.

    Args:
        growth: Problem, graph and options.
        poses: Shape (F + 1, N, 3).

    Returns:
        Covariance rows, terms and shortfalls by step and robot.
    """
    setting = growth.setting_until(len(poses))
    return replay_path(setting, growth.links, growth.prepared.root, poses)
