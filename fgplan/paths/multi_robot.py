"""When two robots gain information about each other, and which.

A multi-robot factor joins a state of one robot and a state of another, each future or past, where
a symmetric criterion holds (the paper's cr_MR of section 3; its default is a distance of 300 m).
The factor is a relative pose between any two times - two views of one scene - or a range or
bearing-range between states at one time. Its direction is fixed by the order of the robots in the
team (the earlier robot measures the later), because noise lives in the tangent of the second pose:
two robots must not compute two beliefs.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError
from fgplan.models.pose import position
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.state import State


class Criterion(Protocol):
    """Whether two states of different robots admit a multi-robot factor; symmetric."""

    def __call__(self, first: State, second: State) -> bool:
        """True where a factor joins the two states."""
        ...


@dataclass(frozen=True, slots=True)
class DistanceCriterion:
    """States nearer than a distance (section 7.1 of Regev and Indelman 2017 uses 300 m).

    Attributes:
        distance_m: Largest distance of the two positions, metres.
    """

    distance_m: float

    def __post_init__(self) -> None:
        """Check the distance."""
        check_positive(self.distance_m, "distance criterion distance_m")

    def __call__(self, first: State, second: State) -> bool:
        """True where the positions are nearer than the distance."""
        offset = position(first.pose) - position(second.pose)
        return bool(np.sqrt(offset @ offset) < self.distance_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class MultiRobotModel:
    """Criterion and sensor of multi-robot factors.

    Attributes:
        criterion: Symmetric test on two states.
        sensor: Relative pose, or a range or bearing-range sensor that sees the other robot.
        time_tolerance_s: For range and bearing-range: largest difference of the two times,
            seconds. Relative poses join any two times and take None.
        include_past: Whether past poses of other robots (known to the prior) take part.
    """

    criterion: Criterion
    sensor: RelativePoseSensor | AbstractSensor
    time_tolerance_s: float | None = None
    include_past: bool = True

    def __post_init__(self) -> None:
        """Check that sensor and tolerance fit."""
        relative = isinstance(self.sensor, RelativePoseSensor)
        if relative and self.time_tolerance_s is not None:
            raise InvalidInputError(
                "multi-robot model: a relative pose joins any two times; leave time_tolerance_s out"
            )
        if not relative:
            if self.time_tolerance_s is None:
                raise InvalidInputError(
                    "multi-robot model: range and bearing-range need time_tolerance_s, the largest "
                    "difference in seconds of the times of the two states"
                )
            check_positive(self.time_tolerance_s, "multi-robot model time_tolerance_s")

    def joins(self, first: State, second: State) -> bool:
        """Whether a factor joins two states, the first of the robot earlier in the team."""
        if self.time_tolerance_s is not None and isinstance(self.sensor, AbstractSensor):
            if abs(first.time_s - second.time_s) > self.time_tolerance_s:
                return False
            if not self.sensor.visible(first.pose, position(second.pose)):
                return False
        return bool(self.criterion(first, second))
