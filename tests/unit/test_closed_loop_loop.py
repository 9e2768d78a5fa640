"""A closed loop from its first step to its last: order, goals, candidates, who stands still."""

from dataclasses import replace
from itertools import pairwise

import closed_loop_worlds as worlds
import numpy as np
import pytest

from fgplan.closed_loop.comparison import EXECUTED, Contestant
from fgplan.closed_loop.loop import run_loop
from fgplan.closed_loop.records import GivenUpRecord, SessionRecord, SlamRecord, StepRecord
from fgplan.errors import InvalidInputError, NoCandidatePathError, UnknownNameError
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.models.pose import between
from fgplan.models.range_bearing import BearingRangeSensor
from roadmaps import Workspace

SHORT_SIGHTED = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.2, max_range_m=9.0)
"""Sees a landmark from one or two poses, so that paths fall into many segments."""

ENCLOSED = [
    np.array(ring, dtype=float)
    for ring in (
        [(80, 70), (110, 70), (110, 72), (80, 72)],
        [(80, 88), (110, 88), (110, 90), (80, 90)],
        [(80, 70), (82, 70), (82, 90), (80, 90)],
        [(108, 70), (110, 70), (110, 90), (108, 90)],
    )
]
"""Four walls about (95, 80)."""


@pytest.fixture(scope="module")
def mission():
    return worlds.small_mission(1)


@pytest.fixture(scope="module")
def records(mission):
    return list(run_loop(mission))


def test_events_come_in_order(records):
    steps, sessions = worlds.steps_of(records), worlds.sessions_of(records)
    assert [step.step for step in steps] == list(range(len(steps)))
    assert [session.session for session in sessions] == list(range(1, len(sessions) + 1))
    assert isinstance(records[0], StepRecord)
    assert isinstance(records[1], SessionRecord)
    assert isinstance(records[-1], SlamRecord)
    assert [isinstance(record, SlamRecord) for record in records].count(True) == 1
    number, before = 0, records[0]
    for record in records[1:-1]:
        if isinstance(record, SessionRecord):
            assert isinstance(before, StepRecord)
            assert record.step == before.step
            assert record.trigger == ("goal" if before.arrived else "start")
            number += 1
        else:
            assert record.session == number
            assert isinstance(before, SessionRecord) or not before.arrived
        before = record
    assert records[-1].step == before.step


def test_every_goal_is_reached_one_after_the_other(mission, records):
    assert worlds.reached(records) == {"ann": 2, "bob": 2}
    done = dict.fromkeys(worlds.GOALS, 0)
    for step in worlds.steps_of(records):
        for robot in step.arrived:
            goal = mission.goals[robot][done[robot]]
            assert np.linalg.norm(step.estimates[robot][:2] - goal) < 1.0
            done[robot] += 1
    for session in worlds.sessions_of(records):
        for robot, goal in session.goals.items():
            np.testing.assert_array_equal(
                goal, mission.goals[robot][session.goal_numbers[robot] - 1]
            )


def test_new_candidates_only_for_who_arrived(records):
    arrived = {"ann", "bob"}
    for record in records:
        if isinstance(record, StepRecord) and record.step:
            arrived = set(record.arrived)
        if isinstance(record, SessionRecord):
            renewed = arrived & record.candidates.keys()
            assert set(record.renewed) == renewed
            for robot, paths in record.candidates.items():
                counts = record.candidates_kept[robot], record.candidates_replaced[robot]
                assert (counts[0] == 0) == (robot in renewed)
                assert (counts[1] == 0) == (robot not in renewed)
                assert sum(counts) == len(paths)


def test_tails_of_kept_candidates_are_the_same_bits(records):
    sessions = worlds.sessions_of(records)
    compared = 0
    for before, after in pairwise(sessions):
        taken = after.step - before.step
        for robot in after.candidates.keys() - set(after.renewed):
            rest = before.chosen[robot].poses[taken + 1 :]
            first = after.candidates[robot][0].poses
            assert first[-len(rest) :].tobytes() == rest.tobytes()
            for path in after.candidates[robot]:
                start = after.estimate.trajectories[robot][-1]
                assert path.poses[0].tobytes() == start.tobytes()
                tails = [
                    old.poses[-1].tobytes() == path.poses[-1].tobytes()
                    and old.motion_covariances[-1].tobytes()
                    == path.motion_covariances[-1].tobytes()
                    for old in before.candidates[robot]
                ]
                assert any(tails)
                compared += 1
    assert compared > 5


