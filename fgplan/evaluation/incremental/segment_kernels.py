"""Compiled: where a path may be cut, and how the messages of its pieces make the message of it all.

A segment is a piece of path that hangs on its start pose, with its last pose as the pose that is
read; its message is (N, T, Theta, G, E) of ``message_kernels``. A second segment that hangs on the
last pose of a first one only adds:

    x_mid = Theta1 x_k + n1,  cov(n1) = E1,  cov(e1, n1) = G1'
    T = [T1; T2 Theta1],  Theta = Theta2 Theta1,  E = E2 + Theta2 E1 Theta2'
    N = [N1, G1'T2'; ., N2 + T2 E1 T2'],  G' = [G1'Theta2'; G2' + T2 E1 Theta2']

Nothing is subtracted. The rows are those of building the path whole if no interface variable is
touched from both sides of the cut; only there is a path cut.
"""

import numpy as np
from numba import njit

from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.message_pool import MessagePool
from fgplan.typing import BoolArray, FloatArray, IntArray


@njit(cache=True)
def boundaries(
    candidates: IntArray, lengths: IntArray, states: IntArray, factors: FactorBlocks, size: int
) -> tuple[BoolArray, BoolArray]:
    """Where factors stand on some candidates, and where their variables forbid a cut.

    Args:
        candidates: Shape (n,), indices of candidates.
        lengths: Shape (n,), steps of each.
        states: Shape (N, Lmax), own state of each candidate and step.
        factors: Factors of the own states.
        size: Number of variables V.

    Returns:
        Shape (n, Lmax), whether each state has a factor; and the same shape, whether a variable is
        touched both before that state and from it on.
    """
    count, longest = candidates.shape[0], states.shape[1]
    holds = np.zeros((count, longest), np.bool_)
    crossed = np.zeros((count, longest), np.bool_)
    met_by = np.full(size, -1, np.int64)
    low, high, met = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    for n in range(count):
        found = 0
        for i in range(lengths[n]):
            s = states[candidates[n], i]
            for m in range(factors.pointer[s], factors.pointer[s + 1]):
                v = factors.variable[m]
                holds[n, i] = True
                if met_by[v] != n:
                    met_by[v] = n
                    low[v] = i
                    met[found] = v
                    found += 1
                high[v] = i
        for k in range(found):
            for i in range(low[met[k]] + 1, high[met[k]] + 1):
                crossed[n, i] = True
    return holds, crossed


@njit(cache=True, fastmath={"reassoc", "contract"})
def _append(
    segment: MessagePool,
    at: int,
    out: MessagePool,
    n: int,
    slots: int,
    rows: int,
    theta: FloatArray,
    spread: FloatArray,
    seen: FloatArray,
) -> None:
    """Append a segment's rows to message n; theta, spread and seen (G') go on to its last pose."""
    d = theta.shape[0]
    total = out.row_count[n]
    more, base = segment.row_count[at], segment.row_pointer[at]
    noise, noise_out = segment.noise_pointer[at], out.noise_pointer[n]
    response = segment.response[base : base + more]
    onward = segment.read_response[at]
    carry = np.zeros((more, d))
    for a in range(more):
        for i in range(d):
            moved = 0.0
            for k in range(d):
                moved += response[a, k] * theta[k, i]
                carry[a, i] += response[a, k] * spread[k, i]
            out.response[out.row_pointer[n] + rows + a, i] = moved
        into = noise_out + (rows + a) * total
        for b in range(rows):
            entry = 0.0
            for k in range(d):
                entry += response[a, k] * seen[b, k]
            out.noise[into + b] = entry
        for b in range(a + 1):
            entry = segment.noise[noise + a * more + b]
            for k in range(d):
                entry += carry[a, k] * response[b, k]
            out.noise[into + rows + b] = entry
    fresh = np.empty(d)
    for b in range(rows):
        for i in range(d):
            fresh[i] = 0.0
            for k in range(d):
                fresh[i] += onward[i, k] * seen[b, k]
        seen[b, :] = fresh
    for a in range(more):
        for i in range(d):
            entry = segment.read_noise[base + a, i]
            for k in range(d):
                entry += carry[a, k] * onward[i, k]
            seen[rows + a, i] = entry
    half = np.zeros((d, d))
    new_theta = np.zeros((d, d))
    for i in range(d):
        for j in range(d):
            for k in range(d):
                new_theta[i, j] += onward[i, k] * theta[k, j]
                half[i, j] += onward[i, k] * spread[k, j]
    theta[:, :] = new_theta
    for i in range(d):
        for j in range(d):
            entry = segment.read_covariance[at, i, j]
            for k in range(d):
                entry += half[i, k] * onward[j, k]
            spread[i, j] = entry
    first, first_out = segment.slot_pointer[at], out.slot_pointer[n] + slots
    for k in range(segment.slot_pointer[at + 1] - first):
        out.slot_variable[first_out + k] = segment.slot_variable[first + k]
        out.slot_row[first_out + k] = segment.slot_row[first + k] + rows
        out.slot_rank[first_out + k] = segment.slot_rank[first + k]
        out.slot_c[first_out + k] = segment.slot_c[first + k]
    if segment.sound[at] == 0:
        out.sound[n] = 0


@njit(cache=True)
def compose_messages(
    pointer: IntArray,
    kept: BoolArray,
    place: IntArray,
    carried: MessagePool,
    built: MessagePool,
    out: MessagePool,
) -> None:
    """Compose messages of segments that follow on each other.

    Args:
        pointer: Shape (n + 1,), where the segments of each message begin.
        kept: Shape (S,), whether each segment is in ``carried``; otherwise it is in ``built``.
        place: Shape (S,), its place there.
        carried: Messages that read the last pose.
        built: Messages that read the last pose.
        out: In: candidates, pointers and row counts. Out: all the rest.
    """
    d = out.response.shape[1]
    most = 0
    for n in range(out.row_count.shape[0]):
        most = max(most, out.row_count[n])
    seen = np.empty((most, d))
    theta, spread = np.empty((d, d)), np.empty((d, d))
    for n in range(pointer.shape[0] - 1):
        theta[:, :] = np.eye(d)
        spread[:, :] = 0.0
        out.sound[n] = 1
        slots = rows = 0
        for p in range(pointer[n], pointer[n + 1]):
            segment = carried if kept[p] else built
            at = place[p]
            _append(segment, at, out, n, slots, rows, theta, spread, seen)
            slots += segment.slot_pointer[at + 1] - segment.slot_pointer[at]
            rows += segment.row_count[at]
        if out.read_covariance.shape[1] == d:
            base = out.row_pointer[n]
            out.read_noise[base : base + rows] = seen[:rows]
            out.read_response[n] = theta
            out.read_covariance[n] = spread
