"""MR.CLAM folders: reader, odometry's lag, steps; a small folder with a known truth."""

import gzip
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mrclam_folder import BARCODES, LANDMARKS, ORIGIN_S, REMARK, STARTS, VIEW_RAD, write_folder

from fgplan.errors import InvalidInputError, ScenarioError
from fgplan.io.mrclam import read_mrclam
from fgplan.io.mrclam_motion import dead_reckoning, odometry_lag, relative_poses
from fgplan.io.mrclam_slam import mrclam_slam
from fgplan.io.mrclam_steps import (
    CAMERA,
    CAMERA_ROBOT,
    MrclamOptions,
    landmark_key,
    mrclam_steps,
    robot_name,
)
from fgplan.slam.trajectory_error import absolute_trajectory_error

REAL = os.environ.get("FGPLAN_MRCLAM")
needs_real = pytest.mark.skipif(not REAL, reason="FGPLAN_MRCLAM names no folder")
NO_LAG = MrclamOptions(lags_s=dict.fromkeys(STARTS, 0.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("mrclam") / "exact"
    return path, write_folder(path)


@pytest.fixture(scope="module")
def log(folder):
    return read_mrclam(folder[0])


def edited(tmp_path, name, change):
    """A folder in which one file's text is changed."""
    write_folder(tmp_path, seconds=4.0)
    path = tmp_path / name
    path.write_text(change(path.read_text()))
    return path


def test_reader_returns_what_was_written(folder, log):
    _, world = folder
    assert [robot.subject for robot in log.robots] == list(STARTS)
    assert log.origin_s == ORIGIN_S
    assert log.barcodes == {code: subject for subject, code in BARCODES.items()}
    assert {s: tuple(where) for s, where in log.landmarks.items()} == LANDMARKS
    robot = log.robot(2)
    np.testing.assert_allclose(robot.truth[:, 0], world.times, atol=1e-6)
    np.testing.assert_allclose(robot.truth[:, 1:], world.poses[2], atol=1e-8)
    assert set(robot.measured.tolist()) <= {*LANDMARKS, 1, 3}
    assert robot.own_barcode == 0
    assert robot.unknown_barcodes == {}
    assert (np.abs(robot.bearings_rad) < VIEW_RAD).all()
    with pytest.raises(ValueError, match="read-only"):
        robot.truth[0, 0] = 1.0


def test_heading_is_unwrapped(tmp_path):
    write_folder(tmp_path, seconds=4.0)
    path = tmp_path / "Robot1_Groundtruth.dat"
    path.write_text(f"{ORIGIN_S:.3f} 0 0 3.1\n{ORIGIN_S + 1:.3f} 0 0 -3.1\n")
    poses = read_mrclam(tmp_path).robot(1).true_poses(np.array([0.5, 2.0]))
    np.testing.assert_allclose(poses[0], [0.0, 0.0, np.pi], atol=1e-12)
    assert np.isnan(poses[1]).all()


def test_compressed_files_are_the_same(folder, log, tmp_path):
    write_folder(tmp_path, compressed=True)
    packed = read_mrclam(tmp_path)
    np.testing.assert_array_equal(packed.robot(1).ranges_m, log.robot(1).ranges_m)


def test_unknown_and_own_barcodes_are_counted(tmp_path):
    write_folder(tmp_path, seconds=6.0)
    whole = read_mrclam(tmp_path)
    path = tmp_path / "Robot1_Measurement.dat"
    last = f"{ORIGIN_S + 6.0:.3f}"
    extra = f"{last} 99 1.0 0.1\n{last} 99 1.0 0.1\n{last} 98 1.0 0.1\n{last} {BARCODES[1]} 1 0\n"
    path.write_text(path.read_text() + extra)
    robot = read_mrclam(tmp_path).robot(1)
    assert robot.unknown_barcodes == {98: 1, 99: 2}
    assert robot.own_barcode == 1
    np.testing.assert_array_equal(robot.ranges_m, whole.robot(1).ranges_m)
    steps = mrclam_steps(read_mrclam(tmp_path), NO_LAG)
    assert (steps.counts["unknown_barcode"], steps.counts["own_barcode"]) == (3, 1)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("Robot2_Odometry.dat", lambda t: t + "1 2\n", r"Robot2_Odometry.dat:\d+: expected 3 fini"),
        ("Robot2_Odometry.dat", lambda t: t + "9e9 x 1\n", "3 finite numbers, got '9e9 x 1'"),
        ("Robot1_Groundtruth.dat", lambda t: t + "9e9 nan 0 0\n", "4 finite numbers"),
        ("Robot1_Groundtruth.dat", lambda t: t + "1 0 0 0\n", "never run backwards"),
        ("Robot3_Measurement.dat", lambda t: t + "9e9 6.5 1 0\n", "barcode, a whole number"),
        ("Robot3_Measurement.dat", lambda t: t + "9e9 63 -1 0\n", "range above zero"),
        ("Robot3_Measurement.dat", lambda t: t + "9e9 63 1 4\n", "bearing within pi"),
        ("Robot1_Odometry.dat", lambda t: REMARK, "at least one line of numbers"),
        ("Barcodes.dat", lambda t: t + "1 77\n", "Barcodes.dat:11: subject 1 is there a second"),
        ("Barcodes.dat", lambda t: t + "21 5\n", "barcode 5 is there a second time"),
        ("Barcodes.dat", lambda t: t.replace("  3 \t 41", "  4 \t 41"), "none of robot 3"),
        ("Barcodes.dat", lambda t: t + "21 77\n", "subject 21 is missing"),
        ("Landmark_Groundtruth.dat", lambda t: t + "30 0 0 0 0\n", "got subject 30"),
        ("Landmark_Groundtruth.dat", lambda t: t + "2 0 0 0 0\n", "got subject 2"),
    ],
)
def test_malformed_files_are_named_with_their_line(tmp_path, name, change, words):
    edited(tmp_path, name, change)
    with pytest.raises(ScenarioError, match=words) as caught:
        read_mrclam(tmp_path)
    assert name in str(caught.value)


