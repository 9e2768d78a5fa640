"""Covariances of all targets at once in numpy: for where ``covariance_kernels`` are not compiled.

A row holds three numbers (xx, xy, yy) of each target; the formulas are the kernels', target by
target in the same order of operations, so that both give the same numbers (a test compares them).
"""

import numpy as np

from fgplan.planners.aia.covariance_kernels import (
    DETERMINANT,
    EACH,
    SUM,
    TRACE,
    Criteria,
    Dynamics,
)
from fgplan.typing import BoolArray, FloatArray


def numbers_of(row: FloatArray, function: int) -> FloatArray:
    """One number of each target's covariance.

    Args:
        row: Shape (3 M,), square metres.
        function: ``DETERMINANT``, ``TRACE`` or ``LARGEST_EIGENVALUE``.

    Returns:
        Shape (M,).
    """
    a, b, c = row[0::3], row[1::3], row[2::3]
    if function == DETERMINANT:
        return a * c - b * b
    if function == TRACE:
        return a + c
    half = 0.5 * (a - c)
    return 0.5 * (a + c) + np.sqrt(half * half + b * b)


def measured(row: FloatArray, information: FloatArray) -> FloatArray:
    """Covariances after measuring; without information a target's stay as they are.

    Args:
        row: Shape (3 M,), square metres.
        information: As long, one over square metres.

    Returns:
        A new row.
    """
    now, gain = row.reshape(-1, 3).T, information.reshape(-1, 3).T
    det = now[0] * now[2] - now[1] * now[1]
    inner = now * gain
    scale = gain[0] * gain[2] - gain[1] * gain[1]
    scale *= det
    scale += 1.0 + (inner[0] + 2.0 * inner[1] + inner[2])
    after = gain[::-1] * det  # det(Sigma) adj(J), but for the sign of xy
    after[1] *= -1.0
    after += now
    after *= 1.0 / scale
    return after.T.ravel()


def predicted(row: FloatArray, dynamics: Dynamics, t: int) -> FloatArray:
    """Covariances predicted from t to t + 1.

    Args:
        row: Shape (3 M,), square metres.
        dynamics: Of the targets.
        t: When.

    Returns:
        A new row.
    """
    process = dynamics.process[min(t, len(dynamics.process) - 1)].ravel()
    if dynamics.identity:
        return row + process
    transition = dynamics.transition[min(t, len(dynamics.transition) - 1)]
    k, l, m, n = transition.T  # noqa: E741 - A = [[k, l], [m, n]]
    a, b, c = row[0::3], row[1::3], row[2::3]
    out = np.empty_like(row)
    out[0::3] = k * k * a + 2.0 * k * l * b + l * l * c
    out[1::3] = k * m * a + (k * n + l * m) * b + l * n * c
    out[2::3] = m * m * a + 2.0 * m * n * b + n * n * c
    return out + process


def is_below(low: FloatArray, high: FloatArray) -> bool:
    """Whether covariances are at most others in the Loewner order, every target.

    Args:
        low: Shape (3 M,), square metres.
        high: As long.
    """
    gap = high - low
    a, b, c = gap[0::3], gap[1::3], gap[2::3]
    return bool(((a >= 0.0) & (c >= 0.0) & (a * c >= b * b)).all())


class RowJudgement:
    """Objective and terminal constraint, as ``Judgement`` for what the kernels know."""

    def __init__(self, criteria: Criteria) -> None:
        """Look at the criteria once.

        Args:
            criteria: What is minimised and what must hold at the end.
        """
        self._criteria = criteria
        self._one_limit = bool((criteria.threshold == criteria.threshold[0]).all())
        self._limit = float(criteria.threshold[0])
        self._same = criteria.terminal == criteria.objective
        self._row = np.zeros(0)
        self._numbers = np.zeros(0)

    def term(self, row: FloatArray) -> float:
        """The objective's term of one step.

        Args:
            row: Covariances, shape (3 M,).
        """
        criteria = self._criteria
        numbers = numbers_of(row, criteria.objective)
        self._row, self._numbers = row, numbers
        if criteria.objective_scope == SUM:
            return float(sum(numbers.tolist()))
        joint = _joint(numbers, criteria.objective)
        return float(np.exp(joint)) if criteria.objective == DETERMINANT else joint

    def judge(self, row: FloatArray, time: int) -> tuple[float, BoolArray]:
        """Shortfall of the terminal constraint, and which targets are satisfied.

        Args:
            row: Covariances, shape (3 M,).
            time: When; these criteria are the same at all times.
        """
        criteria = self._criteria
        numbers = self._numbers  # of a node's covariance, read for its cost before
        if row is not self._row or not self._same:
            numbers = numbers_of(row, criteria.terminal)
        satisfied = numbers <= criteria.satisfied
        if criteria.terminal_scope == EACH:
            if self._one_limit:
                return max(numbers.tolist()) / self._limit, satisfied
            return float((numbers / criteria.threshold).max()), satisfied
        joint = _joint(numbers, criteria.terminal)
        if criteria.terminal == DETERMINANT:
            return float(np.exp((joint - self._limit) / (2.0 * len(numbers)))), satisfied
        return joint / self._limit, satisfied


def _joint(numbers: FloatArray, function: int) -> float:
    """That number of the joint covariance; of a determinant its logarithm."""
    if function == DETERMINANT:
        return float(np.log(numbers).sum())
    return float(numbers.sum()) if function == TRACE else float(numbers.max())
