"""What a run from a log leaves of the past it planned from, in forms that others read.

    trajectories/ROBOT.tum   estimated poses of each robot: evo, ROS tools (%2F for / in a name)
    pose_graph.g2o           the graph at the estimate; held poses as FIX lines
    pose_graph.pyfg          instead, where the past has times; held poses as PRIOR lines
    covariances.json         marginal covariance of every pose and landmark

Covariances are in the world frame ("map"), position before rotation about fixed axes
(fgplan/io/ros_covariance.py): 6 x 6 in space, rows x y z rotation_x rotation_y rotation_z; 3 x 3 in
the plane, rows x y rotation_z; landmarks x y (z). By rows. g2o has no times: its poses are stamped
0, 1, 2, ... seconds, and so is the plan that follows.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import gtsam
import msgspec
import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.factors.keys import describe_key
from fgplan.io.g2o import write_g2o
from fgplan.io.past_estimate import PastEstimate
from fgplan.io.plain_value import plain_value
from fgplan.io.plan_file import FRAME_ID
from fgplan.io.pyfg import pyfg_holds, write_pyfg
from fgplan.io.result_file import replace_file
from fgplan.io.ros_covariance import PLANAR_ROWS, ROS_ORDER, map_covariance
from fgplan.io.tum import write_tum
from fgplan.typing import Covariance, Key

COVARIANCES_SCHEMA = "covariances.v1"
_WRITTEN = ("trajectories/*.tum", "pose_graph.g2o", "pose_graph.pyfg", "covariances.json")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedCovariance:
    """Covariance of one pose or landmark, world frame.

    Attributes:
        key: As its maker would write it, ``a12``.
        robot: Whose pose it is; empty for a landmark.
        stamp_s: Time of the pose, seconds; None for a landmark.
        frame_id: Frame of the covariance.
        order: What the rows are.
        covariance: Shape (n, n), n the length of ``order``.
    """

    key: str
    robot: str
    stamp_s: float | None
    frame_id: str
    order: tuple[str, ...]
    covariance: Covariance


def pose_stamps(estimate: PastEstimate) -> dict[Key, float]:
    """Time of each pose: the log's, or its place among the robot's poses in seconds."""
    past = estimate.past
    if past.times_s:
        return dict(past.times_s)
    return {key: float(place) for keys in past.robots.values() for place, key in enumerate(keys)}


def plan_start_s(estimate: PastEstimate) -> float:
    """When a plan from a past begins: the latest stamp of the robots' current poses."""
    stamps = pose_stamps(estimate)
    return max(stamps[key] for key in estimate.current_keys.values())


