"""Baselines: one interface, feasible plans, and an exhaustive search that is exhaustive."""

import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pytest
from aia_scenes import OPTIMA, lattice_problem, tiny_problem

from fgplan.errors import NoCandidatePathError, OptionError
from fgplan.io.mission_file import load_mission
from fgplan.planners.aia.baseline import Budget
from fgplan.planners.aia.team_model import TeamModel
from fgplan.planners.fvi.iteration import iterate_values
from fgplan.planners.plan import plan_of
from fgplan.planners.registry import find_planner

SCENARIO = Path(__file__).parents[2] / "examples" / "scenarios" / "information_gathering.toml"
BASELINES = ("greedy", "biased_greedy", "fvi", "rig_tree", "dec_mcts")


def solve(name, problem, seed=0, **budget):
    module = importlib.import_module(f"fgplan.planners.{name}.planner")
    return module.solve(problem, Budget(**budget), np.random.default_rng(seed))


@pytest.mark.parametrize("name", ["greedy", "biased_greedy", "rig_tree", "dec_mcts"])
def test_a_baseline_s_plan_is_feasible_and_not_below_the_optimum(name):
    problem = tiny_problem(1)
    found = solve(name, problem, nodes=20_000, seconds=20.0)
    path = found.plan
    assert path is not None
    assert path.cost >= OPTIMA[1] * (1 - 1e-9)
    numbers = np.linalg.det(path.covariances)
    assert path.cost == pytest.approx(numbers.sum(), rel=1e-9)
    assert numbers[-1].max() <= 2e-3 < numbers[-2].max()
    ways = path.poses[:, 0, :2]
    assert problem.workspace.are_motions_valid(ways[:-1], ways[1:]).all()
    np.testing.assert_allclose(
        np.abs(np.diff(ways, axis=0)).max(axis=1), 0.5, atol=1e-9
    )  # every control moves by the step along at least one axis


def test_the_same_seed_gives_the_same_plan():
    for name in ("greedy", "rig_tree", "dec_mcts"):
        plans = [solve(name, tiny_problem(1), seed=4, seconds=20.0).plan for _ in range(2)]
        np.testing.assert_array_equal(plans[0].poses, plans[1].poses)


def test_exhaustive_search_finds_the_optimum_with_and_without_dominance():
    problem = lattice_problem([(0.0, 0.0)], [(1.3, 2.2)], side=3.0, step=1.0, delta=2e-3)
    budget = Budget(nodes=200_000, seconds=30.0)
    generator = np.random.default_rng(0)
    pruned = iterate_values(problem, budget, generator)
    assert pruned.plan is not None
    whole = iterate_values(problem, budget, generator, dominance=False)
    assert whole.plan is not None
    assert whole.plan.cost == pytest.approx(pruned.plan.cost, rel=1e-12)
    assert whole.nodes >= pruned.nodes


def test_nothing_below_the_stated_optimum_exists():
    # Bounded by the optimum itself: whatever is cheaper would be found.
    budget = Budget(nodes=200_000, seconds=60.0)
    found = iterate_values(
        tiny_problem(1), budget, np.random.default_rng(0), bound=OPTIMA[1] * (1 + 1e-9)
    )
    assert found.plan is not None
    assert found.plan.cost == pytest.approx(OPTIMA[1], rel=1e-12)


@pytest.mark.full
def test_nothing_below_the_stated_optimum_exists_on_the_larger_instance():
    budget = Budget(nodes=400_000, seconds=200.0)
    found = iterate_values(
        tiny_problem(0), budget, np.random.default_rng(0), bound=OPTIMA[0] * (1 + 1e-9)
    )
    assert found.plan is not None
    assert found.plan.cost == pytest.approx(OPTIMA[0], rel=1e-12)


@pytest.mark.parametrize("name", ["aia", "biased_greedy", "dec_mcts"])
def test_planners_are_swapped_by_name_in_a_scenario(name):
    mission = load_mission(SCENARIO)
    options = {"delta": 1e-4}
    if name == "aia":
        options["preset"] = "pruned"
    mission = dataclasses.replace(mission, options=options)
    plan = find_planner(name).plan(mission, np.random.default_rng(0))
    assert plan.planner == name
    assert plan.details["horizon"] == len(plan.paths["ann"].poses) - 1
    last = np.array(plan.details["target_covariances"][-1])
    assert np.linalg.det(last).max() <= 1e-4
    again = plan_of(plan.to_data())
    assert again.value == plan.value
    np.testing.assert_array_equal(again.paths["bob"].poses, plan.paths["bob"].poses)


