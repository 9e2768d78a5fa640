"""The world as it truly is: what no planner may read, and what a simulation runs on.

Time is counted in steps of ``step_s`` seconds. A robot that is given a command u (a relative pose)
moves, and its odometry reads, with noise in the tangent of the later pose,

    x(t + 1) = x(t) u Exp(w),   w ~ N(0, actuation(u))
    z(t + 1) = x(t)^-1 x(t + 1) Exp(v),   v ~ N(0, odometry(u))

Without a model of odometry the robot knows its command alone: z = u with the noise of the
actuation. With neither it knows its pose exactly.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fgplan.checks import check_finite, check_positive, frozen
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.models.hidden_state import HiddenState
from fgplan.models.motion import MotionModel
from fgplan.models.pose import check_pose, position, tangent_dim
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.multi_robot import MultiRobotModel
from fgplan.typing import BoolArray, FloatArray, Key, Pose
from roadmaps import Workspace


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldRobot:
    """One robot as it truly is.

    Attributes:
        name: Unique name.
        pose: True pose at step 0, shape (3,) or (4, 4), world frame.
        actuation: Noise of the motion itself; None moves exactly as commanded.
        odometry: Noise of measuring the motion; None reads the command.
        landmark_sensors: Names of the world's sensors that see landmarks.
        target_sensors: Names of the world's sensors that see hidden targets.
        robot_sensors: Names of the world's sensors that see other robots' positions.
    """

    name: str
    pose: Pose
    actuation: MotionModel | None = None
    odometry: MotionModel | None = None
    landmark_sensors: tuple[str, ...] = ()
    target_sensors: tuple[str, ...] = ()
    robot_sensors: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the pose and that noise fits it."""
        pose = frozen(check_pose(self.pose, f"pose of robot {self.name!r}"))
        object.__setattr__(self, "pose", pose)
        for what, model in (("actuation", self.actuation), ("odometry", self.odometry)):
            if model is not None and model.sigmas.size != tangent_dim(pose):
                raise InvalidInputError(
                    f"robot {self.name!r}: expected {what} noise of {tangent_dim(pose)} numbers "
                    f"for this pose, got {model.sigmas.size}"
                )
        for key in ("landmark_sensors", "target_sensors", "robot_sensors"):
            object.__setattr__(self, key, tuple(getattr(self, key)))

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of all its sensors, each once."""
        names = (*self.landmark_sensors, *self.target_sensors, *self.robot_sensors)
        return tuple(dict.fromkeys(names))


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """The truth: obstacles, landmarks, robots, hidden targets, sensors.

    Attributes:
        robots: In the order of the team.
        workspace: Bounds and obstacles; None has none.
        sensors: Sensors by name.
        landmark_keys: Key of each landmark, N in all.
        landmark_positions: Shape (N, 2) or (N, 3), metres, world frame.
        known_landmarks: Keys of the landmarks that the team knows beforehand.
        hidden: Dynamics of the hidden targets; None has none.
        hidden_state: Their true stacked state at step 0, shape (n,), metres, world frame.
        multi_robot: Models by name: two robots for which one holds measure each other, the robot
            earlier in the team first, as planning assumes.
        step_s: Duration of a step, seconds.
    """

    robots: tuple[WorldRobot, ...]
    workspace: Workspace | None = None
    sensors: Mapping[str, AbstractSensor] = field(default_factory=dict)
    landmark_keys: tuple[Key, ...] = ()
    landmark_positions: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    known_landmarks: frozenset[Key] = frozenset()
    hidden: HiddenState | None = None
    hidden_state: FloatArray = field(default_factory=lambda: np.zeros(0))
    multi_robot: Mapping[str, MultiRobotModel] = field(default_factory=dict)
    step_s: float = 1.0

    def __post_init__(self) -> None:
        """Check names, sizes and that every robot starts in free space."""
        object.__setattr__(self, "robots", tuple(self.robots))
        object.__setattr__(self, "sensors", dict(self.sensors))
        object.__setattr__(self, "multi_robot", dict(self.multi_robot))
        object.__setattr__(self, "step_s", check_positive(self.step_s, "world step_s"))
        self._check_robots()
        self._check_landmarks()
        size = 0 if self.hidden is None else self.hidden.size
        state = check_finite(self.hidden_state, "world hidden_state", (size,))
        object.__setattr__(self, "hidden_state", state)
        flat = self.hidden is not None and 2 in self.hidden.sizes
        if flat and any(robot.pose.ndim == 2 for robot in self.robots):
            raise InvalidInputError(
                "world: expected targets in space (3 coordinates) for robots with 4 x 4 poses, "
                "got 2 coordinates"
            )

    def robot(self, name: str) -> WorldRobot:
        """Look a robot up by name.

        Raises:
            UnknownNameError: If there is none.
        """
        for robot in self.robots:
            if robot.name == name:
                return robot
        known = ", ".join(robot.name for robot in self.robots)
        raise UnknownNameError(f"world: robot {name!r} is not one of: {known}")

    def landmark_position(self, key: Key) -> FloatArray:
        """True position of a landmark, metres.

        Raises:
            UnknownNameError: If there is no such landmark.
        """
        if key not in self.landmark_keys:
            raise UnknownNameError(
                f"world: landmark {key} is not one of its {len(self.landmark_keys)} landmarks"
            )
        return self.landmark_positions[self.landmark_keys.index(key)]

    def has_line_of_sight(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """Whether segments are free of obstacles: what a sensor asks of a world.

        Args:
            starts: Shape (n, 2) or (1, 2), metres, world frame.
            ends: Shape (n, 2), metres, world frame.

        Returns:
            Shape (n,), 1 where free, 0 where an obstacle is in between.
        """
        if self.workspace is None:
            return np.ones(len(ends), dtype=np.int64)
        return self.workspace.has_line_of_sight(starts, ends)

    def _check_robots(self) -> None:
        """Check names, sensors and start positions."""
        names = [robot.name for robot in self.robots]
        if not names or len(set(names)) != len(names):
            raise InvalidInputError(f"world: expected robots with unique names, got {names}")
        if len({robot.pose.ndim for robot in self.robots}) > 1:
            raise InvalidInputError("world: expected planar or spatial robots, got both")
        for robot in self.robots:
            for sensor in robot.sensors:
                if sensor not in self.sensors:
                    known = ", ".join(self.sensors) or "none"
                    raise UnknownNameError(
                        f"robot {robot.name!r}: sensor {sensor!r} is not one of: {known}"
                    )
            where = position(robot.pose)[:2]
            if self.workspace is not None and not self.workspace.are_positions_valid(where)[0]:
                raise InvalidInputError(
                    f"robot {robot.name!r}: expected a start in free space, got {where}, which "
                    "is out of bounds or touches an obstacle"
                )

    def _check_landmarks(self) -> None:
        """Check keys and positions of landmarks."""
        keys = tuple(int(key) for key in self.landmark_keys)
        if len(set(keys)) != len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise InvalidInputError(f"world: expected unique landmark keys, got {twice} twice")
        points = check_finite(self.landmark_positions, "landmark positions", (len(keys), None))
        if points.shape[1] not in (2, 3):
            raise InvalidInputError(
                f"landmark positions: expected 2 or 3 coordinates, got {points.shape[1]}"
            )
        spatial = any(robot.pose.ndim == 2 for robot in self.robots)
        if keys and spatial and points.shape[1] == 2:
            raise InvalidInputError(
                "landmark positions: expected 3 coordinates for robots with 4 x 4 poses, got 2"
            )
        unknown = sorted(frozenset(self.known_landmarks) - frozenset(keys))
        if unknown:
            raise UnknownNameError(f"world: known landmark {unknown[0]} is not a landmark")
        object.__setattr__(self, "landmark_keys", keys)
        object.__setattr__(self, "landmark_positions", points)
        object.__setattr__(self, "known_landmarks", frozenset(self.known_landmarks))
