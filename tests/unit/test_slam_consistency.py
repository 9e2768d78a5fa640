import gtsam
import numpy as np
import pytest

from fgplan.errors import InvalidInputError
from fgplan.models.pose import compose
from fgplan.simulation.noise import exponential
from fgplan.slam.consistency import (
    chi_square_interval,
    logarithm,
    normalised_error_squared,
    pose_error,
)

TWISTS = [
    np.zeros(3),
    np.array([1.0, -2.0, 1e-12]),
    np.array([1.0, -2.0, 3.1]),
    np.zeros(6),
    np.array([1e-10, -2e-10, 1e-10, 1.0, 2.0, 3.0]),
    np.array([5e-5, -2e-5, 1e-5, 1.0, 2.0, 3.0]),
    np.array([0.3, -0.2, 0.7, 1.0, 2.0, 3.0]),
    np.array([3.1, 0.1, 0.2, 1.0, 2.0, 3.0]),
    np.array([0.0, 3.14159, 0.0, 1.0, 2.0, 3.0]),
    np.array([0.0, 0.0, -3.1415, 1.0, 2.0, 3.0]),
]


@pytest.mark.parametrize("twist", TWISTS, ids=str)
def test_logarithm_undoes_the_exponential(twist):
    np.testing.assert_allclose(logarithm(exponential(twist)), twist, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("twist", TWISTS, ids=str)
def test_pose_error_is_the_tangent_from_estimate_to_truth(twist):
    estimate = exponential(0.5 * np.roll(TWISTS[2] if twist.size == 3 else TWISTS[6], 1))
    truth = compose(estimate, exponential(twist))
    np.testing.assert_allclose(pose_error(estimate, truth), twist, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("twist", [TWISTS[2], TWISTS[6], TWISTS[7]], ids=str)
def test_pose_error_is_gtsams_local_coordinates(twist):
    estimate = exponential(0.3 * twist)
    truth = exponential(-0.4 * twist[::-1])
    pose = (lambda array: gtsam.Pose2(*array)) if twist.size == 3 else gtsam.Pose3
    expected = pose(estimate).logmap(pose(truth))
    np.testing.assert_allclose(pose_error(estimate, truth), expected, rtol=1e-9, atol=1e-12)


def test_normalised_error_squared_counts_sigmas():
    # two sigmas along x, one of the heading: 4 + 1
    covariance = np.diag([0.25, 0.25, 0.01])
    truth = exponential(np.array([0.0, 0.0, 0.1]))
    truth[:2] += 0.0
    estimate = np.zeros(3)
    assert normalised_error_squared(estimate, truth, covariance) == pytest.approx(1.0, rel=1e-12)
    assert normalised_error_squared(estimate, [1.0, 0.0, 0.0], covariance) == pytest.approx(4.0)
    assert normalised_error_squared(list(estimate), truth, covariance) == pytest.approx(1.0)


def test_normalised_error_squared_keeps_digits_beside_a_tight_prior():
    covariance = np.diag([1e-12, 400.0, 1e-12])
    found = normalised_error_squared(np.zeros(3), np.array([2e-6, 20.0, 0.0]), covariance)
    assert found == pytest.approx(5.0, rel=1e-9)


def test_interval_holds_the_share():
    # Tables: chi-square of 1 degree, 2.5 % and 97.5 %.
    low, high = chi_square_interval(1)
    assert (low, high) == (pytest.approx(0.000982069, rel=1e-5), pytest.approx(5.0238862, rel=1e-7))
    low, high = chi_square_interval(600, 0.9)
    draws = np.random.default_rng(0).chisquare(600, 20_000)
    assert ((low < draws) & (draws < high)).mean() == pytest.approx(0.9, abs=0.01)


def test_bad_input_is_refused():
    with pytest.raises(InvalidInputError, match=r"truth: expected a pose of shape \(3,\)"):
        pose_error(np.zeros(3), np.eye(4))
    with pytest.raises(InvalidInputError, match="estimate: expected finite"):
        pose_error(np.array([np.nan, 0, 0]), np.zeros(3))
    with pytest.raises(InvalidInputError, match="covariance of the estimate"):
        normalised_error_squared(np.zeros(3), np.zeros(3), np.zeros((3, 3)))
    with pytest.raises(InvalidInputError, match="degrees: expected 1 or more"):
        chi_square_interval(0)
    with pytest.raises(InvalidInputError, match="share: expected between 0 and 1"):
        chi_square_interval(3, 95.0)
