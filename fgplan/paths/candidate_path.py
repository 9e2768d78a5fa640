"""A path that a robot may take, with all that its factors need.

A candidate path and an announced path are the same product: poses with steps and times, the noise
of every motion step, and the mapped landmarks that would be observed with their noise. Nobody
needs more to rebuild the local factors of equation (9) of Regev and Indelman 2017,

    FG_local(P) = prod_l P(x_l | x_{l-1}, u_{l-1}) P(Z_l | X_l).

Pose 0 is the robot's current pose as the prior estimates it.
"""

from dataclasses import dataclass, field

import numpy as np

from fgplan.checks import check_covariances, check_finite
from fgplan.errors import InvalidInputError
from fgplan.models.pose import PLANAR_DIM, SPATIAL_DIM
from fgplan.paths.state import State
from fgplan.typing import Covariance, FloatArray, Key

KNOWN_MOTION = 1e-12
"""Variance of a motion step of robots whose poses a planner takes as known; a path needs some."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """A planned observation of a mapped landmark.

    Attributes:
        step: Look-ahead step from which the landmark is observed, 1 or more.
        landmark: GTSAM key of the landmark in the prior.
        sensor: Name of the sensor in the planning problem.
        covariance: Noise, shape (m, m).
    """

    step: int
    landmark: Key
    sensor: str
    covariance: Covariance


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidatePath:
    """A path with the parameters of its local factors.

    Attributes:
        robot: Name of the robot.
        poses: Shape (L + 1, 3) or (L + 1, 4, 4), world frame; pose 0 is the current pose.
        times_s: Shape (L + 1,), seconds from planning time, increasing from 0.
        motion_covariances: Shape (L, d, d), tangent of the later pose.
        vertices: Roadmap vertex of each pose, length L + 1; -1 between vertices.
        observations: Planned observations of mapped landmarks, by increasing step.
        length_m: Length of the path, metres.
    """

    robot: str
    poses: FloatArray
    times_s: FloatArray
    motion_covariances: FloatArray
    vertices: tuple[int, ...] = ()
    observations: tuple[Observation, ...] = ()
    length_m: float = field(default=-1.0)

    def __post_init__(self) -> None:
        """Check shapes, finiteness, times and noise once."""
        name = f"path of robot {self.robot!r}"
        shape = np.shape(self.poses)
        if shape[1:] not in ((3,), (4, 4)) or shape[0] < 2:
            raise InvalidInputError(
                f"{name}: expected poses of shape (L + 1, 3) or (L + 1, 4, 4) with L >= 1, got "
                f"{shape}"
            )
        size = shape[0]
        dim = PLANAR_DIM if len(shape) == 2 else SPATIAL_DIM
        poses = check_finite(self.poses, f"{name}: poses", shape)
        times = check_finite(self.times_s, f"{name}: times_s", (size,))
        stops = times[1:] <= times[:-1]
        if stops.any():
            step = int(np.argmax(stops)) + 1
            raise InvalidInputError(f"{name}: expected increasing times, got a stop at step {step}")
        noise = check_finite(
            self.motion_covariances, f"{name}: motion_covariances", (size - 1, dim, dim)
        )
        noise = check_covariances(noise, lambda row: f"{name}: motion covariance of step {row + 1}")
        vertices = tuple(map(int, self.vertices)) or (-1,) * size
        if len(vertices) != size:
            raise InvalidInputError(f"{name}: expected {size} vertices, got {len(vertices)}")
        for seen in self.observations:
            if not 1 <= seen.step < size:
                raise InvalidInputError(
                    f"{name}: expected observations at steps 1 to {size - 1}, got {seen.step}"
                )
        where = poses[:, :2] if dim == PLANAR_DIM else poses[:, :3, 3]
        with np.errstate(over="ignore"):
            steps = where[1:] - where[:-1]
            length = float(np.sqrt((steps * steps).sum(axis=1)).sum())
        if not np.isfinite(length):
            raise InvalidInputError(
                f"{name}: poses: expected places whose distances are finite, got up to "
                f"{np.abs(where).max():g} m"
            )
        for key, value in (
            ("poses", poses),
            ("times_s", times),
            ("motion_covariances", noise),
            ("vertices", vertices),
            ("observations", tuple(sorted(self.observations, key=lambda o: (o.step, o.landmark)))),
            ("length_m", length if self.length_m < 0 else float(self.length_m)),
        ):
            object.__setattr__(self, key, value)

    @property
    def steps(self) -> int:
        """Number of steps L."""
        return len(self.poses) - 1

    @property
    def dim(self) -> int:
        """Dimension of a pose's tangent: 3 or 6."""
        return PLANAR_DIM if self.poses.ndim == 2 else SPATIAL_DIM

    def state(self, step: int) -> State:
        """State at a step, 0 to L; a path that has ended keeps its last state."""
        step = min(step, self.steps)
        return State(
            self.robot, step, float(self.times_s[step]), self.poses[step], self.vertices[step]
        )

    def states(self) -> tuple[State, ...]:
        """States 1 to L: the variables that the path adds to the belief."""
        return tuple(self.state(step) for step in range(1, self.steps + 1))
