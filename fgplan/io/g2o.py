"""g2o pose graphs: one line a vertex or edge, read without ever losing one silently.

    VERTEX_SE2 id x y heading                      EDGE_SE2 a b dx dy dheading  I (6)
    VERTEX_XY id x y                               EDGE_SE2_XY a b x y  I (3)
    VERTEX_SE3:QUAT id x y z qx qy qz qw           EDGE_SE3:QUAT a b x y z qx qy qz qw  I (21)
    VERTEX_TRACKXYZ id x y z                       EDGE_SE3_TRACKXYZ a b parameter x y z  I (6)
    PARAMS_SE3OFFSET id x y z qx qy qz qw          FIX id ...          # comment

I is the upper triangle, by rows, of the information in the frame of b (of a for landmarks); its
rotation part is taken as GTSAM's reader does, as a rotation vector. An offset of the sensor is
folded into the measured point. What lines of text have in common is in fgplan/io/graph_text.py.

Own code because gtsam.readG2o loses every edge after a FIX line, and all of them at a comment.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import gtsam
import numpy as np

from fgplan.checks import check_not_negative
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
from fgplan.typing import Key

_VERTICES = {"VERTEX_SE2": 3, "VERTEX_XY": 2, "VERTEX_SE3:QUAT": 7, "VERTEX_TRACKXYZ": 3}
_EDGES = {
    "EDGE_SE2": (3, 3, "VERTEX_SE2", "VERTEX_SE2"),
    "EDGE_SE2_XY": (2, 2, "VERTEX_SE2", "VERTEX_XY"),
    "EDGE_SE3:QUAT": (7, 6, "VERTEX_SE3:QUAT", "VERTEX_SE3:QUAT"),
    "EDGE_SE3_TRACKXYZ": (3, 3, "VERTEX_SE3:QUAT", "VERTEX_TRACKXYZ"),
}
_WHOLE = ("fullgraph", "full")
_LANDMARKS = ("VERTEX_XY", "VERTEX_TRACKXYZ")
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
            numbers or the other way round: two measurements, or one written with different rounding
            (repeat_tolerance) or from its other end.
        files: Files that were read, in order.
        left_out: Files of the folder that were not read: the whole graph beside files by robot.
        vertex_files: Places in ``files`` of the files that define each vertex.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    fixed: tuple[Key, ...]
    counts: Mapping[str, int]
    repeated: int
    same_ends: int
    files: tuple[Path, ...]
    left_out: tuple[Path, ...]
    vertex_files: Mapping[Key, tuple[int, ...]]


def read_g2o(
    paths: Path | str | Sequence[Path | str],
    landmark_character: str | None = None,
    repeat_tolerance: float = 0.0,
) -> G2oGraph:
    """Read one g2o file, or the files of several robots as one graph.

    Args:
        paths: One file, one a robot, or a folder of them (``g2o_files``). An edge may join vertices
            of different files; an edge that is exactly repeated in another file is taken once.
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
        InvalidInputError: If ``landmark_character`` is no letter or ``repeat_tolerance`` below 0.
    """
    check_not_negative(repeat_tolerance, "g2o repeat_tolerance")
    if landmark_character is not None and not re.fullmatch("[A-Za-z]", landmark_character):
        raise InvalidInputError(
            f"g2o landmark_character: expected one letter, got {landmark_character!r}"
        )
    files = [Path(paths)] if isinstance(paths, Path | str) else [Path(path) for path in paths]
    left_out: tuple[Path, ...] = ()
    if len(files) == 1 and files[0].is_dir():
        files, left_out = g2o_files(files[0])
    if not files:
        raise ScenarioError("g2o: expected at least one file, got none")
    parsed = [_parse(path, landmark_character) for path in files]
    vertices = _definitions((line for lines in parsed for line in lines), _VERTICES)
    defined = [{line.ids[0] for line in lines if line.tag in _VERTICES} for lines in parsed]
    values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
    for key, line in sorted(vertices.items()):
        if line.tag == "VERTEX_SE2":
            values.insert(key, gtsam.Pose2(*line.numbers))
        elif line.tag == "VERTEX_SE3:QUAT":
            values.insert(key, spatial_pose(line.where, line.tag, line.numbers))
        else:
            values.insert(key, np.array(line.numbers))
    seen: dict[tuple[str, tuple[int, ...]], list[tuple[int, GraphLine]]] = {}
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
            turned = seen.get((line.tag, line.ids[::-1]), ())
            same_ends += bool(others) or any(other != file for other, _ in turned)
            same.append((file, line))
            graph.add(_factor(line, offsets))
    return G2oGraph(
        graph=graph,
        values=values,
        fixed=tuple(fixed),
        counts=dict(sorted(counts.items())),
        repeated=repeated,
        same_ends=same_ends,
        files=tuple(files),
        left_out=left_out,
        vertex_files={
            key: tuple(i for i, own in enumerate(defined) if key in own) for key in sorted(vertices)
        },
    )


def g2o_files(folder: Path) -> tuple[list[Path], tuple[Path, ...]]:
    """Files of a folder of g2o files, numbers in their names sorted as numbers.

    Args:
        folder: The folder.

    Returns:
        The files to read, and those to leave out: where a file named fullGraph (full_graph, full)
        lies beside others, these are the robots' parts of it, and only they say who is who.

    Raises:
        ScenarioError: If there is no g2o file.
    """
    files = sorted(folder.glob("*.g2o"), key=lambda path: _natural(path.stem))
    if not files:
        raise ScenarioError(f"{folder}: expected *.g2o files in this folder, found none")
    whole = [path for path in files if path.stem.lower().replace("_", "") in _WHOLE]
    parts = [path for path in files if path not in whole]
    return (parts, tuple(whole)) if parts else (files, ())


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
        InvalidInputError: If a factor or value has no line in g2o or is not finite, or a fixed key
            has no value.
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
    write_text_lines(path, lines)


def _natural(name: str) -> list[tuple[int, str]]:
    """Parts of a name, numbers by value, so that 2 comes before 10."""
    return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"(\d+)", name)]


def _parse(path: Path, landmark_character: str | None) -> list[GraphLine]:
    """Lines of one file; every word of every line accounted for."""
    lines = [_parse_line(where, words, landmark_character) for where, words in text_lines(path)]
    if not lines:
        raise ScenarioError(f"{path}: expected vertices and edges, got none; is it a g2o file?")
    return lines


def _parse_line(where: str, words: list[str], landmark_character: str | None) -> GraphLine:
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
        for word in words[1 + ids :]:
            float(word.replace("_", "?"))
    except ValueError as error:
        raise ScenarioError(
            f"{where}: {tag}: expected integer ids, then numbers, got {' '.join(words[1:])}"
        ) from error
    if not all(0 <= key < 2**64 for key in keys):
        raise ScenarioError(f"{where}: {tag}: expected ids from 0 to 2**64 - 1, got {keys}")
    values = finite_numbers(where, tag, words[1 + ids :])
    if landmark_character is not None and tag in (*_LANDMARKS, "EDGE_SE2_XY", "EDGE_SE3_TRACKXYZ"):
        place = 0 if tag in _LANDMARKS else 1
        if keys[place] >= 2**56:
            raise ScenarioError(
                f"{where}: {tag}: expected a landmark's id below 2**56, which leaves room for the "
                f"letter {landmark_character!r}, got {keys[place]}"
            )
        symbol = gtsam.symbol(landmark_character, keys[place])
        keys = (*keys[:place], symbol, *keys[place + 1 :])
    return GraphLine(where, tag, keys, values)


def _definitions(lines: Iterable[GraphLine], tags: Iterable[str]) -> dict[Key, GraphLine]:
    """Lines of these tags by id; the same one may stand several times."""
    found: dict[Key, GraphLine] = {}
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


def _check_vertex(
    line: GraphLine, key: Key, tag: str | None, vertices: Mapping[Key, GraphLine]
) -> None:
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


def _factor(line: GraphLine, offsets: Mapping[int, GraphLine]) -> gtsam.NonlinearFactor:
    """The factor of one edge."""
    first, second = line.ids[:2]
    if first == second:
        raise ScenarioError(f"{line.where}: {line.tag} joins {describe_key(first)} to itself")
    measured, size = _EDGES[line.tag][:2]
    information = symmetric_matrix(line, size, "information")
    numbers = line.numbers[:measured]
    if line.tag == "EDGE_SE2":
        noise = gtsam.noiseModel.Gaussian.Information(information)
        return gtsam.BetweenFactorPose2(first, second, gtsam.Pose2(*numbers), noise)
    if line.tag == "EDGE_SE3:QUAT":
        ordered = information[np.ix_(TRANSLATION_FIRST, TRANSLATION_FIRST)]
        noise = gtsam.noiseModel.Gaussian.Information(ordered)
        pose = spatial_pose(line.where, line.tag, numbers)
        return gtsam.BetweenFactorPose3(first, second, pose, noise)
    point = np.array(numbers)
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    if line.tag == "EDGE_SE3_TRACKXYZ":
        parameter = line.ids[2]
        if parameter not in offsets:
            raise ScenarioError(
                f"{line.where}: {line.tag} uses sensor offset {parameter}, which its file does not "
                f"define; add the line: PARAMS_SE3OFFSET {parameter} 0 0 0 0 0 0 1"
            )
        defined = offsets[parameter]
        offset = spatial_pose(defined.where, defined.tag, defined.numbers)
        rotation = offset.rotation().matrix()
        point = rotation @ point + offset.translation()
        covariance = rotation @ covariance @ rotation.T
    return landmark_factor(line, point, covariance)


def _vertex_line(key: Key, values: gtsam.Values) -> str:
    """The line of one value."""
    for tag, read in (
        ("VERTEX_SE2", lambda: values.atPose2(key).translation()),
        ("VERTEX_SE3:QUAT", lambda: spatial_numbers(values.atPose3(key))),
        ("VERTEX_XY", lambda: values.atPoint2(key)),
        ("VERTEX_TRACKXYZ", lambda: values.atPoint3(key)),
    ):
        try:
            numbers = list(read())
        except RuntimeError:  # GTSAM's only way to say "another type"
            continue
        if tag == "VERTEX_SE2":
            numbers.append(values.atPose2(key).theta())
        return f"{tag} {int(key)} {number_text(numbers, f'value of {describe_key(key)}')}"
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
        tag, numbers = "EDGE_SE3:QUAT", spatial_numbers(measured)
        information = information[np.ix_(TRANSLATION_FIRST, TRANSLATION_FIRST)]
    else:
        point, information = landmark_point(factor)
        planar = point.size == 2
        tag, parameter = ("EDGE_SE2_XY", "") if planar else ("EDGE_SE3_TRACKXYZ", "0 ")
        numbers = point.tolist()
    first, second = factor.keys()
    words = number_text([*numbers, *upper_triangle(information)], f"factor {index}")
    return f"{tag} {first} {second} {parameter}{words}"
