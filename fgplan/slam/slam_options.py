"""How SLAM starts and how iSAM2 is run.

One step of iSAM2 an update is enough while estimates move little. Where two robots of which one
hardly knows where it is see the same landmark, it is not, so steps go on until nothing moves by
more than the threshold. With threshold 0 that never happens, and each update takes all steps.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fgplan.checks import check_covariance, check_not_negative, frozen
from fgplan.errors import InvalidInputError
from fgplan.models.pose import check_pose, tangent_dim
from fgplan.slam.measured_factor import rigid
from fgplan.slam.robust_noise import RobustLoss
from fgplan.typing import Covariance, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamOptions:
    """How iSAM2 is run.

    Attributes:
        relinearise_threshold: A variable is linearised anew when its estimate has moved by more
            than this in any direction (metres, radians).
        relinearise_every: Steps of iSAM2 from one such check to the next.
        iterations: Most steps of iSAM2 in each update; it ends with the first in which no variable
            has to be linearised anew, so more than two are rare.
        robust: Loss by name of sensor, for measurements that may be outliers; none for the others.
    """

    relinearise_threshold: float = 0.1
    relinearise_every: int = 1
    iterations: int = 10
    robust: Mapping[str, RobustLoss] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidInputError: If one is not usable.
        """
        check_not_negative(self.relinearise_threshold, "slam relinearise_threshold")
        for name in ("relinearise_every", "iterations"):
            number = getattr(self, name)
            if isinstance(number, bool) or not isinstance(number, int) or number < 1:
                raise InvalidInputError(
                    f"slam {name}: expected a whole number above zero, got {number!r}"
                )
        for name, loss in self.robust.items():
            if not isinstance(loss, RobustLoss):
                raise InvalidInputError(
                    f"slam robust: expected a RobustLoss for sensor {name!r}, got {loss!r}"
                )
        object.__setattr__(self, "robust", dict(self.robust))


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamStart:
    """What is known of a robot's first pose.

    Attributes:
        pose: Shape (3,) or (4, 4), world frame.
        covariance: Shape (3, 3) or (6, 6), tangent of the pose.
    """

    pose: Pose
    covariance: Covariance

    def __post_init__(self) -> None:
        """Check both.

        Raises:
            InvalidInputError: If the pose is none or the covariance does not fit it.
        """
        pose = frozen(rigid(check_pose(self.pose, "start pose")))
        object.__setattr__(self, "pose", pose)
        covariance = check_covariance(self.covariance, "start covariance", tangent_dim(pose))
        object.__setattr__(self, "covariance", covariance)
