"""Compiled: covariances after following a candidate path, from its message and others' belief.

S is the joint covariance of everything outside the path under everybody else's belief. The
measurements e = C'x_v + T x_k + noise(N) of the message (see ``message_kernels``) and the variables
that are read have one joint covariance

    J = [ K  Y' ]   K = N + C'S_vv C + C'S_vk T' + T S_kv C + T S_kk T'
        [ Y  Q  ]   own pose s:  Y = Theta_s (S_kv C + S_kk T') + G_s
                                 Q = E_ss + Theta_s S_kk Theta_s'
                    variable g:  Y = S_gv C + S_gk T',  Q = S_gg,  S_gk Theta_s'

and J = L L' gives the covariance of what is read, given e, as L_Q L_Q': no inverse, no difference.
A pivot says how many digits were lost on the way: if a diagonal entry was summed from terms more
than 1e4 times the pivot, the candidate is flagged and evaluated by QR.
"""

import numpy as np

from fgplan.compiling import njit
from fgplan.evaluation.incremental.cholesky_kernels import cholesky
from fgplan.evaluation.incremental.message_pool import MessagePool
from fgplan.typing import FloatArray, IntArray

LOSS_LIMIT = 1e4
"""Largest ratio of the terms of a diagonal entry to its pivot."""


@njit(cache=True, fastmath={"reassoc", "contract"}, inner=True)
def _gather_slot(
    slot: int,
    first_slot: int,
    covariance: FloatArray,
    start: int,
    read_columns: IntArray,
    column: IntArray,
    width: IntArray,
    pool: MessagePool,
    joint: FloatArray,
    start_c: FloatArray,
    other_c: FloatArray,
) -> None:
    """Put C'S of one slot with x_k, with what is read, and with the slots before it in place."""
    v = pool.slot_variable[slot]
    col, size, first, rank = column[v], width[v], pool.slot_row[slot], pool.slot_rank[slot]
    if rank == size:  # C = I
        for r in range(rank):
            row = covariance[col + r]
            for i in range(start_c.shape[0]):
                start_c[i, first + r] = row[start + i]
            for g in range(other_c.shape[0]):
                other_c[g, first + r] = row[read_columns[g]]
            target = joint[first + r]
            for second in range(first_slot, slot + 1):
                v2 = pool.slot_variable[second]
                col2, size2 = column[v2], width[v2]
                first2, rank2 = pool.slot_row[second], pool.slot_rank[second]
                if rank2 == size2:
                    for r2 in range(rank2):
                        target[first2 + r2] = row[col2 + r2]
                else:
                    c_b = pool.slot_c[second]
                    for r2 in range(rank2):
                        total = 0.0
                        for k in range(size2):
                            total += row[col2 + k] * c_b[k, r2]
                        target[first2 + r2] = total
        return
    c_a = pool.slot_c[slot]
    for r in range(rank):
        for k in range(size):
            weight = c_a[k, r]
            row = covariance[col + k]
            for i in range(start_c.shape[0]):
                start_c[i, first + r] += weight * row[start + i]
            for g in range(other_c.shape[0]):
                other_c[g, first + r] += weight * row[read_columns[g]]
            target = joint[first + r]
            for second in range(first_slot, slot + 1):
                v2 = pool.slot_variable[second]
                col2, size2 = column[v2], width[v2]
                first2, rank2 = pool.slot_row[second], pool.slot_rank[second]
                c_b = pool.slot_c[second]
                for r2 in range(rank2):
                    total = 0.0
                    for k2 in range(size2):
                        total += row[col2 + k2] * c_b[k2, r2]
                    target[first2 + r2] += weight * total


