"""fgplan reproduce regev-fig6: the short version runs, chooses as from scratch, and draws."""

import numpy as np
import pytest

from fgplan.bench.session import CONTESTANTS, plan_session
from fgplan.io.command import CommandOptions
from fgplan.io.result_file import require_at_least
from fgplan.reproduce.regev_fig6.announcement_change import changes_of, find_change
from fgplan.reproduce.regev_fig6.command import QUICK_COUNTS, _requirements, run
from fgplan.reproduce.regev_fig6.running_times import (
    EVALUATORS,
    PUBLISHED,
    SessionTimes,
    session_results,
)
from fgplan.reproduce.regev_fig6.scenario import draw_scenario

FIGURES = {
    "figure_5_2_robots.png",
    "figure_5_4_robots.png",
    "figure_6a.png",
    "figure_6b.png",
    "figure_7.png",
}


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    recorded = []
    options = CommandOptions(
        out=tmp_path_factory.mktemp("regev"), quick=True, seeds=1, record=recorded.append
    )
    return run(options), recorded


@pytest.fixture(scope="module")
def scenario():
    return draw_scenario(2)


def test_a_case_for_every_team_and_number_of_candidates(outcome):
    found, recorded = outcome
    sizes = [(case["robots"], case["candidates"]) for case in found.results["cases"]]
    assert sizes == [(robots, count) for robots in (2, 4) for count in QUICK_COUNTS]
    for case in found.results["cases"]:
        assert tuple(case["seconds"]) == EVALUATORS
        for seconds in case["seconds"].values():
            low, high = seconds["quartiles"]
            assert 0.0 < seconds["least"] <= low <= seconds["median"] <= high <= seconds["most"]
            assert seconds["sets"] == 1
    assert found.seeds == (0,)
    assert len(recorded) == 1


def test_exact_evaluators_choose_the_same(outcome):
    results = outcome[0].results
    assert results["same_choices"]
    assert results["max_rel_diff"] < 1e-9
    assert all(case["same_choices"] for case in results["cases"])
    assert all(case["same_choices_as_published_share"] in (0.0, 1.0) for case in results["cases"])


def test_figures_are_pictures(outcome):
    found, _ = outcome
    assert {path.name for path in found.figures} == FIGURES
    for path in found.figures:
        assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        assert path.stat().st_size > 10_000


def test_published_numbers_are_those_of_the_text(outcome):
    assert PUBLISHED == {(2, 50): {"Standard approach": 85.0, "proposed approach": 35.0}}
    assert outcome[0].results["published_ratio"] == 85.0 / 35.0


def test_published_ratio_is_required_at_the_published_size(outcome):
    results = dict(outcome[0].results)
    names = [item.name for item in _requirements(results)]
    assert names == ["same_choices", "max_rel_diff"]
    at_50 = {**results["cases"][0], "candidates": 50}
    at_50["ratio_vs_from_scratch"] = {"incremental": 2.0}
    required = _requirements({**results, "cases": [at_50]})[-1]
    name = "ratio_vs_from_scratch at 2 robots, 50 candidates"
    assert required == require_at_least(name, 2.0, 85.0 / 35.0)
    assert not required.met


def test_without_a_folder_nothing_is_drawn(monkeypatch):
    module = "fgplan.reproduce.regev_fig6.command"
    monkeypatch.setattr(f"{module}.time_sessions", lambda *_: pytest.fail("drawn before this"))
    monkeypatch.setattr(f"{module}.find_change", lambda *_: None)
    monkeypatch.setattr("fgplan.viz.figure.save", lambda *_: pytest.fail("no folder was given"))
    with pytest.raises(pytest.fail.Exception, match="drawn before this"):
        run(CommandOptions(quick=True))


def test_scenario_stays_while_candidates_change(scenario):
    one, two = scenario.with_candidates(6, 0), scenario.with_candidates(6, 1)
    again = scenario.with_candidates(6, 0)
    changed = False
    for robot in scenario.robots:
        assert len(one.candidates[robot]) == 6
        for path, same, other in zip(
            one.candidates[robot], again.candidates[robot], two.candidates[robot], strict=True
        ):
            assert path.vertices == same.vertices
            assert path.vertices[0] == other.vertices[0]
            assert path.vertices[-1] == other.vertices[-1]
            np.testing.assert_array_equal(path.poses[0], other.poses[0])
            changed |= path.vertices != other.vertices
        np.testing.assert_array_equal(path.poses[-1, :2], scenario.goals[robot])
    assert changed


def test_change_of_figure_7_is_what_the_evaluator_reports(scenario):
    world = scenario.with_candidates(25, 4)
    _, agreement = plan_session(world, CONTESTANTS["incremental"], scenario.digest)
    decided = {(r.turn, r.robot): r.decision for r in agreement.records if r.decision is not None}
    found = list(changes_of(world, 4, 300.0, scenario.digest))
    assert found
    for change in found:
        report = decided[change.turn, change.robot].report
        assert change.impacted == report.impacted
        assert len(change.kept) == report.factors_kept
        assert len(change.removed) == report.factors_removed
        assert len(change.added) == report.factors_added


def test_figure_7_shows_impacted_and_untouched_under_the_papers_criterion():
    change = find_change(2, 25)
    assert change is not None
    assert change.criterion_m == 300.0
    assert 0 < len(change.impacted) < 25
    assert len(change.kept) > 0
    assert len(change.removed) > 0
    assert len(change.added) > 0
    # A candidate is impacted exactly if it has a factor before or after.
    touched = {
        state.pose.tobytes()
        for pair in (*change.kept, *change.removed, *change.added)
        for state in pair
        if state.robot == change.robot
    }
    paths = change.world.candidates[change.robot]
    for index, path in enumerate(paths):
        meets = any(pose.tobytes() in touched for pose in path.poses[1:])
        assert meets == (index in change.impacted)


def test_session_that_never_agrees_is_given_up_and_counted(monkeypatch):
    # One turn is not enough for anybody: every session is given up.
    monkeypatch.setattr("fgplan.reproduce.regev_fig6.running_times.MOST_TURNS", 1)
    times = SessionTimes(2, 3)
    times.time_set(draw_scenario(2), 0)
    assert times.endless == {name: [0] for name in EVALUATORS}
    monkeypatch.undo()
    times.time_set(draw_scenario(2), 1)
    found = session_results(times)
    assert not found["same_choices"]
    for seconds in found["seconds"].values():
        assert (seconds["sets"], seconds["sets_without_agreement"]) == (1, 1)


def test_results_of_an_evaluator_that_never_agreed():
    times = SessionTimes(2, 3)
    times.time_set(draw_scenario(2), 0)
    times.endless["as_published"] = list(times.seconds["as_published"])
    times.seconds["as_published"].clear()
    times.agreements["as_published"].clear()
    found = session_results(times)
    assert found["same_choices"]
    assert found["same_choices_as_published_share"] == 0.0
    assert found["ratio_vs_from_scratch"]["as_published"] is None
    assert found["seconds"]["as_published"]["median"] is None
