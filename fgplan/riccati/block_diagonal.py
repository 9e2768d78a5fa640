"""Independent targets: M small filters instead of one large one.

A measurement of one target touches one block, and A, Q and the prior are block-diagonal, so the
joint covariance stays block-diagonal exactly and is never made dense: blocks of shape (M, n, n),

    Sigma_i  ->  A_i (Sigma_i^-1 + J_i)^-1 A_i' + Q_i

Legend as in ``gaussian``; the leading axis is the target. The update is (I + Sigma J)^-1 Sigma.
"""

import numpy as np

from fgplan.riccati.gaussian import predict_covariance
from fgplan.typing import FloatArray


def update_blocks(Sigma: FloatArray, J: FloatArray) -> FloatArray:
    """Covariances after measurements.

    Args:
        Sigma: Shape (M, n, n), symmetric, positive semidefinite.
        J: Information of all measurements of each target, shape (M, n, n).

    Returns:
        Shape (M, n, n), exactly symmetric.
    """
    after = np.linalg.solve(np.eye(Sigma.shape[-1]) + Sigma @ J, Sigma)
    return np.asarray(0.5 * (after + np.swapaxes(after, -1, -2)))


def riccati_map_blocks(
    Sigma: FloatArray, J: FloatArray, A: FloatArray, Q: FloatArray, *, at_child: bool = False
) -> FloatArray:
    """One step of equation (5e) of Kantaros et al. 2019 for independent targets.

    Args:
        Sigma: Shape (M, n, n).
        J: Shape (M, n, n), information of the measurements of the step.
        A: Transitions, shape (M, n, n).
        Q: Process noises, shape (M, n, n).
        at_child: Predict first and measure where the robots arrive; otherwise measure where they
            are, then predict.

    Returns:
        Shape (M, n, n).
    """
    if at_child:
        return update_blocks(predict_covariance(Sigma, A, Q), J)
    return predict_covariance(update_blocks(Sigma, J), A, Q)