@njit(cache=True, fastmath={"reassoc", "contract"})
def posterior_covariances(
    places: IntArray,
    covariance: FloatArray,
    start: int,
    read_columns: IntArray,
    column: IntArray,
    width: IntArray,
    pool: MessagePool,
    sound: IntArray,
    out: FloatArray,
) -> None:
    """Covariance of what is read, for some candidates.

    Args:
        places: Shape (n,), places of the messages to use.
        covariance: S, shape (U, U).
        start: Column of x_k in S.
        read_columns: Shape (g,), scalar columns of S that are read after the own poses.
        column: Shape (V,), column of each variable in S.
        width: Shape (V,), tangent dimension of each variable.
        pool: The messages.
        sound: In and out: shape (n,), set to 0 where digits were lost.
        out: Out: shape (n, p d + g, p d + g).
    """
    d = pool.response.shape[1]
    own = pool.read_covariance.shape[1]
    extra = read_columns.shape[0]
    read = own + extra
    largest = read
    for n in range(places.shape[0]):
        largest = max(largest, pool.row_count[places[n]] + read)
    work = np.empty(largest * largest)
    for n in range(places.shape[0]):
        m = places[n]
        if sound[n] == 0:
            continue
        z = pool.row_count[m]
        base = pool.row_pointer[m]
        offset = pool.noise_pointer[m]
        size = z + read
        joint = work[: size * size].reshape((size, size))
        joint[:z, :z] = 0.0
        terms = np.empty(z + read)
        start_c = np.zeros((d, z))
        other_c = np.zeros((extra, z))
        transposed = np.empty((d, z))
        for a in range(z):
            for i in range(d):
                transposed[i, a] = pool.response[base + a, i]
        for slot in range(pool.slot_pointer[m], pool.slot_pointer[m + 1]):
            _gather_slot(
                slot,
                pool.slot_pointer[m],
                covariance,
                start,
                read_columns,
                column,
                width,
                pool,
                joint,
                start_c,
                other_c,
            )
        moved = np.zeros((d, z))
        for i in range(d):
            for k in range(d):
                weight = covariance[start + i, start + k]
                for a in range(z):
                    moved[i, a] += weight * transposed[k, a]
        for a in range(z):
            spread = pool.noise[offset + a * z + a] + joint[a, a]
            for i in range(d):
                spread += transposed[i, a] * moved[i, a]
            terms[a] = spread
        for i in range(d):
            for a in range(z):
                moved[i, a] += start_c[i, a]
        for a in range(z):
            row = joint[a]
            from_noise = pool.noise[offset + a * z : offset + a * z + a + 1]
            for b in range(a + 1):
                row[b] += from_noise[b]
            for i in range(d):
                by_path, by_start = transposed[i, a], start_c[i, a]
                moved_i, transposed_i = moved[i], transposed[i]
                for b in range(a + 1):
                    row[b] += by_path * moved_i[b] + by_start * transposed_i[b]
        for s in range(own):
            row = joint[z + s]
            for a in range(z):
                row[a] = pool.read_noise[base + a, s]
            for i in range(d):
                weight = pool.read_response[m, s, i]
                for a in range(z):
                    row[a] += weight * moved[i, a]
            for s2 in range(s + 1):
                total = pool.read_covariance[m, s, s2]
                for i in range(d):
                    for k in range(d):
                        total += (
                            pool.read_response[m, s, i]
                            * covariance[start + i, start + k]
                            * pool.read_response[m, s2, k]
                        )
                row[z + s2] = total
            terms[z + s] = row[z + s]
        for g in range(extra):
            row = joint[z + own + g]
            from_s = covariance[read_columns[g]]
            for a in range(z):
                row[a] = other_c[g, a]
            for i in range(d):
                weight = from_s[start + i]
                for a in range(z):
                    row[a] += weight * transposed[i, a]
            for s in range(own):
                total = 0.0
                for i in range(d):
                    total += from_s[start + i] * pool.read_response[m, s, i]
                row[z + s] = total
            for g2 in range(g + 1):
                row[z + own + g2] = from_s[read_columns[g2]]
            terms[z + own + g] = row[z + own + g]
        positive, factor = cholesky(joint)
        if not positive:
            sound[n] = 0
            continue
        for a in range(size):
            if terms[a] > LOSS_LIMIT * factor[a, a] * factor[a, a]:
                sound[n] = 0
        for a in range(read):
            for b in range(a + 1):
                total = 0.0
                for k in range(b + 1):
                    total += factor[z + a, z + k] * factor[z + b, z + k]
                out[n, a, b] = total
                out[n, b, a] = total
