"""The distributed Kalman filter against naive inverses, and the laws it must keep."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag

from fgplan.riccati.block_diagonal import riccati_map_blocks
from fgplan.riccati.distributed import (
    fuse_blocks,
    fuse_dense,
    fusion_weights,
    team_step_blocks,
)
from fgplan.riccati.distributed_mean import (
    fuse_means_blocks,
    fuse_means_dense,
    team_step_means_blocks,
)

SEEDS = st.integers(0, 2**32 - 1)
KAPPAS = st.floats(0.5, 0.999)


def spd(generator, *shape):
    """Covariances whose scales differ by up to a hundred."""
    roots = generator.standard_normal((*shape, shape[-1]))
    scale = 10.0 ** generator.uniform(-1.0, 1.0, (*shape[:-1], 1, 1))
    return scale * (roots @ np.swapaxes(roots, -1, -2) + 0.1 * np.eye(shape[-1]))


def draw_rows(generator, *shape):
    """Whitened rows of shape (..., m, n); some robots and targets see nothing."""
    rows = 2.0 * generator.standard_normal(shape)
    return rows * (generator.random((*shape[:-2], 1, 1)) < 0.6)


def draw_dynamics(generator, targets, size, *, noise=True):
    transition = np.eye(size) + 0.2 * generator.standard_normal((targets, size, size))
    d = generator.standard_normal((targets, size))
    return transition, d, 0.05 * spd(generator, targets, size) * noise


def draw_links(generator, robots, probability=0.4):
    upper = np.triu(generator.random((robots, robots)) < probability, 1)
    return upper | upper.T


def information(rows):
    return np.swapaxes(rows, -1, -2) @ rows


def naive_weights(priors, kappa):
    """One target: from determinants, robot by robot."""
    if len(priors) == 1:
        return [1.0]
    determinants = [np.linalg.det(covariance) for covariance in priors]
    best = determinants.index(min(determinants))
    return [kappa if j == best else (1.0 - kappa) / (len(priors) - 1) for j in range(len(priors))]


def naive_step(mus, priors, rows, z, transition, d, process, kappa):
    """The formulas of the module headers for one target, by inverses."""
    weights = naive_weights(priors, kappa)
    total, omega = rows.T @ rows, rows.T @ z
    for weight, mu, covariance in zip(weights, mus, priors, strict=True):
        total = total + weight * np.linalg.inv(covariance)
        omega = omega + weight * np.linalg.inv(covariance) @ mu
    after = np.linalg.inv(total)
    return transition @ after @ omega + d, transition @ after @ transition.T + process


@given(seed=SEEDS, robots=st.integers(1, 6), targets=st.integers(1, 4), kappa=KAPPAS)
def test_block_and_dense_equal_the_naive_formulas(seed, robots, targets, kappa):
    generator = np.random.default_rng(seed)
    size = int(generator.integers(1, 4))
    priors, mus = (
        spd(generator, robots, targets, size),
        generator.standard_normal((robots, targets, size)),
    )
    rows = draw_rows(generator, targets, 2, size)
    z = generator.standard_normal((targets, 2))
    transition, d, process = draw_dynamics(generator, targets, size)
    means, covariances = fuse_means_blocks(mus, priors, rows, z, transition, d, process, kappa)
    for k in range(targets):
        mu, covariance = naive_step(
            mus[:, k], priors[:, k], rows[k], z[k], transition[k], d[k], process[k], kappa
        )
        scale = np.abs(covariance).max()
        np.testing.assert_allclose(covariances[k], covariance, rtol=0, atol=1e-10 * scale)
        np.testing.assert_allclose(means[k], mu, rtol=1e-9, atol=1e-9 * (1 + scale))
    blocks = fuse_blocks(priors, information(rows), transition, process, kappa)
    np.testing.assert_allclose(blocks, covariances, rtol=1e-12, atol=1e-13 * np.abs(blocks).max())

    joint = np.array([block_diag(*own) for own in priors])
    stacked = (block_diag(*transition), block_diag(*process))
    parts = [slice(size * k, size * (k + 1)) for k in range(targets)]
    dense = fuse_dense(joint, block_diag(*information(rows)), *stacked, kappa, parts)
    limit = 1e-12 * np.abs(blocks).max()
    np.testing.assert_allclose(dense, block_diag(*blocks), rtol=0, atol=limit)
    mu, covariance = fuse_means_dense(
        mus.reshape(robots, -1),
        joint,
        block_diag(*rows),
        z.ravel(),
        stacked[0],
        d.ravel(),
        stacked[1],
        kappa,
        parts,
    )
    np.testing.assert_allclose(covariance, dense, rtol=0, atol=limit)
    np.testing.assert_allclose(mu, means.ravel(), rtol=1e-11, atol=1e-11)


@given(seed=SEEDS, robots=st.integers(1, 5), kappa=KAPPAS)
def test_dense_with_one_weight_a_robot_equals_the_naive_formulas(seed, robots, kappa):
    generator = np.random.default_rng(seed)
    size = 5
    priors, mus = spd(generator, robots, size), generator.standard_normal((robots, size))
    rows, z = draw_rows(generator, 3, size), generator.standard_normal(3)
    transition, d, process = (part[0] for part in draw_dynamics(generator, 1, size))
    mu, covariance = naive_step(mus, priors, rows, z, transition, d, process, kappa)
    limit = 1e-9 * np.abs(covariance).max()  # condition numbers to 1e4 lose in the naive inverses
    dense = fuse_dense(priors, rows.T @ rows, transition, process, kappa)
    np.testing.assert_allclose(dense, covariance, rtol=0, atol=limit)
    means, covariances = fuse_means_dense(mus, priors, rows, z, transition, d, process, kappa)
    np.testing.assert_allclose(covariances, dense, rtol=1e-12, atol=1e-12 * np.abs(dense).max())
    np.testing.assert_allclose(means, mu, rtol=1e-8, atol=limit)
    one_block = fuse_blocks(
        priors[:, None], (rows.T @ rows)[None], transition[None], process[None], kappa
    )
    np.testing.assert_array_equal(one_block[0], dense)


@given(values=st.lists(st.floats(-80.0, 80.0), min_size=1, max_size=40), kappa=KAPPAS)
def test_weights_sum_to_one_and_favour_the_most_certain(values, kappa):
    weights = fusion_weights(values, kappa)
    assert abs(weights.sum() - 1.0) < 1e-14
    assert (weights > 0.0).all()
    assert weights.max() == weights[int(np.argmin(values))]


@given(seed=SEEDS, robots=st.integers(2, 6))
def test_the_order_of_neighbours_changes_nothing(seed, robots):
    generator = np.random.default_rng(seed)
    transition, d, process = draw_dynamics(generator, 3, 2)
    priors, mus = spd(generator, robots, 3, 2), generator.standard_normal((robots, 3, 2))
    rows, z = draw_rows(generator, 3, 1, 2), generator.standard_normal((3, 1))
    order = np.concatenate(([0], 1 + generator.permutation(robots - 1)))
    first = fuse_means_blocks(mus, priors, rows, z, transition, d, process)
    second = fuse_means_blocks(mus[order], priors[order], rows, z, transition, d, process)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


@given(seed=SEEDS, robots=st.integers(2, 6))
def test_the_order_of_the_team_changes_nothing(seed, robots):
    generator = np.random.default_rng(seed)
    transition, d, process = draw_dynamics(generator, 2, 2)
    links = draw_links(generator, robots)
    priors, mus = spd(generator, robots, 2, 2), generator.standard_normal((robots, 2, 2))
    rows, z = draw_rows(generator, robots, 2, 1, 2), generator.standard_normal((robots, 2, 1))
    order = generator.permutation(robots)
    first = team_step_means_blocks(mus, priors, links, rows, z, transition, d, process)
    second = team_step_means_blocks(
        mus[order],
        priors[order],
        links[np.ix_(order, order)],
        rows[order],
        z[order],
        transition,
        d,
        process,
    )
    for one, other in zip(first, second, strict=True):
        np.testing.assert_allclose(one[order], other, rtol=1e-12, atol=1e-12)
    covariances = team_step_blocks(priors, links, information(rows), transition, process)
    np.testing.assert_allclose(covariances, first[1], rtol=1e-12, atol=1e-12)


def smallest_difference(above, below):
    """Least eigenvalue of above - below, relative to above: not negative if above >= below."""
    roots = np.linalg.inv(np.linalg.cholesky(above))
    return np.linalg.eigvalsh(roots @ (above - below) @ np.swapaxes(roots, -1, -2)).min()


@given(
    seed=SEEDS,
    robots=st.integers(1, 6),
    kappa=KAPPAS,
    noise=st.booleans(),
    varying=st.booleans(),
)
def test_information_is_never_above_the_central_filters(seed, robots, kappa, noise, varying):
    generator = np.random.default_rng(seed)
    transition, _, process = draw_dynamics(generator, 2, 2, noise=noise)
    central = spd(generator, 2, 2)
    team = np.repeat(central[None], robots, axis=0)
    links = draw_links(generator, robots)
    for _ in range(8):
        if varying:
            links = draw_links(generator, robots)
        gained = information(draw_rows(generator, robots, 2, 1, 2))
        team = team_step_blocks(team, links, gained, transition, process, kappa)
        central = riccati_map_blocks(central, gained.sum(axis=0), transition, process)
        assert smallest_difference(team, np.broadcast_to(central, team.shape)) > -1e-9


def test_links_help():
    """Guards the test above against a filter that never fuses: pooled robots know more."""
    generator = np.random.default_rng(2)
    eye, zero = np.eye(2)[None], np.zeros((1, 2, 2))
    alone = linked = np.repeat(eye[None], 4, axis=0)
    links = ~np.eye(4, dtype=bool)
    for _ in range(10):
        gained = information(generator.standard_normal((4, 1, 1, 2)))
        gained[1:] = 0.0  # one robot sees
        alone = team_step_blocks(alone, links & False, gained, eye, zero)
        linked = team_step_blocks(linked, links, gained, eye, zero)
    np.testing.assert_array_equal(alone[1:], np.repeat(eye[None], 3, axis=0))
    assert np.linalg.det(linked[1:]).max() < 0.05
    assert np.linalg.det(linked[0]).min() >= np.linalg.det(alone[0]).min() * (1 - 1e-12)


def test_every_robot_of_a_connected_team_learns_a_static_target():
    """Mean square consistency: ends of a chain see one axis each, the middle sees nothing."""
    robots = 5
    links = np.zeros((robots, robots), dtype=bool)
    for i in range(robots - 1):
        links[i, i + 1] = links[i + 1, i] = True
    gained = np.zeros((robots, 1, 2, 2))
    gained[0, 0, 0, 0] = gained[-1, 0, 1, 1] = 1.0
    eye, zero = np.eye(2)[None], np.zeros((1, 2, 2))
    team = np.repeat(eye[None], robots, axis=0)
    largest = [1.0]
    for _ in range(4):
        for _ in range(50):
            team = team_step_blocks(team, links, gained, eye, zero)
        largest.append(np.linalg.eigvalsh(team).max())
    assert (np.diff(largest) < 0.0).all()
    assert largest[-1] < 0.02


def error_covariances(robots, weights, priors, rows, errors, transition, process):
    """Exact joint covariance of all robots' errors after a step of one target.

    e_i' = A Omega_i^-1 (sum_j w_ij Sigma_j^-1 e_j - W_i' v_i) - w, v_i standard normal.
    """
    size = len(transition)
    inverses = np.linalg.inv(priors)
    gain, noise = np.zeros((robots * size, robots * size)), np.zeros_like(errors)
    for i in range(robots):
        own = slice(i * size, (i + 1) * size)
        gained = rows[i].T @ rows[i]
        after = np.linalg.inv(gained + np.einsum("j,jab->ab", weights[i], inverses))
        gain[own] = (
            transition @ after @ np.hstack([weights[i, j] * inverses[j] for j in range(robots)])
        )
        noise[own, own] = transition @ after @ gained @ after @ transition.T
    return gain @ errors @ gain.T + noise + np.kron(np.ones((robots, robots)), process)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("kappa", [0.5, 0.9])
def test_errors_are_as_large_as_computed_and_covariances_above_them(moving, kappa):
    """Five robots, a random graph: exact error covariances, and Monte Carlo of the means."""
    robots, size, steps, trials = 5, 2, 12, 1500
    generator = np.random.default_rng(11 + moving)
    transition, d, process = draw_dynamics(generator, 1, size, noise=moving)
    if not moving:
        transition, d = np.eye(size)[None], np.zeros((1, size))
    prior = spd(generator, size)
    links = draw_links(generator, robots, 0.5)
    rows = draw_rows(generator, steps, robots, 1, 1, size)

    # One prior mean for all, so errors begin equal. Trials are targets that are not related.
    x = generator.multivariate_normal(np.zeros(size), prior, trials)
    mus = np.zeros((robots, trials, size))
    priors = np.broadcast_to(prior, (robots, trials, size, size))
    errors = np.kron(np.ones((robots, robots)), prior)
    least = np.inf
    for t in range(steps):
        seen = np.repeat(rows[t], trials, axis=1)
        z = np.einsum("rtmn,tn->rtm", seen, x) + generator.standard_normal((robots, trials, 1))
        weights = np.zeros((robots, robots))
        for i in range(robots):
            fused = [i, *np.flatnonzero(links[i])]
            weights[i, fused] = naive_weights(priors[fused, 0], kappa)
        errors = error_covariances(
            robots, weights, priors[:, 0], rows[t, :, 0], errors, transition[0], process[0]
        )
        stacked = (np.repeat(part, trials, axis=0) for part in (transition, d, process))
        mus, priors = team_step_means_blocks(mus, priors, links, seen, z, *stacked, kappa)
        noise = generator.multivariate_normal(np.zeros(size), process[0], trials)
        x = x @ transition[0].T + d[0] + noise
        for i in range(robots):
            own = slice(i * size, (i + 1) * size)
            covariance, exact = priors[i, 0], errors[own, own]
            assert smallest_difference(covariance, exact) > -1e-9
            least = min(least, np.trace(np.linalg.solve(covariance, exact)))
            wrong = mus[i] - x
            nees = np.einsum("ta,ab,tb->t", wrong, np.linalg.inv(covariance), wrong)
            spread = nees.std() / np.sqrt(trials)
            # 60 averages a run: five standard errors, 1 in 30 000.
            assert abs(nees.mean() - np.trace(np.linalg.solve(covariance, exact))) < 5.0 * spread
            assert nees.mean() < size + 5.0 * spread
    assert least < 0.9 * size  # the graph did fuse: conservative, not equal