def test_missing_and_doubled_files_are_named(tmp_path):
    with pytest.raises(ScenarioError, match=r"asrl.utias.utoronto.ca"):
        read_mrclam(tmp_path / "nothing")
    with pytest.raises(ScenarioError, match=r"Robot1_Odometry.dat and so on, got none"):
        read_mrclam(tmp_path)
    write_folder(tmp_path, seconds=4.0)
    path = tmp_path / "Robot2_Measurement.dat"
    content = path.read_bytes()
    packed = tmp_path / "Robot2_Measurement.dat.gz"
    packed.write_bytes(gzip.compress(content))
    with pytest.raises(ScenarioError, match="there twice"):
        read_mrclam(tmp_path)
    path.unlink()
    packed.write_bytes(gzip.compress(content)[:-20])
    with pytest.raises(ScenarioError, match=r"Measurement.dat.gz: expected a readable"):
        read_mrclam(tmp_path)
    packed.unlink()
    with pytest.raises(ScenarioError, match=r"Robot2_Measurement.dat \(or .*missing"):
        read_mrclam(tmp_path)


def test_robot_is_checked(log):
    with pytest.raises(InvalidInputError, match="one of 1, 2, 3, got 7"):
        log.robot(7)
    robot = log.robot(1)
    with pytest.raises(InvalidInputError, match="one subject a measurement"):
        replace(robot, measured=robot.measured[1:])
    with pytest.raises(InvalidInputError, match="truth: expected times"):
        replace(robot, truth=robot.truth[::-1])
    with pytest.raises(InvalidInputError, match="ranges_m: expected shape"):
        replace(robot, ranges_m=robot.ranges_m[1:])


