"""Where a landmark is that was measured a few times: its first estimate, or that it must wait.

A bearing and range at once give the point. For ranges and bearings from several poses, every
starting point that geometry offers is refined by least squares on all of them:

    meeting of the bearings     sum (I - u u') (q - p) = 0
    bearing meets range         |p_i + t u_i - p_j| = r_j
    ranges                      -2 p'q + |q|^2 = r^2 - |p|^2, and its mirror images about the line
                                (in space: plane) that the poses p lie nearest to

The best one, q, is taken as the start if both hold, with S the covariance of all residuals, which
has the noise of the measurements and of the poses relative to the last one:

    determined     largest sigma of (J' S^-1 J)^-1 at most SIGMA_SHARE of the nearest distance
    no rival       e' S^-1 e of every other minimum, the mirror image of q among the starts, is
                   larger by RIVAL_CHI_SQUARE

So ranges from a straight way never start a landmark: both sides fit. Ranges from less than three
poses not in line (four not in a plane) and bearings without parallax wait too. Bearings count by
the chord between measured and predicted direction, the same in the plane and in space.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.models.measurement import Measurement
from fgplan.models.pose import (
    heading_slice,
    point_jacobian,
    position,
    rotation_matrix,
    skew,
    tangent_dim,
)
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.typing import Covariance, FloatArray, Pose

SIGMA_SHARE = 0.2
"""Largest sigma of a start, as a share of the distance to the nearest pose that measured it."""

RIVAL_CHI_SQUARE = 25.0
"""How much worse every other place must fit: as improbable as five sigmas."""

_ITERATIONS = 30
_SAME_PLACE = 1e-3


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


def sighting_of(measurement: Measurement, sensor: AbstractSensor) -> Sighting | None:
    """A measurement as geometry; None for a user's own sensor, which starts no landmark."""
    sigmas, value = np.sqrt(np.diag(measurement.covariance)), measurement.value
    if isinstance(sensor, RangeSensor):
        return Sighting(distance=float(value[0]), distance_sigma=float(sigmas[0]))
    if not isinstance(sensor, BearingSensor | BearingRangeSensor):
        return None
    ranged = isinstance(sensor, BearingRangeSensor)
    bearing = value[:-1] if ranged else value
    if bearing.size == 1:
        bearing = np.array([np.cos(bearing[0]), np.sin(bearing[0])])
    return Sighting(
        direction=bearing,
        direction_sigma=float(sigmas[: sigmas.size - int(ranged)].max()),
        distance=float(value[-1]) if ranged else None,
        distance_sigma=float(sigmas[-1]) if ranged else 1.0,
    )


def landmark_start(
    sightings: Sequence[Sighting], poses: Sequence[Pose], covariance: Covariance | None = None
) -> FloatArray | None:
    """First estimate of a landmark, if it is determined.

    Args:
        sightings: What was measured of it, n of them.
        poses: Estimate of the pose of each, shape (3,) or (4, 4), world frame.
        covariance: Joint covariance of the poses, shape (n d, n d), in their tangents; None takes
            them as exact, which says less than the truth against a start.

    Returns:
        Shape (2,) or (3,), metres, world frame; None if it must wait.
    """
    geometry = _Geometry.of(sightings, poses)
    found = [geometry.refined(point) for point in geometry.candidates()]
    fits = [place for place in found if place is not None]
    if not fits:
        return None
    best = min(fits, key=geometry.chi_square)
    mirrored = geometry.refined(geometry.mirrored(best))
    rivals = [*fits, *([] if mirrored is None else [mirrored])]
    distance = float(np.linalg.norm(best - geometry.origins, axis=1).min())
    relative = None if covariance is None else _relative(covariance, tangent_dim(poses[-1]))
    chi_square, spread = geometry.weighed(best, poses, relative)
    if not spread <= SIGMA_SHARE * distance:
        return None
    for rival in rivals:
        if np.linalg.norm(rival - best) <= _SAME_PLACE * distance:
            continue
        if geometry.weighed(rival, poses, relative)[0] - chi_square < RIVAL_CHI_SQUARE:
            return None
    return best


def _relative(covariance: Covariance, dim: int) -> Covariance:
    """Covariance of poses if the last one is known: what is common to all drops out."""
    rest, last = slice(0, len(covariance) - dim), slice(len(covariance) - dim, None)
    given = np.zeros_like(covariance)
    gain = np.linalg.solve(covariance[last, last], covariance[last, rest])
    given[rest, rest] = covariance[rest, rest] - covariance[rest, last] @ gain
    return given


