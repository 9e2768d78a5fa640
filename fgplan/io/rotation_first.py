"""Poses of a pose graph where the initial values lead nowhere: rotations first, then positions.

Without positions the rotations minimise sum w |R_j - R_i R_ij|^2. As numbers without the condition
of being rotations this is linear, one sparse system for every row of all R (the chordal
relaxation); what comes out is projected to rotations. With these, positions minimise
sum w |t_j - t_i - R_i t_ij|^2, linear again. The first pose stays where it is. Weights are the mean
information of an edge's rotation and translation.
"""

from typing import Any

import gtsam
import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from fgplan.typing import FloatArray, IntArray, Key

_BETWEEN = gtsam.BetweenFactorPose2 | gtsam.BetweenFactorPose3


def rotations_first(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, first: Key
) -> gtsam.Values | None:
    """Poses that agree with the relative poses of a graph, whatever the initial values are.

    Args:
        graph: Relative poses; factors of one variable are passed over.
        values: Poses; only that of ``first`` is used.
        first: The pose that stays.

    Returns:
        Poses of all keys; None if the graph has other factors or variables, or is not connected.
    """
    edges: list[Any] = []
    for index in range(graph.size()):
        factor = graph.at(index)
        if isinstance(factor, _BETWEEN):
            edges.append(factor)
        elif factor.size() > 1:
            return None
    if not edges:
        return None
    keys = list(values.keys())
    place = {key: index for index, key in enumerate(keys)}
    size = 3 if isinstance(edges[0], gtsam.BetweenFactorPose3) else 2
    if set(values.dims().values()) != {6 if size == 3 else 3}:
        return None
    ends = np.array([[place[key] for key in list(edge.keys())] for edge in edges])
    joined = sparse.coo_array((np.ones(len(ends)), ends.T), shape=(len(keys),) * 2)
    if connected_components(joined)[0] > 1:
        return None
    measured = np.array([edge.measured().matrix() for edge in edges])
    turns, steps = measured[:, :size, :size], measured[:, :size, size]
    spin = slice(2, 3) if size == 2 else slice(0, 3)
    shift = slice(0, 2) if size == 2 else slice(3, 6)
    noises = np.array([edge.noiseModel().information().diagonal() for edge in edges])
    start = values.atPose3(first) if size == 3 else values.atPose2(first)
    fixed = start.matrix()
    rotations = _solve(
        ends,
        turns.swapaxes(1, 2),
        np.zeros((len(edges), size, size)),
        noises[:, spin].mean(axis=1),
        place[first],
        fixed[:size, :size].T,
        len(keys),
    ).swapaxes(1, 2)
    left, _, right = np.linalg.svd(rotations)
    left[:, :, -1] *= np.linalg.det(left @ right)[:, None]
    rotations = left @ right
    offsets = np.einsum("nij,nj->ni", rotations[ends[:, 0]], steps)[:, :, None]
    identity = np.tile(np.eye(size), (len(edges), 1, 1))
    positions = _solve(
        ends,
        identity,
        offsets,
        noises[:, shift].mean(axis=1),
        place[first],
        fixed[:size, size][:, None],
        len(keys),
    )[:, :, 0]
    found = gtsam.Values()
    for key, rotation, position in zip(keys, rotations, positions, strict=True):
        if size == 3:
            found.insert(key, gtsam.Pose3(gtsam.Rot3(rotation), position))
        else:
            angle = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
            found.insert(key, gtsam.Pose2(float(position[0]), float(position[1]), angle))
    return found


def _solve(
    ends: IntArray,
    maps: FloatArray,
    offsets: FloatArray,
    weights: FloatArray,
    anchor: int,
    fixed: FloatArray,
    count: int,
) -> FloatArray:
    """Blocks x_i, shape (count, d, m), minimising sum w |x_j - M x_i - o|^2; one is fixed."""
    edges, size = len(ends), maps.shape[1]
    root = np.sqrt(weights)[:, None, None]
    rows = (np.arange(edges)[:, None, None] * size + np.arange(size)[None, :, None]).repeat(size, 2)
    within = np.arange(size)[None, None, :]
    identity = np.tile(np.eye(size), (edges, 1, 1))
    blocks = [(ends[:, 1], root * identity), (ends[:, 0], -root * maps)]
    matrix = sparse.csc_array(
        (
            np.concatenate([block.ravel() for _, block in blocks]),
            (
                np.tile(rows.ravel(), 2),
                np.concatenate(
                    [
                        np.broadcast_to(end[:, None, None] * size + within, rows.shape).ravel()
                        for end, _ in blocks
                    ]
                ),
            ),
        ),
        shape=(edges * size, count * size),
    )
    known = np.arange(anchor * size, (anchor + 1) * size)
    unknown = np.setdiff1d(np.arange(count * size), known)
    right = (root * offsets).reshape(edges * size, -1) - matrix[:, known] @ fixed
    free = matrix[:, unknown]
    found = np.zeros((count * size, fixed.shape[1]))
    found[known] = fixed
    found[unknown] = splu((free.T @ free).tocsc()).solve(np.asarray(free.T @ right))
    return found.reshape(count, size, -1)
