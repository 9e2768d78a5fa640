"""One robot's way through its own tree, when a teammate's plan needs it at a node.

Up to the node the way is fixed: its ancestors. Later steps change nothing that the teammate at the
plan's origin learns (what is measured there would arrive too late), but the team goes on: the way
follows the cheapest children that were there when the goal node was made, then the free control
that ends nearest to the robot's target. So it depends on the tree alone, whoever asks and when.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.planners.aia.pose_kernels import find_cell, follow_controls
from fgplan.planners.aia.tree import way_to
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Way:
    """Poses of one robot from its start.

    Attributes:
        poses: Shape (F + 1, 3), world frame.
        assigned: Its target at each step, shape (F + 1,).
        sources: Node of each neighbour that the last fixed node was made with, in the order of
            ``CommunicationGraph.ever``; -1 for none.
    """

    poses: FloatArray
    assigned: IntArray
    sources: tuple[int, ...]


def way_through(growth: ForestGrowth, row: int, node: int, steps: int, born_by: int) -> Way:
    """The way through a node, so many steps long.

    Args:
        growth: Holds the robot's tree.
        row: Its row.
        node: The node; deeper than ``steps`` it is cut.
        steps: F.
        born_by: Children made in later sweeps are not looked at.

    Returns:
        The way.
    """
    forest = growth.forest
    nodes = way_to(forest.trees.parent[row], max(node, 0))[: steps + 1]
    while len(nodes) <= steps:
        child = _cheapest_child(growth, row, nodes[-1], born_by)
        if child < 0:
            break
        nodes.append(child)
    poses = list(growth.poses_to(row, nodes))
    assigned = forest.trees.assigned[row, nodes, 0].astype(np.int64).tolist()
    while len(poses) <= steps:
        poses.append(_nearer(growth, row, poses[-1], assigned[-1], len(poses)))
        assigned.append(assigned[-1])
    degree = len(growth.graph.ever(growth.robots[row]))
    sources = forest.source[row, node, :degree] if node >= 0 else np.full(degree, -1)
    return Way(
        poses=np.array(poses),
        assigned=np.array(assigned),
        sources=tuple(int(source) for source in sources),
    )


def _cheapest_child(growth: ForestGrowth, row: int, node: int, born_by: int) -> int:
    """Child of least cost among those made by a sweep; of equal ones the first; -1 for none."""
    born, trees = growth.forest.born, growth.forest.trees
    best = -1
    child = int(trees.first_child[row, node])
    while child >= 0:
        if born[row, child] <= born_by and (
            best < 0 or trees.cost[row, child] <= trees.cost[row, best]
        ):
            best = child
        child = int(trees.next_sibling[row, child])
    return best


def _nearer(growth: ForestGrowth, row: int, pose: FloatArray, target: int, time: int) -> FloatArray:
    """End of the free control that comes nearest to a target; the pose where none is free."""
    setting = growth.setting_until(time)
    fields = setting.fields
    kind = int(setting.kind[growth.robots[row]])
    controls = int(setting.motions.controls[kind])
    ends, found = np.empty((controls, 3)), np.empty(controls, dtype=np.int64)
    cell = find_cell(fields.frame, pose[0], pose[1])
    follow_controls(setting.motions, setting.obstacles, pose, kind, cell, ends, found)
    free = np.flatnonzero(found != -1)
    if len(free) == 0:
        return pose
    field = fields.of_target[min(time, len(fields.of_target) - 1), target]
    cells = [find_cell(fields.frame, *ends[u, :2]) for u in free]
    return np.array(ends[free[int(np.argmin(fields.distance_m[field, cells]))]])
