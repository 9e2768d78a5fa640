"""Planner `intermittent` of a scenario; messages, radio, delays, baselines and pictures."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from intermittent_scenes import block_model, estimate_of, room, segment_problem

from fgplan.bench import intermittent_scene
from fgplan.bench.intermittent import bench_team
from fgplan.bench.intermittent import run as bench
from fgplan.bench.intermittent_methods import indoor_case, run_method
from fgplan.cli.run_command import summary_lines
from fgplan.cli.run_recording import record_run, target_tracks
from fgplan.errors import InvalidInputError, NoCandidatePathError, OptionError
from fgplan.io.command import CommandOptions
from fgplan.io.mission_file import load_mission
from fgplan.models.range_bearing import RangeSensor
from fgplan.planners.intermittent.all_time import formation, run_formation
from fgplan.planners.intermittent.delay import team_delays, team_series
from fgplan.planners.intermittent.estimate import Record
from fgplan.planners.intermittent.knowledge import join, know_nothing, remember
from fgplan.planners.intermittent.leg import Leg
from fgplan.planners.intermittent.meeting_points import plan_meeting_point
from fgplan.planners.intermittent.message import (
    Agreed,
    Numbers,
    Offer,
    Sensed,
    array_of,
    knowledge_of,
    known_of,
    leg_data,
    leg_of,
    unwrap,
    wrap,
)
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.planner import IntermittentPlanner, read_options
from fgplan.planners.intermittent.radio import Radio
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from fgplan.planners.intermittent.truth import draw_truth
from fgplan.planners.registry import find_planner
from fgplan.team.envelope import Envelope, decode_envelope
from fgplan.team.in_process import InProcessTransport
from fgplan.viz.figure import save
from fgplan.viz.intermittent import (
    draw_delays,
    draw_team_paths,
    draw_team_run,
    draw_two_series,
    film_team_run,
)
from roadmaps import Workspace

SCENARIO = Path(__file__).parents[2] / "examples" / "scenarios" / "intermittent.toml"
FEW = {"steps": 40, "samples": 40, "explore": 20, "step_m": 0.5, "epsilon_m": 1.0}


def short_mission(**changes):
    mission = load_mission(SCENARIO)
    return replace(mission, options={**mission.options, **FEW, **changes})


def test_a_scenario_names_the_planner_and_gets_a_plan_with_meetings():
    planner = find_planner("intermittent")
    mission = short_mission()
    plan = planner.plan(mission, np.random.default_rng(0))
    again = planner.plan(mission, np.random.default_rng(0))
    assert plan.details == again.details
    assert plan.planner == "intermittent"
    assert list(plan.paths) == ["ann", "bob", "cat", "dan"]
    assert plan.details["delay_bound_epochs"] == 3
    assert plan.details["schedules"]["bob"] == [0, 1]
    assert plan.report["meetings"] == len(plan.details["meetings"]) > 2
    assert all(len(item.covariances) == 0 for item in plan.robots)  # poses are taken as known
    tracks = target_tracks(plan)
    assert {name: track.shape for name, track in tracks.items()} == dict.fromkeys(
        ("t0", "t1", "t2"), (len(plan.details["uncertainty"]), 2)
    )
    record = record_run(mission, plan)
    sigmas = [
        np.sqrt(np.linalg.eigvalsh(record.target_covariances[name][-1])[-1]) for name in tracks
    ]
    (said,) = [line for line in summary_lines(plan) if "1 sigma" in line]
    assert "worst direction" in said
    for name, sigma in zip(tracks, sigmas, strict=True):
        told = float(said.partition(f"{name} to ")[2].partition(" m")[0])
        assert told >= 0.99 * sigma  # of all three coordinates, not the two on the map
    places = {name: path.poses[:, :2] for name, path in plan.paths.items()}
    for meeting in plan.details["meetings"]:
        met = np.array([places[name][meeting["step"]] for name in meeting["robots"]])
        np.testing.assert_allclose(met, meeting["places"], rtol=1e-12)
        assert np.linalg.norm(met[0] - met[1]) <= 0.3 + 1e-9
    for way in places.values():
        assert np.hypot(*np.diff(way, axis=0).T).max() <= 0.5 + 1e-9
        assert mission.workspace.are_motions_valid(way[:-1], way[1:]).all()
    assert plan.value == pytest.approx(sum(plan.details["uncertainty"]), rel=1e-12)


def test_own_sensors_and_other_metrics_take_the_dense_model():
    class Own(RangeSensor):
        """A user's own sensor."""

    mission = short_mission(steps=8, samples=2, explore=1)
    own = replace(mission, sensors={"range": Own(sigma_m=0.1, max_range_m=4.0)})
    plan = IntermittentPlanner().plan(own, np.random.default_rng(0))
    assert np.shape(plan.details["target_covariance_at_end"]) == (1, 9, 9)


