"""The roadmap bench runs and measures both engines (its times are claimed by the bench itself)."""

from fgplan.bench.roadmap import run
from fgplan.io.command import CommandOptions


def test_both_engines_are_measured():
    outcome = run(CommandOptions(quick=True, seeds=1))
    assert set(outcome.results) == {"prm_ms_shapely", "prm_ms_numpy"}
    assert all(value > 0.0 for value in outcome.results.values())
    assert [r.name for r in outcome.requirements] == ["prm_ms_shapely", "prm_ms_numpy"]
