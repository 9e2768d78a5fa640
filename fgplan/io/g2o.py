"""g2o pose graphs: one line a vertex or edge, read without ever losing one silently.

    VERTEX_SE2 id x y heading                      EDGE_SE2 a b dx dy dheading  I (6)
    VERTEX_XY id x y                               EDGE_SE2_XY a b x y  I (3)
    VERTEX_SE3:QUAT id x y z qx qy qz qw           EDGE_SE3:QUAT a b x y z qx qy qz qw  I (21)
    VERTEX_TRACKXYZ id x y z                       EDGE_SE3_TRACKXYZ a b parameter x y z  I (6)
    PARAMS_SE3OFFSET id x y z qx qy qz qw          FIX id ...          # comment

I is the upper triangle, by rows, of the information in the frame of b (of a for landmarks). In
space g2o orders it (translation, rotation), GTSAM (rotation, translation); the rotation part is
taken as GTSAM's reader does, as a rotation vector. A landmark measured at p in the frame of a pose
becomes GTSAM's bearing-range factor with the covariance J I^-1 J', J the Jacobian of (bearing,
range) at p: the same information at the measurement, and a factor that can be pickled. An offset of
the sensor is folded into p.

Own code because gtsam.readG2o loses every edge after a FIX line, and all of them at a comment.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import gtsam
import numpy as np

from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.factors.keys import describe_key
from fgplan.typing import FloatArray, Key

_VERTICES = {"VERTEX_SE2": 3, "VERTEX_XY": 2, "VERTEX_SE3:QUAT": 7, "VERTEX_TRACKXYZ": 3}
_EDGES = {
    "EDGE_SE2": (3, 3, "VERTEX_SE2", "VERTEX_SE2"),
    "EDGE_SE2_XY": (2, 2, "VERTEX_SE2", "VERTEX_XY"),
    "EDGE_SE3:QUAT": (7, 6, "VERTEX_SE3:QUAT", "VERTEX_SE3:QUAT"),
    "EDGE_SE3_TRACKXYZ": (3, 3, "VERTEX_SE3:QUAT", "VERTEX_TRACKXYZ"),
}
_LANDMARKS = ("VERTEX_XY", "VERTEX_TRACKXYZ")
_SWAP = [3, 4, 5, 0, 1, 2]
_WRITTEN = gtsam.BetweenFactorPose2 | gtsam.BetweenFactorPose3
_WRITTEN |= gtsam.BearingRangeFactor2D | gtsam.BearingRangeFactor3D


@dataclass(frozen=True, slots=True, kw_only=True)
class G2oGraph:
    """What g2o files hold.

    Attributes:
        graph: One factor an edge, in the order of files and lines.
        values: Initial estimate of every vertex.
        fixed: Keys of FIX lines, in order: put a prior on each, nothing else fixes the frame.
        counts: Lines read, by tag, repeated edges included.
        repeated: Edges left out because another file holds the same one.
        same_ends: Edges kept although another file holds one between the same vertices with other
            numbers: two measurements, or one written with different rounding (repeat_tolerance).
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    fixed: tuple[Key, ...]
    counts: Mapping[str, int]
    repeated: int
    same_ends: int


class _Line(NamedTuple):
    """One line: where it stands, its tag, ids and numbers."""

    where: str
    tag: str
    ids: tuple[int, ...]
    numbers: tuple[float, ...]


