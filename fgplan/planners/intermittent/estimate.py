"""What is known of the state at a time: a mean and a covariance, and measurements to come.

Covariances are blocks: one a target where targets are independent, else one of the whole state.
"""

from dataclasses import dataclass

import msgspec

from fgplan.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A Gaussian belief.

    Attributes:
        time: Step.
        mean: Shape (n,).
        covariance: Blocks on the diagonal, shape (M, s, s); (1, n, n) where states are coupled.
    """

    time: int
    mean: FloatArray
    covariance: FloatArray


class Record(msgspec.Struct, frozen=True, array_like=True):
    """What one robot measured in one step.

    Attributes:
        time: Step.
        position: Where it was, metres, world frame.
        readings: What was measured (an index into the robot's observations), and its value.
    """

    time: int
    position: tuple[float, float]
    readings: tuple[tuple[int, tuple[float, ...]], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """An estimate run on through measurements.

    Attributes:
        estimate: At the end.
        means: After every step, shape (steps, n).
        uncertainty: Of the whole state after every step, shape (steps,).
    """

    estimate: Estimate
    means: FloatArray
    uncertainty: FloatArray