def test_dead_reckoning_of_exact_odometry_is_the_truth(folder, log):
    _, world = folder
    motion = dead_reckoning(log.robot(1))
    moved = motion.at(world.times)
    expected = relative_poses(np.repeat(world.poses[1][:1], len(world.times), 0), world.poses[1])
    np.testing.assert_allclose(
        moved[:, :3], expected, atol=1e-5
    )  # arc by chord of 20 ms, stamps in ms
    steps = np.diff(world.poses[1], axis=0)
    np.testing.assert_allclose(moved[-1, 3], np.linalg.norm(steps[:, :2], axis=1).sum(), rtol=1e-9)
    np.testing.assert_allclose(moved[-1, 4], np.abs(steps[:, 2]).sum(), rtol=1e-9)


@pytest.mark.parametrize("lag_s", [0.0, 0.2, 0.3])
def test_lag_is_found_from_the_robots_own_sightings(tmp_path, lag_s):
    write_folder(tmp_path, lag_s=lag_s)
    robot = read_mrclam(tmp_path).robot(1)
    found, pairs = odometry_lag(robot, frozenset(LANDMARKS))
    assert found == pytest.approx(lag_s, abs=0.026)  # its grid is 0.025 s
    assert pairs >= 50
    few = odometry_lag(robot, frozenset({6}))
    assert few[1] < 50
    assert few[0] == 0.0


def test_measurements_are_carried_to_the_nearest_tick(folder, log):
    _, world = folder
    steps = mrclam_steps(log, NO_LAG)
    origin = steps.times_s
    np.testing.assert_allclose(np.diff(origin), 1.0)
    count = 0
    for tick, of_tick in enumerate(steps.measurements):
        poses = {s: world.at(s, origin[tick : tick + 1])[0] for s in STARTS}
        for one in of_tick:
            if one.sensor != CAMERA:
                continue
            subject = next(s for s in LANDMARKS if landmark_key(s) == one.target)
            pose = poses[int(one.robot.removeprefix("robot"))]
            offset = np.array(LANDMARKS[subject]) - pose[:2]
            angle = np.arctan2(offset[1], offset[0]) - pose[2]
            wrong = np.array([angle, np.hypot(*offset)]) - one.value
            wrong[0] = np.arctan2(np.sin(wrong[0]), np.cos(wrong[0]))
            # carried along arcs that the file's rounded velocities and stamps give
            np.testing.assert_allclose(wrong, 0.0, atol=1e-5)
            count += 1
    assert count == steps.counts["used_landmark"] > 500


def test_noise_of_a_moving_target_grows_with_its_way(log):
    steps = mrclam_steps(log, NO_LAG)
    camera = NO_LAG.camera
    of_robots = [m for tick in steps.measurements for m in tick if m.sensor == CAMERA_ROBOT]
    assert len(of_robots) == steps.counts["used_robot"] > 50
    for one in of_robots:
        bearing, distance = one.value
        plain = (camera.range_sigma_m + camera.range_sigma_per_metre * distance) ** 2
        added = one.covariance[1, 1] - plain
        # Half a second at 0.08 m/s, both ways.
        assert -1e-12 <= added <= 0.5 * 0.0401**2
        across = one.covariance[0, 0] - camera.bearing_sigma_rad**2
        assert across == pytest.approx(added / distance**2, abs=1e-12)
        assert np.isfinite(bearing)
    assert max(m.covariance[0, 0] for m in of_robots) > camera.bearing_sigma_rad**2


