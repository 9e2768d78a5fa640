"""Information blocks of motions and relative poses in space, many at once.

The same blocks as ``factor_kernels`` has for the plane, with Ad = Ad(x2^-1 x1) of GTSAM's order
(rotation before translation):

    x2^-1 x1 = (R, t)     Ad = [ R      0 ]
                               [ [t] R  R ]
"""

import numpy as np

from fgplan.typing import BoolArray, FloatArray, IntArray


def spatial_pairs(
    own: FloatArray,
    own_place: IntArray,
    other: FloatArray,
    other_place: IntArray,
    distance_m: float,
    each_once: bool,
) -> tuple[IntArray, IntArray]:
    """Pairs of poses in space of different robots nearer than a distance, by own state.

    Args:
        own: Shape (A, 4, 4), world frame.
        own_place: Shape (A,), place of each one's robot in the team.
        other: Shape (B, 4, 4), world frame.
        other_place: Shape (B,), likewise.
        distance_m: Largest distance, metres.
        each_once: Both sides are the same states: take each pair from its later robot only.

    Returns:
        Row pointer of shape (A + 1,) and indices into ``other``, shape (M,).
    """
    offset = own[:, None, :3, 3] - other[None, :, :3, 3]
    near: BoolArray = np.sqrt((offset**2).sum(axis=2)) < distance_m
    mine, theirs = own_place[:, None], other_place[None]
    near &= theirs < mine if each_once else theirs != mine
    pointer = np.zeros(len(own) + 1, np.int64)
    np.cumsum(near.sum(axis=1), out=pointer[1:])
    return pointer, np.nonzero(near)[1]


def spatial_relative_blocks(
    own: FloatArray,
    other: FloatArray,
    pointer: IntArray,
    found: IntArray,
    own_place: IntArray,
    other_place: IntArray,
    omega: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Information blocks of relative-pose factors between poses in space.

    Args:
        own: Shape (A, 4, 4), world frame.
        other: Shape (B, 4, 4), world frame.
        pointer: Row pointer, shape (A + 1,).
        found: Indices into ``other``, shape (M,).
        own_place: Shape (A,), place of each one's robot in the team; the earlier is the first.
        other_place: Shape (B,), likewise.
        omega: Information, shape (6, 6), tangent of the second pose.

    Returns:
        Blocks (own, own), (other, own) and (other, other), each of shape (M, 6, 6).
    """
    rows = np.repeat(np.arange(len(own)), np.diff(pointer))
    swapped = (other_place[found] < own_place[rows])[:, None, None]
    mine, theirs = own[rows], other[found]
    first, second = np.where(swapped, theirs, mine), np.where(swapped, mine, theirs)
    back = _adjoints(second, first)
    mixed = -omega @ back
    square = -np.swapaxes(back, 1, 2) @ mixed
    late = np.broadcast_to(omega, square.shape)
    return (
        np.where(swapped, late, square),
        np.where(swapped, np.swapaxes(mixed, 1, 2), mixed),
        np.where(swapped, square, late),
    )


def spatial_motion_blocks(
    before: FloatArray, after: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Information blocks of motion factors between consecutive poses in space.

    Args:
        before: Shape (M, 4, 4), pose before each step, world frame.
        after: Shape (M, 4, 4), pose after it.
        covariances: Shape (M, 6, 6), noise in the tangent of the pose after.

    Returns:
        Blocks A2'A2, A2'A1 and A1'A1, each of shape (M, 6, 6).
    """
    information: FloatArray = np.asarray(np.linalg.inv(covariances), dtype=np.float64)
    back = _adjoints(after, before)
    cross = -information @ back
    return information, cross, -np.swapaxes(back, 1, 2) @ cross


def _adjoints(second: FloatArray, first: FloatArray) -> FloatArray:
    """Ad(second^-1 first) of many pairs, shape (M, 6, 6)."""
    turned = np.swapaxes(second[:, :3, :3], 1, 2)
    rotation = turned @ first[:, :3, :3]
    where = (turned @ (first[:, :3, 3] - second[:, :3, 3])[:, :, None])[:, None, :, 0]
    found = np.zeros((len(first), 6, 6))
    found[:, :3, :3] = found[:, 3:, 3:] = rotation
    found[:, 3:, :3] = np.swapaxes(np.cross(where, np.swapaxes(rotation, 1, 2)), 1, 2)
    return found