def test_robots_steer_from_their_estimates(mission):
    records = list(run_loop(replace(mission, seed=3, world=_exact(mission.world))))
    path, taken = {}, {}
    before = None
    for record in records[:-1]:
        if isinstance(record, SessionRecord):
            path, taken = record.chosen, dict.fromkeys(record.chosen, 0)
        elif path:
            for reading in record.odometry:
                target = path[reading.robot].poses[taken[reading.robot] + 1]
                taken[reading.robot] += 1
                command = between(before.estimates[reading.robot], target)
                np.testing.assert_allclose(reading.relative, command, atol=2e-5)
        if isinstance(record, StepRecord):
            before = record


def _exact(world):
    """The same world with hardly any noise of motion."""
    quiet = worlds.motion(scale=1e-6)
    robots = [replace(robot, odometry=quiet, actuation=quiet) for robot in world.robots]
    return replace(world, robots=tuple(robots))


def test_who_has_finished_stays_and_measures_no_more(records):
    steps = worlds.steps_of(records)
    last = {
        robot: [step.step for step in steps if robot in step.arrived][-1] for robot in worlds.GOALS
    }
    assert last["ann"] != last["bob"]
    early = min(last, key=last.get)
    for step in steps[last[early] + 1 :]:
        assert step.truth[early].tobytes() == steps[last[early]].truth[early].tobytes()
        assert all(reading.robot != early for reading in step.odometry)
        assert all(one.robot != early for one in step.measurements)
    final = worlds.sessions_of(records)[-1]
    assert early not in final.candidates
    assert early not in final.chosen
    assert records[-1].trajectory_steps[early][-1] == last[early]


def test_robots_that_meet_have_factors_and_without_a_model_none(mission, records):
    assert sum(session.counts["multi_robot_factors"] for session in worlds.sessions_of(records)) > 0
    for session in worlds.sessions_of(records):
        assert len(session.joined) == session.counts["multi_robot_factors"]
        for first, second in session.joined:
            assert (first.robot, second.robot) == ("ann", "bob")
            assert np.linalg.norm(first.pose[:2] - second.pose[:2]) < 30.0
    alone = list(run_loop(replace(mission, multi_robot=())))
    assert all(not session.joined for session in worlds.sessions_of(alone))


def test_landmarks_that_only_others_mapped_can_be_left_out(mission, records):
    def foreign(found):
        return sum(
            robot not in session.estimate.seen_by[seen.landmark]
            for session in worlds.sessions_of(found)
            for robot, paths in session.candidates.items()
            for path in paths
            for seen in path.observations
        )

    assert foreign(records) > 0
    assert foreign(run_loop(replace(mission, others_landmarks=False))) == 0


def test_segments_of_kept_candidates_are_reused_while_landmarks_stay():
    mission = worlds.small_mission(1, sensor=SHORT_SIGHTED, landmarks=20)

    def reused(relinearise_m):
        found = run_loop(replace(mission, relinearise_m=relinearise_m))
        kept = [
            session.segments_reused[robot]
            for session in worlds.sessions_of(found)
            for robot, count in session.candidates_kept.items()
            if count
        ]
        return sum(kept)

    # Landmarks keep their linearisation point for ever, for 10 cm, or never.
    assert reused(100.0) >= reused(0.1) > 0
    assert reused(0.1) >= reused(0.0)


def test_goal_that_cannot_be_reached_is_reported_and_skipped():
    goals = {**worlds.GOALS, "bob": ((95.0, 80.0), (70.0, 60.0))}
    mission = worlds.small_mission(1, goals=goals, obstacles=ENCLOSED, known=ENCLOSED)
    records = list(run_loop(mission))
    first, *others = worlds.sessions_of(records)
    assert list(first.unreachable) == ["bob"]
    assert "goal 1" in first.unreachable["bob"]
    assert first.goal_numbers["bob"] == 2
    assert not any(session.unreachable for session in others)
    assert worlds.reached(records) == {"ann": 2, "bob": 1}
    history = worlds.history_of(mission, records)
    assert history.reached == {"ann": 2, "bob": 1}
    assert {robot: len(why) for robot, why in history.unreachable.items()} == {"bob": 1}


