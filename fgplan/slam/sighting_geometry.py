"""Ranges and bearings of one point from several poses: where it may be, and how surely.

Starting points that geometry offers:

    meeting of the bearings     sum (I - u u') (q - p) = 0
    bearing meets range         |p_i + t u_i - p_j| = r_j
    ranges                      -2 p'q + |q|^2 = r^2 - |p|^2, and its mirror images about the line
                                (in space: plane) that the poses p lie nearest to

Bearings count by the chord between measured and predicted direction, the same in the plane and in
space: residuals are (q - p) / |q - p| - u and |q - p| - r.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.models.pose import (
    heading_slice,
    point_jacobian,
    position,
    rotation_matrix,
    skew,
    tangent_dim,
)
from fgplan.models.sensor import MIN_DISTANCE_M
from fgplan.typing import Covariance, FloatArray, IntArray, Pose

RIVAL_CHI_SQUARE = 25.0
"""How much worse every other place must fit: as improbable as five sigmas."""

FAIR_SIGMAS = 3.0
"""How far the squared change of the residuals must be within a factor of two of the linear one."""

_ITERATIONS = 30
_LEAST_DAMPING = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """One measurement as geometry.

    Attributes:
        direction: Unit vector in the robot frame, shape (2,) or (3,); None without a bearing.
        direction_sigma: Radians.
        distance: Metres; None without a range.
        distance_sigma: Metres.
    """

    direction: FloatArray | None = None
    direction_sigma: float = 1.0
    distance: float | None = None
    distance_sigma: float = 1.0

    def point(self, pose: Pose) -> FloatArray | None:
        """The point that a bearing and range give; None without both or at no distance."""
        if self.direction is None or self.distance is None or self.distance <= 0.0:
            return None
        return position(pose) + self.distance * rotation_matrix(pose) @ self.direction


@dataclass(frozen=True, slots=True)
class Minimum:
    """A minimum of the least squares, and its squared whitened residuals."""

    point: FloatArray
    chi_square: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SightingGeometry:
    """Sightings in the world frame. Residuals are those of the bearings, then of the ranges.

    Attributes:
        origins: Positions of the poses, shape (n, s).
        with_bearing: Rows of the sightings with a bearing, shape (b,).
        directions: Unit vectors of these, shape (b, s).
        with_range: Rows of the sightings with a range, shape (r,).
        distances: Metres, shape (r,).
        variances: Of each residual, shape (b s + r,).
    """

    origins: FloatArray
    with_bearing: IntArray
    directions: FloatArray
    with_range: IntArray
    distances: FloatArray
    variances: FloatArray

    @staticmethod
    def of(sightings: Sequence[Sighting], poses: Sequence[Pose]) -> "SightingGeometry":
        """Sightings put into the world frame."""
        origins = np.array([position(pose) for pose in poses])
        size = origins.shape[1]
        seen = [
            (row, rotation_matrix(pose) @ one.direction, one.direction_sigma)
            for row, (one, pose) in enumerate(zip(sightings, poses, strict=True))
            if one.direction is not None
        ]
        ranged = [
            (row, one.distance, one.distance_sigma)
            for row, one in enumerate(sightings)
            if one.distance is not None
        ]
        sigmas = np.append(
            np.repeat([sigma for _, _, sigma in seen], size), [sigma for _, _, sigma in ranged]
        )
        return SightingGeometry(
            origins=origins,
            with_bearing=np.array([row for row, _, _ in seen], dtype=np.int64),
            directions=np.array([unit for _, unit, _ in seen]).reshape(-1, size),
            with_range=np.array([row for row, _, _ in ranged], dtype=np.int64),
            distances=np.array([distance for _, distance, _ in ranged], dtype=np.float64),
            variances=sigmas**2,
        )

    def candidates(self) -> list[FloatArray]:
        """Starting points that geometry offers."""
        points: list[FloatArray] = []
        if len(self.with_bearing) >= 2:
            points.append(self._bearings_meet())
        if len(self.with_bearing) and len(self.with_range):
            points += self._bearing_meets_range()
        if len(self.with_range) >= 2:
            points += self._ranges_meet()
        return points

    def _bearings_meet(self) -> FloatArray:
        """Point nearest to the lines of all bearings."""
        size = self.origins.shape[1]
        across = np.eye(size) - self.directions[:, :, None] * self.directions[:, None, :]
        right = across @ self.origins[self.with_bearing][:, :, None]
        return np.asarray(np.linalg.lstsq(across.reshape(-1, size), right.ravel(), rcond=None)[0])

    def _bearing_meets_range(self) -> list[FloatArray]:
        """Where the last bearing meets the last range; where it comes nearest if it does not."""
        start, unit = self.origins[self.with_bearing[-1]], self.directions[-1]
        offset = start - self.origins[self.with_range[-1]]
        middle = -float(unit @ offset)
        square = middle**2 - float(offset @ offset) + self.distances[-1] ** 2
        half = np.sqrt(max(square, 0.0))
        return [start + way * unit for way in (middle - half, middle + half) if way > 0.0]

    def _ranges_meet(self) -> list[FloatArray]:
        """Points at the measured distances: linear in (q, |q|^2), and mirror images."""
        size, positions = self.origins.shape[1], self.origins[self.with_range]
        centre, axes = self._axes(positions)
        local = positions - centre
        right = self.distances**2 - (local**2).sum(axis=1)
        points = []
        for kept in (size - 1, size):
            lifted = np.hstack([-2.0 * local @ axes[:kept].T, np.ones((len(right), 1))])
            solved = np.linalg.lstsq(lifted, right, rcond=None)[0]
            middle = centre + solved[:kept] @ axes[:kept]
            if kept == size:
                points.append(middle)
                continue
            # Never quite on the plane of the poses: there the least squares have a saddle.
            least = 0.05 * self.distances.mean()
            aside = np.sqrt(max(solved[-1] - solved[:kept] @ solved[:kept], least**2))
            points += [middle + sign * aside * axes[-1] for sign in (1.0, -1.0)]
        return points

    @staticmethod
    def _axes(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Centre of positions and their principal axes, the least one last."""
        centre: FloatArray = positions.mean(axis=0)
        return centre, np.linalg.svd(positions - centre)[2]

    def mirrored(self, point: FloatArray) -> FloatArray:
        """Mirror image of a point about the line or plane that the poses lie nearest to."""
        centre, axes = self._axes(self.origins)
        image: FloatArray = point - 2.0 * float((point - centre) @ axes[-1]) * axes[-1]
        return image

    def residuals(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals at a point, shape (m,), and their derivatives by it, shape (m, s)."""
        offset = point - self.origins
        length = np.sqrt((offset**2).sum(axis=1))
        unit = offset / length[:, None]
        far, ray = length[self.with_bearing], unit[self.with_bearing]
        across = (np.eye(point.size) - ray[:, :, None] * ray[:, None, :]) / far[:, None, None]
        errors = ((ray - self.directions).ravel(), length[self.with_range] - self.distances)
        slopes = (across.reshape(-1, point.size), unit[self.with_range])
        return np.concatenate(errors), np.concatenate(slopes)

    def refined(self, start: FloatArray) -> Minimum | None:
        """Damped least squares from a start; None where it meets a pose, or nothing fits."""
        if not self._apart(start):
            return None
        point, damping = start, 1e-12
        error, slope = self.residuals(point)
        cost = float(error**2 @ (1.0 / self.variances))
        for _ in range(_ITERATIONS):
            weighted = slope.T / self.variances
            square = weighted @ slope
            bound = damping * np.trace(square) * np.eye(point.size)
            step = np.linalg.solve(square + bound, -weighted @ error)
            if not self._apart(point + step):
                damping *= 10.0
                continue
            after, slope_after = self.residuals(point + step)
            cost_after = float(after**2 @ (1.0 / self.variances))
            if not cost_after < cost:
                damping *= 10.0
                continue
            small = cost - cost_after <= 1e-6 * (1.0 + cost)
            point, error, slope, cost = point + step, after, slope_after, cost_after
            damping = max(0.1 * damping, _LEAST_DAMPING)
            if small:
                break
        return Minimum(point, cost)

    def _apart(self, point: FloatArray) -> bool:
        """Whether a point is finite and away from every pose."""
        return bool((((point - self.origins) ** 2).sum(axis=1) > MIN_DISTANCE_M**2).all())

    def outdoes(
        self, best: FloatArray, rivals: Sequence[FloatArray], sigma: float, noise: Covariance
    ) -> bool:
        """Whether a place is determined to a sigma and fits better than all rivals.

        Args:
            best: The place.
            rivals: Other minima.
            sigma: Largest sigma allowed, metres.
            noise: Covariance S of the residuals, shape (m, m).

        Returns:
            Whether (J' S^-1 J)^-1 has no larger sigma, residuals are nearly linear as far as
            FAIR_SIGMAS, and e' S^-1 e of each rival is larger by RIVAL_CHI_SQUARE.
        """
        try:
            lower = np.asarray(np.linalg.cholesky(noise), dtype=np.float64)
        except np.linalg.LinAlgError:
            # What all poses share is so uncertain that taking it out has left rounding errors.
            return False
        error, slope = self.residuals(best)
        _, singular, axes = np.linalg.svd(np.linalg.solve(lower, slope), full_matrices=False)
        if len(singular) < best.size or sigma * singular[-1] < 1.0:
            return False
        if not all(
            self._fair(best, axes, axis, sign * FAIR_SIGMAS / singular[axis], lower)
            for axis in range(best.size)
            for sign in (1.0, -1.0)
        ):
            return False
        fit = float((np.linalg.solve(lower, error) ** 2).sum())
        others = [np.linalg.solve(lower, self.residuals(rival)[0]) for rival in rivals]
        return all(float(other @ other) - fit >= RIVAL_CHI_SQUARE for other in others)

    def _fair(
        self, best: FloatArray, axes: FloatArray, axis: int, way: float, lower: FloatArray
    ) -> bool:
        """Whether residuals change about as they should linearly, some way along an axis."""
        point = best + way * axes[axis]
        if not self._apart(point):
            return False
        error, slope = self.residuals(point)
        change = np.linalg.solve(lower, error - self.residuals(best)[0])
        # Along a circle of equal range, say: what moving across the axis can make up for.
        across = np.linalg.solve(lower, slope @ np.delete(axes, axis, axis=0).T)
        change = change - across @ np.linalg.lstsq(across, change, rcond=None)[0]
        return bool(0.5 * FAIR_SIGMAS**2 <= change @ change <= 2.0 * FAIR_SIGMAS**2)

    def by_poses(self, point: FloatArray, poses: Sequence[Pose]) -> FloatArray:
        """Derivatives of the residuals by the pose tangents, shape (m, n d)."""
        size, dim = point.size, tangent_dim(poses[0])
        _, slope = self.residuals(point)
        matrix = np.zeros((len(slope), len(poses) * dim))
        for place, row in enumerate(self.with_bearing):
            rows, pose = slice(place * size, (place + 1) * size), poses[row]
            block = -slope[rows] @ point_jacobian(pose, size)
            rotation, seen = rotation_matrix(pose), self.directions[place]
            turn = (
                np.array([[seen[1]], [-seen[0]]])
                if size == 2
                else rotation @ skew(rotation.T @ seen)
            )
            block[:, heading_slice(dim)] += turn
            matrix[rows, row * dim : (row + 1) * dim] = block
        first = size * len(self.with_bearing)
        for place, row in enumerate(self.with_range):
            rows = slice(first + place, first + place + 1)
            matrix[rows, row * dim : (row + 1) * dim] = -slope[rows] @ point_jacobian(
                poses[row], size
            )
        return matrix
