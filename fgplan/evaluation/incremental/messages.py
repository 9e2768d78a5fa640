"""Messages of candidate paths in flat arrays, built and used by compiled kernels.

Once a roadmap: nothing. Once a robot: motion blocks and factors with landmarks and past poses.
Once an announcement: the factors with announced poses, the messages of the candidates that have a
changed factor, and the final solve. What a message is, ``message_kernels`` says.
"""

from typing import NamedTuple

import numpy as np

from fgplan.evaluation.incremental.candidate_table import MotionBlocks
from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.message_pool import MessagePool
from fgplan.evaluation.incremental.universe import Universe
from fgplan.typing import BoolArray, FloatArray, IntArray


class Chains(NamedTuple):
    """Paths or pieces of paths, each hanging on the pose before its first state.

    Attributes:
        states: Shape (N, Lmax), own state of each path and step.
        motion: Blocks of the motion factors, each of shape (N, Lmax, d, d).
    """

    states: IntArray
    motion: MotionBlocks


def empty_pool(
    candidates: IntArray, slots: IntArray, rows: IntArray, dim: int, read: int
) -> MessagePool:
    """Room for messages.

    Args:
        candidates: Shape (n,), whose message is to stand at each place.
        slots: Shape (n,), slots of each.
        rows: Shape (n,), most rows of each.
        dim: Tangent dimension d of a pose.
        read: Scalars of own poses that are read.

    Returns:
        A pool whose pointers are set.
    """
    size = len(candidates)
    slot_pointer, noise_pointer, row_pointer = (np.zeros(size + 1, np.int64) for _ in range(3))
    np.cumsum(slots, out=slot_pointer[1:])
    np.cumsum(rows**2, out=noise_pointer[1:])
    np.cumsum(rows, out=row_pointer[1:])
    all_slots, all_rows = int(slot_pointer[-1]), int(row_pointer[-1])
    return MessagePool(
        candidates=candidates,
        live=np.ones(size, bool),
        slot_pointer=slot_pointer,
        noise_pointer=noise_pointer,
        row_pointer=row_pointer,
        slot_variable=np.empty(all_slots, np.int64),
        slot_row=np.empty(all_slots, np.int64),
        slot_rank=np.empty(all_slots, np.int64),
        slot_c=np.empty((all_slots, dim, dim)),
        noise=np.empty(int(noise_pointer[-1])),
        response=np.empty((all_rows, dim)),
        read_noise=np.empty((all_rows, read)),
        read_response=np.empty((size, read, dim)),
        read_covariance=np.empty((size, read, read)),
        row_count=np.zeros(size, np.int64),
        sound=np.zeros(size, np.int64),
    )


def build(
    chains: Chains,
    fixed: FactorBlocks,
    moving: FactorBlocks,
    column: IntArray,
    width: IntArray,
    candidates: IntArray,
    lengths: IntArray,
    read_steps: IntArray,
) -> MessagePool:
    """Build messages.

    Args:
        chains: Candidates of the robot, or pieces of them.
        fixed: Factors of the distinct own states with landmarks and past poses.
        moving: Factors with announced poses.
        column: Shape (V,), first scalar of each variable, -1 where it does not take part.
        width: Shape (V,), tangent dimension of each variable.
        candidates: Shape (n,), indices of candidates.
        lengths: Shape (n,), steps of each up to the cut.
        read_steps: Shape (n, p), steps of own poses that are read.

    Returns:
        The messages.
    """
    from fgplan.evaluation.incremental.interface_kernels import count_interface
    from fgplan.evaluation.incremental.message_kernels import build_messages

    dim = chains.motion.late.shape[2]
    counts = count_interface(candidates, lengths, chains.states, fixed, moving, column)
    pool = empty_pool(candidates, counts, counts * dim, dim, read_steps.shape[1] * dim)
    build_messages(
        lengths,
        chains.states,
        chains.motion,
        fixed,
        moving,
        column,
        width,
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
