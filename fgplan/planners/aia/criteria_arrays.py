"""Objective and terminal constraint as the numbers that the compiled kernels work on.

``log_determinant``, ``entropy`` H = (n log(2 pi e) + log det) / 2 and ``mutual_information``
I = (log det Sigma_0(F) - log det) / 2, with Sigma_0 the covariance without any measurement, are
determinants with another limit. A user's own function is read in Python, and its limit here is
never met; so is the mutual information where Sigma_0 is not the prior's, but moves.
"""

import numpy as np
from scipy.linalg import block_diag

from fgplan.models.uncertainty import uncertainty_function
from fgplan.planners.aia.covariance_kernels import (
    DETERMINANT,
    JOINT,
    LARGEST_EIGENVALUE,
    SUM,
    TRACE,
    Criteria,
)
from fgplan.planners.aia.problem import AcquisitionProblem, TerminalConstraint
from fgplan.typing import FloatArray

BUILT_IN = {
    "determinant": DETERMINANT,
    "trace": TRACE,
    "largest_eigenvalue": LARGEST_EIGENVALUE,
}
"""Functions that the kernels know."""


def criteria_arrays(problem: AcquisitionProblem) -> tuple[Criteria, bool]:
    """Objective and terminal constraint as the kernels read them.

    Args:
        problem: The problem.

    Returns:
        The arrays, and whether the kernels know the terminal constraint.
    """
    objective = BUILT_IN.get(problem.objective, DETERMINANT)
    terminal = problem.terminal
    limits = terminal.limits(problem.targets)
    joint = terminal.scope == "joint"
    sizes = np.array([problem.hidden.size] if joint else problem.hidden.sizes, dtype=np.float64)
    code = BUILT_IN.get(terminal.function, DETERMINANT)
    known = True
    moves = uncertainty_function(terminal.function).needs_prior and not problem.still
    if terminal.function in ("log_determinant", "entropy", "mutual_information") and not moves:
        logarithms = _log_determinant_limits(problem, terminal, limits, sizes)
    elif terminal.function in BUILT_IN:
        logarithms = np.log(limits)
    else:
        known = False
        logarithms = np.full_like(limits, -np.inf)  # never satisfied here: Python decides
    if joint:
        threshold = logarithms if code == DETERMINANT else limits
        share = np.array(problem.hidden.sizes, dtype=np.float64) / problem.hidden.size
        each = (
            np.exp(share * logarithms[0])
            if code == DETERMINANT
            else np.full(problem.targets, limits[0] / (problem.targets if code == TRACE else 1.0))
        )
    else:
        threshold = np.exp(logarithms)
        each = threshold
    return (
        Criteria(
            objective=objective,
            objective_scope=JOINT if problem.objective_scope == "joint" else SUM,
            terminal=code,
            terminal_scope=1 if joint else 0,
            threshold=np.asarray(threshold, dtype=np.float64),
            satisfied=np.asarray(each, dtype=np.float64),
        ),
        known,
    )


def _log_determinant_limits(
    problem: AcquisitionProblem, terminal: TerminalConstraint, limits: FloatArray, sizes: FloatArray
) -> FloatArray:
    """Limits of log det that say the same: entropy H = (n log(2 pi e) + log det) / 2, and so on."""
    if terminal.function == "log_determinant":
        return limits
    if terminal.function == "entropy":
        return 2.0 * limits - sizes * np.log(2.0 * np.pi * np.e)
    prior = block_diag(*problem.priors)
    if terminal.scope == "joint":
        before = np.array([np.linalg.slogdet(prior)[1]])
    else:
        names = problem.hidden.targets
        parts = [problem.hidden.slice_of(name) for name in names]
        before = np.array([np.linalg.slogdet(prior[part, part])[1] for part in parts])
    return np.asarray(before - 2.0 * limits)
