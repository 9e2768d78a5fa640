"""fgplan reproduce kantaros-convergence: bound (7), its constants, and the short version."""

import numpy as np
import pytest
from scipy.stats import binomtest

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.io.command import CommandOptions
from fgplan.planners.aia.baseline import Budget
from fgplan.planners.aia.options import tree_options
from fgplan.reproduce.kantaros_convergence import command
from fgplan.reproduce.kantaros_convergence.convergence_bound import (
    least_alpha,
    probability_bound,
    reachable_configurations,
)


def test_the_short_version_meets_its_requirements_and_draws(tmp_path):
    recorded = []
    outcome = command.run(CommandOptions(out=tmp_path, quick=True, record=recorded.append))
    assert outcome.seeds == tuple(range(8))
    assert all(need.met for need in outcome.requirements)
    assert [path.name for path in outcome.figures] == ["convergence.png"]
    assert len(recorded) == 2
    for row in outcome.results["rows"]:
        assert row["seeds_optimal"] == 8
        assert min(row["first_iterations"]) >= outcome.results["constants"]["horizon"]
        assert row["empirical_reaches"]["0.99"] < row["bound_reaches"]["0.99"]
    assert any("reconstructed" in line for line in outcome.summary)


def test_more_iterations_do_not_change_when_the_optimum_was_found():
    problem = command.tiny_scene()
    optimum = command.optimal_path(problem).cost
    options = command.densities()["uniform"]
    long = command.first_iterations(problem, options, optimum, range(6), 5000)
    limit = int(np.median(long))
    short = command.first_iterations(problem, options, optimum, range(6), limit)
    np.testing.assert_array_equal(short, np.where(long <= limit, long, np.inf))


def test_requirements_fail_below_the_bound_and_without_the_optimum():
    bound = np.full(100, 0.9)
    curve = command.compare(np.full(20, np.inf), bound, bound)
    row = {"densities": "any"} | command.summarise([np.inf] * 20, curve)
    assert row["margin"] < 0.0
    assert row["first_iterations"] == [None] * 20
    assert row["printed_form_fails_at"] == 1
    assert [need.met for need in command.requirements([row])] == [False, False]


def test_seeds_that_were_cut_off_are_compared_up_to_there_and_said():
    outcome = command.run(CommandOptions(quick=True, arguments={"iterations": 5}))
    for row, margin, optimal in zip(
        outcome.results["rows"], outcome.requirements[::2], outcome.requirements[1::2], strict=True
    ):
        assert row["seeds_optimal"] < row["seeds"]
        assert margin.met  # the bound says nothing by iteration 5
        assert not optimal.met
    assert "not reached" in outcome.summary[-1]
    assert outcome.figures == ()


def test_no_iterations_are_refused():
    with pytest.raises(InvalidInputError, match="--iterations: expected at least 1, got 0"):
        command.run(CommandOptions(quick=True, arguments={"iterations": 0}))


def test_the_interval_is_clopper_pearson_s():
    low, high = command.binomial_interval(np.array([0.0, 3.0, 20.0]), 20)
    for place, successes in enumerate((0, 3, 20)):
        exact = binomtest(successes, 20).proportion_ci(0.95, "exact")
        assert low[place] == pytest.approx(exact.low, rel=1e-9, abs=1e-12)
        assert high[place] == pytest.approx(exact.high, rel=1e-9)


def test_three_by_three_cells_are_nine_configurations():
    assert reachable_configurations(command.tiny_scene()) == 9


def test_alpha_counts_groups_controls_and_both_densities():
    count = np.array([1.0, 4.0, 50.0])
    uniform = least_alpha(count, 9, 8, tree_options("paper", uniform_after=0))
    np.testing.assert_allclose(uniform, [1 / 8, 1 / 32, 1 / 72], rtol=1e-15)
    biased = least_alpha(count, 9, 8, tree_options("paper", p_group=0.8, p_control=0.7))
    np.testing.assert_allclose(biased, 0.2 * 0.3 * uniform, rtol=1e-12)


def test_the_bound_is_below_the_poisson_binomial_tail_and_its_printed_form_is_not():
    # Equal alphas make the proof's Y binomial: P(Y >= F) is known.
    from scipy.stats import binom

    alpha, horizon = np.full(2000, 0.02), 3
    count = np.arange(1, 2001)
    tail = binom.sf(horizon - 1, count, 0.02)
    bound = probability_bound(alpha, horizon)
    assert (bound <= tail).all()
    assert bound[-1] == pytest.approx(1.0 - np.exp(3.0 - 20.0), rel=1e-12)
    assert not bound[: 2 * 3 * 50].any()
    assert (probability_bound(alpha, horizon, printed=True) > tail).any()
    assert not probability_bound(np.ones(5), 4)[:4].any()  # stated for n > F


def test_a_scene_too_large_for_the_exhaustive_search_is_refused(monkeypatch):
    monkeypatch.setattr(command, "Budget", lambda **_: Budget(nodes=5))
    with pytest.raises(NoCandidatePathError, match="without an optimum"):
        command.optimal_path(command.tiny_scene())
