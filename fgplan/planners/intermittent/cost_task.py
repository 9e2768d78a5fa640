"""What a model is asked for when the tree grows: the cost of Algorithm 4 for pairs of nodes."""

from typing import NamedTuple

from fgplan.planners.intermittent.tree_kernels import Space, Tree
from fgplan.typing import BoolArray, FloatArray, IntArray


class CostTask(NamedTuple):
    """Pairs of a parent in the tree and the place and times of a child; see ``cost_pairs``.

    Attributes:
        tree: Nodes.
        space: What moves.
        carriers: Robot of each carrier of sensors, shape (K,).
        means: Predicted means from ``space.base`` on, shape (T, n).
        parents: Nodes, shape (P,).
        positions: Of the children, shape (P, B, 2), metres.
        times: Their arrivals, steps, shape (P, B).
        limits: A cost that is not below it is given as infinite, shape (P,).
        falling: Whether each cost found becomes the limit of the pairs after it.
        costs: Written, shape (P,).
        covariances: At the earliest arrivals, written, shape (P, M, s, s).
        places: Work for the carriers' places, shape (T, K, 2).
        there: Work: whether a carrier takes part, shape (T, K).
    """

    tree: Tree
    space: Space
    carriers: IntArray
    means: FloatArray
    parents: IntArray
    positions: FloatArray
    times: IntArray
    limits: FloatArray
    falling: bool
    costs: FloatArray
    covariances: FloatArray
    places: FloatArray
    there: BoolArray
