"""Whole runs compared with their traces: ids and counts exactly, numbers to 1e-9.

Each scenario says in its first lines what it guards; ``pytest --update-golden`` rewrites traces.
The trace also holds the value of every candidate from scratch under what was agreed, so that a
golden run is an oracle test at the same time.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from golden_trace import RELATIVE, assert_follows

from fgplan.cli.run_recording import draw_candidates, joined_states
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.io.mission_file import load_mission
from fgplan.planners.impacted_paths.candidates import planning_problem
from fgplan.planners.registry import find_planner

FOLDER = Path(__file__).parent
SCENARIOS = sorted(FOLDER.glob("*.toml"))
COUNTS = (
    "turns",
    "announcements",
    "evaluations",
    "factors_added",
    "factors_removed",
    "factors_kept",
    "impacted",
    "untouched",
    "skipped",
    "fallbacks",
)


def trace(path: Path) -> dict:
    """What a run did, as plain data."""
    mission = load_mission(path)
    planner = find_planner("impacted_paths")
    plan = planner.plan(mission, np.random.default_rng(mission.seed))
    candidates = draw_candidates(mission, plan)
    problem = planning_problem(mission)
    evaluator = FromScratch()
    values = {}
    for robot, paths in candidates.items():
        others = {name: chosen for name, chosen in plan.paths.items() if name != robot}
        _, found = evaluator.evaluate(evaluator.start(problem, robot, paths), others)
        values[robot] = found.values.tolist()
    pairs = joined_states(mission, plan.paths)
    return {
        "agreed": plan.agreed,
        "chosen": {item.robot: item.candidate for item in plan.robots},
        "candidates": {
            robot: [[list(path.vertices), path.length_m] for path in paths]
            for robot, paths in candidates.items()
        },
        "objective": [[item.robot, item.value] for item in plan.objective],
        "turns": [
            {key: value for key, value in turn.items() if key != "seconds"}
            for turn in plan.details["turns"]
        ],
        "counts": {name: plan.report[name] for name in COUNTS},
        "joined": [[one.robot, one.step, two.robot, two.step] for one, two in pairs],
        "values_from_scratch": values,
    }


@pytest.mark.parametrize("path", SCENARIOS, ids=[path.stem for path in SCENARIOS])
def test_run_follows_its_trace(path, pytestconfig):
    update = pytestconfig.getoption("--update-golden")
    assert_follows(path.with_suffix(".json"), trace(path), update=update)


@pytest.mark.parametrize("path", SCENARIOS, ids=[path.stem for path in SCENARIOS])
def test_what_was_agreed_is_the_best_response_of_everybody(path):
    found = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    value = found["objective"][-1][1]
    for robot, values in found["values_from_scratch"].items():
        assert values[found["chosen"][robot]] == pytest.approx(value, rel=RELATIVE)
        assert value <= min(values) * (1.0 + 1e-6)  # the tolerance of an announcement


def read(name: str) -> dict:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def test_independent_robots_have_nothing_in_common():
    found = read("independent_robots")
    assert found["joined"] == []
    assert found["chosen"] == {"ann": 0, "bob": 0}
    assert found["counts"]["announcements"] == 0


def test_meeting_changes_a_choice():
    found = read("one_meeting_point")
    assert found["joined"]
    assert found["counts"]["announcements"] >= 1
    assert found["counts"]["factors_added"] > 0


def test_ends_of_the_chain_are_never_joined():
    found = read("chain_of_impacts")
    pairs = {frozenset((one, two)) for one, _, two, _ in found["joined"]}
    assert pairs == {frozenset(("ann", "bob")), frozenset(("bob", "cid"))}


def test_shared_prefix_is_shared():
    found = read("shared_prefix")
    paths = [vertices for vertices, _ in found["candidates"]["ann"]]
    assert len({tuple(vertices[:2]) for vertices in paths}) == 1
    assert min(step for one, step, _, _ in found["joined"] if one == "ann") <= 2
    evaluated = [t for t in found["turns"] if t["robot"] == "ann" and t["evaluated"]]
    assert len(evaluated) > 1
    assert evaluated[-1]["impacted"] == list(range(len(paths)))


def test_of_equal_candidates_the_first_is_kept():
    found = read("tie")
    values = found["values_from_scratch"]["ann"]
    assert len(values) > 1
    np.testing.assert_allclose(values, values[0], rtol=1e-12)
    assert found["chosen"]["ann"] == 0
