"""fgplan bench consistency: SLAM's covariances are those of its errors; arrivals are as planned."""

import argparse

import numpy as np
import pytest

from fgplan.bench import consistency
from fgplan.bench.consistency import (
    QUICK_CANDIDATES,
    QUICK_GOALS,
    QUICK_SEEDS,
    add_arguments,
    judge_plans,
    judge_slam,
    make_task,
    measure_mission,
    position_trace,
    run,
)
from fgplan.closed_loop.loop import run_loop
from fgplan.closed_loop.records import SessionRecord, StepRecord
from fgplan.closed_loop.unknown_world import draw_mission
from fgplan.errors import FgplanError, InvalidInputError
from fgplan.io.command import CommandOptions
from fgplan.simulation.sweep import SweepRecord, SweepSummary, SweepTask
from fgplan.slam.consistency import normalised_error_squared

SEEDS = 12
"""Fewer than the bench's 50, of short missions: a mean of 12 x 3 squares."""


@pytest.fixture(scope="module")
def missions():
    return [
        measure_mission(make_task(seed, 1, QUICK_CANDIDATES, QUICK_GOALS)) for seed in range(SEEDS)
    ]


def test_slam_is_consistent_in_short_missions(missions):
    found = judge_slam(missions)
    assert found["inside"] >= consistency.SMALLEST_INSIDE
    # 3 expected; the mean over steps is of correlated numbers, so this is no sharp bound.
    assert 2.5 < found["mean_error"] < 3.5
    assert found["inside"] + found["above"] + found["below"] == pytest.approx(1.0)
    assert {row["seeds"] for row in found["errors"]} <= set(range(SEEDS // 2, SEEDS + 1))


def test_a_mission_is_measured_as_it_is_recorded(missions):
    """Errors end with a robot's last arrival, and the plan is the last one before it."""
    found = missions[0]
    records = list(run_loop(draw_mission(0, 1, candidates=QUICK_CANDIDATES, goals=QUICK_GOALS)))
    steps = [record for record in records if isinstance(record, StepRecord)]
    sessions = [record for record in records if isinstance(record, SessionRecord)]
    assert len(found["arrivals"]) == 4
    for arrival in found["arrivals"]:
        robot, step = arrival["robot"], steps[arrival["step"]]
        assert robot in step.arrived
        assert len(found["errors"][robot]) == step.step + 1
        assert arrival["reported"] == position_trace(step.covariances[robot])
        planned = [one.covariances[robot][-1] for one in sessions if one.step < step.step]
        assert arrival["planned"]["leg"] == position_trace(planned[0])
        assert arrival["planned"]["last"] == position_trace(planned[-1])
        last = normalised_error_squared(
            step.estimates[robot], step.truth[robot], step.covariances[robot]
        )
        assert found["errors"][robot][-1] == last


def _errors(values):
    return [{"errors": {"red": [value] * 3}} for value in values]


@pytest.mark.parametrize(
    ("values", "inside", "above", "below"),
    [([3.0, 3.0], 1.0, 0.0, 0.0), ([20.0, 20.0], 0.0, 1.0, 0.0), ([0.1, 0.1], 0.0, 0.0, 1.0)],
)
def test_errors_are_judged_by_the_interval_of_their_number(values, inside, above, below):
    found = judge_slam(_errors(values))
    assert (found["inside"], found["above"], found["below"]) == (inside, above, below)
    # Chi-square with 6 degrees, two-sided 95 %: 1.2373 to 14.4494, over two seeds; tables have four
    # digits after the point.
    interval = found["errors"][0]["interval"]
    np.testing.assert_allclose(interval, [0.61867, 7.22469], rtol=1e-4)


def test_steps_that_few_seeds_reached_are_left_out():
    found = judge_slam([{"errors": {"red": [3.0] * length}} for length in (1, 1, 3, 4)])
    assert [(row["step"], row["seeds"]) for row in found["errors"]] == [(0, 4), (1, 2), (2, 2)]


def test_plans_are_compared_by_their_ratio():
    arrival = {"step": 1, "robot": "red", "reported": 2.0}
    missions = [
        {"seed": 0, "arrivals": [{**arrival, "planned": {"leg": 4.0, "last": 2.0}}]},
        {"seed": 1, "arrivals": [{**arrival, "planned": {"leg": 16.0, "last": 2.0}}]},
    ]
    found = judge_plans(missions)
    assert found["planned_over_reported"]["leg"]["mean"] == 5.0
    assert found["planned_over_reported"]["leg"]["geometric_mean"] == pytest.approx(4.0)
    assert found["planned_over_reported"]["last"]["quartiles"] == [1.0, 1.0, 1.0]
    assert [each["seed"] for each in found["arrivals"]] == [0, 1]


@pytest.fixture
def swept_here(monkeypatch, missions):
    """Missions that were measured above instead of other processes."""

    def sweep(tasks, function, *, out, workers, progress):
        assert function is measure_mission
        out.write_text("")
        progress(len(tasks), len(tasks), "tasks")
        records = [
            SweepRecord(task.digest, task, "done", result=missions[task.seed]) for task in tasks
        ]
        return SweepSummary(records=tuple(records), skipped=0)

    monkeypatch.setattr(consistency, "run_sweep", sweep)


def test_the_quick_bench_reports_and_draws(swept_here, tmp_path):
    (tmp_path / consistency.MISSIONS_FILE).write_text("of another run")
    told = []
    outcome = run(
        CommandOptions(quick=True, out=tmp_path, progress=lambda *words: told.append(words))
    )
    assert told == [(QUICK_SEEDS, QUICK_SEEDS, "missions")]
    assert outcome.seeds == tuple(range(QUICK_SEEDS))
    assert [item.required for item in outcome.requirements] == ["at least 0.9"]
    assert outcome.requirements[0].value == outcome.results["inside"]
    assert "12 arrivals" not in outcome.summary[2]
    assert "16 arrivals" in outcome.summary[2]
    for path in outcome.figures:
        assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        assert path.stat().st_size > 10_000


def test_a_failed_mission_is_not_judged_away(monkeypatch, tmp_path):
    def sweep(tasks, *_, **__):
        record = SweepRecord(tasks[1].digest, tasks[1], "failed", error="ValueError: no")
        return SweepSummary(records=(record,), skipped=0)

    monkeypatch.setattr(consistency, "run_sweep", sweep)
    with pytest.raises(FgplanError, match=r"seed 1: the mission failed(.|\n)*ValueError: no"):
        run(CommandOptions(quick=True))


@pytest.mark.parametrize(("seeds", "workers"), [(1, 1), (2, 0)])
def test_one_seed_or_no_worker_is_refused(seeds, workers):
    options = CommandOptions(quick=True, seeds=seeds, arguments={"workers": workers})
    with pytest.raises(InvalidInputError, match="expected --seeds 2 or more"):
        run(options)


def test_arguments_have_their_defaults():
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    assert vars(parser.parse_args([])) == {"scenario": 1, "workers": 1, "resume": False}


def test_a_task_is_another_one_with_other_numbers():
    digests = {
        make_task(seed, scenario, candidates, 1).digest
        for seed in (0, 1)
        for scenario in (1, 2)
        for candidates in (3, 4)
    }
    assert len(digests) == 8
    again = make_task(0, 1, 3, 1)
    assert SweepTask(seed=0, arguments=again.arguments).digest in digests
