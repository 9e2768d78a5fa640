"""The mutual-information form (5) of Tzes et al. 2021 beside the determinants of (6).

    I(x(t); y_0:t) = (log det S(t) - log det Sigma_i(t)) / 2,    S(t + 1) = A S(t) A' + Q

is what the measurements up to t tell robot i of the hidden state; S(t), from the prior S(0) on, is
what would be known without any. (5a) adds it up over robots and steps; (5b) asks for I >= delta at
the end, which is det Sigma_i(F) <= det S(F) exp(-2 delta): the threshold of (6). The formulas (5)
are lost in the text at hand; this is what its words and the definition of mutual information leave.
"""

import numpy as np

from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.riccati.gaussian import predict_covariance
from fgplan.typing import FloatArray


def determinant_limit(prior_determinant: float, information: float) -> float:
    """The threshold of (6) that says the same as one of (5b).

    Args:
        prior_determinant: det S(F) without measurements.
        information: Threshold of the mutual information, nats.

    Returns:
        Limit of the determinant.

    Example:
        >>> round(determinant_limit(0.04, 5.0), 9)
        1.816e-06
    """
    return float(prior_determinant * np.exp(-2.0 * information))


def unmeasured_covariances(problem: AcquisitionProblem, steps: int) -> FloatArray:
    """Covariances without any measurement.

    Args:
        problem: Independent targets in the plane.
        steps: F.

    Returns:
        S(t) of each target, shape (F + 1, M, 2, 2), square metres.
    """
    out = np.empty((steps + 1, problem.targets, 2, 2))
    out[0] = problem.priors
    for t in range(steps):
        for k, block in enumerate(problem.hidden.blocks):
            A, _, Q = block.at(t)  # noqa: N806
            out[t + 1, k] = predict_covariance(out[t, k], A, Q)
    return out


def information_gathered(problem: AcquisitionProblem, covariances: FloatArray) -> FloatArray:
    """I(x(t); y_0:t) of all targets together, at every robot and step.

    Args:
        problem: Independent targets in the plane.
        covariances: Shape (F + 1, N, M, 2, 2), square metres.

    Returns:
        Nats, shape (F + 1, N).
    """
    unmeasured = np.linalg.slogdet(unmeasured_covariances(problem, len(covariances) - 1))[1]
    known = np.linalg.slogdet(covariances)[1]
    return np.asarray(0.5 * (unmeasured[:, None] - known).sum(axis=-1))
