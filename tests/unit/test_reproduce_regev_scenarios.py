"""fgplan reproduce regev-scenarios: short missions run, choose as from scratch, and are drawn."""

import argparse
import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fgplan.closed_loop.comparison import EVERYBODY
from fgplan.errors import FgplanError, InvalidInputError
from fgplan.io.command import CommandOptions
from fgplan.reproduce.regev_scenarios import command, mission_run
from fgplan.reproduce.regev_scenarios.command import (
    PUBLISHED,
    QUICK_CANDIDATES,
    QUICK_GOALS,
    add_arguments,
    run,
)
from fgplan.reproduce.regev_scenarios.mission_run import MissionCase, ratios, run_mission
from fgplan.reproduce.regev_scenarios.scenario_summary import (
    messages_taken_over,
    summarise,
    trace_without_meetings,
)
from fgplan.simulation.sweep import SweepRecord, SweepSummary
from fgplan.viz import loop_figures
from fgplan.viz.loop_figures import draw_loop_figures

LEAST_MISSION = "messages_reused in session 3 by robots that kept candidates, least mission"
ROBOTS = ("red", "green", "blue", "purple")


def _here(tasks, function, *, out, workers, progress):
    """A sweep in this process: kernels are compiled already, and nothing is started."""
    assert isinstance(function, partial)
    records = []
    with out.open("a") as file:
        for done, task in enumerate(tasks, start=1):
            record = SweepRecord(task.digest, task, "done", result=function(task), seconds=1.0)
            json.dumps(record.result, allow_nan=False)
            records.append(record)
            file.write(
                json.dumps(
                    {
                        "schema": "sweep.v1",
                        "digest": record.digest,
                        "seed": task.seed,
                        "arguments": dict(task.arguments),
                        "status": "done",
                        "result": record.result,
                        "error": "",
                        "seconds": 1.0,
                    }
                )
                + "\n"
            )
            file.flush()
            progress(done, len(tasks), "tasks")
    return SweepSummary(records=tuple(records), skipped=0)


def _draw_first_session(history, folder, workspace):
    """The figures; those of the other sessions are no different (test_viz_loop_figures)."""
    return draw_loop_figures(replace(history, sessions=history.sessions[:1]), folder, workspace)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    recorded = []
    folder = tmp_path_factory.mktemp("scenarios")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "run_sweep", _here)
        patch.setattr(mission_run, "warm_up", lambda *_: None)  # nobody reads these times
        patch.setattr(loop_figures, "draw_loop_figures", _draw_first_session)
        options = CommandOptions(
            out=folder, quick=True, record=recorded.append, arguments={"scenarios": "1,2"}
        )
        found = run(options)
    return found, recorded, folder


def test_an_entry_a_mission(outcome):
    found, recorded, _ = outcome
    entries = found.results["scenarios"]
    which = [(one["scenario"], one["variant"], one["seed"]) for one in entries]
    assert which == [
        (1, "as_published", 0),
        (2, "as_published", 0),
        (2, "own_landmarks", 0),
    ]
    assert [len(each["scenarios"]) for each in recorded] == [1, 2, 3]
    for one in entries:
        assert tuple(one["position_trace_end"]) == ROBOTS
        for robot in ROBOTS:
            assert 0.0 < one["position_trace_start"][robot] <= one["position_trace_max"][robot]
            assert one["position_trace_end"][robot] <= one["largest_position_trace"]
        assert max(one["largest_position_trace_by_step"]) == one["largest_position_trace"]
        assert len(one["largest_position_trace_by_step"]) == one["steps"] + 1


def test_everybody_plans_every_session_and_chooses_the_same(outcome):
    found = outcome[0]
    for one in found.results["scenarios"]:
        timed = one["variant"] == "as_published"
        for place, held in enumerate(one["sessions"], start=1):
            assert held["session"] == place
            assert set(held["seconds"]) == (set(EVERYBODY) if timed else {"incremental_choose"})
            assert held["same_choices"] is (True if timed else None)
            assert (held["max_rel_diff"] is not None) == timed
            assert (held["ratio"] is not None) == timed
        if timed:
            total = sum(held["seconds"]["from_scratch"] for held in one["sessions"])
            ours = sum(held["seconds"]["incremental_choose"] for held in one["sessions"])
            assert one["ratio_choose_total"] == pytest.approx(total / ours)
    assert [item.name for item in found.requirements] == ["same_choices", "max_rel_diff"]
    assert all(item.met for item in found.requirements)