def test_nobody_can_reach_a_goal_at_the_start():
    mission = worlds.small_mission(
        1,
        goals={"ann": ((95.0, 80.0),), "bob": ((95.0, 80.0), (90.0, 80.0))},
        obstacles=ENCLOSED,
        known=ENCLOSED,
    )
    with pytest.raises(NoCandidatePathError, match=r"robot 'ann' .* goal 1.*'bob' .* goal 2"):
        list(run_loop(mission))


def test_loop_ends_when_no_goal_that_is_left_can_be_reached():
    mission = worlds.small_mission(
        1,
        goals={"ann": ((15.0, 40.0),), "bob": ((70.0, 40.0), (95.0, 80.0))},
        obstacles=ENCLOSED,
        known=ENCLOSED,
    )
    records = list(run_loop(mission))
    given_up, final = records[-2:]
    assert isinstance(given_up, GivenUpRecord)
    assert isinstance(final, SlamRecord)
    assert list(given_up.unreachable) == ["bob"]
    assert given_up.step == final.step == worlds.steps_of(records)[-1].step
    assert worlds.reached(records) == {"ann": 1, "bob": 1}
    resumed = [*records[:-1], *run_loop(mission, past=records[:-1])]
    worlds.assert_same(records, resumed)


def test_estimate_outside_the_bounds_or_in_a_margin_is_no_obstacle():
    starts = {"ann": (0.0, 10.0, np.pi / 2), "bob": (60.0, 0.0, np.pi / 2)}
    mission = worlds.small_mission(0, starts=starts, start_sigma=1.0)
    outside = 0
    for seed in range(3):
        records = list(run_loop(replace(mission, seed=seed)))
        first = records[0].estimates
        outside += sum(not mission.workspace.are_positions_valid(p[:2])[0] for p in first.values())
        assert worlds.reached(records) == {"ann": 2, "bob": 2}
    assert outside >= 2


def test_robot_without_goals_only_looks_on():
    mission = worlds.small_mission(1, goals={**worlds.GOALS, "bob": ()})
    records = list(run_loop(mission))
    assert worlds.reached(records) == {"ann": 2}
    assert all("bob" not in session.candidates for session in worlds.sessions_of(records))
    assert records[-1].trajectories["bob"].shape == (1, 3)


def test_nobody_has_a_goal():
    mission = worlds.small_mission(1, goals={"ann": (), "bob": ()})
    assert [type(record) for record in run_loop(mission)] == [StepRecord, SlamRecord]


def test_robots_may_share_a_goal():
    mission = worlds.small_mission(1, goals={"ann": ((40.0, 50.0),), "bob": ((40.0, 50.0),) * 2})
    assert worlds.reached(run_loop(mission)) == {"ann": 1, "bob": 2}


def test_loop_is_given_up_after_max_steps(mission, records):
    cut = list(run_loop(replace(mission, max_steps=5)))
    assert worlds.steps_of(cut)[-1].step == cut[-1].step == 5
    worlds.assert_same(cut[:-1], records[: len(cut) - 1])


def test_sessions_that_are_compared_can_be_named(mission):
    compared = worlds.sessions_of(run_loop(mission, compare={2, 3}))
    assert [session.max_rel_diff is not None for session in compared[:4]] == [
        False,
        True,
        True,
        False,
    ]


def test_landmarks_known_beforehand_are_in_the_first_plan():
    mission = worlds.small_mission(1)
    keys = mission.world.landmark_keys[:4]
    known = replace(
        mission,
        world=replace(mission.world, known_landmarks=frozenset(keys)),
        landmark_covariances=dict.fromkeys(keys, 0.25 * np.eye(2)),
    )
    first = worlds.sessions_of(run_loop(known))[0].estimate
    assert set(keys) <= first.landmarks.keys()
    for key in keys:
        error = first.landmarks[key] - mission.world.landmark_position(key)
        assert 0.0 < np.linalg.norm(error) < 2.0


def test_loop_without_the_evaluator_that_is_executed_is_refused(mission):
    other = {"from_scratch": Contestant(FromScratch())}
    with pytest.raises(InvalidInputError, match="expected 'incremental_choose' among"):
        list(run_loop(mission, contestants=other))


