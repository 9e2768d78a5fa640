"""Compiled: which node of a neighbour's tree is fused, section III-A2 and f_C of (10).

Robot i extends q_i(t). Its covariance was made with S_i(t)[j], a node of depth t - 1 of robot j's
tree, so only children of that node are admissible: the covariances that i uses of j are then those
along one path of j. Among them f_C takes the least uncertain one with probability p_C and each
other one equally.

Where j's tree has no child there yet, S_i(t + 1)[j] stays, and lags. A node that lags is followed
child by child, f_C each time, until its depth is t again or it has no child, ``CATCH_UP`` steps at
most.
"""

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.planners.distributed_aia.stream import Stream
from fgplan.typing import FloatArray, IntArray

CATCH_UP = 8
"""Most steps by which a node that lags is followed at once: what bounds the numbers drawn."""


@njit(**UNCOUNTED)
def draw_child(
    first_child: IntArray,
    next_sibling: IntArray,
    uncertainty: FloatArray,
    node: int,
    known: int,
    p_candidate: float,
    stream: Stream,
) -> int:
    """Draw a child of a node by f_C (10), among those of number below ``known``; -1 for none.

    One number is drawn where there are two children or more.
    """
    count = 0
    best = -1
    child = first_child[node]
    while child >= 0:
        if child < known:
            count += 1
            if best < 0 or uncertainty[child] <= uncertainty[best]:  # of equal ones the first made
                best = child
        child = next_sibling[child]
    if count < 2:
        return best
    number = stream.random()
    if number < p_candidate:
        return best
    place = int((number - p_candidate) / (1.0 - p_candidate) * (count - 1))
    child = first_child[node]
    while child >= 0:
        if child < known and child != best:
            if place == 0:
                return child
            place -= 1
        child = next_sibling[child]
    return best


@njit(**UNCOUNTED)
def draw_candidate(
    first_child: IntArray,
    next_sibling: IntArray,
    depth: IntArray,
    uncertainty: FloatArray,
    before: int,
    t: int,
    known: int,
    p_candidate: float,
    stream: Stream,
) -> int:
    """The node of a neighbour's tree for time t, after the one used before (-1: the root).

    Where:
        depth: -1 for a node that has not arrived: then -1 is returned for the root.

    Returns:
        A node of depth t, or one that lags; -1 where nothing is known of the neighbour.
    """
    node = before
    if node < 0:
        if known == 0 or depth[0] < 0:
            return -1
        node = 0
    for _ in range(CATCH_UP):
        if depth[node] >= t:
            break
        child = draw_child(first_child, next_sibling, uncertainty, node, known, p_candidate, stream)
        if child < 0:
            break
        node = child
    return node
