"""Candidate paths of one robot as arrays: what is computed once and shared by all evaluations.

Candidates share states where they share a prefix: the state (step, time, pose, observations) is
the key, since heading depends on the edge by which a vertex was reached. Motion factors between
consecutive poses have whitened rows A1 = -W Ad(h^-1), A2 = W with h the relative pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.models.pose import adjoint, between
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.paths.state import State
from fgplan.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class CandidateTable:
    """Candidates of one robot.

    Attributes:
        paths: The N candidates.
        lengths: Shape (N,), steps of each.
        states: Shape (N, Lmax), number of the own state at steps 1 to L; -1 beyond the end.
        owner: Shape (A, 2), candidate and step where each distinct own state was first met.
        poses: Shape (A, 3) or (A, 4, 4), poses of the distinct own states.
        vertices: Shape (A,), their roadmap vertices.
        observations: Planned observations from each distinct state.
        motion_late: Shape (N, Lmax, d, d), A2'A2 of the motion into each step.
        motion_cross: The same, A2'A1.
        motion_early: The same, A1'A1.
    """

    paths: tuple[CandidatePath, ...]
    lengths: IntArray
    states: IntArray
    owner: IntArray
    poses: FloatArray
    vertices: IntArray
    observations: tuple[tuple[Observation, ...], ...]
    motion_late: FloatArray
    motion_cross: FloatArray
    motion_early: FloatArray

    def distinct(self) -> list[State]:
        """The distinct own states."""
        return [self.paths[c].state(step) for c, step in self.owner.tolist()]


def tabulate(paths: Sequence[CandidatePath]) -> CandidateTable:
    """Turn candidate paths into arrays.

    Args:
        paths: At least one path, all of one robot.

    Returns:
        The table.
    """
    paths = tuple(paths)
    dim = paths[0].dim
    lengths = np.array([path.steps for path in paths], np.int64)
    longest = int(lengths.max())
    inside = np.arange(longest) < lengths[:, None]
    late, cross, early = np.zeros((3, len(paths), longest, dim, dim))
    late[inside], cross[inside], early[inside] = step_blocks(
        np.concatenate([path.poses[:-1] for path in paths]),
        np.concatenate([path.poses[1:] for path in paths]),
        np.concatenate([path.motion_covariances for path in paths]),
    )
    poses = np.concatenate([path.poses[1:] for path in paths])
    steps = np.concatenate([np.arange(1.0, length + 1.0) for length in lengths.tolist()])
    times = np.concatenate([path.times_s[1:] for path in paths])
    marks = np.column_stack([steps, times, poses.reshape(len(poses), -1)])
    raw, width = marks.tobytes(), marks.shape[1] * marks.itemsize
    names: list[tuple[object, ...] | bytes] = [
        raw[at : at + width] for at in range(0, len(raw), width)
    ]
    observed = _observed(paths, names)
    number: dict[object, int] = {}
    flat = np.array([number.setdefault(name, len(number)) for name in names], np.int64)
    first = np.unique(flat, return_index=True)[1]
    states = np.full((len(paths), longest), -1, np.int64)
    states[inside] = flat
    owner = np.column_stack([np.repeat(np.arange(len(paths)), lengths), steps]).astype(np.int64)
    vertices = np.concatenate([np.array(path.vertices[1:], np.int64) for path in paths])
    return CandidateTable(
        paths=paths,
        lengths=lengths,
        states=states,
        owner=owner[first],
        poses=np.ascontiguousarray(poses[first]),
        vertices=vertices[first],
        observations=tuple(observed.get(at, ()) for at in first.tolist()),
        motion_late=late,
        motion_cross=cross,
        motion_early=early,
    )


def _observed(
    paths: Sequence[CandidatePath], names: list[tuple[object, ...] | bytes]
) -> dict[int, tuple[Observation, ...]]:
    """Observations by flat place; states that observe differently get different names."""
    found: dict[int, list[Observation]] = {}
    begin = 0
    for path in paths:
        for seen in path.observations:
            found.setdefault(begin + seen.step - 1, []).append(seen)
        begin += path.steps
    for at, seen_here in found.items():
        marks = ((o.landmark, o.sensor, np.asarray(o.covariance).tobytes()) for o in seen_here)
        names[at] = (names[at], *marks)
    return {at: tuple(seen_here) for at, seen_here in found.items()}


def step_blocks(
    before: FloatArray, after: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Blocks of motion factors.

    Args:
        before: Shape (M, 3) or (M, 4, 4), pose before each step, world frame.
        after: The same, pose after it.
        covariances: Shape (M, d, d), noise in the tangent of the pose after.

    Returns:
        A2'A2, A2'A1 and A1'A1 of every step, each of shape (M, d, d).
    """
    information = np.linalg.inv(covariances)
    if before.ndim == 2:
        cos2, sin2 = np.cos(after[:, 2]), np.sin(after[:, 2])
        x, y = before[:, 0] - after[:, 0], before[:, 1] - after[:, 1]
        turn = before[:, 2] - after[:, 2]
        back = np.zeros((len(before), 3, 3))
        back[:, 0, 0] = back[:, 1, 1] = np.cos(turn)
        back[:, 1, 0] = np.sin(turn)
        back[:, 0, 1] = -back[:, 1, 0]
        back[:, 0, 2] = -sin2 * x + cos2 * y
        back[:, 1, 2] = -(cos2 * x + sin2 * y)
        back[:, 2, 2] = 1.0
    else:
        back = np.array([adjoint(between(b, a)) for a, b in zip(before, after, strict=True)])
    cross = -information @ back
    return information, cross, -np.swapaxes(back, 1, 2) @ cross