def test_records_of_another_mission_are_refused(mission, records):
    with pytest.raises(InvalidInputError, match="records of this mission from step 0 on"):
        list(run_loop(replace(mission, world=_moved(mission.world)), past=records[:3]))
    with pytest.raises(InvalidInputError, match="expected a StepRecord next, got a SessionRecord"):
        list(run_loop(mission, past=records[1:3]))
    with pytest.raises(InvalidInputError, match="SessionRecord or GivenUpRecord next, got a Step"):
        list(run_loop(mission, past=[records[0], *records[2:5]]))
    session = records[1]
    other = {**session.chosen_index, "ann": (session.chosen_index["ann"] + 1) % 6}
    with pytest.raises(InvalidInputError, match="session at step 0: expected the recorded choice"):
        list(run_loop(mission, past=[records[0], replace(session, chosen_index=other)]))


def _moved(world):
    """The same world with the first robot one metre on."""
    first, *others = world.robots
    moved = replace(first, pose=first.pose + np.array([1.0, 0.0, 0.0]))
    return replace(world, robots=(moved, *others))


def test_finished_records_have_nothing_to_go_on_with(mission, records):
    assert list(run_loop(mission, past=records)) == []


def test_contestants_are_all_recorded(mission):
    contestants = {
        EXECUTED: Contestant(FromScratch(elimination="qr")),
        "again": Contestant(FromScratch(elimination="qr"), repeats=2),
    }
    found = run_loop(replace(mission, max_steps=1), contestants=contestants)
    [session] = worlds.sessions_of(found)
    assert list(session.runs) == [EXECUTED, "again"]
    assert session.runs[EXECUTED].objective == session.runs["again"].objective == session.values[-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robots": ()}, "expected the robots of the world in its order"),
        ({"relinearise_m": -1.0}, "relinearise_m"),
        ({"obstacle_range_m": -1.0}, "obstacle_range_m"),
        ({"max_steps": 0}, "max_steps: expected a whole number of at least 1, got 0"),
        ({"max_steps": 2.5}, "max_steps: expected a whole number of at least 1, got 2.5"),
        ({"seed": -1}, "seed: expected a whole number of at least 0"),
        ({"landmark_covariances": {1: np.eye(2)}}, "differ in landmark 1"),
    ],
)
def test_mission_refuses(mission, change, message):
    with pytest.raises(InvalidInputError, match=message):
        replace(mission, **change)


def test_mission_refuses_candidates_without_steps(mission):
    with pytest.raises(InvalidInputError, match="expected candidates with spacing_m"):
        replace(mission, candidates=replace(mission.candidates, spacing_m=None))
    with pytest.raises(InvalidInputError, match="on a prm"):
        replace(mission, candidates=replace(mission.candidates, roadmap="rrg"))


def test_mission_refuses_robots_that_do_not_fit(mission):
    ann, bob = mission.robots
    spatial = replace(ann, motion=worlds.motion(spatial=True), start_covariance=np.eye(6))
    with pytest.raises(InvalidInputError, match="'ann': expected a motion model of 3 sigmas"):
        replace(mission, robots=(spatial, bob))
    with pytest.raises(UnknownNameError, match="sensor 'ear' is not one of: eye"):
        replace(mission, robots=(replace(ann, sensors=("ear",)), bob))
    with pytest.raises(InvalidInputError, match=r"goals in free space, got \[500.0, 0.0\]"):
        replace(mission, robots=(replace(ann, goals=[[500.0, 0.0]]), bob))
    with pytest.raises(InvalidInputError, match="expected 2 coordinates, or 3 for a robot in"):
        replace(ann, goals=[[1.0, 2.0, 3.0]])
    with pytest.raises(UnknownNameError, match="'cid' is not one of: ann, bob"):
        mission.robot("cid")


def test_mission_refuses_worlds_of_which_something_would_be_left_out(mission):
    world = mission.world
    with pytest.raises(InvalidInputError, match=r"other names .* got 'eye' for both"):
        replace(mission, world=replace(world, multi_robot={"eye": worlds.MEETING}))
    wall = [(40.0, 40.0), (50.0, 40.0), (50.0, 50.0)]
    walled = replace(world, workspace=replace(world.workspace, obstacles=(wall,)))
    with pytest.raises(InvalidInputError, match=r"obstacle_range_m: expected more than a step"):
        replace(mission, world=walled)
    assert replace(mission, world=walled, obstacle_range_m=11.0).unknown_obstacles[0].shape == (
        3,
        2,
    )
    known = Workspace(lower=np.zeros(2), upper=np.array([120.0, 100.0]), obstacles=(wall,))
    assert not replace(mission, world=walled, workspace=known).unknown_obstacles
    assert not replace(mission, world=replace(world, workspace=None)).unknown_obstacles
