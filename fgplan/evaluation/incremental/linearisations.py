"""Whitened Jacobians of planned observations, known by what they were computed from.

A planned observation depends on the pose that it is made from, the estimate of the landmark, the
sensor and the noise. Candidates that share a pose share it, and so does the next planning session
where the landmark's estimate has not moved; where it has, the observation is linearised anew.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from fgplan.models.sensor import AbstractSensor
from fgplan.typing import Covariance, FloatArray, Jacobian, Pose

Content = tuple[bytes, bytes, bytes, int]
"""Bits of pose, landmark and noise, and the identity of the sensor."""

OVERHEAD_BYTES = 600
"""What Python needs for an entry besides its numbers: four keys, two arrays, a place in a table."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearisations:
    """Whitened Jacobians by content.

    Attributes:
        known: Sensor, rows by pose and rows by landmark of each content; the sensor is held so
            that its identity is nobody else's.
    """

    known: Mapping[Content, tuple[AbstractSensor, Jacobian, Jacobian]] = field(default_factory=dict)

    @property
    def bytes(self) -> int:
        """Memory held."""
        arrays = sum(own.nbytes + other.nbytes for _, own, other in self.known.values())
        return arrays + OVERHEAD_BYTES * len(self.known)

    def first(self, memory_bytes: int) -> "Linearisations":
        """As many of the first as fit into an amount of memory."""
        if self.bytes <= memory_bytes:
            return self
        sizes = [own.nbytes + other.nbytes for _, own, other in self.known.values()]
        room = np.cumsum(np.array(sizes) + OVERHEAD_BYTES)
        count = int(np.searchsorted(room, memory_bytes, side="right"))
        return Linearisations(known=dict(islice(self.known.items(), count)))


class Lineariser:
    """Linearises planned observations, each once; lives as long as one preparation."""

    def __init__(self, earlier: Linearisations | None = None) -> None:
        """Start from what an earlier session left."""
        self._earlier = {} if earlier is None else earlier.known
        self._found: dict[Content, tuple[AbstractSensor, Jacobian, Jacobian]] = {}

    def rows(
        self, sensor: AbstractSensor, pose: Pose, landmark: FloatArray, covariance: Covariance
    ) -> tuple[Jacobian, Jacobian]:
        """Whitened rows of an observation, see ``AbstractSensor.linearise``."""
        content = (pose.tobytes(), landmark.tobytes(), covariance.tobytes(), id(sensor))
        entry = self._found.get(content) or self._earlier.get(content)
        if entry is None:
            entry = (sensor, *sensor.linearise(pose, landmark, covariance))
        self._found[content] = entry
        return entry[1], entry[2]

    def linearisations(self) -> Linearisations:
        """What was asked for."""
        return Linearisations(known=self._found)
