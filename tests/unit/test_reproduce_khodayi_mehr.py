"""fgplan reproduce khodayi-mehr-table1 and -fig5 to -fig9: short runs, and their judgement."""

import numpy as np
import pytest

from fgplan.io.command import CommandOptions
from fgplan.reproduce.khodayi_mehr_figures import command as figures
from fgplan.reproduce.khodayi_mehr_table1.command import (
    METHODS,
    PUBLISHED,
    QUANTITIES,
    paired_interval,
    requirements,
    run,
)


def judged(changes):
    """A table with the published numbers, some of them changed; ten seeds that differ a little."""
    cases = []
    for targets, methods in PUBLISHED.items():
        case = {"targets": targets}
        noise = 0.01 * np.random.default_rng(0).standard_normal(10)
        for method in METHODS:
            case[method] = {}
            for quantity in QUANTITIES:
                mean = changes.get((targets, method, quantity), methods[method][quantity][0])
                case[method][quantity] = mean
                case[method][f"{quantity}_by_seed"] = (mean + noise).tolist()
                case[method][f"{quantity}_published"] = methods[method][quantity][0]
        case["differences"] = {
            f"{method}_{q}": paired_interval(
                case[method][f"{q}_by_seed"], case["intermittent"][f"{q}_by_seed"]
            )
            for method in METHODS[:2]
            for q in QUANTITIES
        }
        cases.append(case)
    return {need.name: need for need in requirements(cases)}


def test_published_table_meets_its_own_requirements():
    needs = judged({})
    assert all(need.met for need in needs.values())
    assert needs["comparisons_that_intermittent_wins"].value == 4


def test_losses_and_far_baselines_are_seen():
    needs = judged({(4, "intermittent", "error_m"): 1.5, (8, "intermittent", "error_m"): 1.3})
    assert needs["comparisons_that_intermittent_wins"].value == 2
    assert not needs["comparisons_that_intermittent_wins"].met
    assert needs["intermittent_is_worst_in_none"].met
    assert not judged({(4, "intermittent", "error_m"): 2.5})["intermittent_is_worst_in_none"].met
    far = judged({(8, "heuristic", "eigenvalue_m2"): 0.7})
    assert not all(need.met for name, need in far.items() if name.startswith("heuristic_eigen"))


def test_interval_by_hand():
    # Differences 1, 2, 3: mean 2, deviation 1, t(0.975, 2) = 4.3027 over sqrt 3.
    found = paired_interval([2.0, 4.0, 6.0], [1.0, 2.0, 3.0])
    assert found["mean"] == pytest.approx(2.0, rel=1e-12)
    assert found["upper"] - found["mean"] == pytest.approx(4.302652729911275 / 3**0.5, rel=1e-9)
    assert paired_interval([1.0], [0.0])["lower"] == -np.inf


@pytest.mark.full
def test_table_in_a_short_run():
    outcome = run(CommandOptions(quick=True))
    assert [case["targets"] for case in outcome.results["cases"]] == [4, 8]
    for case in outcome.results["cases"]:
        for method in METHODS:
            assert case[method]["error_m"] > 0.0
            assert case[method]["eigenvalue_m2"] > 0.0
            assert len(case[method]["error_m_by_seed"]) == 2
    assert outcome.results["unprinted"]["samples"] == 600
    assert outcome.requirements == ()


@pytest.mark.full
@pytest.mark.parametrize("name", ["fig5", "fig6", "fig7", "fig8", "fig9"])
def test_figures_in_short_runs(name, tmp_path):
    outcome = getattr(figures, name)(CommandOptions(quick=True, out=tmp_path, seeds=1))
    assert outcome.requirements == ()
    assert "unprinted" in outcome.results
    for path in outcome.figures:
        assert path.stat().st_size > 1000