@pytest.mark.parametrize(
    ("changes", "error", "match"),
    [
        ({"sample": 3}, OptionError, "'sample'"),
        ({"steps": 0}, OptionError, "steps"),
        ({"sync": "no"}, OptionError, "sync"),
        ({"teams": [["ann", "bob"]]}, OptionError, "two or more teams"),
        ({"metric": "log_determinant"}, OptionError, "positive"),
    ],
)
def test_options_that_cannot_be_used_are_refused(changes, error, match):
    with pytest.raises(error, match=match):
        IntermittentPlanner().plan(short_mission(**changes), np.random.default_rng(0))


def test_missions_that_cannot_be_planned_are_refused():
    mission = short_mission()
    with pytest.raises(InvalidInputError, match="targets"):
        IntermittentPlanner().plan(replace(mission, targets=()), np.random.default_rng(0))
    narrow = RangeSensor(sigma_m=0.1, field_of_view_rad=1.0)
    with pytest.raises(InvalidInputError, match="sees all round"):
        IntermittentPlanner().plan(
            replace(mission, sensors={"range": narrow}), np.random.default_rng(0)
        )
    with pytest.raises(InvalidInputError, match="not one of"):
        IntermittentPlanner().plan(replace(mission, sensors={}), np.random.default_rng(0))
    own, segment = read_options({"teams": [["a", "b"], ["b", "a"]], "delta": 0.5})
    assert own.teams == (("a", "b"), ("b", "a"))
    assert segment.delta == 0.5


def test_messages_survive_the_wire_and_bad_ones_are_refused():
    known = know_nothing(1, 3, estimate_of(3))
    known = remember(known, 4, Record(4, (1.0, 2.0), ((2, (3.5,)),)))
    leg = Leg(2, 5, 30, 20, np.arange(6.0).reshape(3, 2), slack=4)
    offers = {"b": Offer((1.0, 2.0), (leg_data(leg),))}
    for content in (
        Sensed(Record(4, (1.0, 2.0))),
        known_of(known, offers),
        Agreed(known_of(known, offers), {"b": leg_data(leg)}),
    ):
        sent = wrap("b", 2, 5, content)
        received = decode_envelope(sent.encoded)
        assert received.content is None
        assert unwrap(received) == content
    there = knowledge_of(known_of(known, offers))
    np.testing.assert_array_equal(there.checkpoint.covariance, known.checkpoint.covariance)
    np.testing.assert_array_equal(there.heard, known.heard)
    assert there.logs == known.logs
    back = leg_of(leg_data(leg))
    np.testing.assert_array_equal(back.places, leg.places)
    assert (back.due, back.arrival, back.ready, back.leaves) == (30, 22, 30, 34)
    with pytest.raises(InvalidInputError, match="expected one of"):
        unwrap(Envelope(robot="b", session=0, sequence=0, kind="gossip"))
    with pytest.raises(InvalidInputError, match="known"):
        unwrap(Envelope(robot="b", session=0, sequence=0, kind="known", payload=b"x"))
    with pytest.raises(InvalidInputError, match="bytes"):
        array_of(Numbers((2, 2), b"12345678"))
    with pytest.raises(InvalidInputError, match="finite"):
        array_of(Numbers((1,), np.array([np.nan]).tobytes()))
    with pytest.raises(InvalidInputError, match="places"):
        leg_of(msgspec.structs.replace(leg_data(leg), places=Numbers((0, 2), b"")))


