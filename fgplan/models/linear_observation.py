"""A linear observation of the whole hidden state, with noise that depends on the robot's state.

    y = M(p) x + v,    v ~ N(0, R(p))

equation (3) of Kantaros et al. 2019, for hidden states that are no points: the cells of a gas or
temperature field. A user's own gives ``matrix`` and ``noise``; ``FieldSensor`` averages a field
around the robot.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from fgplan.checks import check_finite, check_not_negative, check_positive
from fgplan.errors import InvalidInputError
from fgplan.models.pose import position
from fgplan.models.sensor import SightLines, whiten
from fgplan.typing import Covariance, FloatArray, Jacobian, Pose


class AbstractLinearObservation(ABC):
    """A model of observing the hidden state; your own gives ``matrix`` and ``noise``."""

    @abstractmethod
    def matrix(self, pose: Pose, world: SightLines | None = None) -> Jacobian:
        """M(p), shape (m, n); no rows where nothing is observed."""

    @abstractmethod
    def noise(self, pose: Pose) -> Covariance:
        """R(p), shape (m, m), for as many rows as ``matrix`` has."""

    def rows(self, pose: Pose, size: int, world: SightLines | None = None) -> Jacobian:
        """Whitened rows of the observation.

        Args:
            pose: Robot pose, shape (3,) or (4, 4), world frame.
            size: Number of coordinates n of the hidden state.
            world: Obstacles; None has none.

        Returns:
            Shape (m, n).

        Raises:
            InvalidInputError: If matrix or noise have another shape, are not finite, or the noise
                is not positive definite.
        """
        matrix = check_finite(self.matrix(pose, world), "observation matrix", (None, size))
        if len(matrix) == 0:
            return np.zeros((0, size))
        noise = check_finite(self.noise(pose), "observation noise", (len(matrix), len(matrix)))
        (rows,) = whiten(noise, matrix)
        return rows


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldSensor(AbstractLinearObservation):
    """A weighted mean of a field near the robot: weights exp(-l^2 / 2 width^2), sum one.

    Attributes:
        cells: Where the cells of the field are, shape (n, 2), metres, world frame.
        width_m: How far the sensor reaches.
        sigma: Standard deviation of a reading, in the field's unit.
        cut: Cells with a weight below this are not observed.
    """

    cells: FloatArray
    width_m: float
    sigma: float
    cut: float = 1e-3

    def __post_init__(self) -> None:
        """Check the numbers."""
        cells = check_finite(self.cells, "field sensor: cells", (None, 2))
        if len(cells) == 0:
            raise InvalidInputError("field sensor: expected at least one cell, got none")
        object.__setattr__(self, "cells", cells)
        check_positive(self.width_m, "field sensor: width_m")
        check_positive(self.sigma, "field sensor: sigma")
        check_not_negative(self.cut, "field sensor: cut")

    def matrix(self, pose: Pose, world: SightLines | None = None) -> Jacobian:
        """One row of weights, shape (1, n), or none where every cell is too far."""
        del world
        square = ((self.cells - position(pose)[:2]) ** 2).sum(axis=1)
        weights = np.exp(-0.5 * square / self.width_m**2)
        weights[weights < self.cut] = 0.0
        if not weights.any():
            return np.zeros((0, len(self.cells)))
        return (weights / weights.sum())[None]

    def noise(self, pose: Pose) -> Covariance:
        """Shape (1, 1)."""
        del pose
        return np.array([[self.sigma**2]])
