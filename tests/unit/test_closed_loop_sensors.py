"""Closed loops with range alone, bearing alone, and robots that measure each other."""

from dataclasses import replace

import closed_loop_worlds as worlds
import numpy as np
import pytest

from fgplan.closed_loop.loop import run_loop
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor

SENSORS = {
    "range": RangeSensor(sigma_m=0.2, max_range_m=25.0),
    "bearing": BearingSensor(sigma_rad=0.01, max_range_m=25.0),
}
SIDE_BY_SIDE = {"ann": ((55.0, 60.0),), "bob": ((70.0, 60.0),)}


@pytest.mark.parametrize("name", SENSORS)
def test_landmarks_start_when_they_are_determined(name):
    mission = worlds.small_mission(1, sensor=SENSORS[name])
    records = list(run_loop(mission, compare=True))
    sessions = worlds.sessions_of(records)
    assert not sessions[0].estimate.landmarks  # one reading of each determines none
    measured = {one.target for step in worlds.steps_of(records) for one in step.measurements}
    final = records[-1]
    assert len(final.landmarks) >= 5
    assert set(final.landmarks) <= measured
    assert any(session.counts["landmark_factors"] for session in sessions[1:])
    assert all(session.max_rel_diff <= 1e-9 for session in sessions)
    assert worlds.reached(records) == {"ann": 2, "bob": 2}
    assert_consistent(mission, records)


def assert_consistent(mission, records):
    """Final estimates are within five standard deviations of the truth."""
    final, truth = records[-1], worlds.steps_of(records)[-1].truth
    for robot, pose in truth.items():
        error = final.trajectories[robot][-1][:2] - pose[:2]
        sigma = np.sqrt(np.linalg.eigvalsh(_in_world(final, robot))[-1])
        assert np.linalg.norm(error) < 5.0 * sigma
    for key, point in final.landmarks.items():
        error = point - mission.world.landmark_position(key)
        chi2 = error @ np.linalg.solve(final.landmark_covariances[key], error)
        assert chi2 < 30.0


def _in_world(final, robot):
    """Position covariance of the last pose in the world frame."""
    heading = final.trajectories[robot][-1][2]
    cosine, sine = np.cos(heading), np.sin(heading)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    return turn @ final.covariances[robot][-1][:2, :2] @ turn.T


def test_relative_poses_are_measured_and_tie_the_robots_together():
    """Without landmarks, bob knows where he is; ann learns it when they meet."""
    blind = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.2, max_range_m=1e-3)
    mission = worlds.small_mission(1, sensor=blind, goals=SIDE_BY_SIDE)
    ann, bob = mission.robots
    lost = replace(ann, start_covariance=np.diag([25.0, 25.0, 0.01]))
    mission = replace(mission, robots=(lost, bob))
    measured = replace(mission, world=replace(mission.world, multi_robot={"meet": worlds.MEETING}))

    def spread(records):
        return np.trace(records[-1].covariances["ann"][-1][:2, :2])

    alone, together = list(run_loop(mission, compare=True)), list(run_loop(measured, compare=True))
    readings = [one for step in worlds.steps_of(together) for one in step.measurements]
    assert readings
    assert {(one.kind, one.sensor, one.robot, one.target) for one in readings} == {
        ("robot", "meet", "ann", "bob")
    }
    assert spread(alone) > 25.0
    assert spread(together) < 0.1 * spread(alone)
    for session in (*worlds.sessions_of(alone), *worlds.sessions_of(together)):
        assert session.max_rel_diff <= 1e-9
    # Planning counts on the factor: it expects to know more than it does now.
    first = worlds.sessions_of(together)[0]
    assert first.counts["multi_robot_factors"] > 0
    planned = np.trace(first.covariances["ann"][-1][:2, :2])
    assert planned < 0.1 * np.trace(first.estimate.covariances["ann"][-1][:2, :2])


def test_robots_can_range_each_other():
    near = replace(
        worlds.MEETING, sensor=RangeSensor(sigma_m=0.1, max_range_m=30.0), time_tolerance_s=0.5
    )
    mission = worlds.small_mission(
        1, goals=SIDE_BY_SIDE, multi_robot=(near,), measured={"ping": near}
    )
    records = list(run_loop(mission, compare=True))
    sessions = worlds.sessions_of(records)
    assert any(
        one.sensor == "ping" for step in worlds.steps_of(records) for one in step.measurements
    )
    assert any(session.joined for session in sessions)
    assert all(session.max_rel_diff <= 1e-9 for session in sessions)
    for session in sessions:
        assert all(one.time_s == other.time_s for one, other in session.joined)
