"""Numbers that say how uncertain a covariance is; one registry for objectives and constraints.

Each function maps covariances of shape (..., n, n) to shape (...). It is *monotone* if a larger
covariance (in the Loewner order) never gives a smaller number, and *positive* if it is never
negative: lower bounds on a covariance bound monotone functions only, and a sum over an unknown
number of steps may only hold positive ones (Remark 2.1 of Kantaros et al. 2019).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.typing import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyFunction:
    """A named number of a covariance.

    Attributes:
        name: Name in scenario files and objective terms.
        evaluate: Maps (covariance, prior covariance or None), each of shape (..., n, n), to (...).
        monotone: Never smaller for a larger covariance.
        positive: Never negative.
        needs_prior: Compares with the covariance before planning (mutual information).
    """

    name: str
    evaluate: Callable[[FloatArray, FloatArray | None], FloatArray]
    monotone: bool
    positive: bool
    needs_prior: bool = False


def _log_determinant(covariance: FloatArray) -> FloatArray:
    """Log-determinant by Cholesky: a covariance that is not positive definite must not pass."""
    lower = np.linalg.cholesky(covariance)
    total: FloatArray = 2.0 * np.log(np.diagonal(lower, axis1=-2, axis2=-1)).sum(axis=-1)
    return total


def _entropy(covariance: FloatArray) -> FloatArray:
    """Differential entropy of a Gaussian in nats: (n log(2 pi e) + log det) / 2."""
    size = covariance.shape[-1]
    return 0.5 * (size * np.log(2.0 * np.pi * np.e) + _log_determinant(covariance))


def _mutual_information(covariance: FloatArray, prior: FloatArray | None) -> FloatArray:
    """Information gained in nats: (log det prior - log det posterior) / 2."""
    if prior is None:
        raise InvalidInputError(
            "mutual_information: expected variables that the prior holds (landmarks, past or "
            "current poses), got future poses, which have no covariance before planning"
        )
    return 0.5 * (_log_determinant(prior) - _log_determinant(covariance))


_BUILT_IN = (
    UncertaintyFunction(
        name="trace",
        evaluate=lambda covariance, _: np.trace(covariance, axis1=-2, axis2=-1),
        monotone=True,
        positive=True,
    ),
    UncertaintyFunction(
        name="determinant",
        evaluate=lambda covariance, _: np.exp(_log_determinant(covariance)),
        monotone=True,
        positive=True,
    ),
    UncertaintyFunction(
        name="log_determinant",
        evaluate=lambda covariance, _: _log_determinant(covariance),
        monotone=True,
        positive=False,
    ),
    UncertaintyFunction(
        name="largest_eigenvalue",
        evaluate=lambda covariance, _: np.asarray(
            np.linalg.eigvalsh(covariance)[..., -1], dtype=np.float64
        ),
        monotone=True,
        positive=True,
    ),
    UncertaintyFunction(
        name="entropy",
        evaluate=lambda covariance, _: _entropy(covariance),
        monotone=True,
        positive=False,
    ),
    UncertaintyFunction(
        name="mutual_information",
        evaluate=_mutual_information,
        monotone=False,
        positive=True,
        needs_prior=True,
    ),
)

UNCERTAINTY_FUNCTIONS: dict[str, UncertaintyFunction] = {f.name: f for f in _BUILT_IN}
"""The registry: built-in functions and those added by ``register_uncertainty``."""


def register_uncertainty(function: UncertaintyFunction, *, replace: bool = False) -> None:
    """Add a function to the registry, for objectives and scenario files.

    The same function again is no error, so a module may be imported twice.

    Args:
        function: The function; its flags decide whether bounds may be used.
        replace: Whether it may take the place of an own function of that name, as when a notebook
            cell is run again; built-in ones stay.

    Raises:
        InvalidInputError: If the name is taken.

    Example:
        >>> import numpy as np
        >>> from fgplan.models.uncertainty import UncertaintyFunction, register_uncertainty
        >>> worst = UncertaintyFunction(
        ...     name="worst_variance",
        ...     evaluate=lambda covariance, _: np.diagonal(covariance, axis1=-2, axis2=-1).max(-1),
        ...     monotone=True,
        ...     positive=True,
        ... )
        >>> register_uncertainty(worst)
    """
    taken = UNCERTAINTY_FUNCTIONS.get(function.name, function)
    if taken in _BUILT_IN and taken != function:
        raise InvalidInputError(
            f"uncertainty function {function.name!r}: the name is taken by a built-in function; "
            "choose another"
        )
    if taken != function and not replace:
        raise InvalidInputError(
            f"uncertainty function {function.name!r}: the name is taken; choose another or pass "
            "replace=True"
        )
    UNCERTAINTY_FUNCTIONS[function.name] = function


def uncertainty_function(name: str) -> UncertaintyFunction:
    """Look a function up by name.

    Raises:
        UnknownNameError: If there is none; the message lists those that are.
    """
    if name not in UNCERTAINTY_FUNCTIONS:
        known = ", ".join(sorted(UNCERTAINTY_FUNCTIONS))
        raise UnknownNameError(f"uncertainty function {name!r}: expected one of {known}")
    return UNCERTAINTY_FUNCTIONS[name]
