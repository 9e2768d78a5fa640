"""PyFactorGraph text (.pyfg): poses, landmarks and beacons with time stamps.

    VERTEX_SE2 t name x y heading                     VERTEX_SE3:QUAT t name x y z qx qy qz qw
    VERTEX_XY name x y                                VERTEX_XYZ name x y z
    VERTEX_SE2:PRIOR t name x y heading C (6)         VERTEX_SE3:QUAT:PRIOR t name (7) C (21)
    VERTEX_XY:PRIOR t name x y C (3)                  VERTEX_XYZ:PRIOR t name x y z C (6)
    EDGE_SE2 t a b dx dy dheading C (6)               EDGE_SE3:QUAT t a b (7) C (21)
    EDGE_SE2_XY t pose landmark x y C (3)             EDGE_SE3_XYZ t pose landmark x y z C (6)
    EDGE_RANGE t a b metres variance

as MarineRoboticsGroup/PyFactorGraph writes them (py_factor_graph/io/pyfg_text.py): C is the upper
triangle, by rows, of the covariance, translation before rotation, taken in the frame of the pose
that is measured (of the measuring pose for landmarks, of the pose itself for priors). Its own
reader passes over EDGE_SE2_XY without a word and keeps two numbers of each covariance; here every
line is read in full or refused. Vertices hold what PyFactorGraph calls the true position: where it
is known they are ground truth, and an estimate that begins there begins at the truth.

Names are a letter and a number, ``A12``; the letter tells robots apart, ``L`` is for landmarks.
They become GTSAM symbols (``AB12`` a LabeledSymbol).
"""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gtsam
import numpy as np

from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.factors.keys import describe_key
from fgplan.io.graph_text import (
    TRANSLATION_FIRST,
    GraphLine,
    finite_numbers,
    landmark_factor,
    landmark_point,
    number_text,
    spatial_numbers,
    spatial_pose,
    symmetric_matrix,
    text_lines,
    upper_triangle,
    write_text_lines,
)
from fgplan.typing import Covariance, FloatArray, Key

_POSES = {"VERTEX_SE2": 3, "VERTEX_SE3:QUAT": 7}
_POINTS = {"VERTEX_XY": 2, "VERTEX_XYZ": 3}
_VERTICES = {**_POSES, **_POINTS}
_PRIORS = {f"{tag}:PRIOR": tag for tag in _VERTICES}
_EDGES = {
    "EDGE_SE2": ("VERTEX_SE2", "VERTEX_SE2"),
    "EDGE_SE3:QUAT": ("VERTEX_SE3:QUAT", "VERTEX_SE3:QUAT"),
    "EDGE_SE2_XY": ("VERTEX_SE2", "VERTEX_XY"),
    "EDGE_SE3_XYZ": ("VERTEX_SE3:QUAT", "VERTEX_XYZ"),
}
_TANGENT = {"VERTEX_SE2": 3, "VERTEX_SE3:QUAT": 6, "VERTEX_XY": 2, "VERTEX_XYZ": 3}
_RANGES: dict[tuple[str, str], Any] = {
    ("VERTEX_SE2", "VERTEX_XY"): gtsam.RangeFactor2D,
    ("VERTEX_SE2", "VERTEX_SE2"): gtsam.RangeFactorPose2,
    ("VERTEX_SE3:QUAT", "VERTEX_XYZ"): gtsam.RangeFactor3D,
    ("VERTEX_SE3:QUAT", "VERTEX_SE3:QUAT"): gtsam.RangeFactorPose3,
}
_PRIOR_FACTORS: dict[str, Any] = {
    "VERTEX_SE2": gtsam.PriorFactorPose2,
    "VERTEX_SE3:QUAT": gtsam.PriorFactorPose3,
    "VERTEX_XY": gtsam.PriorFactorPoint2,
    "VERTEX_XYZ": gtsam.PriorFactorPoint3,
}
_TAGS: dict[Any, str] = {
    **{made: f"{tag}:PRIOR" for tag, made in _PRIOR_FACTORS.items()},
    gtsam.BetweenFactorPose2: "EDGE_SE2",
    gtsam.BetweenFactorPose3: "EDGE_SE3:QUAT",
    gtsam.BearingRangeFactor2D: "EDGE_SE2_XY",
    gtsam.BearingRangeFactor3D: "EDGE_SE3_XYZ",
    **dict.fromkeys(_RANGES.values(), "EDGE_RANGE"),
}
_NAME = re.compile(r"([A-Za-z])([A-Za-z]?)([0-9]{1,15})")


