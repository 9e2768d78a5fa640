"""TUM trajectories as a team's past: one robot a file, odometry between consecutive poses.

    z_k = x_k^-1 x_k+1 of the file,   variances = base^2 + distance * per_metre^2

A TUM file has poses and times, neither measurements nor noise. What was measured is therefore
assumed, and ``notes`` say so: every step is odometry with the standard deviations ``BASE_M`` and
``BASE_RAD``, which a robot that stands still has too, and ``METRE_M`` and ``METRE_RAD`` after one
metre (fgplan/models/motion.py). Nothing joins two robots.

Poses are planar (Pose2) if those of all files are level and at one height, within ``LEVEL``; in
space (Pose3) otherwise. Keys: robots whose names are single letters have these, the others a, b, c,
... in the order of their names; l and L are left to landmarks.
"""

import itertools
import string
from pathlib import Path

import gtsam
import numpy as np

from fgplan.errors import ScenarioError
from fgplan.factors.gaussian_noise import gaussian_noise
from fgplan.factors.motion import between_factor, gtsam_pose
from fgplan.io.graph_text import text_lines
from fgplan.io.team_past import TeamPast
from fgplan.io.tum import TumTrajectory, read_tum
from fgplan.models.motion import MotionModel
from fgplan.typing import FloatArray, Key

BASE_M = 0.01
"""Standard deviation of the position in every step, metres."""

BASE_RAD = 0.001
"""Standard deviation of the rotation in every step, radians."""

METRE_M = 0.05
"""Standard deviation of the position after one metre, metres."""

METRE_RAD = 0.01
"""Standard deviation of the rotation after one metre, radians."""

LEVEL = 1e-6
"""Metres and radians by which poses in the plane may leave it."""

_LETTERS = tuple(letter for letter in string.ascii_letters if letter not in "lL")


def tum_files(path: Path) -> tuple[Path, ...]:
    """The TUM files that a path names, one a robot: the file itself, or those of a folder."""
    return tuple(sorted(path.glob("*.tum"))) if path.is_dir() else (path,)


def read_tum_past(path: Path) -> TeamPast:
    """Read a team's past from TUM trajectories.

    Args:
        path: A .tum file, or a folder of them; a robot is named as its file.

    Returns:
        The past, with times. Its values fit its odometry exactly, so it is not estimated again.

    Raises:
        ScenarioError: If a line is wrong, stamps do not increase (names file and line), a file has
            one pose only, or there are more files than letters for keys.
    """
    files = tum_files(path)
    if not 0 < len(files) <= len(_LETTERS):
        raise ScenarioError(
            f"{path}: expected 1 to {len(_LETTERS)} files ROBOT.tum, one a robot, got {len(files)}"
        )
    tracks = [_read_track(file) for file in files]
    planar = _level(np.concatenate([track.poses for track in tracks]))
    motion = _motion(planar)
    names = [file.stem for file in files]
    letters = names if all(name in _LETTERS for name in names) else _LETTERS
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    robots: dict[str, tuple[Key, ...]] = {}
    times_s: dict[Key, float] = {}
    stamps_s: list[float] = []
    for name, letter, track in zip(names, letters, tracks, strict=False):
        keys = tuple(int(gtsam.symbol(letter, step)) for step in range(len(track.times_s)))
        poses = _planar(track.poses) if planar else track.poses
        robots[name] = keys
        times_s.update(zip(keys, track.times_s.tolist(), strict=True))
        stamps_s += track.times_s[1:].tolist()
        for key, pose in zip(keys, poses, strict=True):
            values.insert(key, gtsam_pose(pose))
        noises = motion.covariances(poses)
        for step, (first, second) in enumerate(itertools.pairwise(poses)):
            noise = gaussian_noise(noises[step], f"odometry of robot {name!r} at step {step}")
            graph.add(between_factor(keys[step], keys[step + 1], first, second, noise))
    return TeamPast(
        format="tum",
        files=files,
        graph=graph,
        values=values,
        robots=robots,
        times_s=times_s,
        stamps_s=tuple(stamps_s),
        estimated=True,
        notes=_notes(planar, len(robots)),
    )


def _read_track(file: Path) -> TumTrajectory:
    """One robot's poses, in the order of their times."""
    track = read_tum(file)
    if len(track.times_s) < 2:
        raise ScenarioError(
            f"{file}: expected two poses at least, for odometry joins consecutive ones, got one; "
            "write it again with a later stamp if the robot stands"
        )
    late = np.flatnonzero(np.diff(track.times_s) <= 0)
    if late.size:
        before, stamp = (float(time) for time in track.times_s[late[0] : late[0] + 2])
        where, _ = next(itertools.islice(text_lines(file), int(late[0]) + 1, None))
        raise ScenarioError(
            f"{where}: pose: expected stamps that increase, got {stamp!r} after {before!r}; sort "
            "the lines by their stamps and leave out repeated ones"
        )
    return track


def _level(poses: FloatArray) -> bool:
    """Whether poses (n, 4, 4) are all at one height without roll and pitch."""
    level = np.ptp(poses[:, 2, 3]) <= LEVEL and (np.abs(poses[:, 2, :2]) <= LEVEL).all()
    return bool(level and (poses[:, 2, 2] > 0).all())


def _planar(poses: FloatArray) -> FloatArray:
    """Level poses (n, 4, 4) as (n, 3): x, y, heading."""
    headings = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    return np.column_stack([poses[:, 0, 3], poses[:, 1, 3], headings])


def _motion(planar: bool) -> MotionModel:
    """The noise that is assumed; rotation last in the plane and first in space."""
    if planar:
        return MotionModel(
            sigmas=np.array([BASE_M, BASE_M, BASE_RAD]),
            per_metre=np.array([METRE_M, METRE_M, METRE_RAD]),
        )
    return MotionModel(
        sigmas=np.array([BASE_RAD] * 3 + [BASE_M] * 3),
        per_metre=np.array([METRE_RAD] * 3 + [METRE_M] * 3),
    )


def _notes(planar: bool, robots: int) -> tuple[str, ...]:
    """What is assumed."""
    space = "in the plane, all poses are level" if planar else "in space"
    assumed = (
        f"TUM files have no noise; ASSUMED: odometry between consecutive poses, {space}, with "
        f"{BASE_M:g} m and {BASE_RAD:g} rad a step and {METRE_M:g} m and {METRE_RAD:g} rad after a "
        "metre (standard deviations; variances add up)"
    )
    apart = "TUM files have no measurements between robots: their poses are not correlated"
    return (assumed,) if robots == 1 else (assumed, apart)
