"""A team's past from any file or folder that fgplan reads: one graph, and who was where when.

    folder of *.g2o, or a .g2o file     one robot a file, or one graph of all
    .pyfg file                          PyFactorGraph, with times
    folder with Robot1_Odometry.dat     UTIAS MR.CLAM, see fgplan/io/mrclam_past.py
    folder of *.tum, or a .tum file     trajectories, one robot a file, see fgplan/io/tum_past.py

Robots are told apart by the first letter of their poses' keys (GTSAM Symbols; of LabeledSymbols
both letters), and where keys are plain numbers by the file that defines the pose. A robot's poses
are in the order of their keys, or of their times where the format has times. What is merged or left
out stands in ``notes``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import gtsam

from fgplan.errors import ScenarioError
from fgplan.factors.keys import describe_key
from fgplan.io.g2o import G2oGraph, read_g2o
from fgplan.io.pyfg import read_pyfg
from fgplan.typing import Key

ROUNDED_REPEAT = 1e-5
"""Edges of two files between the same vertices that differ by no more are one measurement.

Files have six digits; 16 of the 226 repeated edges of the ARGoS sample differ in the last of them.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TeamPast:
    """What a team did and measured, before any estimate of fgplan's.

    Attributes:
        format: Which reader it came from.
        files: Files that were read.
        graph: Factors; nothing in it need fix the frame.
        values: Initial values of every variable, as the files have them.
        robots: Poses of each robot, oldest first, in the order of the team.
        times_s: Time of each pose, seconds; empty where the format has none.
        stamps_s: Time of each factor, seconds; empty where the format has none.
        held: Poses that the files say are to be held (FIX lines).
        estimated: Whether the values are a joint estimate already; nothing is optimised then.
        notes: Plain sentences: what was merged or left out.
    """

    format: str
    files: tuple[Path, ...]
    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    robots: Mapping[str, tuple[Key, ...]]
    times_s: Mapping[Key, float] = field(default_factory=dict)
    stamps_s: tuple[float, ...] = ()
    held: tuple[Key, ...] = ()
    estimated: bool = False
    notes: tuple[str, ...] = ()

    @property
    def robot_of(self) -> dict[Key, str]:
        """Robot of each pose."""
        return {key: robot for robot, keys in self.robots.items() for key in keys}


def read_g2o_past(
    paths: Path | Sequence[Path],
    landmark_character: str | None = None,
    repeat_tolerance: float = ROUNDED_REPEAT,
    current: Mapping[str, Key] | None = None,
) -> TeamPast:
    """Read a team's past from g2o files.

    Args:
        paths: A file, a folder, or one file a robot.
        landmark_character: See ``read_g2o``.
        repeat_tolerance: See ``read_g2o``.
        current: Current pose of each robot: a robot's poses are then those that share its letters,
            up to its current one and after that of any other robot. None finds robots by itself.

    Returns:
        The past; robots in the order of ``current``, of their letters, or of the files.

    Raises:
        ScenarioError: If a line is wrong, or it cannot be said whose a pose is.
    """
    read = read_g2o(paths, landmark_character, repeat_tolerance)
    notes = []
    if read.left_out:
        left = ", ".join(path.name for path in read.left_out)
        notes.append(f"read {len(read.files)} files by robot; left out the whole graph, {left}")
    if read.repeated:
        notes.append(f"{read.repeated} edges stand in two files and were taken once")
    if read.same_ends:
        notes.append(
            f"{read.same_ends} edges join vertices that another file's edge joins with other "
            "numbers or the other way round; both are kept as two measurements"
        )
    return TeamPast(
        format="g2o",
        files=read.files,
        graph=read.graph,
        values=read.values,
        robots=_robots_of_g2o(read) if current is None else _robots_up_to(current, read.values),
        held=read.fixed,
        notes=tuple(notes),
    )


def read_pyfg_past(path: Path, current: Mapping[str, Key] | None = None) -> TeamPast:
    """Read a team's past from a PyFactorGraph file.

    Args:
        path: The file, or a folder with one.
        current: As for ``read_g2o_past``.

    Returns:
        The past, with times.

    Raises:
        ScenarioError: If a line is wrong, there is no pose, or a folder has several files.
    """
    files = sorted(path.glob("*.pyfg")) if path.is_dir() else [path]
    if len(files) != 1:
        raise ScenarioError(
            f"{path}: expected one .pyfg file, which holds all robots, got {len(files)}; name one"
        )
    read = read_pyfg(files[0])
    found: dict[str, list[Key]] = {}
    for key in sorted(read.times_s, key=lambda key: (read.times_s[key], key)):
        found.setdefault(_letters(key), []).append(key)
    if not found:
        raise ScenarioError(f"{files[0]}: expected poses of at least one robot, got none")
    robots = {name: tuple(found[name]) for name in sorted(found)}
    return TeamPast(
        format="pyfg",
        files=(files[0],),
        graph=read.graph,
        values=read.values,
        robots=robots if current is None else _robots_up_to(current, read.values),
        times_s=read.times_s,
        stamps_s=read.stamps_s,
        notes=("initial values are the file's vertices, which may be ground truth",),
    )


def _robots_up_to(current: Mapping[str, Key], values: gtsam.Values) -> dict[str, tuple[Key, ...]]:
    """Poses of each robot up to its current one, by letters; its own current pose at least."""
    poses = [key for key in values.keys() if is_pose(values, key)]  # noqa: SIM118
    robots = {}
    for name, last in current.items():
        before = [key for key in current.values() if key >> 48 == last >> 48 and key < last]
        first = max(before, default=-1)
        own = [key for key in poses if key >> 48 == last >> 48 and first < key < last]
        robots[name] = (*own, last)
    return robots


def _robots_of_g2o(read: G2oGraph) -> dict[str, tuple[Key, ...]]:
    """Poses by robot: by letter, else by file."""
    robots: dict[str, list[Key]] = {}
    keys = [key for key in read.vertex_files if is_pose(read.values, key)]
    lettered = [key for key in keys if _letters(key)]
    if lettered and len(lettered) != len(keys):
        plain = next(key for key in keys if not _letters(key))
        raise ScenarioError(
            f"{read.files[0]}: expected keys with a letter for every pose or for none, got "
            f"{describe_key(lettered[0])} and {plain}"
        )
    for key in keys:
        if lettered:
            robots.setdefault(_letters(key), []).append(key)
            continue
        files = read.vertex_files[key]
        if len(files) > 1:
            names = " and ".join(read.files[place].name for place in files)
            raise ScenarioError(
                f"{read.files[files[0]].parent}: pose {key} stands in {names}: whose is it? Give "
                "poses GTSAM Symbols with a letter a robot as ids, or each pose to one file"
            )
        robots.setdefault(read.files[files[0]].stem, []).append(key)
    if not robots:
        raise ScenarioError(f"{read.files[0]}: expected poses of at least one robot, got none")
    return {name: tuple(keys) for name, keys in robots.items()}


def is_pose(values: gtsam.Values, key: Key) -> bool:
    """Whether a value is a Pose2 or Pose3."""
    for read in (values.atPose2, values.atPose3):
        try:
            read(key)
        except RuntimeError:  # GTSAM's only way to say "another type"
            continue
        return True
    return False


def _letters(key: Key) -> str:
    """Letters of a Symbol or LabeledSymbol; none of a plain number."""
    character, label = key >> 56, (key >> 48) & 0xFF
    if not 32 < character < 127:
        return ""
    return chr(character) + (chr(label) if 32 < label < 127 else "")
