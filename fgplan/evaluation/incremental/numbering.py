"""Numbers of variables, fixed so that messages survive an announcement.

Pose s of robot q is q * capacity + s - 1; the touched variables of the prior follow.
"""

from dataclasses import dataclass

from fgplan.typing import Key


@dataclass(frozen=True, slots=True)
class Numbering:
    """Numbers of variables.

    Attributes:
        robots: Names in team order.
        capacity: Most steps of an announced path.
        prior_keys: Touched variables of the prior, in order; new ones are appended.
    """

    robots: tuple[str, ...]
    capacity: int
    prior_keys: tuple[Key, ...]

    def pose(self, robot: str, step: int) -> int:
        """Number of an announced pose, step 1 and up."""
        return self.robots.index(robot) * self.capacity + step - 1

    def prior(self, key: Key) -> int:
        """Number of a prior variable."""
        return len(self.robots) * self.capacity + self.prior_keys.index(key)
