"""Where a landmark is that was measured a few times: its first estimate, or that it must wait.

A bearing and range at once give the point. For ranges and bearings from several poses, every
starting point that geometry offers (fgplan.slam.sighting_geometry) is refined by least squares on
all of them. The best one, q, is taken as the start if all of this holds, with S the covariance of
all residuals, which has the noise of the measurements and of the poses relative to the last one:

    determined     largest sigma of (J' S^-1 J)^-1 at most SIGMA_SHARE of the nearest distance
    nearly linear  FAIR_SIGMAS along each axis of that covariance, the residuals have changed about
                   as they should: fails beside the line of the poses, where two mirror images
                   become one minimum and noise decides on the side
    no rival       e' S^-1 e of every other minimum, the mirror image of q among the starts, is
                   larger by RIVAL_CHI_SQUARE

So ranges from a straight way never start a landmark: both sides fit. Ranges from less than three
poses not in line (four not in a plane) and bearings without parallax wait too. The measurement of
a user's own sensor starts no landmark; it counts as soon as another has.
"""

from collections.abc import Callable, Sequence

import numpy as np

from fgplan.models.measurement import Measurement
from fgplan.models.pose import tangent_dim
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.slam.sighting_geometry import Sighting, SightingGeometry
from fgplan.typing import Covariance, FloatArray, Pose

SIGMA_SHARE = 0.2
"""Largest sigma of a start, as a share of the distance to the nearest pose that measured it."""

_SAME_PLACE = 1e-3


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
    sightings: Sequence[Sighting],
    poses: Sequence[Pose],
    covariance: Callable[[], Covariance] | None = None,
) -> FloatArray | None:
    """First estimate of a landmark, if it is determined.

    Args:
        sightings: What was measured of it, n of them.
        poses: Estimate of the pose of each, shape (3,) or (4, 4), world frame.
        covariance: Gives the joint covariance of the poses, shape (n d, n d), in their tangents;
            called only where the landmark is determined if the poses are exact. None takes them
            as exact.

    Returns:
        Shape (2,) or (3,), metres, world frame; None if it must wait.
    """
    geometry = SightingGeometry.of(sightings, poses)
    fits = [place for start in geometry.candidates() if (place := geometry.refined(start))]
    if not fits:
        return None
    best = min(fits, key=lambda place: place.chi_square).point
    mirrored = geometry.refined(geometry.mirrored(best))
    distance = float(np.linalg.norm(best - geometry.origins, axis=1).min())
    rivals = [
        place.point
        for place in (*fits, *([mirrored] if mirrored else []))
        if np.linalg.norm(place.point - best) > _SAME_PLACE * distance
    ]
    if not geometry.outdoes(best, rivals, SIGMA_SHARE * distance, np.diag(geometry.variances)):
        return None
    if covariance is None:
        return best
    relative = _relative(covariance(), tangent_dim(poses[-1]))
    by_pose = geometry.by_poses(best, poses)
    noise = np.diag(geometry.variances) + by_pose @ relative @ by_pose.T
    return best if geometry.outdoes(best, rivals, SIGMA_SHARE * distance, noise) else None


def _relative(covariance: Covariance, dim: int) -> Covariance:
    """Covariance of poses if the last one is known: what is common to all drops out."""
    rest, last = slice(0, len(covariance) - dim), slice(len(covariance) - dim, None)
    given = np.zeros_like(covariance)
    gain = np.linalg.solve(covariance[last, last], covariance[last, rest])
    given[rest, rest] = covariance[rest, rest] - covariance[rest, last] @ gain
    return given
