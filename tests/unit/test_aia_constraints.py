"""What a terminal constraint means where the hidden state moves, and when dominance is allowed."""

import dataclasses

import numpy as np
import pytest
from aia_scenes import lattice_problem, tiny_problem

from fgplan.errors import InvalidInputError
from fgplan.models.position_sensor import PositionSensor
from fgplan.models.uncertainty import UNCERTAINTY_FUNCTIONS, UncertaintyFunction
from fgplan.planners.aia.arrays import prepare
from fgplan.planners.aia.baseline import Budget
from fgplan.planners.aia.lower_bound import unreachable_reason
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.problem import TerminalConstraint
from fgplan.planners.aia.search import search
from fgplan.planners.fvi.iteration import iterate_values


def gained(path, step, *, process, joint):
    """Mutual information of x(step) and all measurements, with the prior carried to that step."""
    before = np.linalg.slogdet((0.2 + process * step) * np.eye(2))[1]
    each = 0.5 * (before - np.linalg.slogdet(path.covariances[step])[1])
    return each.sum() if joint else each.min()


@pytest.mark.parametrize(("scope", "limit"), [("each", 1.2), ("joint", 2.6)])
def test_mutual_information_is_of_the_state_at_the_end(scope, limit):
    process = 0.02
    problem = dataclasses.replace(
        lattice_problem([(0.5, 0.5)], [(2.7, 1.2), (1.3, 3.1)], side=4.0, step=0.5),
        terminal=TerminalConstraint(limit=limit, function="mutual_information", scope=scope),
    )
    moving = lattice_problem(
        [(0.5, 0.5)], [(2.7, 1.2), (1.3, 3.1)], side=4.0, step=0.5, process=process
    )
    moving = dataclasses.replace(moving, terminal=problem.terminal)
    for one, noise in ((problem, 0.0), (moving, process)):
        options = tree_options("pruned", iterations=20_000)
        path = search(one, options, np.random.default_rng(0)).plan
        assert path is not None
        # At the end and nowhere before, which it would not be against the prior at time 0.
        now = [
            gained(path, step, process=noise, joint=scope == "joint") >= limit
            for step in range(path.horizon + 1)
        ]
        assert now == [False] * path.horizon + [True]
    assert prepare(problem, options).constant
    assert not prepare(moving, options).constant, "dominance of any time must not be used"


def test_a_function_that_is_not_monotone_forbids_dominance(monkeypatch):
    own = UncertaintyFunction(
        name="own_ratio",
        evaluate=lambda covariance, _: covariance[..., 0, 0] / covariance[..., 1, 1],
        monotone=False,
        positive=True,
    )
    monkeypatch.setitem(UNCERTAINTY_FUNCTIONS, "own_ratio", own)
    for changes in (
        {"objective": "own_ratio"},
        {"terminal": TerminalConstraint(limit=0.7, function="own_ratio")},
    ):
        problem = dataclasses.replace(tiny_problem(1), **changes)
        with pytest.raises(InvalidInputError, match=r"own_ratio.*set dominance = 'off'"):
            search(problem, tree_options("pruned"), np.random.default_rng(0))
        options = tree_options("pruned", dominance="off", iterations=3000)
        search(problem, options, np.random.default_rng(0))
    # FVI keeps what looks dominated, so that it stays exact.
    budget = Budget(steps=3, nodes=10**6)
    plain = iterate_values(problem, budget, np.random.default_rng(0), dominance=False)
    kept = iterate_values(problem, budget, np.random.default_rng(0))
    assert kept.nodes == plain.nodes


def test_measuring_at_the_child_reaches_what_process_noise_forbids_at_the_parent():
    """Before measuring a target is never known better than its process noise; after, it is."""
    problem = lattice_problem(
        [(0.0, 0.0)], [(1.5, 1.5)], process=0.1, delta=1e-3, sensor=PositionSensor(sigma_m=0.05)
    )
    assert "process noise" in unreachable_reason(problem, "parent")
    assert not unreachable_reason(problem, "child")
    found = search(problem, tree_options("pruned", measure_at="child"), np.random.default_rng(0))
    assert found.plan is not None
    noisy = dataclasses.replace(problem, terminal=TerminalConstraint(limit=1e-6))
    assert unreachable_reason(noisy, "child")


def test_sensors_of_points_are_refused_for_targets_that_have_places_only():
    problem = tiny_problem(1)
    places = problem.mean.reshape(-1, 2)
    with pytest.raises(InvalidInputError, match="use a linear observation"):
        dataclasses.replace(problem, places=places)


def test_a_noisy_target_is_unreachable_whatever_the_others_are():
    """Static targets settle at zero only after thousands of steps; that must not hide the other."""
    moving = lattice_problem([(0.0, 0.0)], [(2.0, 2.0)], process=0.1).hidden.blocks[0]
    problem = lattice_problem([(0.0, 0.0)], [(2.0, 2.0), (1.0, 3.0)], delta=1e-3)
    hidden = dataclasses.replace(
        problem.hidden,
        blocks=(dataclasses.replace(moving, targets=("fox",)), problem.hidden.blocks[1]),
    )
    assert "'fox'" in unreachable_reason(dataclasses.replace(problem, hidden=hidden))
    assert not unreachable_reason(problem)
    # A noise that ends later does not make the limit unreachable.
    ending = np.zeros((60, 2, 2))
    ending[:59] = 0.1 * np.eye(2)
    blocks = tuple(dataclasses.replace(b, process=ending) for b in problem.hidden.blocks)
    assert not unreachable_reason(
        dataclasses.replace(problem, hidden=dataclasses.replace(hidden, blocks=blocks))
    )
