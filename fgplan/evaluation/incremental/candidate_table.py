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
        distinct: The distinct own states.
        poses: Shape (A, 3) or (A, 4, 4), their poses.
        vertices: Shape (A,), their roadmap vertices.
        observations: Planned observations from each distinct state.
        motion_late: Shape (N, Lmax, d, d), A2'A2 of the motion into each step.
        motion_cross: The same, A2'A1.
        motion_early: The same, A1'A1.
    """

    paths: tuple[CandidatePath, ...]
    lengths: IntArray
    states: IntArray
    distinct: tuple[State, ...]
    poses: FloatArray
    vertices: IntArray
    observations: tuple[tuple[Observation, ...], ...]
    motion_late: FloatArray
    motion_cross: FloatArray
    motion_early: FloatArray


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
    states = np.full((len(paths), longest), -1, np.int64)
    late, cross, early = np.zeros((3, len(paths), longest, dim, dim))
    number: dict[tuple[object, ...], int] = {}
    distinct: list[State] = []
    observed: list[tuple[Observation, ...]] = []
    for c, path in enumerate(paths):
        late[c, : path.steps], cross[c, : path.steps], early[c, : path.steps] = motion_blocks(path)
        seen: dict[int, list[Observation]] = {}
        for observation in path.observations:
            seen.setdefault(observation.step, []).append(observation)
        width = path.poses[0].nbytes
        raw = path.poses.tobytes()
        times = path.times_s.tolist()
        for step in range(1, path.steps + 1):
            here = tuple(seen.get(step, ()))
            marks = tuple((o.landmark, o.sensor, np.asarray(o.covariance).tobytes()) for o in here)
            key = (step, times[step], raw[step * width : (step + 1) * width], marks)
            if key not in number:
                number[key] = len(distinct)
                distinct.append(path.state(step))
                observed.append(here)
            states[c, step - 1] = number[key]
    return CandidateTable(
        paths=paths,
        lengths=lengths,
        states=states,
        distinct=tuple(distinct),
        poses=np.ascontiguousarray([state.pose for state in distinct]),
        vertices=np.array([state.vertex for state in distinct], np.int64),
        observations=tuple(observed),
        motion_late=late,
        motion_cross=cross,
        motion_early=early,
    )


def motion_blocks(path: CandidatePath) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Blocks of a path's motion factors.

    Args:
        path: The path, L steps.

    Returns:
        A2'A2, A2'A1 and A1'A1 of every step, each of shape (L, d, d).
    """
    information = np.linalg.inv(path.motion_covariances)
    if path.poses.ndim == 2:
        before, after = path.poses[:-1], path.poses[1:]
        cos2, sin2 = np.cos(after[:, 2]), np.sin(after[:, 2])
        x, y = before[:, 0] - after[:, 0], before[:, 1] - after[:, 1]
        turn = before[:, 2] - after[:, 2]
        back = np.zeros((path.steps, 3, 3))
        back[:, 0, 0] = back[:, 1, 1] = np.cos(turn)
        back[:, 1, 0] = np.sin(turn)
        back[:, 0, 1] = -back[:, 1, 0]
        back[:, 0, 2] = -sin2 * x + cos2 * y
        back[:, 1, 2] = -(cos2 * x + sin2 * y)
        back[:, 2, 2] = 1.0
    else:
        back = np.array(
            [adjoint(between(b, a)) for a, b in zip(path.poses[:-1], path.poses[1:], strict=True)]
        )
    cross = -information @ back
    return information, cross, -np.swapaxes(back, 1, 2) @ cross