def write_past_files(
    folder: Path, estimate: PastEstimate
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write trajectories, pose graph and covariances into a run folder.

    Args:
        folder: The run folder; what an earlier run left of these goes.
        estimate: The past.

    Returns:
        The files, and plain sentences: which factors the pose graph's format has no line for. They
        stand in a comment of that file too.

    Raises:
        InvalidInputError: If a file cannot be written.
        ScenarioError: If a file cannot be written.
    """
    tracks = folder / "trajectories"
    remove_past_files(folder)
    try:
        tracks.mkdir(exist_ok=True)
    except OSError as error:
        raise InvalidInputError(f"{tracks}: expected a folder to write to: {error}") from error
    stamps, files = pose_stamps(estimate), []
    for robot, keys in estimate.past.robots.items():
        files.append(tracks / f"{quote(robot, safe='')}.tum")
        poses = np.array([estimate.belief.pose(key) for key in keys])
        write_tum(files[-1], [stamps[key] for key in keys], poses)
    graph_file, notes = _write_graph(folder, estimate)
    files.append(graph_file)
    files.append(folder / "covariances.json")
    entries = _covariances(estimate, stamps)
    held = {describe_key(key): sigmas for key, sigmas in estimate.held.items()}
    content = {
        "schema": COVARIANCES_SCHEMA,
        "convention": "by rows, world frame, metres and radians; order names the rows",
        "held": held,
        "covariances": entries,
    }
    replace_file(files[-1], msgspec.json.encode(plain_value(content)))
    return tuple(files), notes


def remove_past_files(folder: Path, sources: Iterable[Path] = ()) -> None:
    """Remove what an earlier run left of its past, so that it does not stand beside another's.

    Args:
        folder: The run folder.
        sources: Files that the run reads; if one of them would go, nothing is removed.

    Raises:
        InvalidInputError: If a file that the run reads has a name that the run writes.
    """
    tracks, read = folder / "trajectories", {source.resolve() for source in sources}
    earlier = [file for pattern in _WRITTEN for file in sorted(folder.glob(pattern))]
    for file in earlier:
        if file.resolve() in read:
            raise InvalidInputError(
                f"{file}: expected a run folder other than that of the log, because a run writes a "
                "file of this name; choose another --out"
            )
    for file in earlier:
        file.unlink()
    if tracks.is_dir() and not any(tracks.iterdir()):
        tracks.rmdir()


def read_covariances(path: Path | str) -> dict[str, NamedCovariance]:
    """Read ``covariances.json``.

    Args:
        path: The file.

    Returns:
        By key, in the order of the file.

    Raises:
        InvalidInputError: If it is no such file.
    """
    try:
        content = msgspec.json.decode(Path(path).read_bytes())
        if content["schema"] != COVARIANCES_SCHEMA:
            raise InvalidInputError(
                f"{path}: schema: expected {COVARIANCES_SCHEMA!r}, got {content['schema']!r}"
            )
        found = {}
        for item in content["covariances"]:
            size = len(item["order"])
            matrix = check_finite(item["covariance"], f"{path}: {item['key']}", (size, size))
            fields = {**item, "order": tuple(item["order"]), "covariance": matrix}
            found[item["key"]] = NamedCovariance(**fields)
    except InvalidInputError:
        raise
    except (OSError, msgspec.DecodeError, KeyError, TypeError) as error:
        raise InvalidInputError(
            f"{path}: expected covariances as fgplan run writes them: {error}"
        ) from error
    return found


def _write_graph(folder: Path, estimate: PastEstimate) -> tuple[Path, tuple[str, ...]]:
    """The graph at the estimate, and what its format does not hold."""
    past, belief = estimate.past, estimate.belief
    if not past.times_s:  # only g2o has none, and what was read from g2o can be written
        path = folder / "pose_graph.g2o"
        write_g2o(path, past.graph, belief.values, tuple(estimate.held))
        return path, ()
    path = folder / "pose_graph.pyfg"
    every = [belief.graph.at(index) for index in range(belief.graph.size())]
    stamps = [*past.stamps_s, *(past.times_s[key] for key in estimate.held)]
    graph, kept = gtsam.NonlinearFactorGraph(), []
    for index, factor in enumerate(every):
        if pyfg_holds(factor):
            graph.add(factor)
            kept.append(index)
    stamped = [stamps[index] for index in kept] if past.stamps_s else None
    write_pyfg(path, graph, belief.values, past.times_s, stamped)
    left = Counter(type(factor).__name__ for factor in every if not pyfg_holds(factor))
    if not left:
        return path, ()
    what = ", ".join(f"{count} {name}" for name, count in sorted(left.items()))
    note = f"{path.name} leaves out {what}: PyFactorGraph text has no line for them"
    path.write_text(f"# {note}\n{path.read_text(encoding='utf-8')}", encoding="utf-8")
    return path, (note,)


def _covariances(estimate: PastEstimate, stamps: Mapping[Key, float]) -> list[dict[str, Any]]:
    """Every pose and landmark, in the order of keys."""
    belief, robot_of = estimate.belief, estimate.past.robot_of
    found = belief.marginal_covariances()
    entries = []
    for key in belief.keys:
        covariance, order = np.asarray(found[key]), ROS_ORDER[: belief.dim(key)]
        if belief.kinds[key] in ("Pose2", "Pose3"):
            covariance = map_covariance(belief.pose(key), covariance)
            planar = len(covariance) == 3
            order = tuple(ROS_ORDER[row] for row in PLANAR_ROWS) if planar else ROS_ORDER
        entries.append(
            {
                "key": describe_key(key),
                "robot": robot_of.get(key, ""),
                "stamp_s": stamps.get(key),
                "frame_id": FRAME_ID,
                "order": order,
                "covariance": covariance,
            }
        )
    return entries
