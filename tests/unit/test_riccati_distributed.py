"""Distributed Kalman filter by hand: weights, special cases, and what is refused."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from fgplan.errors import InvalidInputError
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
from fgplan.riccati.gaussian import predict, update

ONE = np.eye(1)[None]
"""A stack of one target with one coordinate."""


def spd(generator, *shape):
    roots = generator.standard_normal((*shape, shape[-1]))
    return roots @ np.swapaxes(roots, -1, -2) + 0.3 * np.eye(shape[-1])


def dynamics(generator, targets, size):
    """A, d and Q of independent targets."""
    return (
        np.eye(size) + 0.2 * generator.standard_normal((targets, size, size)),
        generator.standard_normal((targets, size)),
        0.1 * spd(generator, targets, size),
    )


def test_weights_by_hand():
    np.testing.assert_allclose(fusion_weights([0.0, 1.0, 2.0]), [0.9, 0.05, 0.05], rtol=1e-15)
    np.testing.assert_allclose(fusion_weights([2.0, -1.0, 1.0], 0.7), [0.15, 0.7, 0.15], rtol=1e-15)
    np.testing.assert_allclose(fusion_weights([1.0, 0.0]), [0.1, 0.9], rtol=1e-15)
    np.testing.assert_array_equal(fusion_weights([5.0]), [1.0])
    np.testing.assert_array_equal(fusion_weights(np.zeros((4, 1)), 0.5), np.ones((4, 1)))


def test_ties_go_to_the_robot_itself_then_to_the_first():
    assert fusion_weights([1.0, 1.0, 1.0])[0] == 0.9
    assert fusion_weights([2.0, 1.0, 1.0])[1] == 0.9
    assert fusion_weights([1.0, 2.0, 1.0])[0] == 0.9


def test_every_target_has_its_own_most_certain_robot():
    weights = fusion_weights([[0.0, 1.0, 2.0], [3.0, 2.0, 1.0]], 0.8)
    np.testing.assert_allclose(weights, [[0.8, 0.1, 0.1], [0.1, 0.1, 0.8]], rtol=1e-15)


@pytest.mark.parametrize("kappa", [0.49, 1.0, 0.0, -1.0, np.nan, np.inf, "much", None])
def test_kappa_out_of_range_is_refused(kappa):
    with pytest.raises(InvalidInputError, match="fusion weight kappa: expected"):
        fusion_weights([0.0, 1.0], kappa)


@pytest.mark.parametrize("given", [[0.0, np.nan], [np.inf, 0.0], [], 0.0, np.zeros((2, 0))])
def test_log_determinants_that_are_none_are_refused(given):
    with pytest.raises(InvalidInputError, match="log determinants: expected finite numbers"):
        fusion_weights(given)


def test_two_robots_and_one_coordinate_by_hand():
    """Variances 4 and 1, J = 0.5: Omega = 0.1 / 4 + 0.9 / 1 + 0.5; A = 2, Q = 3."""
    priors = np.array([4.0, 1.0]).reshape(2, 1, 1, 1)
    after = fuse_blocks(priors, 0.5 * ONE, 2.0 * ONE, 3.0 * ONE)
    np.testing.assert_allclose(after, [[[4.0 / 1.425 + 3.0]]], rtol=1e-14)
    mus = np.array([10.0, 20.0]).reshape(2, 1, 1)
    rows, z = np.sqrt(0.5) * ONE, np.sqrt(0.5) * np.array([[14.0]])
    mu, covariance = fuse_means_blocks(
        mus, priors, rows, z, 2.0 * ONE, np.array([[-1.0]]), 3.0 * ONE
    )
    np.testing.assert_allclose(covariance, after, rtol=1e-14)
    middle = (0.1 / 4.0 * 10.0 + 0.9 * 20.0 + 0.5 * 14.0) / 1.425
    np.testing.assert_allclose(mu, [[2.0 * middle - 1.0]], rtol=1e-14)


@pytest.mark.parametrize("kappa", [0.5, 0.9, 0.99])
@pytest.mark.parametrize("robots", [1, 4])
def test_alone_or_with_equal_priors_it_is_the_plain_filter(robots, kappa):
    generator = np.random.default_rng(robots)
    transition, d, process = dynamics(generator, 3, 2)
    covariance, mu = spd(generator, 3, 2), generator.standard_normal((3, 2))
    rows = generator.standard_normal((3, 2, 2))
    rows[1] = 0.0  # not seen
    z = generator.standard_normal((3, 2))
    priors = np.repeat(covariance[None], robots, axis=0)
    gained = np.swapaxes(rows, -1, -2) @ rows
    plain = riccati_map_blocks(covariance, gained, transition, process)
    np.testing.assert_allclose(
        fuse_blocks(priors, gained, transition, process, kappa), plain, rtol=1e-12
    )
    means, covariances = fuse_means_blocks(
        np.repeat(mu[None], robots, axis=0), priors, rows, z, transition, d, process, kappa
    )
    np.testing.assert_allclose(covariances, plain, rtol=1e-12)
    for k in range(3):
        after = update(mu[k], covariance[k], rows[k], np.eye(2), z[k] - rows[k] @ mu[k])
        expected, _ = predict(*after, transition[k], d[k], process[k])
        np.testing.assert_allclose(means[k], expected, rtol=1e-12, atol=1e-13)


def test_a_robot_without_links_in_a_team_is_alone():
    generator = np.random.default_rng(4)
    transition, d, process = dynamics(generator, 2, 2)
    priors = spd(generator, 3, 2, 2)
    rows = generator.standard_normal((3, 2, 1, 2))
    gained = np.swapaxes(rows, -1, -2) @ rows
    links = np.zeros((3, 3), dtype=bool)
    links[0, 2] = links[2, 0] = True
    after = team_step_blocks(priors, links, gained, transition, process)
    np.testing.assert_allclose(
        after[1], riccati_map_blocks(priors[1], gained[1], transition, process), rtol=1e-12
    )
    np.testing.assert_array_equal(
        after[0], fuse_blocks(priors[[0, 2]], gained[0], transition, process)
    )
    np.testing.assert_array_equal(
        after[2], fuse_blocks(priors[[2, 0]], gained[2], transition, process)
    )
    mus, z = generator.standard_normal((3, 2, 2)), generator.standard_normal((3, 2, 1))
    means, covariances = team_step_means_blocks(mus, priors, links, rows, z, transition, d, process)
    np.testing.assert_allclose(covariances, after, rtol=1e-13)
    own, _ = fuse_means_blocks(mus[[2, 0]], priors[[2, 0]], rows[2], z[2], transition, d, process)
    np.testing.assert_array_equal(means[2], own)


def test_ratios_keep_what_inverses_of_tiny_covariances_lose():
    """Variances of 1e-9 and 1: a needle in any direction, equal in both robots, one step."""
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance = turn @ np.diag([1e-9, 1.0]) @ turn.T
    priors = np.repeat(0.5 * (covariance + covariance.T)[None, None], 2, axis=0)
    eye, zero = np.eye(2)[None], np.zeros((1, 2, 2))
    # Rounding of Sigma itself moves the small variance by 1e-16 / 1e-9.
    after = fuse_blocks(priors, zero, eye, zero)[0]
    np.testing.assert_allclose(after, priors[0, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.eigvalsh(after)[0], 1e-9, rtol=1e-6)
    mus = np.array([[[1e6, 1e6]], [[1e6, 1e6]]])
    nothing = (np.zeros((1, 0, 2)), np.zeros((1, 0)))
    means, _ = fuse_means_blocks(mus, priors, *nothing, eye, np.zeros((1, 2)), zero)
    np.testing.assert_array_equal(means, mus[0])  # no digit lost


def bad_prior(value):
    priors = np.repeat(np.eye(2)[None, None], 3, axis=0).repeat(2, axis=1)
    priors[2, 1] = value
    return priors


@pytest.mark.parametrize(
    "value", [np.diag([1.0, 0.0]), np.diag([1.0, -1.0]), np.full((2, 2), np.nan), np.inf]
)
def test_prior_that_is_no_covariance_is_named_by_robot_and_target(value):
    priors = bad_prior(value)
    gained = transition = process = np.zeros((2, 2, 2))
    with pytest.raises(InvalidInputError, match="covariance of robot 2, target 1: expected a pos"):
        fuse_blocks(priors, gained, transition, process)
    names = ("ann", "bob", "carl")
    for call in (
        lambda: fuse_blocks(priors, gained, transition, process, robots=names),
        lambda: team_step_blocks(
            priors, ~np.eye(3, dtype=bool), np.array([gained] * 3), transition, process, 0.9, names
        ),
        lambda: fuse_means_blocks(
            np.zeros((3, 2, 2)),
            priors,
            np.zeros((2, 1, 2)),
            np.zeros((2, 1)),
            transition,
            transition[0],
            process,
            0.9,
            names,
        ),
    ):
        with pytest.raises(InvalidInputError, match="robot 'carl', target 1"):
            call()
    with pytest.raises(InvalidInputError, match="robot 'carl', target 0"):
        fuse_dense(priors[:, 1], gained[0], transition[0], process[0], robots=names)


EYES = np.repeat(np.eye(2)[None, None], 2, axis=0)
"""Priors of two robots, one target."""

EYE = np.eye(2)[None]
DENSE = (EYES[:, 0], EYE[0], EYE[0], EYE[0])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: fuse_blocks(EYES[0], EYE, EYE, EYE),
            "prior covariances: expected one a robot and",
        ),
        (lambda: fuse_dense(EYES, *DENSE[1:]), r"or, of a stacked state, \(robots, n, n\), got"),
        (lambda: fuse_dense(EYES[0, 0], *DENSE[1:]), "prior covariances: expected one a robot"),
        (lambda: fuse_dense(1.0, *DENSE[1:]), "prior covariances: expected one a robot"),
        (lambda: fuse_blocks(np.zeros((0, 1, 2, 2)), EYE, EYE, EYE), "prior covariances: expected"),
        (
            lambda: fuse_blocks(EYES, EYE, EYE, EYE, robots=("ann",)),
            "robots: expected 2 names, one",
        ),
        (lambda: fuse_blocks(EYES, EYE[0], EYE, EYE), "information J .* expected shape"),
        (lambda: fuse_blocks(EYES, EYE, np.nan * EYE, EYE), "transitions A: expected finite"),
        (lambda: fuse_blocks(EYES, EYE, EYE, EYE[0]), "process noises Q: expected shape"),
        (
            lambda: fuse_blocks(EYES, -9.0 * EYE, EYE, EYE),
            "expected positive semidefinite matrices",
        ),
        (lambda: fuse_dense(*DENSE, parts=[slice(0, 1)]), r"parts: expected slices .* 0\.\.1 in"),
        (lambda: fuse_dense(*DENSE, parts=[]), "parts: expected slices"),
        (lambda: fuse_dense(*DENSE, parts=[slice(1, 2), slice(0, 1)]), "parts: expected slices"),
        (lambda: fuse_dense(*DENSE, parts=[slice(0, 2), slice(2, 4)]), "parts: expected slices"),
        (
            lambda: fuse_dense(
                EYES[:, 0] + [np.zeros((2, 2)), np.full((2, 2), 0.1)],
                *DENSE[1:],
                parts=[slice(0, 1), slice(1, 2)],
                robots=("ann", "bob"),
            ),
            "robot 'bob': expected no covariance between the parts, got 0.1 between .* 0 and 1",
        ),
    ],
)
def test_arguments_that_do_not_fit_are_refused_by_name(call, words):
    with pytest.raises(InvalidInputError, match=words):
        call()


@pytest.mark.parametrize(
    ("links", "words"),
    [
        (np.ones((2, 2), dtype=bool), "no link of a robot to itself, got one of robot 0"),
        (np.zeros((2, 2)), r"adjacency: expected booleans of shape \(2, 2\), .* got float64"),
        (np.zeros((3, 3), dtype=bool), r"got bool of shape \(3, 3\)"),
    ],
)
def test_adjacency_that_is_none_is_refused(links, words):
    with pytest.raises(InvalidInputError, match=words):
        team_step_blocks(EYES, links, EYES, EYE, EYE)
    nothing = (np.zeros((2, 1, 1, 2)), np.zeros((2, 1, 1)))
    with pytest.raises(InvalidInputError, match=words):
        team_step_means_blocks(np.zeros((2, 1, 2)), EYES, links, *nothing, EYE, EYE[0, :1], EYE)


def test_measurements_of_another_shape_are_refused():
    mus, d = np.zeros((2, 1, 2)), np.zeros((1, 2))
    with pytest.raises(InvalidInputError, match=r"whitened rows W: expected shape \(1, any, 2\)"):
        fuse_means_blocks(mus, EYES, np.zeros((2, 1, 2)), np.zeros((2, 1)), EYE, d, EYE)
    with pytest.raises(
        InvalidInputError, match=r"whitened measurements z: expected shape \(1, 3\)"
    ):
        fuse_means_blocks(mus, EYES, np.zeros((1, 3, 2)), np.zeros((1, 1)), EYE, d, EYE)
    with pytest.raises(InvalidInputError, match=r"prior means: expected shape \(2, 2\)"):
        fuse_means_dense(
            np.zeros(2), EYES[:, 0], np.zeros((1, 2)), np.zeros(1), EYE[0], d[0], EYE[0]
        )


def test_results_are_exactly_symmetric():
    generator = np.random.default_rng(9)
    transition, _, process = dynamics(generator, 4, 3)
    after = fuse_blocks(spd(generator, 5, 4, 3), spd(generator, 4, 3), transition, process)
    np.testing.assert_array_equal(after, np.swapaxes(after, -1, -2))
    dense = fuse_dense(
        spd(generator, 3, 6),
        spd(generator, 6),
        block_diag(transition[0], transition[1]),
        block_diag(process[0], process[1]),
    )
    np.testing.assert_array_equal(dense, dense.T)
