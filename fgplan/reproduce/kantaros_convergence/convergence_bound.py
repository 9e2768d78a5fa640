"""Theorem 4.3 of Kantaros et al. 2019: least probability of the optimal path by iteration n.

Equation (7) is printed as

    P(A^n(q*)) >= 1 - exp( -(alpha_1 + ... + alpha_n) / 2 n + F ),    n > F,

for a path q* of F edges, and its proof as: Y_n = 1 if iteration n adds the first edge of q* that is
missing, Y = sum Y_n is Poisson binomial, P(A^n) = P(Y >= F), Chernoff. With mu = alpha_1 + ... +
alpha_n that proof yields

    P(A^n) >= 1 - exp(-(mu - F)^2 / (2 mu)) >= 1 - exp(-mu / 2 + F),

without the factor n: this is the form that is used, a reconstruction. The printed one is computed
too, to show where it fails.

alpha_n is the probability of Y_n = 1: f_V of the group of q(f - 1) times f_U of the control to
q(f). The paper leaves it open; below are its least values, so that the bound holds a fortiori:

    uniform draws (Remark 3.4)   1 / (min(n, R) |U|)
    (8) and (9)                  (1 - p_V) (1 - p_U) / (min(n, R) |U|),

R configurations that can be reached (an iteration opens one group at most, so K_n <= min(n, R)),
|U| controls of the team.
"""

import numpy as np

from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.typing import FloatArray


def reachable_configurations(problem: AcquisitionProblem) -> int:
    """Number R of configurations that one robot can reach, its start included.

    Args:
        problem: A scene of one robot whose reachable poses are few.

    Returns:
        The number.
    """
    robot, world = problem.robots[0], problem.workspace
    known = {tuple(np.round(robot.pose, 6).tolist())}
    front = [robot.pose]
    while front:
        pose = front.pop()
        after = robot.primitives.successors(pose)
        starts = np.broadcast_to(pose[:2], (len(after), 2))
        free = world.are_motions_valid(starts, after[:, :2])
        for successor in after[free]:
            key = tuple(np.round(successor, 6).tolist())
            if key not in known:
                known.add(key)
                front.append(successor)
    return len(known)


def least_alpha(
    iterations: FloatArray, reachable: int, controls: int, options: TreeOptions
) -> FloatArray:
    """Least probability alpha_n of the next edge of the optimal path.

    Args:
        iterations: Shape (n,), 1, 2, ....
        reachable: R.
        controls: |U|.
        options: ``uniform_after`` 0 for uniform draws; otherwise (8) and (9) with their p_V, p_U.

    Returns:
        Shape (n,).
    """
    alpha = 1.0 / (np.minimum(iterations, reachable) * controls)
    if options.uniform_after == 0:
        return alpha
    return (1.0 - options.p_group) * (1.0 - options.p_control) * alpha


def probability_bound(alpha: FloatArray, horizon: int, *, printed: bool = False) -> FloatArray:
    """Equation (7), zero where it says nothing.

    Args:
        alpha: Shape (n,), alpha_1, alpha_2, ....
        horizon: F.
        printed: With the factor n of the printed exponent.

    Returns:
        Shape (n,).
    """
    count = np.arange(1, len(alpha) + 1)
    half = np.cumsum(alpha) / 2.0
    exponent = horizon - half * (count if printed else 1)
    bound = np.maximum(0.0, -np.expm1(np.minimum(exponent, 0.0)))
    return np.where(count > horizon, bound, 0.0)