def test_joining_takes_the_longer_log_and_never_counts_twice():
    start = estimate_of(3)
    one = know_nothing(0, 2, start)
    for time in (1, 2, 3):
        one = remember(one, time, Record(time, (0.0, 0.0), ((0, (1.0,)),)))
    two = remember(know_nothing(1, 2, start), 5, Record(5, (1.0, 0.0), ((1, (2.0,)),)))
    first = join(two, one)
    second = join(join(first, one), first)
    assert second.logs == first.logs
    assert [len(log) for log in first.logs] == [3, 1]
    assert first.heard.tolist() == [3, 5]
    assert first.readings == 4
    assert [record.time for _, record in first.records()] == [1, 2, 3, 5]
    # Of two logs that overlap the longer is taken, not both.
    begun = remember(know_nothing(0, 2, start), 1, one.logs[0][0])
    assert join(join(two, begun), one).logs == first.logs
    # A log that a later checkpoint has passed is lost, and is counted.
    later = replace(two, checkpoint=replace(start, time=2))
    assert [record.time for _, record in join(later, one).records()] == [3, 5]
    assert join(later, one).discarded == 2


def test_radio_reaches_as_far_as_its_range():
    names = ("a", "b", "c")
    places = {name: np.array([0.2 * i, 0.0]) for i, name in enumerate(names)}
    radio = Radio(InProcessTransport(names), 0.2, places)
    message = Envelope(robot="a", session=0, sequence=0, kind="sensed")
    radio.send("a", message)
    assert radio.waiting() == ["b"]
    assert len(radio.receive("b")) == 1
    radio.send("a", message, to="c")
    assert radio.waiting() == []
    radio.move("b", None)
    radio.send("a", message)
    radio.send("b", message)
    radio.move("c", np.array([0.1, 0.1]))
    radio.send("a", message, to="c")
    assert radio.waiting() == ["c"]
    assert radio.traffic.of("sensed").sent == 2
    assert radio.next_arrival_s() == np.inf
    radio.advance(3.0)
    assert radio.now() == 3.0


def test_heuristic_goes_straight_to_a_point_and_waits():
    problem = segment_problem(block_model(2), [(1, 1), (9, 9)], [0, 25])
    segment = plan_meeting_point(problem, SegmentOptions(), np.random.default_rng(3))
    np.testing.assert_array_equal(segment.places[0][-1], segment.places[1][-1])
    waited = []
    for places, time in zip(segment.places, (0, 25), strict=True):
        assert len(places) == segment.end - time + 1
        ways = np.hypot(*np.diff(places, axis=0).T)
        moving = np.flatnonzero(ways > 0)
        assert moving[-1] == len(moving) - 1  # never stops before it waits
        waited.append(len(ways) - len(moving))
    assert min(waited) == 0  # until the last is there, and no longer
    walls = [[(4, -1), (5, -1), (5, 11), (4, 11)]]
    apart = SegmentProblem(
        workspace=Workspace(lower=[0, 0], upper=[10, 10], obstacles=walls),
        model=block_model(2),
        estimate=estimate_of(3),
        starts=np.array([(1.0, 1.0), (9.0, 1.0)]),
        times=np.array([0, 0]),
    )
    with pytest.raises(NoCandidatePathError, match="apart"):
        plan_meeting_point(apart, SegmentOptions(), np.random.default_rng(0))


def test_formation_keeps_its_shape_and_everybody_knows_everything():
    model, start = block_model(4), estimate_of(3)
    truth = draw_truth(model.hidden, start.mean, 90, model, 4, np.random.default_rng(0))
    options = SegmentOptions(samples=60, explore=40, delta=0.05)
    places, filtered, plans = run_formation(
        room(), model, options, np.array([2.0, 2.0]), start, truth, np.random.default_rng(0)
    )
    assert places.shape == (91, 4, 2)
    assert len(plans) > 1
    offsets = places - places.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(offsets, np.broadcast_to(offsets[0], offsets.shape), atol=1e-12)
    np.testing.assert_allclose(offsets[0], formation(4, 0.15), atol=1e-12)
    ways = np.diff(places, axis=0)
    assert np.hypot(ways[..., 0], ways[..., 1]).max() <= 0.1 + 1e-9
    records = [
        (
            row,
            Record(
                t,
                tuple(places[t, row]),
                model.measure(row, truth.states[t], places[t, row], truth.normals[t, row]),
            ),
        )
        for t in range(1, 91)
        for row in range(4)
    ]
    np.testing.assert_allclose(
        filtered.means, model.run(start, 90, records).means, rtol=1e-9, atol=1e-12
    )


