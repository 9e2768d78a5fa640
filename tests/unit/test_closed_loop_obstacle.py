"""An obstacle that nobody knew is seen: what it touches is planned anew, the rest is reused."""

from dataclasses import replace
from itertools import pairwise

import closed_loop_worlds as worlds
import numpy as np
import pytest

from fgplan.closed_loop.loop import run_loop
from fgplan.closed_loop.records import GivenUpRecord, SessionRecord, StepRecord
from fgplan.models.range_bearing import BearingRangeSensor
from roadmaps import Workspace

RANGE_M = 15.0
WALL = np.array([(20.0, 45.0), (50.0, 45.0), (50.0, 50.0), (20.0, 50.0)])
FAR = np.array([(1.0, 94.0), (5.0, 94.0), (5.0, 98.0)])
GOALS = {"ann": ((30.0, 90.0),), "bob": ((100.0, 80.0),)}
STARTS = {"ann": (30.0, 10.0, np.pi / 2), "bob": (80.0, 10.0, np.pi / 2)}
SIGHT = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.2, max_range_m=12.0)


def walled_mission(seed=0, **options):
    chosen = {
        "obstacles": (WALL, FAR),
        "obstacle_range_m": RANGE_M,
        "goals": GOALS,
        "starts": STARTS,
        "sensor": SIGHT,
        "noise": 0.3,
        "candidates": 8,
        "robot_radius_m": 1.5,
    }
    return worlds.small_mission(seed, **{**chosen, **options})


@pytest.fixture(scope="module")
def mission():
    return walled_mission()


@pytest.fixture(scope="module")
def records(mission):
    return list(run_loop(mission, compare=True))


@pytest.fixture(scope="module")
def seen(records):
    """The session that the wall triggered, and the one before it."""
    sessions = worlds.sessions_of(records)
    [place] = [i for i, session in enumerate(sessions) if session.trigger == "obstacle"]
    return sessions[place - 1], sessions[place]


def test_obstacle_triggers_a_session_when_a_robot_first_comes_near(records, seen):
    _, session = seen
    assert session.step > 0
    assert [ring.tolist() for ring in session.obstacles] == [WALL.tolist()]
    for step in worlds.steps_of(records)[: session.step]:
        assert distance_to_wall(step.truth["ann"]) > RANGE_M
    assert distance_to_wall(worlds.steps_of(records)[session.step].truth["ann"]) <= RANGE_M


def distance_to_wall(pose):
    """Distance of a position from the wall's rectangle."""
    nearest = np.clip(pose[:2], WALL.min(axis=0), WALL.max(axis=0))
    return np.linalg.norm(pose[:2] - nearest)


def test_candidates_that_cross_it_are_replaced_and_others_kept(mission, seen):
    before, after = seen
    known = Workspace(
        lower=np.zeros(2), upper=mission.workspace.upper, obstacles=(WALL,), robot_radius_m=1.5
    )

    def free(path):
        return known.are_motions_valid(path.poses[:-1, :2], path.poses[1:, :2]).all()

    crossing = [path for path in before.candidates["ann"] if not free(path)]
    assert crossing
    assert all(free(path) for paths in after.candidates.values() for path in paths)
    assert 0 < after.candidates_kept["ann"] <= 8 - len(crossing)
    assert 0 < after.candidates_replaced["ann"] <= 8 - after.candidates_kept["ann"]
    assert after.candidates_kept["bob"] > 0
    assert after.candidates_replaced["bob"] == 0
    assert after.renewed == ()
    for robot, paths in after.candidates.items():
        ends = {old.poses[-2:].tobytes() for old in before.candidates[robot]}
        kept = paths[: after.candidates_kept[robot]]
        assert all(path.poses[-2:].tobytes() in ends for path in kept if path.steps > 2)


def test_counts_are_reported(seen):
    before, after = seen
    assert after.counts["roadmap_edges_removed"] > 0
    assert "roadmap_edges_removed" not in before.counts
    assert after.segments_reused["bob"] > 0
    assert after.counts["segments_reused"] == sum(after.segments_reused.values())


