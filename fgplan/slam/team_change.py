"""What one update of a team's SLAM changes; it joins the state when iSAM2 has accepted it."""

from dataclasses import dataclass, field

from fgplan.models.measurement import Measurement
from fgplan.models.sensor import AbstractSensor
from fgplan.slam.incremental_estimate import Addition
from fgplan.typing import FloatArray, Key, Pose


@dataclass(frozen=True, slots=True)
class LandmarkMeasurement:
    """A measurement of a landmark, in the graph or waiting for it.

    Attributes:
        measurement: What was measured; checked.
        sensor: The sensor that it names.
        pose_key: The pose it was taken from.
    """

    measurement: Measurement
    sensor: AbstractSensor
    pose_key: Key


@dataclass(slots=True)
class TeamChange:
    """What one update changes.

    Attributes:
        waiting: All waiting lists as they will be.
        poses: Key and first estimate of the new pose of each robot that moved.
        points: First estimate of each new landmark.
        seen: Landmark and robot of each measurement of a landmark.
        addition: What iSAM2 gets.
    """

    waiting: dict[Key, tuple[LandmarkMeasurement, ...]]
    poses: dict[str, tuple[Key, Pose]] = field(default_factory=dict)
    points: dict[Key, FloatArray] = field(default_factory=dict)
    seen: list[tuple[Key, str]] = field(default_factory=list)
    addition: Addition = field(default_factory=Addition)
