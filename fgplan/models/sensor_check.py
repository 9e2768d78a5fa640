"""A sensor's Jacobians against central differences of its predictions.

    dh/dx_i ~ (h(x (+) s e_i) - h(x (-) s e_i)) / 2s

with s = 1e-5 and (+) the increment on the right of GTSAM's tangents. A wrong Jacobian raises no
error while planning, it gives wrong covariances. Where the Jacobians have fewer rows than the
measurement has numbers (a unit vector moves in a plane of two) the rows are known up to a rotation
only, and J'J is compared, which the rotation leaves alone.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from fgplan.checks import check_covariance, check_finite
from fgplan.errors import InvalidInputError
from fgplan.models.pose import check_pose, compose, tangent_dim
from fgplan.models.sensor import AbstractSensor, checked_jacobians
from fgplan.typing import ArrayLike, FloatArray, Pose

STEP = 1e-5
"""Step of the differences, metres and radians."""

TOLERANCE = 1e-6
"""Largest difference, relative to the largest entry (but to one at least)."""


def check_sensor(sensor: AbstractSensor, pose: ArrayLike, target: ArrayLike) -> float:
    """Check a sensor at one pose and target; a test of your own sensor asks at several.

    Args:
        sensor: The sensor.
        pose: Robot pose, shape (3,) or (4, 4), world frame.
        target: Point, shape (2,) or (3,), metres, world frame.

    Returns:
        Largest difference of a Jacobian from its central differences, in the Jacobian's units.

    Raises:
        InvalidInputError: If a Jacobian is off (says which, where and by how much), if shapes,
            noise or prediction are not usable, or it is a class and no sensor.

    Example:
        >>> from fgplan.models.range_bearing import RangeSensor
        >>> check_sensor(RangeSensor(sigma_m=0.1), [1.0, 2.0, 0.5], [4.0, 6.0]) < 1e-8
        True
    """
    if not isinstance(sensor, AbstractSensor):
        is_class = isinstance(sensor, type)
        what = f"the class {sensor.__name__}" if is_class else type(sensor).__name__
        remedy = f"make one: {sensor.__name__}(...)" if is_class else "derive yours from it"
        raise InvalidInputError(f"sensor: expected an AbstractSensor, got {what}; {remedy}")
    where = check_pose(pose, f"sensor {sensor.kind!r}: pose")
    point = check_finite(target, f"sensor {sensor.kind!r}: target", (None,))
    if point.size not in (2, 3)[where.ndim - 1 :]:
        wanted = (
            "2 or 3 coordinates for a planar pose"
            if where.ndim == 1
            else ("3 coordinates for a spatial pose")
        )
        raise InvalidInputError(
            f"sensor {sensor.kind!r}: target: expected {wanted}, got {point.size}"
        )
    _check_prediction(sensor, sensor.predict(where, point))
    by_pose, by_target = checked_jacobians(sensor, where, point)
    check_covariance(sensor.noise(where, point), f"noise of sensor {sensor.kind!r}", len(by_pose))
    poses = [
        [_moved(where, sign * step) for step in STEP * np.eye(tangent_dim(where))]
        for sign in (1.0, -1.0)
    ]
    points = [[point + sign * step for step in STEP * np.eye(point.size)] for sign in (1.0, -1.0)]
    expected_by_pose = _columns(sensor, [[(p, point) for p in side] for side in poses])
    expected_by_target = _columns(sensor, [[(where, p) for p in side] for side in points])
    worst = 0.0
    for name, have, want in (
        ("pose", by_pose, expected_by_pose),
        ("target", by_target, expected_by_target),
    ):
        if len(want) < len(have):
            raise InvalidInputError(
                f"Jacobian of sensor {sensor.kind!r} by {name}: expected at most {len(want)} rows "
                f"for a measurement of {len(want)} numbers, got {len(have)}"
            )
        same_rows = len(have) == len(want)
        a, b = (have, want) if same_rows else (have.T @ have, want.T @ want)
        off = np.abs(a - b)
        worst = max(worst, float(off.max()))
        if off.max() > TOLERANCE * max(1.0, float(np.abs(b).max())):
            row, column = np.unravel_index(int(off.argmax()), off.shape)
            what = f"{'' if same_rows else 'J transposed J of the '}Jacobian by {name}"
            raise InvalidInputError(
                f"sensor {sensor.kind!r}: {what}[{row}, {column}] is {a[row, column]:.6g}, central "
                f"differences say {b[row, column]:.6g}, off by {off.max():.3g}; increments of a "
                "pose act on its right: planar (forward, left, turn), spatial rotation first"
            )
    return worst


def _check_prediction(sensor: AbstractSensor, predicted: object) -> None:
    """Refuse a prediction that is no vector of finite numbers."""
    what = f"prediction of sensor {sensor.kind!r}"
    if not isinstance(predicted, np.ndarray) or predicted.ndim != 1:
        came = type(predicted).__name__
        if isinstance(predicted, np.ndarray):
            came = f"one of shape {predicted.shape}"
        raise InvalidInputError(
            f"{what}: expected an array of shape (m,), got {came}; a single number is "
            "numpy.array([number])"
        )
    check_finite(predicted, what, (None,))


def _columns(sensor: AbstractSensor, sides: list[list[tuple[Pose, FloatArray]]]) -> FloatArray:
    """Central differences, a column a direction."""
    ahead, behind = ([sensor.predict(*at) for at in side] for side in sides)
    pairs = zip(ahead, behind, strict=True)
    columns = [np.ravel(sensor.difference(plus, minus)) / (2.0 * STEP) for plus, minus in pairs]
    return np.array(columns).T


def _moved(pose: Pose, tangent: FloatArray) -> Pose:
    """A pose moved by an increment on its right."""
    if pose.ndim == 1:
        return compose(pose, tangent)
    step = np.eye(4)
    step[:3, :3] = Rotation.from_rotvec(tangent[:3]).as_matrix()
    step[:3, 3] = tangent[3:]
    return compose(pose, step)
