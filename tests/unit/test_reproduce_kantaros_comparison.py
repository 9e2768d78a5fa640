"""fgplan reproduce kantaros-comparison: the optimum as yardstick, requirements, lines to print."""

import numpy as np
import pytest

from fgplan.reproduce.kantaros_comparison.command import (
    RESTARTS,
    find_optimum,
    plan_scene,
    requirements,
    small_scenes,
    summarise,
    summary,
)

OPTIMUM = 0.26796140175640354
"""Of the scene 1/2, from exhaustive search without a bound."""


@pytest.fixture(scope="module")
def scene():
    return small_scenes()["1/2"]


def row(scene, planner, cost, seed=0):
    return {
        "scene": scene,
        "planner": planner,
        "seed": seed,
        "solved": cost is not None,
        "cost": cost,
        "horizon": None if cost is None else 7,
        "runtime_s": 0.5,
        "best_at_s": 0.25 if planner == "aia" else None,
    }


def test_the_tree_is_at_the_optimum_that_the_bounded_search_finds(scene):
    ours = plan_scene(scene, "aia", 20.0, small=True)
    assert ours["solved"]
    assert 0.0 <= ours["best_at_s"] <= ours["runtime_s"]
    optimum = find_optimum(scene, ours["cost"], 20.0)
    assert optimum["cost"] == pytest.approx(OPTIMUM, rel=1e-12)
    assert ours["cost"] == pytest.approx(OPTIMUM, rel=1e-12)
    # A dearer known plan changes nothing but the work.
    dearer = find_optimum(scene, 0.285, 20.0)
    assert dearer["cost"] == pytest.approx(OPTIMUM, rel=1e-12)
    assert dearer["nodes"] > optimum["nodes"]


def test_an_optimum_not_found_in_time_is_none(scene):
    assert find_optimum(scene, np.inf, 1e-3)["cost"] is None


def test_restarts_are_not_dearer_than_the_first_feasible_plan(scene):
    first = plan_scene(scene, "aia", 1.0, small=False)
    again = plan_scene(scene, RESTARTS, 1.0, small=False)
    assert OPTIMUM * (1 - 1e-9) <= again["cost"] <= first["cost"]


def test_a_baseline_has_the_same_columns(scene):
    greedy = plan_scene(scene, "greedy", 5.0, small=True)
    assert greedy["solved"]
    assert greedy["best_at_s"] is None
    assert greedy["cost"] >= OPTIMUM * (1 - 1e-9)


@pytest.mark.parametrize(
    ("ours", "other", "optimum", "met"),
    [
        (0.5, 0.6, 0.5, [True, True, True]),
        (0.5, 0.4, None, [True, False]),
        (0.5, None, 0.4, [True, True, False]),
        (None, 0.6, 0.5, [False]),
    ],
)
def test_requirements_of_a_small_scene(ours, other, optimum, met):
    rows = [row("1/2", "aia", ours), row("1/2", "rig_tree", other)]
    optima = [{"scene": "1/2", "cost": optimum, "nodes": 7, "runtime_s": 0.1}]
    assert [need.met for need in requirements(rows, optima)] == met


def test_every_seed_counts():
    rows = [row("10/20", name, 30.0, seed) for seed in (0, 1) for name in ("aia", RESTARTS)]
    assert all(need.met for need in requirements(rows, []))
    cheaper = [*rows, row("10/20", "dec_mcts", 29.0, seed=1)]
    assert [need.met for need in requirements(cheaper, [])] == [True, False]
    unsolved = [*rows[:2], row("10/20", "aia", None, 1), rows[3]]
    assert [need.met for need in requirements(unsolved, [])] == [False]
    first, second = summarise([row("10/20", "aia", 20.0), row("10/20", "aia", 30.0, 1), rows[1]])
    assert (first["solved"], first["seeds"], second["seeds"]) == (2, 2, 1)
    assert (first["cost"], first["least_cost"], first["greatest_cost"]) == (25.0, 20.0, 30.0)
    (nobody,) = summarise([row("10/20", "fvi", None)])
    assert (nobody["solved"], nobody["cost"], nobody["horizon"]) == (0, None, None)


def test_the_large_scene_compares_what_has_the_same_time():
    rows = [row("10/20", "aia", 31.4), row("10/20", RESTARTS, 27.0), row("10/20", "fvi", None)]
    rows.append(row("10/20", "dec_mcts", 31.2))
    needs = requirements(rows, [])
    assert [need.name for need in needs] == [
        "10/20: aia solves every seed",
        "10/20: nobody is cheaper than aia, restarts",
    ]
    assert all(need.met for need in needs)


def test_lines_say_who_failed_and_what_is_published():
    rows = [row("1/2", "aia", 0.5), row("1/2", "fvi", None), row("1/2", "rig_tree", 0.6)]
    optima = [
        {"scene": "1/2", "cost": 0.5, "nodes": 7, "runtime_s": 0.1},
        {"scene": "2/3", "cost": None, "nodes": 9, "runtime_s": 0.1},
    ]
    lines = summary(summarise(rows), optima)
    assert len(lines) == 5
    assert "1/1 cost   0.500 (0.500 to 0.500), F   7.0 in 0.50 s, had after 0.25 s" in lines[0]
    assert "no plan within the budget" in lines[1]
    assert lines[2].endswith("published: 2.25 in 2.23 s")
    assert "optimum        cost 0.500000, 7 nodes" in lines[3]
    assert "not known within the budget" in lines[4]
