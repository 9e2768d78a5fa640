"""A step of the hidden state as a map on covariances, closed under composition.

    Sigma  ->  A (Sigma^-1 + J)^-1 A' + C

Legend: A transition, C process noise, J information of what is measured before the transition.
With E = (I + C1 J2)^-1 a step (A1, C1, J1) followed by (A2, C2, J2) is the step

    A = A2 E A1,    C = A2 E C1 A2' + C2,    J = J1 + A1' J2 E A1

(eliminate the state between from the chain's joint density; the test compares with GTSAM). So any
stretch of a path is three matrices, computed once, whatever covariance it starts from. Measuring
where the step arrives is the same with the information moved: ``arriving``.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.riccati.gaussian import predict_covariance
from fgplan.typing import Covariance, FloatArray, InformationMatrix


@dataclass(frozen=True, slots=True, kw_only=True)
class RiccatiStep:
    """The covariance map of one or more steps.

    Attributes:
        A: Transition, shape (n, n).
        C: Process noise, shape (n, n), symmetric, square metres.
        J: Information gained before the transition, shape (n, n), symmetric.
    """

    A: FloatArray
    C: Covariance
    J: InformationMatrix

    def __post_init__(self) -> None:
        """Check shapes."""
        size = np.shape(self.A)[-1] if np.ndim(self.A) == 2 else 0
        if size == 0:
            raise InvalidInputError(
                f"Riccati step: expected A of shape (n, n), got {np.shape(self.A)}"
            )
        for name in ("A", "C", "J"):
            value = check_finite(getattr(self, name), f"Riccati step: {name}", (size, size))
            object.__setattr__(self, name, value)

    def apply(self, Sigma: Covariance) -> Covariance:
        """Covariance after the step.

        Args:
            Sigma: Shape (n, n), symmetric, positive semidefinite.

        Returns:
            Shape (n, n).
        """
        middle = np.linalg.solve(np.eye(len(Sigma)) + Sigma @ self.J, Sigma)
        return predict_covariance(0.5 * (middle + middle.T), self.A, self.C)


def identity_step(size: int) -> RiccatiStep:
    """The step that changes nothing.

    Args:
        size: Number of coordinates n.

    Returns:
        A = I, C = 0, J = 0.
    """
    zero = np.zeros((size, size))
    return RiccatiStep(A=np.eye(size), C=zero, J=zero)


def arriving(A: FloatArray, Q: Covariance, J: InformationMatrix) -> tuple[RiccatiStep, RiccatiStep]:
    """A step that measures where it arrives, as two: the transition, then the measurement.

    Args:
        A: Transition, shape (n, n).
        Q: Process noise, shape (n, n).
        J: Information of the measurements at the configuration reached, shape (n, n).

    Returns:
        The transition and the measurement; compose them.
    """
    zero = np.zeros_like(np.asarray(J, dtype=np.float64))
    return (
        RiccatiStep(A=A, C=Q, J=zero),
        RiccatiStep(A=np.eye(len(zero)), C=zero, J=J),
    )


def compose(first: RiccatiStep, second: RiccatiStep) -> RiccatiStep:
    """Two consecutive steps as one; associative, not commutative.

    Args:
        first: Earlier step, blocks of shape (n, n).
        second: Later step, same n.

    Returns:
        The map of ``second`` after the map of ``first``.

    Raises:
        InvalidInputError: If the sizes differ.
    """
    size = len(first.A)
    if len(second.A) != size:
        raise InvalidInputError(
            f"Riccati steps: expected equal sizes, got {size} and {len(second.A)}"
        )
    E = np.linalg.inv(np.eye(size) + first.C @ second.J)
    middle = E @ first.C
    inner = second.J @ E
    return RiccatiStep(
        A=second.A @ E @ first.A,
        C=predict_covariance(0.5 * (middle + middle.T), second.A, second.C),
        J=first.J + first.A.T @ (0.5 * (inner + inner.T)) @ first.A,
    )