def test_odometry_of_steps_leads_along_the_truth(folder, log):
    _, world = folder
    steps = mrclam_steps(log, NO_LAG)
    assert steps.robots == tuple(robot_name(subject) for subject in STARTS)
    assert len(steps.odometry) == len(steps.times_s) - 1
    for place, (subject, name) in enumerate(zip(STARTS, steps.robots, strict=True)):
        truth = world.at(subject, steps.times_s)
        np.testing.assert_allclose(steps.truth[name], truth, atol=1e-7)
        # 3e-6 after the whole way: the file has rounded velocities and stamps
        np.testing.assert_allclose(steps.by_odometry[name], truth, atol=1e-5)
        np.testing.assert_array_equal(steps.starts[name], steps.truth[name][0])
        moves = np.array([of_step[place].relative for of_step in steps.odometry])
        np.testing.assert_allclose(moves, relative_poses(truth[:-1], truth[1:]), atol=1e-5)
        assert all(of_step[place].robot == name for of_step in steps.odometry)
    # At rest in the first second: the base noise alone.
    np.testing.assert_allclose(
        steps.odometry[0][0].covariance, np.diag(NO_LAG.motion.sigmas**2), rtol=1e-9
    )


def test_steps_end_where_they_are_told_to_and_count_what_is_outside(log):
    whole, short = mrclam_steps(log, NO_LAG), mrclam_steps(log, NO_LAG, until_s=10.0)
    assert len(short.times_s) == 11
    for counts in (whole.counts, short.counts):
        total = counts["used_landmark"] + counts["used_robot"] + counts["outside"]
        assert total == sum(len(robot.measured) for robot in log.robots)
    assert short.counts["outside"] > whole.counts["outside"]
    with pytest.raises(ScenarioError, match="odometry of all robots for 1 s or more"):
        mrclam_steps(log, NO_LAG, until_s=0.5)


def test_options_and_missing_truth_are_refused(tmp_path, log):
    with pytest.raises(InvalidInputError, match="interval_s"):
        MrclamOptions(interval_s=0.0)
    with pytest.raises(InvalidInputError, match="start_sigmas"):
        MrclamOptions(start_sigmas=(1e-3, 0.0, 1e-3))
    with pytest.raises(InvalidInputError, match="not of 2"):
        mrclam_steps(log, MrclamOptions(lags_s={1: 0.0, 3: 0.0}))
    late = f"{ORIGIN_S + 2.0:.3f} 0 0 0\n{ORIGIN_S + 4.0:.3f} 0 0 0\n"
    edited(tmp_path, "Robot2_Groundtruth.dat", lambda t: REMARK + late)
    with pytest.raises(ScenarioError, match="robot2: expected a true pose when the odometry"):
        mrclam_steps(read_mrclam(tmp_path), NO_LAG)


def test_slam_of_a_noisy_log_is_much_better_than_odometry(tmp_path):
    write_folder(tmp_path, seconds=80.0, lag_s=0.25, noise=np.random.default_rng(7))
    steps = mrclam_steps(read_mrclam(tmp_path))
    assert all(abs(lag - 0.25) < 0.06 for lag in steps.lags_s.values())
    told = []
    slam = mrclam_slam(steps, progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (len(steps.times_s), len(steps.times_s))
    for robot in steps.robots:
        assert slam.steps(robot) == tuple(range(len(steps.times_s)))
        estimate = absolute_trajectory_error(slam.trajectory(robot), steps.truth[robot])
        odometry = absolute_trajectory_error(steps.by_odometry[robot], steps.truth[robot])
        assert estimate < 0.05
        assert estimate < 0.3 * odometry
    mapped = slam.landmarks()
    for subject, where in LANDMARKS.items():
        if landmark_key(subject) in mapped:
            np.testing.assert_allclose(mapped[landmark_key(subject)], where, atol=0.1)
    assert len(mapped) >= 5


@needs_real
def test_real_folder_is_read_in_full():
    log = read_mrclam(Path(str(REAL)))
    assert len(log.robots) == 5
    assert len(log.landmarks) == 15
    steps = mrclam_steps(log, until_s=60.0)
    counts = steps.counts
    total = counts["used_landmark"] + counts["used_robot"] + counts["outside"]
    assert total == sum(len(robot.measured) for robot in log.robots)
    assert all(0.1 < lag < 0.5 for lag in steps.lags_s.values())
