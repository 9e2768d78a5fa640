"""Candidate paths of one robot as arrays: what is computed once and shared by all evaluations.

Candidates share states where they share a prefix: the key is (step, time, vertex, pose,
observations), since heading depends on the edge by which a vertex was reached. Motion factors
between consecutive poses have whitened rows A1 = -W Ad(h^-1), A2 = W with h the relative pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fgplan.evaluation.incremental.observation_table import ObservationTable, observation_table
from fgplan.evaluation.incremental.spatial_blocks import spatial_motion_blocks
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.typing import BoolArray, FloatArray, IntArray


class MotionBlocks(NamedTuple):
    """Blocks of motion factors; a tuple, because compiled code takes it as it is.

    Attributes:
        late: A2'A2 of the motion into each step, (N, Lmax, d, d) by candidate or (M, d, d).
        cross: A2'A1, the same shape.
        early: A1'A1, the same shape.
    """

    late: FloatArray
    cross: FloatArray
    early: FloatArray


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
        counted: Shape (A,), whether each is the first of those that differ only in what they
            observe.
        observations: Planned observations from each distinct state.
        motion: Blocks of the motion factors, each of shape (N, Lmax, d, d).
        tightest: Shape (d,), largest information of any motion step in each direction.
    """

    paths: tuple[CandidatePath, ...]
    lengths: IntArray
    states: IntArray
    owner: IntArray
    poses: FloatArray
    vertices: IntArray
    counted: BoolArray
    observations: ObservationTable
    motion: MotionBlocks
    tightest: FloatArray

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
    from fgplan.evaluation.incremental.distinct_kernels import distinct_rows

    paths = tuple(paths)
    dim = paths[0].dim
    lengths = np.array([path.steps for path in paths], np.int64)
    longest = int(lengths.max())
    inside = np.arange(longest) < lengths[:, None]
    flat_motion = step_blocks(
        np.concatenate([path.poses[:-1] for path in paths]),
        np.concatenate([path.poses[1:] for path in paths]),
        np.concatenate([path.motion_covariances for path in paths]),
    )
    motion = MotionBlocks(*(np.zeros((len(paths), longest, dim, dim)) for _ in flat_motion))
    for padded, blocks in zip(motion, flat_motion, strict=True):
        padded[inside] = blocks
    poses = np.concatenate([path.poses[1:] for path in paths])
    steps = np.concatenate([np.arange(1.0, length + 1.0) for length in lengths.tolist()])
    times = np.concatenate([path.times_s[1:] for path in paths])
    vertices = np.concatenate([np.array(path.vertices[1:], np.int64) for path in paths])
    observed = observation_table(paths)
    seen = observed.marks()
    marks = np.column_stack([seen, steps, times, vertices, poses.reshape(len(poses), -1)])
    flat, first = distinct_rows(marks.view(np.int64))
    counted = np.ones(len(first), bool)
    if len(observed.landmark):
        _, once = distinct_rows(np.ascontiguousarray(marks[:, 1:]).view(np.int64))
        counted = np.isin(first, once)
    states = np.full((len(paths), longest), -1, np.int64)
    states[inside] = flat
    owner = np.column_stack([np.repeat(np.arange(len(paths)), lengths), steps]).astype(np.int64)
    return CandidateTable(
        paths=paths,
        lengths=lengths,
        states=states,
        owner=owner[first],
        poses=np.ascontiguousarray(poses[first]),
        vertices=vertices[first],
        counted=counted,
        observations=observed.take(first),
        motion=motion,
        tightest=flat_motion.late.diagonal(axis1=1, axis2=2).max(axis=0),
    )


def step_blocks(before: FloatArray, after: FloatArray, covariances: FloatArray) -> MotionBlocks:
    """Blocks of motion factors.

    Args:
        before: Shape (M, 3) or (M, 4, 4), pose before each step, world frame.
        after: The same, pose after it.
        covariances: Shape (M, d, d), noise in the tangent of the pose after.

    Returns:
        Blocks of every step, each of shape (M, d, d).
    """
    if before.ndim == 2:
        from fgplan.evaluation.incremental.factor_kernels import motion_blocks

        return MotionBlocks(*motion_blocks(before.copy(), after.copy(), covariances.copy()))
    return MotionBlocks(*spatial_motion_blocks(before, after, covariances))
