"""TUM trajectories: read back to the last bit, malformed lines named."""

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.io.tum import TumTrajectory, pose_numbers, read_tum, write_tum

GOOD = "# time x y z qx qy qz qw\n0.5 1 2 3 0 0 0 1\n\n1.5 4 5 6 0 0 0.6 0.8\n"


def written(tmp_path, text):
    path = tmp_path / "a.tum"
    path.write_text(text)
    return path


def spatial_poses(seed, count):
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=1).as_matrix()
    poses[0, :3, :3] = np.diag(
        [1.0, -1.0, -1.0]
    )  # half a turn: the real part of its quaternion is 0
    poses[:, :3, 3] = rng.normal(size=(count, 3), scale=100.0)
    return poses


def test_reads_times_positions_and_rotations(tmp_path):
    read = read_tum(written(tmp_path, GOOD))
    np.testing.assert_array_equal(read.times_s, [0.5, 1.5])
    np.testing.assert_array_equal(
        read.poses[0], [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    )
    np.testing.assert_allclose(read.poses[1][:2, :2], [[0.28, -0.96], [0.96, 0.28]], rtol=1e-15)


def test_spatial_poses_come_back(tmp_path):
    times = [1288971842.161, 1288971842.2, 1288971843.0, 1e-9, 7.0]
    poses = spatial_poses(0, 5)
    write_tum(tmp_path / "b.tum", times, poses)
    read = read_tum(tmp_path / "b.tum")
    np.testing.assert_array_equal(read.times_s, times)
    np.testing.assert_array_equal(read.poses[:, :3, 3], poses[:, :3, 3])
    np.testing.assert_allclose(read.poses, poses, atol=1e-14)
    quaternions = np.loadtxt(tmp_path / "b.tum")[:, 4:]
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, rtol=1e-15)
    assert (quaternions[:, 3] >= 0.0).all()
    scipys = Rotation.from_quat(quaternions).as_matrix()  # x y z w, as TUM has it
    np.testing.assert_allclose(scipys, poses[:, :3, :3], atol=1e-14)


def test_planar_poses_are_written_flat(tmp_path):
    poses = np.array([[1.0, 2.0, 0.3], [-1.0, 0.5, -3.0], [0.0, 0.0, 7.0]])
    write_tum(tmp_path / "c.tum", [0.0, 1.0, 2.0], poses)
    read = read_tum(tmp_path / "c.tum")
    np.testing.assert_array_equal(read.poses[:, :2, 3], poses[:, :2])
    assert (read.poses[:, 2, 3] == 0.0).all()
    headings = np.arctan2(read.poses[:, 1, 0], read.poses[:, 0, 0])
    np.testing.assert_allclose(np.exp(1j * headings), np.exp(1j * poses[:, 2]), atol=1e-15)


def test_nearly_unit_quaternions_are_scaled(tmp_path):
    read = read_tum(written(tmp_path, "0 0 0 0 0 0 0.6003 0.8004\n"))
    np.testing.assert_allclose(np.linalg.det(read.poses[0]), 1.0, rtol=1e-14)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1 2 3 4 0 0 1", r"a\.tum:2: pose: expected 8 numbers, t x y z qx qy qz qw, got 7"),
        ("1 2 3 4 0 0 0 1 9", r"a\.tum:2: pose: expected 8 numbers.* got 9"),
        ("1 2 3 four 0 0 0 1", r"a\.tum:2: pose: expected numbers, got 1 2 3 four"),
        ("1 2 3 4_0 0 0 0 1", r"a\.tum:2: pose: expected numbers"),
        ("1 2 3 nan 0 0 0 1", r"a\.tum:2: pose: expected finite numbers"),
        ("1 2 3 4 0 0 0.6 0.81", r"a\.tum:2: pose: expected a unit quaternion .* length 1\.00"),
        ("1 2 3 4 0 0 0 0", r"a\.tum:2: pose: expected a unit quaternion .* got length 0"),
    ],
)
def test_malformed_lines_are_named(tmp_path, line, words):
    with pytest.raises(ScenarioError, match=words):
        read_tum(written(tmp_path, f"0 0 0 0 0 0 0 1\n{line}\n"))


def test_a_file_of_windows_is_read(tmp_path):
    path = tmp_path / "a.tum"
    path.write_bytes(b"\xef\xbb\xbf# a trajectory\r\n1.5 1 2 3 0 0 0 1\r\n")
    assert read_tum(path).times_s.tolist() == [1.5]
    path.write_bytes(b"\xef\xbb\xbf1.5 1 2 3 0 0 0 1\r\n")
    assert read_tum(path).times_s.tolist() == [1.5]


def test_what_is_no_trajectory_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match="expected poses, got none"):
        read_tum(written(tmp_path, "# nothing\n"))
    with pytest.raises(ScenarioError, match="cannot be read"):
        read_tum(tmp_path / "none.tum")
    with pytest.raises(ScenarioError, match="cannot be written"):
        write_tum(tmp_path / "no" / "a.tum", [0.0], [[0.0, 0.0, 0.0]])
    with pytest.raises(
        InvalidInputError, match=r"expected a time a pose.* got 2 times and .*\(1, 3"
    ):
        write_tum(tmp_path / "a.tum", [0.0, 1.0], [[0.0, 0.0, 0.0]])
    for times, poses, words in (
        ([], [], r"at least one, .* got 0 times and poses of shape \(0,\)"),
        ([0.0], 7.0, r"poses of shape \(\)"),
        ([0.0], [[0.0, 0.0, 0.0], [0.0]], "expected poses as numbers"),
        ([0.0], [gtsam.Pose3()], "expected poses as numbers"),
        ([0.0], np.zeros((1, 2)), r"poses of shape \(1, 2\)"),
        ([0.0], [[0.0, np.nan, 0.0]], "finite"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            write_tum(tmp_path / "b.tum", times, poses)
        assert not (tmp_path / "b.tum").exists()
    with pytest.raises(InvalidInputError, match="trajectory pose 0: expected a rigid motion"):
        write_tum(tmp_path / "a.tum", [0.0], [2.0 * np.eye(4)])
    with pytest.raises(InvalidInputError, match="trajectory poses"):
        TumTrajectory(np.zeros(2), np.zeros((1, 4, 4)))


def test_numbers_of_a_planar_pose_are_exact():
    assert pose_numbers(np.array([1.0, 2.0, np.pi / 2])) == [
        1.0,
        2.0,
        0.0,
        0.0,
        0.0,
        np.sin(np.pi / 4),
        np.cos(np.pi / 4),
    ]
