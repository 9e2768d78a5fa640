"""What is estimated and how it is measured: equations (1) and (2), also for users' own models.

    x(t + 1) = f(x(t), u(t), w(t)),   w ~ N(0, Q(t))        F = df/dx,  L = df/dw
    y(t, q)  = h(x(t), q, v(t)),      v ~ N(0, R(t))        H = dh/dx,  M = dh/dv

(section II and Algorithm 4 of Khodayi-mehr et al. 2019), q the position of the robot. A user's own
process and observations give f, h and their Jacobians; known controls u(t) are the model's own.
Linear hidden states and the sensors of ``fgplan.models`` are such models with L = I and M = I.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from fgplan.models.hidden_state import HiddenState
from fgplan.models.sensor import AbstractSensor
from fgplan.typing import Covariance, FloatArray, Jacobian
from roadmaps import Workspace


class AbstractProcess(ABC):
    """Dynamics of the state; all shapes in the unit of the user's state.

    Attributes:
        size: Number of coordinates n.
    """

    size: int

    @abstractmethod
    def advance(self, state: FloatArray, time: int) -> FloatArray:
        """f(x, u(t), 0), shape (n,)."""

    @abstractmethod
    def jacobians(self, state: FloatArray, time: int) -> tuple[Jacobian, Jacobian]:
        """F of shape (n, n) and L of shape (n, d_w)."""

    @abstractmethod
    def noise(self, time: int) -> Covariance:
        """Q(t), shape (d_w, d_w)."""


class AbstractObservation(ABC):
    """One thing that a robot can measure."""

    @abstractmethod
    def visible(self, state: FloatArray, position: FloatArray, world: Workspace) -> bool:
        """Whether there is a measurement from a position, shape (2,), metres."""

    @abstractmethod
    def predict(self, state: FloatArray, position: FloatArray) -> FloatArray:
        """h(x, q, 0), shape (m,)."""

    @abstractmethod
    def jacobians(self, state: FloatArray, position: FloatArray) -> tuple[Jacobian, Jacobian]:
        """H of shape (m, n) and M of shape (m, d_v)."""

    @abstractmethod
    def noise(self, state: FloatArray, position: FloatArray) -> Covariance:
        """R, shape (d_v, d_v)."""

    def difference(self, measured: FloatArray, predicted: FloatArray) -> FloatArray:
        """Innovation; angles wrapped by observations that have them."""
        return measured - predicted


@dataclass(frozen=True, slots=True)
class HiddenProcess(AbstractProcess):
    """A linear hidden state as a process: F = A, L = I, Q = Q.

    Attributes:
        hidden: The hidden state.
    """

    hidden: HiddenState

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of coordinates n."""
        return self.hidden.size

    def advance(self, state: FloatArray, time: int) -> FloatArray:
        """A x + d."""
        transition, drift, _ = self.hidden.dense(time)
        return np.asarray(transition @ state + drift)

    def jacobians(self, state: FloatArray, time: int) -> tuple[Jacobian, Jacobian]:
        """A and I."""
        del state
        return self.hidden.dense(time)[0], np.eye(self.hidden.size)

    def noise(self, time: int) -> Covariance:
        """Q(t)."""
        return self.hidden.dense(time)[2]


@dataclass(frozen=True, slots=True)
class TargetObservation(AbstractObservation):
    """A sensor that looks at one target of the state.

    Attributes:
        sensor: The sensor.
        part: Where the target sits in the state.
    """

    sensor: AbstractSensor
    part: slice

    def visible(self, state: FloatArray, position: FloatArray, world: Workspace) -> bool:
        """Whether the target is within range and line of sight."""
        return self.sensor.visible(_pose(position), state[self.part], world)

    def predict(self, state: FloatArray, position: FloatArray) -> FloatArray:
        """The sensor's prediction."""
        return self.sensor.predict(_pose(position), state[self.part])

    def jacobians(self, state: FloatArray, position: FloatArray) -> tuple[Jacobian, Jacobian]:
        """Zero but for the target's columns; M = I."""
        own = self.sensor.jacobians(_pose(position), state[self.part])[1]
        rows = np.zeros((len(own), state.size))
        rows[:, self.part] = own
        return rows, np.eye(len(own))

    def noise(self, state: FloatArray, position: FloatArray) -> Covariance:
        """The sensor's noise."""
        return self.sensor.noise(_pose(position), state[self.part])

    def difference(self, measured: FloatArray, predicted: FloatArray) -> FloatArray:
        """The sensor's difference."""
        return self.sensor.difference(measured, predicted)


def _pose(position: FloatArray) -> FloatArray:
    """A position as a pose; robots of this planner see all round and have no heading."""
    return np.array([position[0], position[1], 0.0])