@pytest.mark.parametrize("name", ["aia", *BASELINES])
def test_unknown_options_and_unreachable_limits_are_said_clearly(name):
    mission = load_mission(SCENARIO)
    planner = find_planner(name)
    with pytest.raises(OptionError, match="colour"):
        planner.plan(dataclasses.replace(mission, options={"colour": 1}), np.random.default_rng(0))
    few = {"iterations": 40} if name == "aia" else {"nodes": 40, "steps": 5, "seconds": 5.0}
    hard = dataclasses.replace(mission, options={"delta": 1e-12, **few})
    with pytest.raises(NoCandidatePathError, match="best uncertainty reached"):
        planner.plan(hard, np.random.default_rng(0))


@pytest.mark.parametrize("name", ["aia", "distributed_aia", *BASELINES])
def test_no_plan_names_the_target_farthest_from_the_limit(name):
    """One whose prior is so wide that no few steps bring it near the others."""
    mission = load_mission(SCENARIO)
    wide = dataclasses.replace(mission.targets[2], covariance=1e6 * np.eye(2))
    few = {"iterations": 5} if name.endswith("aia") else {"nodes": 5, "steps": 2, "seconds": 5.0}
    for scope, words in (
        ("each", f"times the limit, at target '{wide.name}', the farthest from it; relax delta"),
        ("joint", "times the limit; relax delta"),
    ):
        if name == "distributed_aia" and scope == "joint":
            continue  # refused there
        hard = dataclasses.replace(
            mission,
            targets=(*mission.targets[:2], wide, *mission.targets[3:]),
            options={"delta": 1e-9, "constraint_scope": scope, **few},
        )
        with pytest.raises(NoCandidatePathError, match=words):
            find_planner(name).plan(hard, np.random.default_rng(0))


@pytest.mark.parametrize("name", ["aia", "distributed_aia", "intermittent", *BASELINES])
def test_a_slip_in_an_option_s_name_lists_every_option_nearest_first(name):
    mission = dataclasses.replace(load_mission(SCENARIO), options={"dleta": 1.8e-4})
    with pytest.raises(OptionError) as refused:
        find_planner(name).plan(mission, np.random.default_rng(0))
    said = str(refused.value)
    begin = f"option 'dleta' of planner '{name}': expected one of delta, "
    assert said.startswith(begin)
    assert said.endswith("; did you mean 'delta'?")
    listed = said.removesuffix("; did you mean 'delta'?").split("expected one of ")[1].split(", ")
    expected = {
        "aia": {"preset", "dynamics", "p_group", "restarts", "f_control", "least_group"},
        "distributed_aia": {"preset", "dynamics", "p_group", "kappa", "graph", "messages"},
        "intermittent": {"teams", "steps", "samples", "sync"},
    }.get(name, {"dynamics", "terminal_goals", "nodes", "steps"})
    assert expected <= set(listed)
    assert len(set(listed)) == len(listed)


def test_bad_budgets_and_dynamics_are_refused():
    mission = load_mission(SCENARIO)
    for options, message in (
        ({"nodes": 0}, "at least 1"),
        ({"step_m": -1.0}, "step_m"),
        ({"constraint": "colour"}, "delta or constraint"),
    ):
        with pytest.raises(OptionError, match=message):
            find_planner("greedy").plan(
                dataclasses.replace(mission, options=options), np.random.default_rng(0)
            )


def test_one_step_of_a_team_is_that_of_the_tree():
    model = TeamModel(tiny_problem(1))
    state = model.start()
    rows = np.array([model.controls(0, int(state.rows[0]))[2]])
    after = model.advance(state, rows)
    np.testing.assert_allclose(model.poses(after.rows)[0], [1.0, 0.5, 0.0])
    assert after.cost == pytest.approx(2 * 2 * 0.04)  # nothing in range: two targets, two steps
    assert model.shortfall(after) == pytest.approx(0.04 / 2e-3)