@dataclass(frozen=True, slots=True, kw_only=True)
class _Geometry:
    """Sightings in the world frame; NaN where a sighting has no bearing or no range.

    Attributes:
        origins: Shape (n, s).
        directions: Shape (n, s), unit vectors.
        direction_sigmas: Shape (n,).
        distances: Shape (n,).
        distance_sigmas: Shape (n,).
    """

    origins: FloatArray
    directions: FloatArray
    direction_sigmas: FloatArray
    distances: FloatArray
    distance_sigmas: FloatArray

    @staticmethod
    def of(sightings: Sequence[Sighting], poses: Sequence[Pose]) -> "_Geometry":
        """Sightings put into the world frame."""
        nowhere = np.full(position(poses[0]).size, np.nan)
        return _Geometry(
            origins=np.array([position(pose) for pose in poses]),
            directions=np.array(
                [
                    nowhere if one.direction is None else rotation_matrix(pose) @ one.direction
                    for one, pose in zip(sightings, poses, strict=True)
                ]
            ),
            direction_sigmas=np.array([one.direction_sigma for one in sightings]),
            distances=np.array(
                [np.nan if one.distance is None else one.distance for one in sightings]
            ),
            distance_sigmas=np.array([one.distance_sigma for one in sightings]),
        )

    @property
    def with_bearing(self) -> FloatArray:
        """Rows of sightings with a bearing."""
        return np.flatnonzero(np.isfinite(self.directions[:, 0]))

    @property
    def with_range(self) -> FloatArray:
        """Rows of sightings with a range."""
        return np.flatnonzero(np.isfinite(self.distances))

    def candidates(self) -> list[FloatArray]:
        """Starting points that geometry offers."""
        bearings, ranges = self.with_bearing, self.with_range
        size = self.origins.shape[1]
        points: list[FloatArray] = []
        if len(bearings) >= 2:
            unit, start = self.directions[bearings], self.origins[bearings]
            across = np.eye(size) - unit[:, :, None] * unit[:, None, :]
            seen = np.linalg.lstsq(
                across.reshape(-1, size), (across @ start[:, :, None]).ravel(), rcond=None
            )[0]
            points.append(seen)
        if len(bearings) and len(ranges):
            points += self._ray_meets_sphere(int(bearings[-1]), int(ranges[-1]))
        if len(ranges) >= 2:
            points += self._trilaterated(ranges)
        return points

    def _ray_meets_sphere(self, bearing: int, distance: int) -> list[FloatArray]:
        """Where the bearing of one sighting meets the range of another; its nearest point else."""
        unit, offset = self.directions[bearing], self.origins[bearing] - self.origins[distance]
        middle = -float(unit @ offset)
        square = middle**2 - float(offset @ offset) + self.distances[distance] ** 2
        half = np.sqrt(max(square, 0.0))
        ways = [way for way in (middle - half, middle + half) if way > 0.0]
        return [self.origins[bearing] + way * unit for way in ways]

    def _trilaterated(self, rows: FloatArray) -> list[FloatArray]:
        """Points at the measured distances: linear in (q, |q|^2), and mirror images."""
        size, ways = self.origins.shape[1], self.distances[rows]
        centre = self.origins[rows].mean(axis=0)
        local = self.origins[rows] - centre
        axes = np.linalg.svd(local)[2]
        right = ways**2 - (local**2).sum(axis=1)
        points = []
        for kept in (size - 1, size):
            along = local @ axes[:kept].T
            lifted = np.hstack([-2.0 * along, np.ones((len(rows), 1))])
            solved = np.linalg.lstsq(lifted, right, rcond=None)[0]
            middle = centre + solved[:kept] @ axes[:kept]
            if kept == size:
                points.append(middle)
                continue
            # Never quite on the plane of the poses: there the least squares have a saddle.
            aside = max(solved[-1] - solved[:kept] @ solved[:kept], (0.05 * ways.mean()) ** 2)
            points += [middle + sign * np.sqrt(aside) * axes[-1] for sign in (1.0, -1.0)]
        return points

    def mirrored(self, point: FloatArray) -> FloatArray:
        """Mirror image of a point about the line or plane that the poses lie nearest to."""
        centre = self.origins.mean(axis=0)
        normal = np.linalg.svd(self.origins - centre)[2][-1]
        return point - 2.0 * float((point - centre) @ normal) * normal

    def residuals(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals, bearings first, shape (m,), and their derivatives by the point, (m, s)."""
        bearings, ranges = self.with_bearing, self.with_range
        offset = point - self.origins
        length = np.linalg.norm(offset, axis=1)
        unit = offset / length[:, None]
        across = (np.eye(point.size) - unit[:, :, None] * unit[:, None, :]) / length[:, None, None]
        return (
            np.append(
                (unit - self.directions)[bearings].ravel(), (length - self.distances)[ranges]
            ),
            np.vstack([across[bearings].reshape(-1, point.size), unit[ranges]]),
        )

    def sigmas(self) -> FloatArray:
        """Sigma of each residual, shape (m,)."""
        size = self.origins.shape[1]
        return np.append(
            np.repeat(self.direction_sigmas[self.with_bearing], size),
            self.distance_sigmas[self.with_range],
        )

    def chi_square(self, point: FloatArray) -> float:
        """Squared whitened residuals if the poses are exact."""
        return float(((self.residuals(point)[0] / self.sigmas()) ** 2).sum())

    def refined(self, start: FloatArray) -> FloatArray | None:
        """Least squares from a start, damped; None where it leads nowhere."""
        point, sigmas, damping = start, self.sigmas(), 1e-9
        if np.linalg.norm(point - self.origins, axis=1).min() <= 0.0:
            return None
        cost = self.chi_square(point)
        for _ in range(_ITERATIONS):
            error, slope = self.residuals(point)
            slope = slope / sigmas[:, None]
            square = slope.T @ slope
            bound = damping * np.trace(square) * np.eye(point.size)
            step = np.linalg.lstsq(square + bound, -slope.T @ (error / sigmas), rcond=None)[0]
            away = np.linalg.norm(point + step - self.origins, axis=1).min() > 0.0
            after = self.chi_square(point + step) if away else np.inf
            if after < cost:
                small = np.linalg.norm(step) <= 1e-9 * np.linalg.norm(point - self.origins[-1])
                point, cost, damping = point + step, after, max(0.1 * damping, 1e-9)
                if small:
                    break
            else:
                damping *= 10.0
                if damping > 1e6:
                    break
        return point if np.isfinite(cost) else None

    def weighed(
        self, point: FloatArray, poses: Sequence[Pose], covariance: Covariance | None
    ) -> tuple[float, float]:
        """Squared residuals by S, and the largest sigma of the point by S; infinite if none."""
        error, slope = self.residuals(point)
        noise = np.diag(self.sigmas() ** 2)
        if covariance is not None:
            by_pose = self._by_poses(point, poses)
            noise += by_pose @ covariance @ by_pose.T
        whitened = np.linalg.solve(np.linalg.cholesky(noise), np.column_stack([slope, error]))
        singular = np.linalg.svd(whitened[:, :-1], compute_uv=False)
        enough = len(singular) == point.size and singular[-1] > 1e-12 * singular[0]
        return float(whitened[:, -1] @ whitened[:, -1]), (
            1.0 / float(singular[-1]) if enough else np.inf
        )

    def _by_poses(self, point: FloatArray, poses: Sequence[Pose]) -> FloatArray:
        """Derivatives of the residuals by the pose tangents, shape (m, n d)."""
        size, dim = point.size, tangent_dim(poses[0])
        _, slope = self.residuals(point)
        split = size * len(self.with_bearing)
        blocks = np.zeros((len(slope), len(poses) * dim))
        rows = [
            *((row, slice(i * size, (i + 1) * size)) for i, row in enumerate(self.with_bearing)),
            *((row, slice(split + i, split + i + 1)) for i, row in enumerate(self.with_range)),
        ]
        for row, place in rows:
            columns = slice(int(row) * dim, (int(row) + 1) * dim)
            blocks[place, columns] = -slope[place] @ point_jacobian(poses[row], size)
            if place.stop <= split:
                rotation, seen = rotation_matrix(poses[row]), self.directions[row]
                turn = blocks[place, columns][:, heading_slice(dim)]
                if size == 2:
                    turn += np.array([[seen[1]], [-seen[0]]])
                else:
                    turn += rotation @ skew(rotation.T @ seen)
        return blocks
