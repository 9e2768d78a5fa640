"""Whole runs of the planner ``intermittent`` compared with their traces."""

from pathlib import Path

import numpy as np
import pytest
from golden_trace import assert_follows

from fgplan.io.mission_file import load_mission
from fgplan.planners.registry import find_planner

SCENARIOS = sorted((Path(__file__).parent / "intermittent").glob("*.toml"))


def trace(path: Path) -> dict:
    """What a run did, as plain data."""
    mission = load_mission(path)
    plan = find_planner("intermittent").plan(mission, np.random.default_rng(mission.seed))
    details = plan.details
    return {
        "schedules": details["schedules"],
        "period": details["period"],
        "delay_bound_epochs": details["delay_bound_epochs"],
        "meetings": details["meetings"],
        "counts": dict(plan.report),
        "messages": {kind: counts["sent"] for kind, counts in plan.traffic.items()},
        "objective": plan.value,
        "ends": {name: path.poses[-1, :2].tolist() for name, path in plan.paths.items()},
        "target_means_at_end": details["target_means"][-1],
        "target_covariance_at_end": details["target_covariance_at_end"],
    }


@pytest.mark.parametrize("path", SCENARIOS, ids=[path.stem for path in SCENARIOS])
def test_team_follows_its_trace(path, pytestconfig):
    came = trace(path)
    assert len(came["meetings"]) >= 4
    update = pytestconfig.getoption("--update-golden")
    assert_follows(path.with_suffix(".json"), came, update=update)
