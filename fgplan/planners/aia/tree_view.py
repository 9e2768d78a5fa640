"""What a user's own density may look at, taken from a growing tree."""

import numpy as np

from fgplan.planners.aia.arrays import unpacked
from fgplan.planners.aia.densities import TreeView
from fgplan.planners.aia.growth import Growth
from fgplan.planners.aia.tree_kernels import DEEPEST, DEPTH, GROUPS


def view_tree(growth: Growth, k: int) -> TreeView:
    """View of a tree.

    Args:
        growth: The tree.
        k: The group drawn; -1 before one is.

    Returns:
        Views of the tree's arrays.
    """
    tree, sight = growth.tree, growth.prepared.setting.sight
    groups, deepest = int(tree.counts[GROUPS]), int(tree.counts[DEEPEST])
    node = int(tree.tail[k]) if k >= 0 else 0
    time = int(tree.depth[node])
    rows = tree.configuration[k if k >= 0 else 0].astype(np.int64)
    return TreeView(
        iteration=growth.iterations,
        group_sizes=tree.size[:groups],
        deepest=tree.deepest[:deepest],
        depth=int(tree.counts[DEPTH]),
        group=k,
        time=time,
        poses=growth.poses.pose[rows],
        assigned=tree.assigned[node].astype(np.int64),
        covariances=unpacked(tree.covariance[node], packed=growth.problem.packed),
        places=sight.places[min(time + 1, len(sight.places) - 1)],
        feasible=growth.feasible,
    )