@dataclass(frozen=True, slots=True, kw_only=True)
class PyfgGraph:
    """What a PyFactorGraph file holds.

    Attributes:
        graph: One factor a prior, edge or range, in the order of the lines.
        values: Every vertex as the file has it.
        times_s: Time of each pose, seconds.
        stamps_s: Time of each factor, seconds, as many as the graph has.
        counts: Lines read, by tag.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    times_s: Mapping[Key, float]
    stamps_s: tuple[float, ...]
    counts: Mapping[str, int]


def read_pyfg(path: Path | str) -> PyfgGraph:
    """Read a PyFactorGraph file.

    Args:
        path: The file.

    Returns:
        Factors, values and times.

    Raises:
        ScenarioError: At the first line that is not understood in full, naming file, line, tag and
            remedy.
    """
    lines = [_parse_line(where, words) for where, words in text_lines(Path(path))]
    if not lines:
        raise ScenarioError(f"{path}: expected vertices and edges, got none; is it a .pyfg file?")
    vertices: dict[Key, GraphLine] = {}
    values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
    for line in lines:
        if line.tag not in _VERTICES:
            continue
        before = vertices.setdefault(line.ids[0], line)
        if before is not line:
            raise ScenarioError(
                f"{line.where}: {line.tag} {describe_key(line.ids[0])} stands at {before.where} "
                "already; give each vertex a name of its own"
            )
        values.insert(line.ids[0], _value(line))
    stamps = []
    for line in lines:
        if line.tag not in _VERTICES:
            graph.add(_factor(line, vertices))
            stamps.append(line.stamp_s)
    return PyfgGraph(
        graph=graph,
        values=values,
        times_s={key: line.stamp_s for key, line in vertices.items() if line.tag in _POSES},
        stamps_s=tuple(stamps),
        counts=dict(sorted(Counter(line.tag for line in lines).items())),
    )


def write_pyfg(
    path: Path | str,
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    times_s: Mapping[Key, float],
    stamps_s: Sequence[float] | None = None,
) -> None:
    """Write a PyFactorGraph file; what is read back has the same values, noise and times.

    Args:
        path: The file; overwritten.
        graph: Priors, relative poses, landmark observations and ranges.
        values: Pose2 and Point2, or Pose3 and Point3; keys are Symbols or LabeledSymbols.
        times_s: Time of each pose, seconds.
        stamps_s: Time of each factor, seconds; that of the last pose it joins if left out (zero
            where it joins none).

    Raises:
        InvalidInputError: If a factor, value or key has no form in this format or a number is not
            finite, a pose has no time, or the number of stamps is not that of the factors.
        ScenarioError: If the file cannot be written.
    """
    if stamps_s is not None and len(stamps_s) != graph.size():
        raise InvalidInputError(
            f"pyfg: expected a stamp a factor, {graph.size()}, got {len(stamps_s)}"
        )
    tags: dict[Key, str] = {}
    lines = []
    for key in values.keys():  # noqa: SIM118 - gtsam.Values
        tags[key], numbers = _vertex(key, values)
        stamp = ""
        if tags[key] in _POSES:
            if key not in times_s:
                raise InvalidInputError(f"pyfg: expected a time of pose {describe_key(key)}")
            stamp = f"{number_text([times_s[key]], f'time of pose {describe_key(key)}')} "
        text = number_text(numbers, f"value of {describe_key(key)}")
        lines.append(f"{tags[key]} {stamp}{_name(key)} {text}")
    for index in range(graph.size()):
        factor = graph.at(index)
        tag, numbers = _edge(index, factor, tags)
        if stamps_s is None:
            stamp_s = max(
                (times_s[key] for key in list(factor.keys()) if key in times_s), default=0.0
            )
        else:
            stamp_s = stamps_s[index]
        names = " ".join(map(_name, factor.keys()))
        stamp, text = (number_text(one, f"factor {index}") for one in ([stamp_s], numbers))
        lines.append(f"{tag} {stamp} {names} {text}")
    write_text_lines(path, lines)


def pyfg_holds(factor: object) -> bool:
    """Whether the format has a line for a factor of this type."""
    return type(factor) in _TAGS


def _parse_line(where: str, words: list[str]) -> GraphLine:
    """One line, its tag, field count, names and numbers checked."""
    tag = words[0]
    if tag in _VERTICES:
        names, size = 1, _VERTICES[tag]
    elif tag in _PRIORS:
        vertex = _PRIORS[tag]
        names, size = 1, _VERTICES[vertex] + _triangle(_TANGENT[vertex])
    elif tag in _EDGES:
        measured = _EDGES[tag][1]
        names, size = 2, _VERTICES[measured] + _triangle(_TANGENT[measured])
    elif tag == "EDGE_RANGE":
        names, size = 2, 2
    else:
        known = ", ".join([*_VERTICES, *_PRIORS, *_EDGES, "EDGE_RANGE"])
        raise ScenarioError(
            f"{where}: unknown tag {tag}; known are {known}. Convert the line, or comment it out "
            "with # if it is to be ignored"
        )
    stamped = int(tag not in _POINTS)
    if len(words) != 1 + stamped + names + size:
        time = "a time, " if stamped else ""
        raise ScenarioError(
            f"{where}: {tag} has {time}{names} name{'s' if names > 1 else ''} and {size} numbers, "
            f"got {len(words) - 1} fields; is the line cut short?"
        )
    first = 1 + stamped
    stamp_s = finite_numbers(where, tag, words[1:first])[0] if stamped else math.nan
    keys = tuple(_key(where, tag, word) for word in words[first : first + names])
    return GraphLine(where, tag, keys, finite_numbers(where, tag, words[first + names :]), stamp_s)


def _triangle(size: int) -> int:
    """Numbers of an upper triangle."""
    return size * (size + 1) // 2


def _key(where: str, tag: str, name: str) -> Key:
    """Key of a name."""
    match = _NAME.fullmatch(name)
    if match is None:
        raise ScenarioError(
            f"{where}: {tag}: expected a name of a letter and a number, such as A12, got {name!r}"
        )
    letter, label, index = match.groups()
    if int(index) >= 2**48:
        raise ScenarioError(f"{where}: {tag}: expected a number below 2**48 in {name!r}")
    if label:
        return int(gtsam.LabeledSymbol(ord(letter), ord(label), int(index)).key())
    return int(gtsam.symbol(letter, int(index)))


def _name(key: Key) -> str:
    """Name of a key."""
    name = describe_key(key)
    if _NAME.fullmatch(name) is None:
        raise InvalidInputError(
            f"pyfg: expected keys of a letter and a number, as gtsam.symbol('A', 3), got {name}"
        )
    return name


def _value(line: GraphLine) -> gtsam.Pose2 | gtsam.Pose3 | FloatArray:
    """Value of a vertex or prior."""
    numbers = line.numbers
    tag = _PRIORS.get(line.tag, line.tag)
    if tag == "VERTEX_SE2":
        return gtsam.Pose2(*numbers[:3])
    if tag == "VERTEX_SE3:QUAT":
        return spatial_pose(line.where, line.tag, numbers[:7])
    return np.array(numbers[: _VERTICES[tag]])


def _covariance(line: GraphLine, size: int) -> Covariance:
    """Covariance of a line in GTSAM's order."""
    matrix = symmetric_matrix(line, size, "covariance")
    return matrix[np.ix_(TRANSLATION_FIRST, TRANSLATION_FIRST)] if size == 6 else matrix


