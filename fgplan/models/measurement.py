"""What a robot reads: odometry between its own poses, and measurements of what is around it.

Association is known: a measurement says what it is of. Simulated robots and recorded logs hand on
the same two types, and multi-robot SLAM takes them from either.
"""

from dataclasses import dataclass
from typing import Literal

from fgplan.checks import frozen
from fgplan.typing import Covariance, FloatArray, Key, Pose

Kind = Literal["landmark", "target", "robot"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Odometry:
    """What one robot knows of its last motion.

    Attributes:
        robot: Name of the robot.
        relative: Relative pose from the pose before, shape (3,) or (4, 4).
        covariance: Noise in the tangent of the later pose, shape (d, d); None if exact.
    """

    robot: str
    relative: Pose
    covariance: Covariance | None

    def __post_init__(self) -> None:
        """Make arrays read-only."""
        object.__setattr__(self, "relative", frozen(self.relative))
        if self.covariance is not None:
            object.__setattr__(self, "covariance", frozen(self.covariance))


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """One measurement, its association known.

    Attributes:
        robot: Name of the robot that measured.
        sensor: Name of the sensor, or of the multi-robot model.
        kind: What was measured.
        target: Key of the landmark, or name of the target or of the other robot.
        value: Shape (m,); a relative pose is (3,) or (4, 4).
        covariance: Noise that it was drawn with, shape (m, m) or that of its tangent.
    """

    robot: str
    sensor: str
    kind: Kind
    target: Key | str
    value: FloatArray
    covariance: Covariance

    def __post_init__(self) -> None:
        """Make arrays read-only."""
        object.__setattr__(self, "value", frozen(self.value))
        object.__setattr__(self, "covariance", frozen(self.covariance))
