"""An optimal choice in place of lines 6 to 10 of Algorithm 2.

"Any other task assignment algorithm can be employed in place of lines 6-10" (section V-C). The
robots of D and the targets to assign, both as in Algorithm 2, are matched so that the sum of
geodesic distances is least (scipy's linear_sum_assignment), round by round where there are more
robots than targets.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from fgplan.typing import BoolArray, FloatArray, IntArray

_UNREACHABLE_M = 1e9


def assign_optimally(
    assigned: IntArray, satisfied: BoolArray, distance_m: FloatArray, *, everybody: bool = False
) -> IntArray:
    """New assignment of a node.

    Args:
        assigned: The parent's, shape (N,).
        satisfied: Shape (M,), at the node.
        distance_m: Geodesic distances, shape (N, M); infinite ones are allowed.
        everybody: At the root: all robots choose, among all targets.

    Returns:
        Shape (N,).
    """
    out = np.array(assigned)
    unsatisfied = np.flatnonzero(~satisfied)
    if len(unsatisfied) == 0 and not everybody:
        return out
    holders = np.bincount(out, minlength=len(satisfied))
    if everybody:
        choosing = np.arange(len(out))
        targets = np.arange(len(satisfied))
    else:
        choosing = np.flatnonzero(satisfied[out] | (holders[out] > 1))
        targets = np.flatnonzero(~satisfied & (holders == 0))
    again = unsatisfied if len(unsatisfied) else np.arange(len(satisfied))
    if len(targets) == 0:
        targets = again
    cost = np.where(np.isfinite(distance_m), distance_m, _UNREACHABLE_M)
    while len(choosing):
        rows, columns = linear_sum_assignment(cost[np.ix_(choosing, targets)])
        out[choosing[rows]] = targets[columns]
        choosing = np.delete(choosing, rows)
        targets = again
    return out
