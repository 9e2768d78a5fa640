import numpy as np
import pytest

from fgplan.errors import InvalidInputError
from fgplan.models.pose import compose
from fgplan.simulation.noise import exponential
from fgplan.slam.trajectory_error import absolute_trajectory_error, position_errors


def trajectory(size, count=8, seed=0):
    generator = np.random.default_rng(seed)
    pose, poses = exponential(np.zeros(size)), []
    for _ in range(count):
        pose = compose(pose, exponential(generator.normal(0.3, 0.4, size)))
        poses.append(pose)
    return np.array(poses)


def moved(poses, motion):
    return np.array([compose(motion, pose) for pose in poses])


@pytest.mark.parametrize("size", [3, 6])
@pytest.mark.parametrize("alignment", ["first", "all"])
def test_a_rigid_motion_is_no_error(size, alignment):
    truth = trajectory(size)
    estimate = moved(truth, exponential(np.arange(1.0, size + 1.0) * 0.4))
    assert absolute_trajectory_error(estimate, truth, "none") > 0.5
    assert absolute_trajectory_error(estimate, truth, alignment) < 1e-12


def test_error_is_the_root_mean_square_distance():
    truth = np.zeros((4, 3))
    estimate = np.array([[0, 0, 0], [3, 4, 1], [0, 0, 2], [0, 0, 3]], dtype=float)
    # one of four is 5 m off: sqrt(25 / 4)
    assert absolute_trajectory_error(estimate, truth) == pytest.approx(2.5, rel=1e-12)
    np.testing.assert_allclose(position_errors(estimate, truth), [0, 5, 0, 0], atol=1e-12)


@pytest.mark.parametrize("size", [3, 6])
def test_alignment_of_all_has_the_least_error(size):
    generator = np.random.default_rng(3)
    truth = trajectory(size)
    estimate = np.array(
        [compose(pose, exponential(generator.normal(0, 0.3, size))) for pose in truth]
    )
    least = absolute_trajectory_error(estimate, truth, "all")
    aligned = absolute_trajectory_error(estimate, truth, "first")
    assert least < aligned
    for _ in range(50):
        nudge = exponential(generator.normal(0.0, 0.5, size))
        assert least <= absolute_trajectory_error(moved(estimate, nudge), truth, "none") + 1e-12


def test_alignment_never_mirrors():
    # A mirror image of a planar figure would fit; a turn cannot.
    truth = np.array([[0, 0, 0], [4, 0, 0], [4, 2, 0], [0, 0, 0]], dtype=float)
    estimate = truth * [1.0, -1.0, 1.0]
    assert absolute_trajectory_error(estimate, truth, "all") > 0.5


def test_bad_input_is_refused():
    with pytest.raises(InvalidInputError, match=r"of the truth: expected shape \(n, 3\)"):
        absolute_trajectory_error(np.zeros((2, 3)), np.zeros((2, 2)))
    with pytest.raises(InvalidInputError, match="expected one true pose for each estimate"):
        absolute_trajectory_error(np.zeros((2, 3)), np.zeros((3, 3)))
    with pytest.raises(InvalidInputError, match="alignment: expected 'none'"):
        absolute_trajectory_error(np.zeros((2, 3)), np.zeros((2, 3)), "some")
    with pytest.raises(InvalidInputError, match="trajectory of the estimate: expected finite"):
        absolute_trajectory_error(np.full((2, 3), np.nan), np.zeros((2, 3)))
    with pytest.raises(InvalidInputError, match="trajectory of the estimate"):
        absolute_trajectory_error(np.zeros((0, 3)), np.zeros((0, 3)))
