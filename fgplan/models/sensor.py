"""What a robot can measure of a target, and how well.

A sensor is a model z = h(pose, target) + v, v ~ N(0, noise(pose, target)). The target is a point,
shape (2,) or (3,), world frame: a landmark, a hidden target, or another robot's position. Planning
needs the Jacobians only, whitened: with W'W = noise^-1 the rows are W [dh/dpose, dh/dtarget].
Tangents follow GTSAM, so the rows equal those of the linearised GTSAM factor up to a rotation of
the rows, which no covariance sees. Bearings in space have one sigma for both directions, so that
the basis chosen for them does not matter either.
"""

from abc import ABC, abstractmethod
from typing import ClassVar, Protocol

import numpy as np

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError
from fgplan.models.pose import point_jacobian, position_in, rotation_matrix
from fgplan.typing import BoolArray, Covariance, FloatArray, Jacobian, Pose

MIN_DISTANCE_M = 1e-9
"""Nearer than this a range or bearing has no direction: not visible."""


class SightLines(Protocol):
    """What a sensor asks of a world: which straight lines are free."""

    def has_line_of_sight(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """Whether segments from (n, 2) to (n, 2), metres, are free: shape (n,), boolean."""
        ...


class AbstractSensor(ABC):
    """A model of measuring one point; your own gives ``predict``, ``jacobians`` and ``noise``.

    ``fgplan.check_sensor`` compares its Jacobians with differences.

    Attributes:
        kind: Name of the model in messages.
        max_range_m: Farther targets are not seen, metres; by default none is too far.
        field_of_view_rad: Full opening angle about the heading, radians; 2 pi sees all round.
    """

    kind: ClassVar[str] = "own sensor"
    max_range_m: float = np.inf
    field_of_view_rad: float = 2.0 * np.pi

    @abstractmethod
    def predict(self, pose: Pose, target: FloatArray) -> FloatArray:
        """Noise-free measurement, shape (m,)."""

    @abstractmethod
    def jacobians(self, pose: Pose, target: FloatArray) -> tuple[Jacobian, Jacobian]:
        """Derivatives by pose tangent (m, d) and by target (m, n)."""

    @abstractmethod
    def noise(self, pose: Pose, target: FloatArray) -> Covariance:
        """Covariance of the measurement, shape (m, m)."""

    def difference(self, measured: FloatArray, predicted: FloatArray) -> FloatArray:
        """Residual of a measurement; angles wrapped by sensors that have them."""
        return measured - predicted

    def visible(self, pose: Pose, target: FloatArray, world: SightLines | None = None) -> bool:
        """Whether the target is within range, field of view and line of sight.

        Args:
            pose: Robot pose, shape (3,) or (4, 4).
            target: Point, shape (2,) or (3,), metres.
            world: Obstacles; None has none.
        """
        offset = target - position_in(pose, target.size)
        distance = float(np.linalg.norm(offset))
        if not MIN_DISTANCE_M < distance <= self.max_range_m:
            return False
        if self.field_of_view_rad < 2.0 * np.pi:
            ahead = rotation_matrix(pose)[:, 0]
            cosine = float(ahead @ offset[: ahead.size]) / float(
                np.linalg.norm(offset[: ahead.size])
            )
            if np.arccos(np.clip(cosine, -1.0, 1.0)) > 0.5 * self.field_of_view_rad:
                return False
        if world is None:
            return True
        start = position_in(pose, target.size)[None, :2]
        return bool(world.has_line_of_sight(start, target[None, :2])[0])

    def linearise(
        self, pose: Pose, target: FloatArray, covariance: Covariance | None = None
    ) -> tuple[Jacobian, Jacobian]:
        """Whitened Jacobians at a pose and a target.

        Args:
            pose: Robot pose, shape (3,) or (4, 4), world frame.
            target: Point, shape (n,), metres, world frame.
            covariance: Noise to whiten with, shape (m, m); None takes ``noise(pose, target)``.

        Returns:
            Rows by pose tangent, shape (m, d), and by target, shape (m, n).

        Raises:
            InvalidInputError: If Jacobians or noise have another shape, are not finite, or the
                noise is not positive definite; names the sensor's kind.
        """
        by_pose, by_target = checked_jacobians(self, pose, target)
        noise = np.asarray(self.noise(pose, target) if covariance is None else covariance)
        rows = len(by_pose)
        if noise.shape != (rows, rows) or not np.isfinite(noise).all():
            raise InvalidInputError(
                f"noise of sensor {self.kind!r}: expected finite numbers of shape ({rows}, {rows}) "
                f"for Jacobians of {rows} rows, got {noise.tolist()}"
            )
        by_pose, by_target = whiten(noise, by_pose, by_target)
        return by_pose, by_target

    def linearise_between(
        self, pose: Pose, other: Pose, covariance: Covariance | None = None
    ) -> tuple[Jacobian, Jacobian]:
        """Whitened Jacobians of measuring another robot's position.

        Args:
            pose: Pose of the robot that measures.
            other: Pose of the robot that is measured.
            covariance: Noise to whiten with, shape (m, m); None takes the sensor's.

        Returns:
            Rows by the two pose tangents, each of shape (m, d).
        """
        size = 2 if other.ndim == 1 else 3
        target = position_in(other, size)
        by_pose, by_target = self.linearise(pose, target, covariance)
        return by_pose, by_target @ point_jacobian(other, size)


def checked_jacobians(
    sensor: AbstractSensor, pose: Pose, target: FloatArray
) -> tuple[Jacobian, Jacobian]:
    """Jacobians of a sensor, refused by its kind where they cannot be right.

    Args:
        sensor: The sensor, perhaps a user's own.
        pose: Robot pose, shape (3,) or (4, 4), world frame.
        target: Point, shape (n,), metres, world frame.

    Returns:
        By pose tangent, shape (m, d), and by target, shape (m, n).

    Raises:
        InvalidInputError: If there are not two, a shape is another, or a number is not finite.
    """
    found = sensor.jacobians(pose, target)
    if not (isinstance(found, tuple | list) and len(found) == 2):
        raise InvalidInputError(
            f"Jacobians of sensor {sensor.kind!r}: expected two, by pose and by target, got "
            f"{type(found).__name__}"
        )
    blocks = (np.asarray(found[0], dtype=np.float64), np.asarray(found[1], dtype=np.float64))
    rows = blocks[0].shape[:1]
    for name, block, size in (
        ("pose", blocks[0], 3 if pose.ndim == 1 else 6),
        ("target", blocks[1], target.size),
    ):
        if block.shape != (*rows, size) or not rows:
            raise InvalidInputError(
                f"Jacobian of sensor {sensor.kind!r} by {name}: expected shape "
                f"({rows[0] if rows else 'm'}, {size}), got {block.shape}"
            )
        if not np.isfinite(block).all():
            raise InvalidInputError(
                f"Jacobian of sensor {sensor.kind!r} by {name}: expected finite numbers, got "
                f"{block.tolist()} at pose {pose.tolist()} and target {target.tolist()}"
            )
    return blocks


def whiten(covariance: Covariance, *blocks: Jacobian) -> tuple[Jacobian, ...]:
    """Multiply blocks of rows by W with W'W = covariance^-1.

    Args:
        covariance: Shape (m, m), positive definite.
        *blocks: Each of shape (m, any).

    Returns:
        The whitened blocks.

    Raises:
        InvalidInputError: If the covariance is not positive definite.
    """
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError as error:
        raise InvalidInputError(
            f"sensor noise: expected a positive definite covariance, got {np.asarray(covariance)}"
        ) from error
    weight = np.linalg.inv(lower)
    return tuple(weight @ block for block in blocks)


def check_view(sensor: AbstractSensor) -> None:
    """Check range and field of view of a sensor.

    Raises:
        InvalidInputError: If either is not usable.
    """
    if sensor.max_range_m != np.inf:
        check_positive(sensor.max_range_m, f"{sensor.kind} max_range_m")
    angle = check_positive(sensor.field_of_view_rad, f"{sensor.kind} field_of_view_rad")
    if angle > 2.0 * np.pi + 1e-12:
        raise InvalidInputError(
            f"{sensor.kind} field_of_view_rad: expected at most 2 pi, got {angle:g}; "
            "is it in degrees?"
        )
