"""Messages of candidate paths in flat arrays, built and used by compiled kernels.

Once a roadmap: nothing. Once a robot: motion blocks and factors with landmarks and past poses.
Once an announcement: the factors with announced poses, the messages of the candidates that have a
changed factor, and the final solve. What a message is, ``message_kernels`` says.
"""

import numpy as np

from fgplan.evaluation.incremental.candidate_table import CandidateTable
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.message_pool import MessagePool
from fgplan.evaluation.incremental.segment_pool import no_segments
from fgplan.evaluation.incremental.segments import Segments
from fgplan.evaluation.incremental.universe import Universe
from fgplan.typing import BoolArray, FloatArray, IntArray


def build(
    table: CandidateTable,
    fixed: FactorBlocks,
    moving: FactorBlocks,
    segments: Segments | None,
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
        segments: What segments of the candidates say, if it is known.
        universe: Says which variables take part.
        candidates: Shape (n,), indices of candidates.
        lengths: Shape (n,), steps of each up to the cut.
        read_steps: Shape (n, p), steps of own poses that are read.

    Returns:
        The messages.
    """
    from fgplan.evaluation.incremental.interface_kernels import count_interface
    from fgplan.evaluation.incremental.message_kernels import build_messages

    dim = table.motion.late.shape[2]
    counts = count_interface(candidates, lengths, table.states, fixed, moving, universe.column)
    size, read = len(candidates), read_steps.shape[1] * dim
    slot_pointer, noise_pointer, row_pointer = (np.zeros(size + 1, np.int64) for _ in range(3))
    np.cumsum(counts, out=slot_pointer[1:])
    np.cumsum((counts * dim) ** 2, out=noise_pointer[1:])
    np.cumsum(counts * dim, out=row_pointer[1:])
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
    consists_of, known = no_segments(len(table.paths), dim)
    if segments is not None:
        consists_of, known = segments.consists_of, segments.pool
    build_messages(
        lengths,
        table.states,
        table.motion,
        fixed,
        moving,
        consists_of,
        known,
        universe.column,
        universe.width,
        read_steps,
        pool,
    )
    return pool


def solve(
    pool: MessagePool, places: IntArray, universe: Universe, start: int, read_columns: IntArray
) -> tuple[FloatArray, BoolArray]:
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

    size = pool.read_covariance.shape[1] + len(read_columns)
    out = np.empty((len(places), size, size))
    sound = pool.sound[places]
    posterior_covariances(
        places,
        universe.covariance,
        start,
        read_columns,
        universe.column,
        universe.width,
        pool,
        sound,
        out,
    )
    return out, sound.astype(bool)
