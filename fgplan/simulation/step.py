"""What one step of a simulation yields, and the state from which it goes on.

The state holds all that a run needs to go on: the truth and one integer, from which the random
numbers of every step are derived. So a run that was stopped ends as if it had not been.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from fgplan.checks import frozen
from fgplan.models.measurement import Measurement, Odometry
from fgplan.typing import FloatArray, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationState:
    """The truth at one step.

    Attributes:
        step: Steps since the start.
        poses: True pose of each robot, shape (3,) or (4, 4), world frame, in the team's order.
        hidden_state: True stacked state of the targets, shape (n,), metres, world frame.
        entropy: Seed of every random number of the run.
    """

    step: int
    poses: Mapping[str, Pose]
    hidden_state: FloatArray
    entropy: int

    def __post_init__(self) -> None:
        """Make arrays read-only."""
        poses = {robot: frozen(pose) for robot, pose in self.poses.items()}
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "hidden_state", frozen(self.hidden_state))


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationStep:
    """All that happened in one step.

    Attributes:
        state: The truth after the step, from which a run can go on.
        time_s: Seconds since the start.
        odometry: Of the robots that were commanded, in the order of the team.
        measurements: By robot in the order of the team; landmarks, targets, then other robots.
        collided: Robots whose true motion touched an obstacle or left the bounds. They are not
            stopped: what to do about it is the caller's.
    """

    state: SimulationState
    time_s: float
    odometry: tuple[Odometry, ...]
    measurements: tuple[Measurement, ...]
    collided: tuple[str, ...]

    @property
    def poses(self) -> Mapping[str, Pose]:
        """True pose of each robot."""
        return self.state.poses

    @property
    def hidden_state(self) -> FloatArray:
        """True stacked state of the targets."""
        return self.state.hidden_state

    def measurements_of(self, robot: str) -> tuple[Measurement, ...]:
        """The measurements that one robot took."""
        return tuple(one for one in self.measurements if one.robot == robot)
