"""Blocks of motions and relative poses in space, all at once, against one at a time."""

import numpy as np
import pytest

from fgplan.evaluation.incremental.spatial_blocks import (
    spatial_motion_blocks,
    spatial_pairs,
    spatial_relative_blocks,
)
from fgplan.models.pose import adjoint, between
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.simulation.noise import exponential

GENERATOR = np.random.default_rng(5)


def draw_poses(count):
    return np.array([exponential(GENERATOR.normal(size=6)) for _ in range(count)])


def draw_covariance():
    half = GENERATOR.normal(size=(6, 6))
    return half @ half.T + np.eye(6)


@pytest.mark.parametrize("each_once", [False, True])
def test_relative_poses_equal_the_sensors_jacobians(each_once):
    own, other = draw_poses(9), draw_poses(7)
    own_place, other_place = np.array([1] * 9), np.array([0, 0, 1, 1, 2, 2, 2])
    if each_once:
        other, other_place = own, np.arange(9) % 3
        own_place = other_place
    sensor = RelativePoseSensor(covariance=draw_covariance())
    pointer, found = spatial_pairs(own, own_place, other, other_place, 2.5, each_once)
    blocks = spatial_relative_blocks(
        own, other, pointer, found, own_place, other_place, np.linalg.inv(sensor.covariance)
    )
    want = [
        (a, b)
        for a in range(len(own))
        for b in range(len(other))
        if np.linalg.norm(own[a, :3, 3] - other[b, :3, 3]) < 2.5
        and (other_place[b] < own_place[a] if each_once else other_place[b] != own_place[a])
    ]
    assert len(want) > 5
    rows = np.repeat(np.arange(len(own)), np.diff(pointer))
    assert list(zip(rows.tolist(), found.tolist(), strict=True)) == want
    for place, (a, b) in enumerate(want):
        if other_place[b] < own_place[a]:
            by_other, by_own = sensor.linearise_between(other[b], own[a])
        else:
            by_own, by_other = sensor.linearise_between(own[a], other[b])
        for block, exact in zip(
            blocks, (by_own.T @ by_own, by_other.T @ by_own, by_other.T @ by_other), strict=True
        ):
            scale = np.abs(exact).max()
            np.testing.assert_allclose(block[place], exact, rtol=1e-9, atol=1e-12 * scale)


def test_motions_equal_one_at_a_time():
    before, after = draw_poses(6), draw_poses(6)
    noise = np.array([draw_covariance() for _ in before])
    late, cross, early = spatial_motion_blocks(before, after, noise)
    for m in range(len(before)):
        information = np.linalg.inv(noise[m])
        back = adjoint(between(after[m], before[m]))
        np.testing.assert_allclose(late[m], information, rtol=1e-12)
        np.testing.assert_allclose(cross[m], -information @ back, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(early[m], back.T @ information @ back, rtol=1e-9, atol=1e-12)