def test_scenario_2_plans_without_factors_between_robots(outcome):
    for one in outcome[0].results["scenarios"]:
        if one["scenario"] == 2:
            assert all(held["factors"]["multi_robot"] == 0 for held in one["sessions"])
    for case in command._cases(CommandOptions(quick=True), (0,)):
        assert bool(case.mission().multi_robot) == (case.scenario != 2)


def test_only_red_and_green_start_uncertain_in_scenario_3():
    (case,) = command._cases(CommandOptions(quick=True, arguments={"scenarios": "3"}), (0,))
    spread = {robot.name: np.trace(robot.start_covariance) for robot in case.mission().robots}
    assert {robot for robot, trace in spread.items() if trace > 100.0} == {"red", "green"}


def test_figures_are_pictures(outcome):
    found, _, folder = outcome
    names = {str(path.relative_to(folder)) for path in found.figures}
    for scenario in (1, 2):
        assert {
            f"scenario_{scenario}/session_1_candidates.png",
            f"scenario_{scenario}/session_1_chosen.png",
            f"scenario_{scenario}/session_1_slam.png",
            f"scenario_{scenario}/position_covariance.png",
            f"scenario_{scenario}/running_times.png",
            f"scenario_{scenario}_running_times.png",
        } <= names
    assert "position_covariance.png" in names
    for path in found.figures:
        assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        assert path.stat().st_size > 10_000


def test_summary_has_published_numbers_beside_ours(outcome):
    found = outcome[0]
    assert PUBLISHED == {
        "scenario_1_session_2": 2.0,
        "scenario_1_session_3": 7.0,
        "all_least": 2.0,
        "all_most": 8.0,
    }
    assert found.results["published"] == PUBLISHED
    assert "ratio 2 in session 2, 7 in session 3; 2 to 8" in found.summary[-1]
    assert found.summary[0].startswith("scenario 1: 1 missions")


def _mission(scenario, seed, *, trace=10.0, reused=5, steps_left=9, end=100.0, ratio=30.0):
    """A mission of three sessions, planned by all."""
    seconds = {
        "incremental_choose": 0.5,
        "incremental": 1.0,
        "from_scratch": ratio,
        "from_scratch_fastest": 0.5 * ratio,
    }
    held = {
        "seconds": seconds,
        **ratios(seconds),
        "impacted_share": 0.5,
        "factors": {"multi_robot": 1, "landmark": 2},
        "candidates_kept": {"red": 0, "green": 4},
        "messages_reused": {"red": 0, "green": reused},
        "steps_left": {"red": 12, "green": steps_left},
    }
    return {
        "scenario": scenario,
        "variant": "as_published",
        "seed": seed,
        "sessions": [{"session": number, **held} for number in (1, 2, 3)],
        "seconds_total": {name: 3.0 * each for name, each in seconds.items()},
        **ratios(seconds, "_total"),
        "same_choices": True,
        "max_rel_diff": 1e-13,
        "position_trace_start": {"red": 800.0, "green": 800.0},
        "position_trace_max": {"red": 900.0, "green": trace},
        "position_trace_end": {"red": end, "green": 1.0},
        "largest_position_trace": trace,
    }


def _judge(missions):
    """Requirements on missions of full size, by name."""
    results = command._results(missions, CommandOptions())
    return {item.name: item for item in command._requirements(missions, results, full=True)}


def test_requirements_are_those_of_the_issue():
    missions = [_mission(1, 0), _mission(1, 1), _mission(2, 0, trace=12.5), _mission(3, 0)]
    judged = _judge(missions)
    assert all(item.met for item in judged.values())
    assert judged["scenario 1: ratio_total"].value == pytest.approx(30.0)
    assert judged["scenario 1: ratio_total"].required == "at least 10"
    assert judged["scenario 1: ratio_choose_total"].value == pytest.approx(60.0)
    assert judged["scenario 1: ratio_choose_total"].required == "at least 20"
    name = "largest position trace, scenario 2 over scenario 1, of medians"
    assert judged[name].value == 1.25
    assert judged[name].required == "at least 1.2"
    name = "scenario 3: position_trace_end over start of red, worst seed"
    assert judged[name].value == 0.125
    assert judged[name].required == "at most 0.3"


@pytest.mark.parametrize(
    ("change", "unmet"),
    [
        ({"ratio": 9.0}, {"scenario 3: ratio_total", "scenario 3: ratio_choose_total"}),
        ({"end": 300.0}, {"scenario 3: position_trace_end over start of red, worst seed"}),
        ({"reused": 0}, {LEAST_MISSION}),
    ],
)
def test_each_requirement_can_fail(change, unmet):
    judged = _judge([_mission(3, 0, **change)])
    assert {name for name, item in judged.items() if not item.met} == unmet