def read_g2o(
    paths: Path | str | Sequence[Path | str],
    landmark_character: str | None = None,
    repeat_tolerance: float = 0.0,
) -> G2oGraph:
    """Read one g2o file, or the files of several robots as one graph.

    Args:
        paths: One file, or one a robot. An edge may join vertices of different files; an edge that
            is exactly repeated in another file is taken once.
        landmark_character: None keeps the ids of landmarks as keys. A letter makes the key
            ``gtsam.symbol(letter, id)`` of it, as gtsam.readG2o does with ``l``: needed where
            landmarks and poses share ids.
        repeat_tolerance: Two edges of different files between the same vertices are one if no
            number differs by more than this (relative above one, else absolute); 0 is identical.

    Returns:
        Factors, values, fixed keys and counts.

    Raises:
        ScenarioError: At the first line that is not understood in full, naming file, line, tag and
            remedy.
    """
    files = [Path(paths)] if isinstance(paths, Path | str) else [Path(path) for path in paths]
    if not files:
        raise ScenarioError("g2o: expected at least one file, got none")
    parsed = [_parse(path, landmark_character) for path in files]
    vertices = _definitions((line for lines in parsed for line in lines), _VERTICES)
    values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
    for key, line in sorted(vertices.items()):
        if line.tag == "VERTEX_SE2":
            values.insert(key, gtsam.Pose2(*line.numbers))
        elif line.tag == "VERTEX_SE3:QUAT":
            values.insert(key, _spatial(line, line.numbers))
        else:
            values.insert(key, np.array(line.numbers))
    seen: dict[tuple[str, tuple[int, ...]], list[tuple[int, _Line]]] = {}
    fixed: dict[Key, None] = {}
    counts: Counter[str] = Counter()
    repeated, same_ends, limit = 0, 0, repeat_tolerance
    for file, lines in enumerate(parsed):
        offsets = _definitions(lines, ("PARAMS_SE3OFFSET",))
        for line in lines:
            counts[line.tag] += 1
            if line.tag == "FIX":
                for key in line.ids:
                    _check_vertex(line, key, None, vertices)
                    fixed[key] = None
            if line.tag not in _EDGES:
                continue
            for key, end in zip(line.ids[:2], _EDGES[line.tag][2:], strict=True):
                _check_vertex(line, key, end, vertices)
            same = seen.setdefault((line.tag, line.ids), [])
            others = [other for other_file, other in same if other_file != file]
            if any(np.allclose(o.numbers, line.numbers, limit, limit) for o in others):
                repeated += 1
                continue
            same_ends += bool(others)
            same.append((file, line))
            graph.add(_factor(line, offsets))
    return G2oGraph(
        graph=graph,
        values=values,
        fixed=tuple(fixed),
        counts=dict(sorted(counts.items())),
        repeated=repeated,
        same_ends=same_ends,
    )


def write_g2o(
    path: Path | str,
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    fixed: Sequence[Key] = (),
) -> None:
    """Write relative-pose and landmark factors as g2o; what is read back has the same error.

    Args:
        path: The file; overwritten.
        graph: Between factors of poses and bearing-range factors from poses to points.
        values: Pose2 and Point2, or Pose3 and Point3.
        fixed: Keys to name in a FIX line (g2o has no line for a prior factor).

    Raises:
        InvalidInputError: If a factor or value has no line in g2o, or a fixed key no value.
        ScenarioError: If the file cannot be written.
    """
    lines = [_vertex_line(key, values) for key in values.keys()]  # noqa: SIM118
    for key in fixed:
        if not values.exists(key):
            raise InvalidInputError(f"fixed key {describe_key(key)} is not in the values")
        lines.append(f"FIX {int(key)}")
    if any("SE3:QUAT" in line for line in lines):
        lines.insert(0, "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1")
    lines += [_edge_line(index, graph.at(index)) for index in range(graph.size())]
    try:
        Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be written: {error.strerror}") from error