def _factor(line: GraphLine, vertices: Mapping[Key, GraphLine]) -> gtsam.NonlinearFactor:
    """The factor of a prior, edge or range."""
    for key in line.ids:
        if key not in vertices:
            raise ScenarioError(
                f"{line.where}: {line.tag} names {describe_key(key)}, which the file does not "
                "define; add its VERTEX line"
            )
    if line.tag == "EDGE_RANGE":
        return _range(line, vertices)
    expected = (_PRIORS[line.tag],) if line.tag in _PRIORS else _EDGES[line.tag]
    for key, tag in zip(line.ids, expected, strict=True):
        if vertices[key].tag != tag:
            raise ScenarioError(
                f"{line.where}: {line.tag} expects a {tag}, but {describe_key(key)} is the "
                f"{vertices[key].tag} at {vertices[key].where}"
            )
    size = _TANGENT[expected[-1]]
    covariance = _covariance(line, size)
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    if line.tag in _PRIORS:
        return _PRIOR_FACTORS[expected[0]](line.ids[0], _value(line), noise)
    _check_two(line)
    first, second = line.ids
    if line.tag == "EDGE_SE2":
        return gtsam.BetweenFactorPose2(first, second, gtsam.Pose2(*line.numbers[:3]), noise)
    if line.tag == "EDGE_SE3:QUAT":
        relative = spatial_pose(line.where, line.tag, line.numbers[:7])
        return gtsam.BetweenFactorPose3(first, second, relative, noise)
    return landmark_factor(line, np.array(line.numbers[:size]), covariance)