def test_a_choice_that_differs_fails():
    judged = _judge([_mission(1, 0), {**_mission(1, 1), "same_choices": False}])
    assert not judged["same_choices"].met
    judged = _judge([{**_mission(1, 1), "max_rel_diff": 2e-9}])
    assert not judged["max_rel_diff"].met


def test_summaries_are_over_seeds():
    missions = [_mission(1, seed, trace=10.0 + seed, ratio=20.0 + 10.0 * seed) for seed in range(3)]
    (entry,) = summarise(missions)
    assert entry["missions"] == 3
    assert entry["sessions"] == 9
    assert entry["largest_position_trace"] == 11.0
    assert entry["ratio_total"] == pytest.approx(30.0)
    assert entry["ratio_total_least"]["ratio_total"] == 20.0
    assert entry["by_session"][1]["ratio"] == 30.0
    assert entry["by_session"][1]["messages_reused"] == 5.0
    assert trace_without_meetings([entry]) is None


def test_messages_are_those_of_robots_that_kept_candidates():
    missions = [_mission(1, 0), _mission(2, 4, reused=0, steps_left=3)]
    common = {"variant": "as_published", "robot": "green"}
    assert messages_taken_over(missions, 3) == [
        {"scenario": 1, "seed": 0, "steps_left": 9, "messages_reused": 5, **common},
        {"scenario": 2, "seed": 4, "steps_left": 3, "messages_reused": 0, **common},
    ]
    assert messages_taken_over(missions, 4) == []


def test_who_is_about_to_arrive_need_not_take_over_messages():
    """Green is three steps from its goal in session 3 and red took over some."""
    one = _mission(1, 0, reused=0, steps_left=3)
    for held in one["sessions"]:
        held["candidates_kept"] = {"red": 2, "green": 4}
        held["messages_reused"] = {"red": 7, "green": 0}
    judged = _judge([one])
    assert judged[LEAST_MISSION].value == 7
    assert judged[LEAST_MISSION].met


def test_a_failed_mission_is_not_judged_away(monkeypatch):
    def sweep(tasks, *_, **__):
        record = SweepRecord(tasks[2].digest, tasks[2], "failed", error="ValueError: no")
        return SweepSummary(records=(record,), skipped=0)

    monkeypatch.setattr(command, "run_sweep", sweep)
    expected = r"scenario 2 \(own_landmarks\), seed 0: the mission failed(.|\n)*ValueError: no"
    with pytest.raises(FgplanError, match=expected):
        run(CommandOptions(quick=True))


@pytest.mark.parametrize("resume", [False, True])
def test_finished_missions_stay_only_if_asked(monkeypatch, tmp_path, resume):
    file = tmp_path / command.MISSIONS_FILE
    file.write_text("")

    def sweep(*_, out, **__):
        assert out.exists() == resume
        raise InvalidInputError("seen")

    monkeypatch.setattr(command, "run_sweep", sweep)
    with pytest.raises(InvalidInputError, match="seen"):
        run(CommandOptions(quick=True, out=tmp_path, arguments={"resume": resume}))


@pytest.mark.parametrize("scenarios", ["4", "1,1", "", "one"])
def test_unknown_scenarios_are_refused(scenarios):
    with pytest.raises(InvalidInputError, match="--scenarios: expected some of 1, 2 and 3"):
        run(CommandOptions(quick=True, arguments={"scenarios": scenarios}))


def test_no_worker_is_refused():
    with pytest.raises(InvalidInputError, match="--workers: expected 1 or more"):
        run(CommandOptions(quick=True, arguments={"workers": 0}))


def test_arguments_have_their_defaults():
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    found = vars(parser.parse_args([]))
    assert found == {"scenarios": "1,2,3", "workers": 1, "resume": False}


def test_a_case_is_its_task():
    case = MissionCase(
        scenario=2, variant="own_landmarks", seed=1, candidates=QUICK_CANDIDATES, goals=QUICK_GOALS
    )
    assert not case.timed
    assert (
        case.task().digest
        != MissionCase(
            scenario=2,
            variant="as_published",
            seed=1,
            candidates=QUICK_CANDIDATES,
            goals=QUICK_GOALS,
        )
        .task()
        .digest
    )
    found = run_mission(case.task())
    assert (found["scenario"], found["variant"], found["seed"]) == (2, "own_landmarks", 1)
    assert found["figures"] == []
