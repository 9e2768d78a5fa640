"""Messages of candidate paths in flat arrays, built and used by compiled kernels.

Once a roadmap: nothing. Once a robot: motion blocks and factors with landmarks and past poses.
Once an announcement: the factors with announced poses, the messages of the candidates that have a
changed factor, and the final solve. What a message is, ``message_kernels`` says.
"""

from dataclasses import dataclass, fields

import numpy as np

from fgplan.evaluation.incremental.candidate_table import CandidateTable
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.universe import Universe
from fgplan.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class MessagePool:
    """Messages of some candidates; the arrays are described in ``build_messages``.

    Attributes:
        candidates: Shape (n,), increasing: whose message stands at each place.
        live: Shape (n,), whether it still holds.
    """

    candidates: IntArray
    live: IntArray
    slot_pointer: IntArray
    noise_pointer: IntArray
    row_pointer: IntArray
    slot_variable: IntArray
    slot_row: IntArray
    slot_rank: IntArray
    slot_c: FloatArray
    noise: FloatArray
    response: FloatArray
    read_noise: FloatArray
    read_response: FloatArray
    read_covariance: FloatArray
    row_count: IntArray
    sound: IntArray

    @property
    def bytes(self) -> int:
        """Memory held."""
        return sum(int(getattr(self, field.name).nbytes) for field in fields(self))


def build(
    table: CandidateTable,
    fixed: FactorBlocks,
    moving: FactorBlocks,
    universe: Universe,
    candidates: IntArray,
    lengths: IntArray,
    read_steps: IntArray,
) -> MessagePool:
    """Build messages.

    Args:
        table: Candidates of the robot.
        fixed: Factors of the distinct own states with landmarks and past poses.
        moving: Factors with announced poses.
        universe: Says which variables take part.
        candidates: Shape (n,), indices of candidates.
        lengths: Shape (n,), steps of each up to the cut.
        read_steps: Shape (n, p), steps of own poses that are read.

    Returns:
        The messages.
    """
    from fgplan.evaluation.incremental.message_kernels import build_messages, count_interface

    dim = table.motion_late.shape[2]
    counts = count_interface(
        candidates,
        lengths,
        table.states,
        fixed.pointer,
        fixed.variable,
        moving.pointer,
        moving.variable,
        universe.column,
    )
    size, read = len(candidates), read_steps.shape[1] * dim
    slot_pointer, noise_pointer, row_pointer = np.zeros((3, size + 1), np.int64)
    slot_pointer[1:] = np.cumsum(counts)
    noise_pointer[1:] = np.cumsum((counts * dim) ** 2)
    row_pointer[1:] = np.cumsum(counts * dim)
    slots, rows = int(slot_pointer[-1]), int(row_pointer[-1])
    pool = MessagePool(
        candidates=candidates,
        live=np.ones(size, bool),
        slot_pointer=slot_pointer,
        noise_pointer=noise_pointer,
        row_pointer=row_pointer,
        slot_variable=np.empty(slots, np.int64),
        slot_row=np.empty(slots, np.int64),
        slot_rank=np.empty(slots, np.int64),
        slot_c=np.empty((slots, dim, dim)),
        noise=np.empty(int(noise_pointer[-1])),
        response=np.empty((rows, dim)),
        read_noise=np.empty((rows, read)),
        read_response=np.empty((size, read, dim)),
        read_covariance=np.empty((size, read, read)),
        row_count=np.zeros(size, np.int64),
        sound=np.zeros(size, np.int64),
    )
    build_messages(
        candidates,
        lengths,
        table.states,
        table.motion_late,
        table.motion_cross,
        table.motion_early,
        fixed.pointer,
        fixed.variable,
        fixed.rank,
        fixed.own,
        fixed.cross,
        fixed.other,
        moving.pointer,
        moving.variable,
        moving.rank,
        moving.own,
        moving.cross,
        moving.other,
        universe.column,
        universe.width,
        read_steps,
        pool.slot_pointer,
        pool.noise_pointer,
        pool.row_pointer,
        pool.slot_variable,
        pool.slot_row,
        pool.slot_rank,
        pool.slot_c,
        pool.noise,
        pool.response,
        pool.read_noise,
        pool.read_response,
        pool.read_covariance,
        pool.row_count,
        pool.sound,
    )
    return pool


def solve(
    pool: MessagePool, places: IntArray, universe: Universe, start: int, read_columns: IntArray
) -> tuple[FloatArray, IntArray]:
    """Covariances of what is read, after following some candidates.

    Args:
        pool: Messages.
        places: Shape (n,), places in the pool of the messages to use.
        universe: Others' belief.
        start: First scalar of the robot's current pose in it.
        read_columns: Shape (g,), scalars of the universe that are read after the own poses.

    Returns:
        Covariances of shape (n, p d + g, p d + g), and shape (n,) whether each is sound; where it
        is not, digits were lost and the covariance must not be used.
    """
    from fgplan.evaluation.incremental.solve_kernels import posterior_covariances

    own = pool.read_covariance.shape[1]
    size = own + len(read_columns)
    out = np.empty((len(places), size, size))
    sound = pool.sound.copy()
    posterior_covariances(
        places,
        universe.covariance,
        start,
        read_columns,
        own,
        universe.column,
        universe.width,
        pool.slot_pointer,
        pool.noise_pointer,
        pool.row_pointer,
        pool.slot_variable,
        pool.slot_row,
        pool.slot_rank,
        pool.slot_c,
        pool.noise,
        pool.response,
        pool.read_noise,
        pool.read_response,
        pool.read_covariance,
        pool.row_count,
        sound,
        out,
    )
    return out, sound[places].astype(bool)
