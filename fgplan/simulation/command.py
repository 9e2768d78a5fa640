"""What a robot is told to do in one step: a relative pose, in the frame of the pose before.

A change of heading by an angle a followed by a straight way of length l is the relative pose
(l cos a, l sin a, a): how paths over a roadmap become commands (section 7.2 of Regev and Indelman
2017: "the change in heading angle").
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fgplan.checks import check_finite, frozen
from fgplan.errors import InvalidInputError
from fgplan.models.pose import between
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import ArrayLike, FloatArray


@dataclass(frozen=True, slots=True)
class Commands:
    """The commands of one robot, one a step.

    Attributes:
        relative: Shape (L, 3) or (L, 4, 4), each in the frame of the pose before.
    """

    relative: FloatArray

    def __post_init__(self) -> None:
        """Check the shape."""
        shape = np.shape(self.relative)
        if shape[1:] not in ((3,), (4, 4)):
            raise InvalidInputError(
                f"commands: expected shape (L, 3) or (L, 4, 4), one relative pose a step, got "
                f"{shape}"
            )
        object.__setattr__(self, "relative", check_finite(self.relative, "commands", shape))

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.relative)


def commands_along(poses: ArrayLike) -> Commands:
    """Commands that lead from each pose to the next.

    Args:
        poses: Shape (L + 1, 3) or (L + 1, 4, 4), world frame.

    Returns:
        L commands.

    Raises:
        InvalidInputError: If there is no pose or the shape is another.
    """
    array = frozen(poses)
    if array.shape[1:] not in ((3,), (4, 4)) or len(array) == 0:
        raise InvalidInputError(
            f"commands: expected poses of shape (L + 1, 3) or (L + 1, 4, 4), got {array.shape}"
        )
    steps = [between(one, other) for one, other in pairwise(array)]
    return Commands(np.array(steps).reshape(len(array) - 1, *array.shape[1:]))


def commands_of(plan: CandidatePath | Commands) -> Commands:
    """Commands of a plan; the poses of a path are taken one a step, whatever their times."""
    return plan if isinstance(plan, Commands) else commands_along(plan.poses)


def heading_changes(turns_rad: ArrayLike, distances_m: ArrayLike) -> Commands:
    """Commands of turning, then driving straight.

    Args:
        turns_rad: Change of heading of each step, shape (L,), radians.
        distances_m: Way of each step, shape (L,), metres.

    Returns:
        L planar commands.

    Raises:
        InvalidInputError: If the two differ in length.
    """
    turns = check_finite(turns_rad, "turns_rad", (None,))
    ways = check_finite(distances_m, "distances_m", (turns.size,))
    return Commands(np.stack([ways * np.cos(turns), ways * np.sin(turns), turns], axis=1))