def test_values_are_those_of_from_scratch(records):
    assert all(session.max_rel_diff <= 1e-9 for session in worlds.sessions_of(records))


def test_truth_never_crosses_an_obstacle(mission, records):
    steps = worlds.steps_of(records)
    assert not any(step.collided for step in steps)
    world = mission.world.workspace
    for before, after in pairwise(steps):
        for robot in STARTS:
            ends = before.truth[robot][:2], after.truth[robot][:2]
            assert world.are_motions_valid(*ends)[0]
    assert worlds.reached(records) == {"ann": 1, "bob": 1}


def test_obstacle_that_nobody_comes_near_stays_unknown(records):
    assert not any(
        np.array_equal(ring, FAR)
        for session in worlds.sessions_of(records)
        for ring in session.obstacles
    )


def test_loop_that_is_stopped_goes_on_with_what_has_been_seen(mission, records, seen):
    place = records.index(seen[1])
    for cut in (place - 1, place, place + 1, place + 3):
        rest = list(run_loop(mission, past=records[:cut], compare=True))
        worlds.assert_same([*records[:cut], *rest], records)


def test_obstacle_beside_the_start_is_in_the_first_plan():
    near = np.array([(25.0, 15.0), (35.0, 15.0), (35.0, 20.0), (25.0, 20.0)])
    records = run_loop(walled_mission(obstacles=(near,), max_steps=1))
    [session] = worlds.sessions_of(records)
    assert session.trigger == "start"
    assert len(session.obstacles) == 1
    for path in session.candidates["ann"]:
        assert np.ptp(path.poses[:3, 0]) > 0.0  # not straight ahead


def test_goal_that_an_obstacle_encloses_is_given_up_on_the_way():
    ring = [
        np.array(wall, dtype=float)
        for wall in (
            [(15, 80), (45, 80), (45, 82), (15, 82)],
            [(15, 80), (17, 80), (17, 100), (15, 100)],
            [(43, 80), (45, 80), (45, 100), (43, 100)],
        )
    ]
    goals = {"ann": ((30.0, 90.0), (30.0, 40.0)), "bob": ((100.0, 30.0),)}
    mission = walled_mission(goals=goals, obstacles=ring, obstacle_range_m=25.0)
    records = list(run_loop(mission, compare=True))
    sessions = worlds.sessions_of(records)
    gave_up = [session for session in sessions if session.unreachable]
    assert [list(session.unreachable) for session in gave_up] == [["ann"]]
    assert gave_up[0].trigger == "obstacle"
    assert gave_up[0].goal_numbers["ann"] == 2
    assert "ann" in gave_up[0].renewed
    assert worlds.reached(records) == {"ann": 1, "bob": 1}
    assert all(session.max_rel_diff <= 1e-9 for session in sessions)
    goals = {"ann": ((30.0, 90.0),), "bob": ()}
    records = list(run_loop(replace_goals(mission, goals)))
    assert isinstance(records[-2], GivenUpRecord)
    assert isinstance(records[-3], StepRecord)
    assert isinstance(records[1], SessionRecord)


def replace_goals(mission, goals):
    robots = [
        replace(robot, goals=np.array(goals[robot.name]).reshape(-1, 2)) for robot in mission.robots
    ]
    return replace(mission, robots=tuple(robots))


def test_a_robot_looks_from_where_it_truly_is_not_past_bounds_or_grid():
    """Bounds and known obstacles near a robot are nothing new."""
    known = np.array([(25.0, 15.0), (35.0, 15.0), (35.0, 20.0), (25.0, 20.0)])
    starts = {"ann": (0.0, 0.0, np.pi / 2), "bob": (80.0, 0.0, np.pi / 2)}
    records = run_loop(
        walled_mission(obstacles=(known, FAR), known=(known,), starts=starts, noise=1.0)
    )
    assert not any(session.obstacles for session in worlds.sessions_of(records))