def _parse(path: Path, landmark_character: str | None) -> list[_Line]:
    """Lines of one file; every word of every line accounted for."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read as text: {error}") from error
    lines = []
    for number, content in enumerate(text.splitlines(), start=1):
        words = content.split()
        if words and not words[0].startswith("#"):
            lines.append(_parse_line(f"{path}:{number}", words, landmark_character))
    if not lines:
        raise ScenarioError(f"{path}: expected vertices and edges, got none; is it a g2o file?")
    return lines


def _parse_line(where: str, words: list[str], landmark_character: str | None) -> _Line:
    """One line, its tag, field count and numbers checked."""
    tag = words[0]
    if tag in _VERTICES or tag == "PARAMS_SE3OFFSET":
        ids, numbers = 1, _VERTICES.get(tag, 7)
    elif tag in _EDGES:
        measured, size = _EDGES[tag][:2]
        ids, numbers = 2 + (tag == "EDGE_SE3_TRACKXYZ"), measured + size * (size + 1) // 2
    elif tag == "FIX":
        ids, numbers = max(len(words) - 1, 1), 0
    else:
        known = ", ".join([*_VERTICES, *_EDGES, "PARAMS_SE3OFFSET", "FIX"])
        raise ScenarioError(
            f"{where}: unknown tag {tag}; known are {known}. Convert the line, or comment it out "
            "with # if it is to be ignored"
        )
    if len(words) != 1 + ids + numbers:
        raise ScenarioError(
            f"{where}: {tag} has {ids} id{'s' if ids > 1 else ''} and {numbers} numbers, got "
            f"{len(words) - 1} fields; is the line cut short?"
        )
    try:  # Python would take 1_0 for ten
        keys = tuple(int(word.replace("_", "?")) for word in words[1 : 1 + ids])
        values = tuple(float(word.replace("_", "?")) for word in words[1 + ids :])
    except ValueError as error:
        raise ScenarioError(
            f"{where}: {tag}: expected integer ids, then numbers, got {' '.join(words[1:])}"
        ) from error
    if not all(0 <= key < 2**64 for key in keys):
        raise ScenarioError(f"{where}: {tag}: expected ids from 0 to 2**64 - 1, got {keys}")
    if not all(map(math.isfinite, values)):
        raise ScenarioError(f"{where}: {tag}: expected finite numbers, got {words[1 + ids :]}")
    if landmark_character is not None and tag in (*_LANDMARKS, "EDGE_SE2_XY", "EDGE_SE3_TRACKXYZ"):
        place = 0 if tag in _LANDMARKS else 1
        symbol = gtsam.symbol(landmark_character, keys[place])
        keys = (*keys[:place], symbol, *keys[place + 1 :])
    return _Line(where, tag, keys, values)


def _definitions(lines: Iterable[_Line], tags: Iterable[str]) -> dict[Key, _Line]:
    """Lines of these tags by id; the same one may stand several times."""
    found: dict[Key, _Line] = {}
    for line in lines:
        if line.tag not in tags:
            continue
        before = found.setdefault(line.ids[0], line)
        if before[1:] != line[1:]:
            other = "tag" if before.tag != line.tag else "estimate"
            raise ScenarioError(
                f"{line.where}: {line.tag} {describe_key(line.ids[0])} stands with another {other} "
                f"at {before.where}; give each its own id and one estimate (if landmarks and "
                "poses count their own ids, pass landmark_character='l')"
            )
    return found


def _check_vertex(line: _Line, key: Key, tag: str | None, vertices: Mapping[Key, _Line]) -> None:
    """Raise if a line names a vertex that is not there or is of another kind."""
    if key not in vertices:
        raise ScenarioError(
            f"{line.where}: {line.tag} names vertex {describe_key(key)} ({key}), which no file of "
            "this call defines; if it is another robot's, read all files in one call: "
            "read_g2o([first, second])"
        )
    if tag is not None and vertices[key].tag != tag:
        raise ScenarioError(
            f"{line.where}: {line.tag} expects a {tag}, but vertex {describe_key(key)} is the "
            f"{vertices[key].tag} at {vertices[key].where}"
        )


def _spatial(line: _Line, numbers: Sequence[float]) -> gtsam.Pose3:
    """Pose from x y z qx qy qz qw."""
    x, y, z, qx, qy, qz, qw = numbers
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if abs(norm - 1.0) > 1e-3:
        raise ScenarioError(
            f"{line.where}: {line.tag}: expected a unit quaternion qx qy qz qw, got length {norm:g}"
        )
    rotation = gtsam.Rot3.Quaternion(qw / norm, qx / norm, qy / norm, qz / norm)
    return gtsam.Pose3(rotation, np.array([x, y, z]))


def _information(line: _Line, size: int) -> FloatArray:
    """Symmetric information from the last numbers of a line, checked."""
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = line.numbers[len(line.numbers) - size * (size + 1) // 2 :]
    matrix = matrix + np.triu(matrix, 1).T
    diagonal = np.diag(matrix)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    eigenvalues = np.linalg.eigvalsh(matrix * np.outer(scale, scale))
    if (diagonal <= 0.0).any() or eigenvalues[0] <= 1e-14 * eigenvalues[-1]:
        raise ScenarioError(
            f"{line.where}: {line.tag}: expected a positive definite information matrix, got "
            f"diagonal {diagonal} and smallest eigenvalue {eigenvalues[0]:g} (diagonal scaled to "
            "one); is it a covariance, or its triangle in another order?"
        )
    return matrix


def _factor(line: _Line, offsets: Mapping[int, _Line]) -> gtsam.NonlinearFactor:
    """The factor of one edge."""
    first, second = line.ids[:2]
    if first == second:
        raise ScenarioError(f"{line.where}: {line.tag} joins {describe_key(first)} to itself")
    measured, size = _EDGES[line.tag][:2]
    information = _information(line, size)
    numbers = line.numbers[:measured]
    if line.tag == "EDGE_SE2":
        noise = gtsam.noiseModel.Gaussian.Information(information)
        return gtsam.BetweenFactorPose2(first, second, gtsam.Pose2(*numbers), noise)
    if line.tag == "EDGE_SE3:QUAT":
        noise = gtsam.noiseModel.Gaussian.Information(information[np.ix_(_SWAP, _SWAP)])
        return gtsam.BetweenFactorPose3(first, second, _spatial(line, numbers), noise)
    point, covariance = np.array(numbers), np.linalg.inv(information)
    if line.tag == "EDGE_SE3_TRACKXYZ":
        parameter = line.ids[2]
        if parameter not in offsets:
            raise ScenarioError(
                f"{line.where}: {line.tag} uses sensor offset {parameter}, which its file does not "
                f"define; add the line: PARAMS_SE3OFFSET {parameter} 0 0 0 0 0 0 1"
            )
        offset = _spatial(offsets[parameter], offsets[parameter].numbers)
        rotation = offset.rotation().matrix()
        point = rotation @ point + offset.translation()
        covariance = rotation @ covariance @ rotation.T
    range_m = float(np.linalg.norm(point))
    if range_m == 0.0:
        raise ScenarioError(
            f"{line.where}: {line.tag}: a landmark at distance zero has no bearing; leave it out"
        )
    jacobian = _bearing_range_jacobian(point)
    covariance = jacobian @ covariance @ jacobian.T
    # Exactly symmetric: GTSAM drops the off-diagonal of a covariance that is not.
    noise = gtsam.noiseModel.Gaussian.Covariance(0.5 * (covariance + covariance.T))
    if size == 2:
        bearing = gtsam.Rot2(math.atan2(point[1], point[0]))
        return gtsam.BearingRangeFactor2D(first, second, bearing, range_m, noise)
    return gtsam.BearingRangeFactor3D(first, second, gtsam.Unit3(point), range_m, noise)


def _bearing_range_jacobian(point: FloatArray) -> FloatArray:
    """Jacobian of GTSAM's (bearing, range) by the point in the sensor's frame."""
    range_m = float(np.linalg.norm(point))
    if point.size == 2:
        across = np.array([[-point[1], point[0]]]) / range_m**2
    else:
        across = gtsam.Unit3(point).basis().T / range_m
    return np.vstack([across, point[None, :] / range_m])


def _spatial_numbers(pose: gtsam.Pose3) -> list[float]:
    """Position and quaternion: x y z qx qy qz qw."""
    quaternion = pose.rotation().toQuaternion()
    return [*pose.translation(), *(getattr(quaternion, axis)() for axis in "xyzw")]


def _vertex_line(key: Key, values: gtsam.Values) -> str:
    """The line of one value."""
    for tag, read in (
        ("VERTEX_SE2", lambda: values.atPose2(key).translation()),
        ("VERTEX_SE3:QUAT", lambda: _spatial_numbers(values.atPose3(key))),
        ("VERTEX_XY", lambda: values.atPoint2(key)),
        ("VERTEX_TRACKXYZ", lambda: values.atPoint3(key)),
    ):
        try:
            numbers = list(read())
        except RuntimeError:  # GTSAM's only way to say "another type"
            continue
        if tag == "VERTEX_SE2":
            numbers.append(values.atPose2(key).theta())
        return f"{tag} {int(key)} {' '.join(repr(float(x)) for x in numbers)}"
    raise InvalidInputError(
        f"value of {describe_key(key)}: g2o knows Pose2, Pose3, Point2 and Point3 only"
    )


def _edge_line(index: int, factor: gtsam.NonlinearFactor | None) -> str:
    """The line of one factor."""
    name = type(factor).__name__
    if not isinstance(factor, _WRITTEN):
        hint = "; pass its key as fixed instead" if name.startswith("Prior") else ""
        raise InvalidInputError(f"factor {index}: g2o has no line for a {name}{hint}")
    noise, measured = factor.noiseModel(), factor.measured()
    if not isinstance(noise, gtsam.noiseModel.Gaussian):
        raise InvalidInputError(f"factor {index}: g2o has no line for {type(noise).__name__} noise")
    information, parameter = noise.information(), ""
    if isinstance(measured, gtsam.Pose2):
        tag, numbers = "EDGE_SE2", [measured.x(), measured.y(), measured.theta()]
    elif isinstance(measured, gtsam.Pose3):
        tag, numbers = "EDGE_SE3:QUAT", _spatial_numbers(measured)
        information = information[np.ix_(_SWAP, _SWAP)]
    else:
        bearing = measured.bearing()
        planar = isinstance(bearing, gtsam.Rot2)
        direction = [bearing.c(), bearing.s()] if planar else bearing.point3()
        point = measured.range() * np.array(direction)
        jacobian = _bearing_range_jacobian(point)
        information = jacobian.T @ information @ jacobian
        tag, parameter = ("EDGE_SE2_XY", "") if planar else ("EDGE_SE3_TRACKXYZ", "0 ")
        numbers = point.tolist()
    first, second = factor.keys()
    numbers = [*numbers, *information[np.triu_indices(information.shape[0])]]
    return f"{tag} {first} {second} {parameter}{' '.join(repr(float(x)) for x in numbers)}"
