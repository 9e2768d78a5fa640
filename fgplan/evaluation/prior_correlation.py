"""Correlation of current poses at planning time, and when it matters (section 5).

Regev and Indelman 2017 mark the candidates of robot r, where r and r' are correlated (22), only if
the covariance of r's current pose given the new announced path differs by more than a threshold
from that given the old one (39), both with the local information of r' alone (34), (36). They
compare determinants, name the trace as a simple alternative and the Kullback-Leibler divergence as
an information-theoretic one. The printed (39) subtracts a quantity from itself; read here as the
absolute difference of new and old.
"""

from typing import Literal

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.evaluation.problem import PlanningProblem
from fgplan.typing import Covariance

Measure = Literal["determinant", "trace", "divergence"]

INDEPENDENT = 1e-12
"""Correlation below which two current poses count as independent."""


def check_measure(name: str) -> None:
    """Check the name of a measure.

    Raises:
        InvalidInputError: If there is none of that name.
    """
    if name not in ("determinant", "trace", "divergence"):
        raise InvalidInputError(
            f"measure of (39): expected 'determinant', 'trace' or 'divergence', got {name!r}"
        )


def starts_correlated(problem: PlanningProblem, robot: str, other: str) -> bool:
    """Whether the prior correlates the current poses of two robots (22)."""
    joint = problem.prior.covariance((problem.start_keys[robot], problem.start_keys[other]))
    scale = 1.0 / np.sqrt(np.diagonal(joint))
    correlation = (joint * np.outer(scale, scale))[: problem.dim, problem.dim :]
    return bool(np.abs(correlation).max() > INDEPENDENT)


def covariance_difference(old: Covariance, new: Covariance, measure: Measure) -> float:
    """How much two covariances differ, for (39).

    Args:
        old: Shape (d, d).
        new: Shape (d, d).
        measure: Absolute difference of determinants or traces, or the Kullback-Leibler divergence
            of N(0, new) from N(0, old) in nats.

    Returns:
        Zero or more.
    """
    if measure == "determinant":
        return float(abs(np.linalg.det(new) - np.linalg.det(old)))
    if measure == "trace":
        return float(abs(np.trace(new) - np.trace(old)))
    ratio = np.linalg.solve(old, new)
    return float(0.5 * (np.trace(ratio) - len(old) - np.linalg.slogdet(ratio)[1]))
