"""Covariances of a hidden state along a path of measurements, one for every step.

    at parent   Sigma(t + 1) = A (Sigma(t)^-1 + J(t))^-1 A' + Q(t),   Sigma(t) before measuring at t
    at child    Sigma(t + 1) = ((A Sigma(t) A' + Q(t))^-1 + J(t + 1))^-1,   after measuring

The first is Algorithm 1, line 7 of Kantaros et al. 2019 as printed; the second is Sigma(t | y_0:t)
of their equation (4). They hold the same beliefs one half-step apart. With several blocks nothing
dense is formed; measurements must then touch one block each.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from fgplan.checks import check_covariance, frozen
from fgplan.errors import InvalidInputError
from fgplan.models.hidden_state import HiddenState
from fgplan.riccati.gaussian import riccati_map, riccati_map_at_child, update_covariance
from fgplan.typing import Covariance, FloatArray, Jacobian

MeasureAt = Literal["parent", "child"]


def propagate(
    state: HiddenState,
    prior: Covariance,
    rows: Sequence[Jacobian],
    *,
    measure_at: MeasureAt = "parent",
    time: int = 0,
) -> FloatArray:
    """Covariances along a path, dense: for states that are coupled, and as the reference.

    Args:
        state: Dynamics, n coordinates.
        prior: Covariance before anything is measured, shape (n, n).
        rows: Whitened rows of the measurements of each configuration 0..F, each (m, n).
        measure_at: ``parent``: entry t is before measuring at configuration t; ``child``: after.
        time: Time of configuration 0.

    Returns:
        Shape (F + 1, n, n), read-only.

    Raises:
        InvalidInputError: If there is no configuration or rows have another width.
    """
    Sigma = np.array(check_covariance(prior, "prior of the hidden state", state.size))
    _check_rows(rows, state.size)
    if measure_at == "child":
        Sigma = update_covariance(Sigma, rows[0])
    out = [Sigma]
    for t in range(len(rows) - 1):
        A, _, Q = state.dense(time + t)
        if measure_at == "parent":
            Sigma = riccati_map(Sigma, rows[t], A, Q)
        else:
            Sigma = riccati_map_at_child(Sigma, rows[t + 1], A, Q)
        out.append(Sigma)
    return frozen(out)


def propagate_blocks(
    state: HiddenState,
    priors: Sequence[Covariance],
    rows: Sequence[Jacobian],
    *,
    measure_at: MeasureAt = "parent",
    time: int = 0,
) -> tuple[FloatArray, ...]:
    """Covariances along a path, a block at a time.

    Args:
        state: Dynamics, independent blocks.
        priors: One covariance a block.
        rows: As for ``propagate``; every row touches one block.
        measure_at: As for ``propagate``.
        time: Time of configuration 0.

    Returns:
        For each block shape (F + 1, n_b, n_b), read-only.

    Raises:
        InvalidInputError: If a row touches two blocks, or there is not one prior a block.
    """
    if len(priors) != len(state.blocks):
        raise InvalidInputError(
            f"priors: expected one a block ({len(state.blocks)}), got {len(priors)}"
        )
    _check_rows(rows, state.size)
    ends = np.cumsum([block.size for block in state.blocks])
    starts = ends - [block.size for block in state.blocks]
    for t, W in enumerate(rows):
        touched = np.array(
            [(W[:, a:b] != 0.0).any(axis=1) for a, b in zip(starts, ends, strict=True)]
        )
        if touched.size and (touched.sum(axis=0) > 1).any():
            raise InvalidInputError(
                f"measurements of step {t}: expected rows that touch one block each; use "
                "propagate with the coupled state"
            )
    out = []
    for block, prior, a, b in zip(state.blocks, priors, starts, ends, strict=True):
        own = [W[(W[:, a:b] != 0.0).any(axis=1), a:b] for W in rows]
        out.append(propagate(HiddenState((block,)), prior, own, measure_at=measure_at, time=time))
    return tuple(out)


def _check_rows(rows: Sequence[Jacobian], size: int) -> None:
    """Refuse a path without configurations and rows of another width."""
    if len(rows) == 0:
        raise InvalidInputError("path: expected rows for at least one configuration, got none")
    for t, W in enumerate(rows):
        if np.ndim(W) != 2 or np.shape(W)[1] != size:
            raise InvalidInputError(
                f"measurements of step {t}: expected rows of shape (m, {size}), got {np.shape(W)}"
            )
