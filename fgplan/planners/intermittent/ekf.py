"""The extended Kalman filter of Algorithm 4, and its information form (Remark III.4).

    (8)   x <- f(x, u, 0)                      C <- F C F' + L Q L'
    (9)   e = y - h(x, q, 0)                   S = H C H' + M R M'
          K = C H' S^-1
    (10)  x <- x + K e                         C <- (I - K H) C

Measurements of the same step are fused in one update, all linearised at the same x. The
information form adds them instead: Y <- Y + H' (M R M')^-1 H, and has the same result. For data
that arrive late it keeps an information vector of n numbers a measurement, where the Kalman form
keeps time, place and value, 1 + d + m numbers.

Legend: x mean, C covariance, Y = C^-1, F, L, H, M Jacobians, Q, R noises, e innovation.
"""

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.estimate import Record
from fgplan.planners.intermittent.state_model import AbstractObservation, AbstractProcess
from fgplan.riccati.gaussian import update_covariance, whitened
from fgplan.riccati.information import from_information, to_information, update_information
from fgplan.typing import Covariance, FloatArray, Jacobian

Form = Literal["covariance", "information"]
NUMBER_BYTES = 8


def predict_state(
    process: AbstractProcess, mean: FloatArray, covariance: Covariance, time: int
) -> tuple[FloatArray, Covariance]:
    """Equation (8): one step.

    Args:
        process: Dynamics.
        mean: Shape (n,), at ``time``.
        covariance: Shape (n, n), at ``time``.
        time: Step.

    Returns:
        Mean and covariance at ``time + 1``.
    """
    by_state, by_noise = process.jacobians(mean, time)
    spread = by_noise @ process.noise(time) @ by_noise.T
    after = by_state @ covariance @ by_state.T + spread
    return process.advance(mean, time), 0.5 * (after + after.T)


def measurement_rows(
    observation: AbstractObservation, mean: FloatArray, position: FloatArray, value: FloatArray
) -> tuple[Jacobian, FloatArray]:
    """Whitened rows and innovation of one measurement: with W W' = M R M', W^-1 H and W^-1 e.

    Args:
        observation: What was measured.
        mean: Where it is linearised, shape (n,).
        position: Of the robot, shape (2,), metres.
        value: Shape (m,).

    Returns:
        Shapes (m, n) and (m,).

    Raises:
        InvalidInputError: If M R M' is not positive definite.
    """
    by_state, by_noise = observation.jacobians(mean, position)
    spread = by_noise @ observation.noise(mean, position) @ by_noise.T
    innovation = observation.difference(value, observation.predict(mean, position))
    return whitened(by_state, spread, innovation)


def update_state(
    mean: FloatArray,
    covariance: Covariance,
    rows: Sequence[tuple[Jacobian, FloatArray]],
    form: Form = "covariance",
) -> tuple[FloatArray, Covariance]:
    """Equations (9) and (10) with all measurements of a step.

    Args:
        mean: Shape (n,), where the rows were linearised.
        covariance: Shape (n, n).
        rows: As ``measurement_rows`` gives them.
        form: Kalman or information form.

    Returns:
        Mean and covariance after them.

    Raises:
        InvalidInputError: If the form is not known.
    """
    if form not in ("covariance", "information"):
        raise InvalidInputError(f"filter form: expected covariance or information, got {form!r}")
    if not rows:
        return mean, covariance
    stacked = np.concatenate([row for row, _ in rows])
    innovation = np.concatenate([one for _, one in rows])
    if form == "covariance":
        after = update_covariance(covariance, stacked)
        return mean + after @ (stacked.T @ innovation), after
    vector, matrix = to_information(mean, covariance)
    # Linearised: the whitened measurement of W x is W x + the innovation at x.
    measured = stacked @ mean + innovation
    return from_information(*update_information(vector, matrix, stacked, measured))


def stored_bytes(records: Iterable[Record], size: int) -> dict[Form, int]:
    """Bytes that late measurements take until they are forgotten (Remark III.4).

    Args:
        records: What is stored.
        size: Number of coordinates n of the state.

    Returns:
        Covariance form: time, place and value of each; information form: a vector of n each.
    """
    plain = vectors = 0
    for record in records:
        for _, value in record.readings:
            plain += NUMBER_BYTES * (1 + len(record.position) + len(value))
            vectors += NUMBER_BYTES * size
    return {"covariance": plain, "information": vectors}
