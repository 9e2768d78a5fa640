"""Closed loops in space, through the same code: 4 x 4 poses, landmarks with heights."""

from dataclasses import replace
from itertools import pairwise

import closed_loop_worlds as worlds
import numpy as np
import pytest

from fgplan.closed_loop.loop import run_loop
from fgplan.models.range_bearing import BearingSensor, RangeSensor

MEETING = worlds.spatial_meeting()


@pytest.fixture(scope="module")
def mission():
    return worlds.small_mission(0, spatial=True, multi_robot=(MEETING,), measured={"meet": MEETING})


@pytest.fixture(scope="module")
def records(mission):
    return list(run_loop(mission, compare=True))


def test_every_goal_is_reached_at_about_the_height_of_the_start(mission, records):
    assert worlds.reached(records) == {"ann": 2, "bob": 2}
    done = dict.fromkeys(worlds.GOALS, 0)
    for step in worlds.steps_of(records):
        for robot in step.arrived:
            place = step.estimates[robot][:3, 3]
            assert np.linalg.norm(place[:2] - mission.goals[robot][done[robot]]) < 1.5
            assert abs(place[2] - 5.0) < 3.0
            done[robot] += 1


def test_values_are_those_of_from_scratch(records):
    sessions = worlds.sessions_of(records)
    assert all(session.max_rel_diff <= 1e-9 for session in sessions)
    assert any(session.joined for session in sessions)
    assert any(session.counts["landmark_factors"] for session in sessions)
    assert any(
        one.sensor == "meet" for step in worlds.steps_of(records) for one in step.measurements
    )


def test_shapes_are_those_of_space(records):
    final = records[-1]
    for robot in worlds.GOALS:
        count = len(final.trajectory_steps[robot])
        assert final.trajectories[robot].shape == (count, 4, 4)
        assert final.covariances[robot].shape == (count, 6, 6)
    assert all(point.shape == (3,) for point in final.landmarks.values())
    for session in worlds.sessions_of(records):
        for robot, path in session.chosen.items():
            assert path.poses.shape[1:] == (4, 4)
            assert session.covariances[robot].shape == (path.steps + 1, 6, 6)


def test_kept_candidates_keep_their_bits(records):
    sessions = worlds.sessions_of(records)
    kept = 0
    for before, after in pairwise(sessions):
        for robot, count in after.candidates_kept.items():
            rest = before.chosen[robot].poses[after.step - before.step + 1 :] if count else ()
            if len(rest):
                first = after.candidates[robot][0].poses
                assert first[-len(rest) :].tobytes() == rest.tobytes()
                kept += 1
    assert kept >= 2


def test_it_goes_on_where_it_was_stopped(mission, records):
    cut = len(records) // 2
    rest = list(run_loop(mission, past=records[:cut], compare=True))
    worlds.assert_same([*records[:cut], *rest], records)


def test_goals_may_have_a_height(mission, records):
    robots = [
        replace(robot, goals=np.column_stack([robot.goals, [9.0, 9.0]])) for robot in mission.robots
    ]
    higher = replace(mission, robots=tuple(robots))
    for one, other in zip(records, run_loop(higher, compare=True), strict=True):
        if hasattr(one, "goals"):
            assert all(goal.shape == (3,) for goal in other.goals.values())
            worlds.assert_same(one.chosen, other.chosen)


@pytest.mark.parametrize(
    "sensor",
    [RangeSensor(sigma_m=0.2, max_range_m=25.0), BearingSensor(sigma_rad=0.01, max_range_m=25.0)],
    ids=["range", "bearing"],
)
def test_range_or_bearing_alone(sensor):
    mission = worlds.small_mission(1, spatial=True, sensor=sensor, multi_robot=(MEETING,))
    records = list(run_loop(mission, compare=True))
    assert worlds.reached(records) == {"ann": 2, "bob": 2}
    assert all(session.max_rel_diff <= 1e-9 for session in worlds.sessions_of(records))
    if isinstance(sensor, BearingSensor):  # a height needs more than ranges from one height
        assert len(records[-1].landmarks) > 5