def _range(line: GraphLine, vertices: Mapping[Key, GraphLine]) -> gtsam.NonlinearFactor:
    """The factor of a range; a landmark may stand first."""
    _check_two(line)
    keys = line.ids if vertices[line.ids[0]].tag in _POSES else line.ids[::-1]
    ends = (vertices[keys[0]].tag, vertices[keys[1]].tag)
    if ends not in _RANGES:
        raise ScenarioError(
            f"{line.where}: {line.tag} expects a pose and a landmark or two poses, all planar or "
            f"all in space, got {' and '.join(ends)}"
        )
    range_m, variance = line.numbers
    if range_m <= 0.0 or variance <= 0.0:
        raise ScenarioError(
            f"{line.where}: {line.tag}: expected metres and variance above zero, got {range_m:g} "
            f"and {variance:g}"
        )
    return _RANGES[ends](
        keys[0], keys[1], range_m, gtsam.noiseModel.Isotropic.Variance(1, variance)
    )


def _check_two(line: GraphLine) -> None:
    """Refuse an edge from a vertex to itself."""
    if line.ids[0] == line.ids[1]:
        raise ScenarioError(f"{line.where}: {line.tag} joins {describe_key(line.ids[0])} to itself")


def _vertex(key: Key, values: gtsam.Values) -> tuple[str, list[float]]:
    """Tag and numbers of one value."""
    for tag, read in (
        ("VERTEX_SE2", values.atPose2),
        ("VERTEX_SE3:QUAT", values.atPose3),
        ("VERTEX_XY", values.atPoint2),
        ("VERTEX_XYZ", values.atPoint3),
    ):
        try:
            return tag, _measured_numbers(read(key))
        except RuntimeError:  # GTSAM's only way to say "another type"
            continue
    raise InvalidInputError(
        f"pyfg: value of {describe_key(key)}: expected Pose2, Pose3, Point2 or Point3"
    )


def _measured_numbers(value: gtsam.Pose2 | gtsam.Pose3 | FloatArray) -> list[float]:
    """Numbers of a pose or point."""
    if isinstance(value, gtsam.Pose2):
        return [value.x(), value.y(), value.theta()]
    if isinstance(value, gtsam.Pose3):
        return spatial_numbers(value)
    return [float(number) for number in value]


def _edge(
    index: int,
    factor: Any,  # noqa: ANN401 - any factor of GTSAM, which share no typed base
    tags: Mapping[Key, str],
) -> tuple[str, list[float]]:
    """Tag and numbers of one factor."""
    name = type(factor).__name__
    if factor is None or type(factor) not in _TAGS:
        raise InvalidInputError(f"pyfg: factor {index}: the format has no line for a {name}")
    noise, tag = factor.noiseModel(), _TAGS[type(factor)]
    missing = [key for key in list(factor.keys()) if key not in tags]
    if missing:
        raise InvalidInputError(
            f"pyfg: factor {index}: {describe_key(missing[0])} is not in the values"
        )
    if not isinstance(noise, gtsam.noiseModel.Gaussian):
        raise InvalidInputError(
            f"pyfg: factor {index}: the format has no line for {type(noise).__name__} noise"
        )
    if tag == "EDGE_RANGE":
        return tag, [factor.measured(), float(noise.covariance()[0, 0])]
    if name.startswith("BearingRange"):
        point, information = landmark_point(factor)
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        return tag, [*point.tolist(), *upper_triangle(covariance)]
    measured = factor.prior() if name.startswith("Prior") else factor.measured()
    covariance = noise.covariance()
    if len(covariance) == 6:
        covariance = covariance[np.ix_(TRANSLATION_FIRST, TRANSLATION_FIRST)]
    return tag, [*_measured_numbers(measured), *upper_triangle(covariance)]
