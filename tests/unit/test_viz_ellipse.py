"""Ellipses hold what they say they hold, in the frame they say."""

import gtsam
import numpy as np
import pytest

from fgplan.errors import InvalidInputError
from fgplan.simulation.noise import exponential
from fgplan.viz.ellipse import (
    coverage,
    ellipse_outlines,
    magnification_to_see,
    world_position_covariances,
)


def random_covariance(generator, size):
    root = generator.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def test_planar_covariances_turn_into_the_world_frame():
    generator = np.random.default_rng(0)
    poses = generator.uniform(-3, 3, (5, 3))
    full = np.array([random_covariance(generator, 3) for _ in poses])
    world = world_position_covariances(poses, full)
    for pose, covariance, found in zip(poses, full, world, strict=True):
        turn = gtsam.Rot2(pose[2]).matrix()
        np.testing.assert_allclose(found, turn @ covariance[:2, :2] @ turn.T, rtol=1e-12)
    np.testing.assert_array_equal(world_position_covariances(poses, full[:, :2, :2]), world)


def test_spatial_covariances_are_seen_from_above():
    generator = np.random.default_rng(0)
    poses = np.array([exponential(generator.uniform(-1, 1, 6)) for _ in range(4)])
    full = np.array([random_covariance(generator, 6) for _ in poses])
    world = world_position_covariances(poses, full)
    for pose, covariance, found in zip(poses, full, world, strict=True):
        expected = pose[:3, :3] @ covariance[3:, 3:] @ pose[:3, :3].T
        np.testing.assert_allclose(found, expected[:2, :2], rtol=1e-12)
    np.testing.assert_array_equal(world_position_covariances(poses, full[:, 3:, 3:]), world)


def test_outlines_are_at_k_sigmas():
    generator = np.random.default_rng(1)
    covariances = np.array([random_covariance(generator, 2) for _ in range(3)])
    centers = generator.normal(size=(3, 2))
    outlines = ellipse_outlines(centers, covariances, 2.5)
    for center, covariance, outline in zip(centers, covariances, outlines, strict=True):
        offset = outline - center
        distance = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset)
        np.testing.assert_allclose(distance, 2.5**2, rtol=1e-9)
    np.testing.assert_array_equal(
        ellipse_outlines([[1.0, 2.0]], np.zeros((1, 2, 2)), 3.0), [np.tile([1.0, 2.0], (48, 1))]
    )


def test_coverage_is_that_of_samples():
    inside = np.linalg.norm(np.random.default_rng(0).normal(size=(100_000, 2)), axis=1) < 3.0
    # The standard error of the share is 0.0003.
    assert coverage(3.0) == pytest.approx(inside.mean(), abs=1.5e-3)
    assert coverage(3.0) == pytest.approx(1.0 - np.exp(-4.5), rel=1e-12)


def test_magnification():
    covariances = np.array([np.diag([1.0, 4.0]), np.eye(2)])
    assert magnification_to_see(covariances, 3.0, 100.0) == 1
    assert magnification_to_see(covariances, 3.0, 2500.0) == 10
    assert magnification_to_see(covariances, 3.0, 2500.0, share=0.012) == 5
    assert magnification_to_see(np.zeros((1, 2, 2)), 3.0, 100.0) == 1000


def test_bad_input():
    with pytest.raises(InvalidInputError, match="poses of shape"):
        world_position_covariances(np.zeros((2, 2)), np.zeros((2, 2, 2)))
    with pytest.raises(InvalidInputError, match="covariances of positions"):
        world_position_covariances(np.zeros((2, 3)), np.zeros((3, 2, 2)))
    with pytest.raises(InvalidInputError, match="negative eigenvalue, got -1 at 1"):
        ellipse_outlines(np.zeros((2, 2)), [np.eye(2), np.diag([1.0, -1.0])], 3.0)