def test_the_scene_is_the_paper_s_in_what_the_paper_prints():
    case = indoor_case("G1", 0, 5)
    options = case.setup.options
    assert (options.step_m, options.range_m) == (0.1, 0.2)
    assert options.delta == pytest.approx(0.0144, rel=1e-12)
    assert (options.samples, options.goal) == (600, "uncertainty")
    assert case.setup.model.size == 24
    np.testing.assert_array_equal(case.estimate.covariance[3], 0.25 * np.eye(3))
    np.testing.assert_array_equal(case.truth.states[0][:3], [1.0, 2.0, 1.5])
    for path in np.moveaxis(intermittent_scene.target_paths(tuple(range(8)), 400), 1, 0):
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 0.02 + 1e-12
        assert case.setup.workspace.has_line_of_sight(path[:-1, :2], path[1:, :2]).all()
    # Targets avoid walls, also where noise pushes them.
    moved = np.moveaxis(indoor_case("G1", 1, 300).truth.states.reshape(301, 8, 3), 1, 0)
    for places in moved[..., :2]:
        assert case.setup.workspace.are_motions_valid(places[:-1], places[1:]).all()


def test_methods_meet_the_same_targets_and_delays_stay_below_the_bound(tmp_path):
    case = indoor_case("four", 0, 130)
    runs = {method: run_method(case, method) for method in ("all_time", "heuristic")}
    assert runs["all_time"].team is None
    assert all(run.error_m.shape == run.eigenvalue_m2.shape == (130,) for run in runs.values())
    team = runs["heuristic"].team
    delays = [one for index in range(4) for one in team_delays(team, index)]
    assert delays
    for one in delays:
        assert one.age_epochs <= case.setup.schedule.delay_bound
        assert one.complete_until <= one.agrees_until <= one.time
        assert (one.error_m > 0.0) == (one.agrees_until < one.time)
    means, uncertainty = team_series(team, team.snapshots[-1])
    assert len(means) == len(uncertainty) == team.snapshots[-1].time
    names = case.setup.robots
    targets = case.truth.states.reshape(131, -1, 3)[:, :, :2]
    file = film_team_run(case.setup.workspace, team, names, targets, tmp_path / "a.gif", frames=3)
    assert file.stat().st_size > 1000
    world, ways = case.setup.workspace, {"r12": team.positions[:50, 0]}
    drawn = {
        "series": draw_two_series(
            {"one": (runs["heuristic"].error_m, runs["heuristic"].eigenvalue_m2)},
            "error",
            marks=[20, 40],
            bound=30,
        ),
        "delays": draw_delays({"one": (np.arange(3.0), np.arange(3.0), np.ones(3))}, "delays"),
        "paths": draw_team_paths(
            world,
            {
                "team 1": (ways, targets[:50]),
                "team 2": ({"r23": team.positions[:50, 1]} | ways, targets[:50]),
            },
            names,
            "paths",
        ),
        "run": draw_team_run(world, team, names, targets, "run", since=10),
    }
    for name, figure in drawn.items():
        assert save(figure, tmp_path / f"{name}.png").stat().st_size > 1000
        assert all(axes.lines or axes.patches for axes in figure.axes)
    # A robot has one colour in every map, whoever else is drawn.
    first, second = (axes.lines for axes in drawn["paths"].axes[:2])
    assert ways["r12"][0, 0] in first[0].get_xdata()
    same = [line for line in second if np.array_equal(line.get_xdata(), ways["r12"][:, 0])]
    assert [line.get_color() for line in same] == [first[0].get_color()]
    with pytest.raises(InvalidInputError, match=r"\.gif"):
        film_team_run(case.setup.workspace, team, names, targets, tmp_path / "a.mp4")


def test_bench_of_two_robots_counts_every_plan_once():
    found = bench_team(2, 3)
    assert sum(found["limit_held_for"].values()) == found["plans"] == 3
    assert found["met"] == 1.0
    assert found["unexplained"] == 0
    assert set(found["failed"]) <= {"uncertainty", "connection", "time"}


@pytest.mark.full
def test_bench_says_what_failed():
    outcome = bench(CommandOptions(quick=True))
    assert [team["robots"] for team in outcome.results["teams"]] == [2, 3, 4]
    by_name = {need.name: need for need in outcome.requirements}
    assert by_name["every_plan_meets"].met
    assert by_name["every_fallback_says_why"].met
    for team in outcome.results["teams"]:
        held = team["limit_held_for"]
        assert sum(held.values()) == team["plans"] == 3
        assert set(team["failed"]) <= {"uncertainty", "connection", "time"}
