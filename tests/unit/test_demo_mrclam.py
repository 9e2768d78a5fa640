"""The demo over MR.CLAM: a synthetic folder always, the real one where FGPLAN_MRCLAM names it."""

import argparse
import os
import re
from pathlib import Path

import numpy as np
import pytest
from mrclam_folder import BARCODES, LANDMARKS, ORIGIN_S, STARTS, write_folder

from fgplan.demos.mrclam import add_arguments, mrclam, peak_memory_mb
from fgplan.demos.mrclam_judgement import judge, required_m
from fgplan.demos.mrclam_team import choose_goals
from fgplan.demos.mrclam_truth import log_errors
from fgplan.demos.mrclam_variants import only_robot, run_variants, without_robot_measurements
from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.io.command import CommandOptions
from fgplan.io.mrclam import read_mrclam
from fgplan.io.mrclam_slam import mrclam_slam
from fgplan.io.mrclam_steps import CAMERA_ROBOT, MrclamOptions, mrclam_steps

REAL = os.environ.get("FGPLAN_MRCLAM")
needs_real = pytest.mark.skipif(not REAL, reason="FGPLAN_MRCLAM names no folder")
NO_LAG = MrclamOptions(lags_s=dict.fromkeys(STARTS, 0.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("demo") / "noisy"
    write_folder(path, seconds=60.0, lag_s=0.25, noise=np.random.default_rng(3))
    return path


@pytest.fixture(scope="module")
def outcome(folder, tmp_path_factory):
    arguments = {"data": str(folder), "variants": False}
    out = tmp_path_factory.mktemp("out")
    return mrclam(CommandOptions(name="mrclam", quick=True, arguments=arguments, out=out))


def test_demo_reports_errors_and_plans_exactly(outcome):
    results = outcome.results
    assert [item["robot"] for item in results["robots"]] == ["robot1", "robot2", "robot3"]
    for item in results["robots"]:
        assert item["ate_m"] < 0.1 < item["required_m"]
        assert item["required_m"] == required_m(item["odometry_ate_m"])
        assert item["poses"] == item["poses_with_truth"] == results["slam"]["ticks"]
        assert item["odometry_lag_s"] == pytest.approx(0.25, abs=0.06)
        assert item["sigma_now_m"] > 0.0
    assert results["planning"]["max_rel_diff"] < 1e-9
    assert results["planning"]["same_choices"]
    assert not [one for one in outcome.requirements if not one.met]
    assert results["peak_memory_mb"] > 50.0
    text = "\n".join(outcome.summary)
    assert re.search(r"robot2: 0\.\d+ m, odometry alone \d\.\d+ m, required 0\.\d+ m", text)
    assert "same choices: yes" in text


def test_demo_draws_its_figures(outcome):
    assert [path.name for path in outcome.figures] == [
        "trajectories.png",
        "errors.png",
        "chosen_paths.png",
    ]
    assert all(path.stat().st_size > 10_000 for path in outcome.figures)


def test_demo_says_where_the_data_are():
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    given = vars(parser.parse_args([]))
    with pytest.raises(InvalidInputError, match=r"--data FOLDER.*asrl\.utias\.utoronto\.ca"):
        mrclam(CommandOptions(name="mrclam", arguments=given))
    assert vars(parser.parse_args(["--data", "x", "--variants"])) == {"data": "x", "variants": True}


def test_requirement_is_a_fifth_of_odometry_or_20_cm():
    assert required_m(2.0) == pytest.approx(0.4)
    assert required_m(0.9) == pytest.approx(0.2)


def test_judgement_aligns_at_the_first_pose_only(folder):
    log = read_mrclam(folder)
    steps = mrclam_steps(log, until_s=30.0)
    slam = mrclam_slam(steps)
    found = judge(log, steps, slam, None)
    for errors in found.robots:
        robot = errors.robot
        assert found.errors_m[robot][0] == pytest.approx(0.0, abs=1e-12)
        assert np.sqrt(np.mean(found.errors_m[robot] ** 2)) == pytest.approx(errors.ate_m)
        assert errors.largest_m == pytest.approx(found.errors_m[robot].max())
        assert errors.ate_own_alignment_m <= errors.ate_m
        assert np.isnan(errors.sigma_now_m)
    assert sum(e.measurements for e in found.robots) == (
        steps.counts["used_landmark"] + steps.counts["used_robot"]
    )
    assert sum(e.seen_by_others for e in found.robots) == steps.counts["used_robot"]


def test_log_errors_finds_what_was_put_in(tmp_path):
    write_folder(tmp_path, seconds=30.0)
    exact = log_errors(read_mrclam(tmp_path))
    assert exact[1].misread == exact[1].ranges_short == exact[1].ranges_long == 0
    # Fine truth of 20 ms: half a step of turning at 0.4 rad/s.
    assert exact[1].bearing_sigma_rad < 1e-4
    assert exact[1].camera_late_s == pytest.approx(0.0, abs=1e-12)
    path = tmp_path / "Robot1_Measurement.dat"
    head, *lines = path.read_text().splitlines(keepends=True)
    changed, misread, shortened = [], 0, 0
    codes = {BARCODES[subject]: subject for subject in LANDMARKS}
    opposite = {6: 8, 7: 9, 8: 6, 9: 7, 10: 11, 11: 10}
    for line in lines:
        stamp, code, distance, bearing = line.split()
        # A stamp 0.1 s late; every 20th landmark taken for the one on the other side.
        if int(code) in codes and len(changed) % 20 == 5:
            code, misread = str(BARCODES[opposite[codes[int(code)]]]), misread + 1
        elif int(code) in codes and len(changed) % 20 == 6:
            distance, shortened = str(float(distance) * 0.5), shortened + 1
        changed.append(f"{float(stamp) + 0.1:.3f} {code} {distance} {bearing}\n")
    path.write_text(head + "".join(changed))
    found = log_errors(read_mrclam(tmp_path))[1]
    assert found.camera_late_s == pytest.approx(0.1, abs=1e-9)
    assert found.misread == found.misread_confirmed == misread > 3
    assert found.ranges_short == shortened > 3
    assert found.ranges_long == 0


def test_log_errors_leaves_out_a_robot_that_vicon_never_saw(tmp_path):
    write_folder(tmp_path, seconds=6.0)
    path = tmp_path / "Robot2_Groundtruth.dat"
    path.write_text(f"{ORIGIN_S:.3f} 0 0 0\n")
    assert set(log_errors(read_mrclam(tmp_path))) == {1, 3}


def test_variants_change_one_thing(folder):
    log = read_mrclam(folder)
    steps = mrclam_steps(log, NO_LAG, until_s=10.0)
    none = without_robot_measurements(steps)
    assert not any(one.sensor == CAMERA_ROBOT for tick in none.measurements for one in tick)
    assert sum(map(len, none.measurements)) == steps.counts["used_landmark"]
    alone = only_robot(steps, "robot2")
    assert alone.robots == ("robot2",)
    assert {one.robot for tick in alone.measurements for one in tick} == {"robot2"}
    assert all([one.robot for one in step] == ["robot2"] for step in alone.odometry)
    doing = []
    variants = run_variants(log, 20.0, lambda done, total, name: doing.append(name))
    assert [one.name for one in variants] == doing
    assert len(variants) == 6
    assert all(tuple(one.ate_m) == ("robot1", "robot2", "robot3") for one in variants)
    assert all(np.isfinite(list(one.ate_m.values())).all() for one in variants)


def test_goals_are_far_from_their_robot_and_apart_from_everybody():
    starts = {"ann": np.array([0.0, 0.0, 0.0]), "bob": np.array([5.0, 0.0, 0.0])}
    places = np.array([[0.0, 0.1], [5.0, 0.2], [4.0, 2.0], [1.0, 2.0], [4.2, 2.1]])
    goals = choose_goals(starts, places, 1.0)
    np.testing.assert_array_equal(goals["ann"], [4.2, 2.1])
    np.testing.assert_array_equal(goals["bob"], [1.0, 2.0])
    with pytest.raises(NoCandidatePathError, match="robot 'ann': expected a driven place 9 m"):
        choose_goals(starts, places, 9.0)


def test_peak_memory_is_that_of_this_process():
    before = peak_memory_mb()
    kept = np.ones(30_000_000)
    assert peak_memory_mb() >= before
    assert kept.nbytes / 1e6 < peak_memory_mb()


@needs_real
@pytest.mark.full
def test_real_log_meets_what_is_required():
    arguments = {"data": str(Path(str(REAL))), "variants": False}
    outcome = mrclam(CommandOptions(name="mrclam", arguments=arguments))
    assert not [one for one in outcome.requirements if not one.met]
    assert len(outcome.results["robots"]) == 5
