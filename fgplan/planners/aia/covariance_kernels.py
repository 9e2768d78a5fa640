"""Compiled: covariances of all targets as one row of numbers, and what is read from it.

Independent targets in the plane, three numbers (xx, xy, yy) each: no dense matrix is ever made.

    at parent   Sigma <- A (Sigma^-1 + J)^-1 A' + Q
    at child    Sigma <- ((A Sigma A' + Q)^-1 + J)^-1

are those of ``fgplan.riccati.block_diagonal`` (a test compares them), with the update written out,

    (Sigma^-1 + J)^-1 = (Sigma + det(Sigma) adj(J)) / (1 + tr(Sigma J) + det(Sigma) det(J)).
"""

from typing import NamedTuple

import numpy as np

from fgplan.compiling import njit
from fgplan.planners.aia.compilation import UNCOUNTED
from fgplan.typing import BoolArray, FloatArray

DETERMINANT, TRACE, LARGEST_EIGENVALUE = 0, 1, 2
SUM, JOINT, EACH = 0, 1, 0


class Dynamics(NamedTuple):
    """The targets' dynamics; a leading axis of one step is constant.

    Attributes:
        still: Whether every A is the identity and every Q zero: predicting changes nothing.
        identity: Whether every A is the identity.
        transition: A row by row, shape (T, M, 4).
        process: Q as (xx, xy, yy), shape (T, M, 3), square metres.
    """

    still: bool
    identity: bool
    transition: FloatArray
    process: FloatArray


class Criteria(NamedTuple):
    """What is minimised and what must hold at the end.

    Attributes:
        objective: Which number of a covariance.
        objective_scope: ``SUM`` over targets, or ``JOINT``: of the joint covariance.
        terminal: Which number of a covariance.
        terminal_scope: ``EACH`` target, or ``JOINT``.
        threshold: Each target's limit, shape (M,); of a joint one shape (1,), of a joint
            determinant its logarithm.
        satisfied: Each target's limit for assignment, shape (M,).
    """

    objective: int
    objective_scope: int
    terminal: int
    terminal_scope: int
    threshold: FloatArray
    satisfied: FloatArray


@njit(inner=True, **UNCOUNTED)
def measure_row(row: FloatArray, information: FloatArray) -> None:
    """Update every target that was measured, in place."""
    for o in range(0, row.shape[0], 3):
        jxx, jxy, jyy = information[o], information[o + 1], information[o + 2]
        if jxx == 0.0 and jyy == 0.0:
            continue
        a, b, c = row[o], row[o + 1], row[o + 2]
        det = a * c - b * b
        trace = a * jxx + 2.0 * b * jxy + c * jyy
        scale = 1.0 / (1.0 + trace + det * (jxx * jyy - jxy * jxy))
        row[o] = (a + det * jyy) * scale
        row[o + 1] = (b - det * jxy) * scale
        row[o + 2] = (c + det * jxx) * scale


@njit(inner=True, **UNCOUNTED)
def predict_row(
    row: FloatArray, identity: bool, transition: FloatArray, process: FloatArray, t: int
) -> None:
    """Predict every target from t to t + 1, in place."""
    q = min(t, process.shape[0] - 1)
    s = min(t, transition.shape[0] - 1)
    for i in range(process.shape[1]):
        o = 3 * i
        a, b, c = row[o], row[o + 1], row[o + 2]
        if not identity:
            k, l, m, n = (  # noqa: E741 - A = [[k, l], [m, n]]
                transition[s, i, 0],
                transition[s, i, 1],
                transition[s, i, 2],
                transition[s, i, 3],
            )
            xx = k * k * a + 2.0 * k * l * b + l * l * c
            xy = k * m * a + (k * n + l * m) * b + l * n * c
            c = m * m * a + 2.0 * m * n * b + n * n * c
            a, b = xx, xy
        row[o] = a + process[q, i, 0]
        row[o + 1] = b + process[q, i, 1]
        row[o + 2] = c + process[q, i, 2]


@njit(inner=True, **UNCOUNTED)
def propagate_row(
    row: FloatArray,
    information: FloatArray,
    still: bool,
    identity: bool,
    transition: FloatArray,
    process: FloatArray,
    t: int,
    at_child: bool,
) -> None:
    """Covariances at t + 1 of those at t, in place.

    Where:
        row: Shape (3 M,).
        information: J, as long: of the configuration at t, or at t + 1 if ``at_child``.
    """
    if still:
        measure_row(row, information)
    elif at_child:
        predict_row(row, identity, transition, process, t)
        measure_row(row, information)
    else:
        measure_row(row, information)
        predict_row(row, identity, transition, process, t)


@njit(**UNCOUNTED)
def read_numbers(row: FloatArray, function: int, out: FloatArray) -> None:
    """One number of each target's covariance, written to ``out``, shape (M,)."""
    for i in range(out.shape[0]):
        a, b, c = row[3 * i], row[3 * i + 1], row[3 * i + 2]
        if function == DETERMINANT:
            out[i] = a * c - b * b
        elif function == TRACE:
            out[i] = a + c
        else:
            half = 0.5 * (a - c)
            out[i] = 0.5 * (a + c) + np.sqrt(half * half + b * b)


@njit(inner=True, **UNCOUNTED)
def _joint(numbers: FloatArray, function: int) -> float:
    """That number of the joint covariance; of a determinant its logarithm."""
    total = 0.0
    for i in range(numbers.shape[0]):
        if function == DETERMINANT:
            total += np.log(numbers[i])
        elif function == TRACE:
            total += numbers[i]
        else:
            total = max(total, numbers[i])
    return total


@njit(**UNCOUNTED)
def total_of(numbers: FloatArray, criteria: Criteria) -> float:
    """The objective's term of one step."""
    if criteria.objective_scope == SUM:
        total = 0.0
        for i in range(numbers.shape[0]):
            total += numbers[i]
        return total
    joint = _joint(numbers, criteria.objective)
    return float(np.exp(joint)) if criteria.objective == DETERMINANT else joint


@njit(inner=True, **UNCOUNTED)
def shortfall_of(numbers: FloatArray, criteria: Criteria, satisfied: BoolArray) -> float:
    """How far from the terminal constraint (at most one iff it holds), and who is satisfied.

    The worst target's number over its limit; of a joint determinant exp((log det - limit) /
    2 M), so that it, too, is a ratio. Writes ``satisfied``, shape (M,).
    """
    limits, threshold = criteria.satisfied, criteria.threshold
    for i in range(numbers.shape[0]):
        satisfied[i] = numbers[i] <= limits[i]
    if criteria.terminal_scope == EACH:
        worst, largest, limit = 0.0, 0.0, threshold[0]
        for i in range(numbers.shape[0]):
            if threshold[i] != limit:  # one division for targets in a row with one limit
                worst = max(worst, largest / limit)
                largest, limit = 0.0, threshold[i]
            largest = max(largest, numbers[i])
        return max(worst, largest / limit)
    joint = _joint(numbers, criteria.terminal)
    if criteria.terminal == DETERMINANT:
        return float(np.exp((joint - threshold[0]) / (2.0 * numbers.shape[0])))
    return joint / threshold[0]


@njit(inner=True, **UNCOUNTED)
def is_below(low: FloatArray, high: FloatArray) -> bool:
    """Whether covariances are at most others in the Loewner order, every target."""
    for o in range(0, low.shape[0], 3):
        a, b, c = high[o] - low[o], high[o + 1] - low[o + 1], high[o + 2] - low[o + 2]
        if a < 0.0 or c < 0.0 or a * c < b * b:
            return False
    return True
