"""Lines of pose graphs as text, what g2o and PyFactorGraph have in common.

One line is a tag, ids and numbers. A line that is not understood to its last word is an error that
names file, line and tag; nothing is skipped but empty lines and comments. A symmetric matrix is
written as its upper triangle, by rows. In space both formats order a pose's tangent (translation,
rotation) and GTSAM (rotation, translation): ``TRANSLATION_FIRST`` permutes, either way. Quaternions
are x y z w, last the real part.

A landmark measured at p in the frame of a pose becomes GTSAM's bearing-range factor with the
covariance J C J', J the Jacobian of (bearing, range) at p: the same information at the measurement,
and a factor that can be pickled.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gtsam
import numpy as np

from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.typing import Covariance, FloatArray, Key

TRANSLATION_FIRST = [3, 4, 5, 0, 1, 2]
"""Rows of a (rotation, translation) matrix in the order (translation, rotation), and back."""

UNIT_TOLERANCE = 1e-3
"""A quaternion whose length is nearer to one than this is scaled to one; others are refused."""


class GraphLine(NamedTuple):
    """One line: where it stands, its tag, ids, numbers, and its time where the format has one."""

    where: str
    tag: str
    ids: tuple[Key, ...]
    numbers: tuple[float, ...]
    stamp_s: float = math.nan


def text_lines(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Words of every line of a file that is neither empty nor a comment (#), and where it stands.

    Args:
        path: The file.

    Yields:
        ``file:line`` and the words.

    Raises:
        ScenarioError: If the file cannot be read as text.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # a byte order mark is no part of the tag
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read as text: {error}") from error
    for number, content in enumerate(text.splitlines(), start=1):
        words = content.split()
        if words and not words[0].startswith("#"):
            yield f"{path}:{number}", words


def write_text_lines(path: Path | str, lines: Sequence[str]) -> None:
    """Write lines of text.

    Raises:
        ScenarioError: If the file cannot be written.
    """
    try:
        Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be written: {error.strerror}") from error


def finite_numbers(where: str, tag: str, words: Sequence[str]) -> tuple[float, ...]:
    """Numbers of some words.

    Raises:
        ScenarioError: If a word is no finite number.
    """
    try:  # Python would take 1_0 for ten
        numbers = tuple(float(word.replace("_", "?")) for word in words)
    except ValueError as error:
        raise ScenarioError(f"{where}: {tag}: expected numbers, got {' '.join(words)}") from error
    if not all(map(math.isfinite, numbers)):
        raise ScenarioError(f"{where}: {tag}: expected finite numbers, got {list(words)}")
    return numbers


def number_text(values: Iterable[float], what: str) -> str:
    """Numbers so that they are read back to the last bit.

    Args:
        values: The numbers.
        what: What they are of, for the message.

    Raises:
        InvalidInputError: If one is not finite: no reader would take the file.
    """
    numbers = [float(value) for value in values]
    if not all(map(math.isfinite, numbers)):
        raise InvalidInputError(f"{what}: expected finite numbers, got {numbers}")
    return " ".join(map(repr, numbers))


def unit_quaternion(where: str, tag: str, quaternion: Sequence[float]) -> gtsam.Rot3:
    """Rotation from qx qy qz qw.

    Raises:
        ScenarioError: If its length is not one.
    """
    qx, qy, qz, qw = quaternion
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if abs(norm - 1.0) > UNIT_TOLERANCE:
        raise ScenarioError(
            f"{where}: {tag}: expected a unit quaternion qx qy qz qw, got length {norm:g}"
        )
    return gtsam.Rot3.Quaternion(qw / norm, qx / norm, qy / norm, qz / norm)


def spatial_pose(where: str, tag: str, numbers: Sequence[float]) -> gtsam.Pose3:
    """Pose from x y z qx qy qz qw.

    Raises:
        ScenarioError: If the quaternion is not of length one.
    """
    return gtsam.Pose3(unit_quaternion(where, tag, numbers[3:7]), np.array(numbers[:3]))


def spatial_numbers(pose: gtsam.Pose3) -> list[float]:
    """Position and quaternion: x y z qx qy qz qw."""
    quaternion = pose.rotation().toQuaternion()
    return [*pose.translation(), *(getattr(quaternion, axis)() for axis in "xyzw")]


def symmetric_matrix(line: GraphLine, size: int, what: str) -> FloatArray:
    """Positive definite matrix whose upper triangle, by rows, ends a line.

    Args:
        line: The line.
        size: Rows of the matrix.
        what: ``information`` or ``covariance``, for the message.

    Returns:
        Shape (size, size).

    Raises:
        ScenarioError: If it is not positive definite.
    """
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = line.numbers[len(line.numbers) - size * (size + 1) // 2 :]
    matrix = matrix + np.triu(matrix, 1).T
    diagonal = np.diag(matrix)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    eigenvalues = np.linalg.eigvalsh(matrix * np.outer(scale, scale))
    if (diagonal <= 0.0).any() or eigenvalues[0] <= 1e-14 * eigenvalues[-1]:
        other = "covariance" if what == "information" else "information matrix"
        raise ScenarioError(
            f"{line.where}: {line.tag}: expected a positive definite {what} matrix, got "
            f"diagonal {diagonal} and smallest eigenvalue {eigenvalues[0]:g} (diagonal scaled to "
            f"one); is it a {other}, or its triangle in another order?"
        )
    return matrix


def upper_triangle(matrix: FloatArray) -> list[float]:
    """Upper triangle of a symmetric matrix, by rows."""
    return [float(number) for number in matrix[np.triu_indices(len(matrix))]]


def landmark_factor(
    line: GraphLine, point: FloatArray, covariance: Covariance
) -> gtsam.NonlinearFactor:
    """Factor of a landmark that a pose measured.

    Args:
        line: Its ids are the pose and the landmark.
        point: The landmark in the frame of the pose, shape (2,) or (3,), metres.
        covariance: Of the point, same frame, square metres.

    Returns:
        A BearingRangeFactor2D or BearingRangeFactor3D.

    Raises:
        ScenarioError: If the landmark is at distance zero.
    """
    range_m = float(np.linalg.norm(point))
    if range_m == 0.0:
        raise ScenarioError(
            f"{line.where}: {line.tag}: a landmark at distance zero has no bearing; leave it out"
        )
    pose, landmark = line.ids[:2]
    jacobian = _bearing_range_jacobian(point)
    covariance = jacobian @ covariance @ jacobian.T
    # Exactly symmetric: GTSAM drops the off-diagonal of a covariance that is not.
    noise = gtsam.noiseModel.Gaussian.Covariance(0.5 * (covariance + covariance.T))
    if len(point) == 2:
        bearing = gtsam.Rot2(math.atan2(point[1], point[0]))
        return gtsam.BearingRangeFactor2D(pose, landmark, bearing, range_m, noise)
    return gtsam.BearingRangeFactor3D(pose, landmark, gtsam.Unit3(point), range_m, noise)


def landmark_point(factor: Any) -> tuple[FloatArray, FloatArray]:  # noqa: ANN401
    """Point and information behind a bearing-range factor.

    Args:
        factor: A BearingRangeFactor2D or BearingRangeFactor3D.

    Returns:
        The landmark in the frame of the pose, shape (2,) or (3,), and its information.
    """
    measured, information = factor.measured(), factor.noiseModel().information()
    bearing = measured.bearing()
    planar = isinstance(bearing, gtsam.Rot2)
    point = measured.range() * np.array([bearing.c(), bearing.s()] if planar else bearing.point3())
    jacobian = _bearing_range_jacobian(point)
    return point, jacobian.T @ information @ jacobian


def _bearing_range_jacobian(point: FloatArray) -> FloatArray:
    """Jacobian of GTSAM's (bearing, range) by the point in the sensor's frame."""
    range_m = float(np.linalg.norm(point))
    if point.size == 2:
        across = np.array([[-point[1], point[0]]]) / range_m**2
    else:
        across = gtsam.Unit3(point).basis().T / range_m
    return np.vstack([across, point[None, :] / range_m])
