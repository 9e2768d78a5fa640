"""``fgplan reproduce kantaros-convergence``: the optimal path by iteration n, against bound (7).

A robot and two targets on nine cells, small enough for the exhaustive planner to state the optimum.
Algorithm 1 runs with the draws of many generators, each until it holds a plan of the optimal cost;
the share of them that does by iteration n, with its 95 % Clopper-Pearson interval, must not fall
below bound (7) (``convergence_bound``). Two densities: uniform ones (Remark 3.4), and (8) and (9),
uniform after the first feasible node (Remark 5.1). Nodes not cheaper than the best plan are left
out, as the whole tree would outgrow any memory; no node of a path cheaper than the best is among
them, so the theorem's proof holds as it stands.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_least, require_true
from fgplan.models.hidden_state import independent_targets
from fgplan.models.motion_primitives import first_order
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.planners.aia.baseline import Budget
from fgplan.planners.aia.growth_choice import make_growth
from fgplan.planners.aia.options import TreeOptions, tree_options
from fgplan.planners.aia.problem import AcquisitionProblem, SensingRobot, TerminalConstraint
from fgplan.planners.aia.team_path import TeamPath
from fgplan.planners.fvi.iteration import iterate_values
from fgplan.reproduce.kantaros_convergence.convergence_bound import (
    least_alpha,
    probability_bound,
    reachable_configurations,
)
from fgplan.reproduce.kantaros_convergence.picture import draw_convergence
from fgplan.typing import FloatArray
from fgplan.viz.figure import save
from roadmaps import Workspace

SEEDS = 100
QUICK_SEEDS = 8
SHOWN = 200_000
"""Iterations of the curves; the bound of (8) and (9) is near one only there."""
_EQUAL = 1e-9
_LEVELS = (0.5, 0.9, 0.99)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of this reproduction."""
    parser.add_argument(
        "--iterations", type=int, default=20_000, help="most iterations of a seed (default 20000)"
    )


def tiny_scene() -> AcquisitionProblem:
    """One robot and two targets on three by three cells of a metre."""
    return AcquisitionProblem(
        workspace=Workspace(lower=np.zeros(2), upper=np.full(2, 3.0)),
        robots=(
            SensingRobot(
                name="r0",
                pose=np.array([0.5, 0.5, 0.0]),
                primitives=first_order(1.0),
                sensors=(ProportionalRangeSensor(max_range_m=1.5),),
            ),
        ),
        hidden=independent_targets(["t0", "t1"], np.zeros((2, 2)), np.zeros((2, 2))),
        mean=np.array([2.7, 1.2, 1.3, 2.8]),
        priors=(0.2 * np.eye(2),) * 2,
        terminal=TerminalConstraint(limit=2e-3),
    )


def densities() -> dict[str, TreeOptions]:
    """Options of the tree by the name of its densities."""
    changes: dict[str, Any] = {"bound": True, "until": "budget", "iterations": SHOWN}
    return {
        "uniform": tree_options("paper", uniform_after=0, **changes),
        "(8) and (9)": tree_options("paper", **changes),
    }


def optimal_path(problem: AcquisitionProblem) -> TeamPath:
    """The optimum, by exhaustive search.

    Args:
        problem: The scene.

    Returns:
        The path.

    Raises:
        NoCandidatePathError: If the scene is too large for the budget.
    """
    found = iterate_values(problem, Budget(nodes=100_000, seconds=60.0), np.random.default_rng(0))
    if found.plan is None:
        raise NoCandidatePathError(
            f"expected the exhaustive search to end within its budget, got {found.nodes} nodes in "
            f"{found.seconds:.0f} s without an optimum; take a smaller scene"
        )
    return found.plan


def first_iterations(
    problem: AcquisitionProblem,
    options: TreeOptions,
    optimum: float,
    seeds: Sequence[int],
    limit: int,
) -> FloatArray:
    """Iteration at which each seed's tree first holds a plan of the optimal cost.

    Args:
        problem: The scene.
        options: Of the tree.
        optimum: Optimal cost.
        seeds: One tree each.
        limit: Most iterations.

    Returns:
        Shape (seeds,); infinite where the limit came first.
    """
    growth = make_growth(problem, options)
    found = np.full(len(seeds), np.inf)
    for place, seed in enumerate(seeds):
        generator = np.random.default_rng(seed)
        growth.plant()
        while growth.best_cost > optimum * (1 + _EQUAL) and growth.iterations < limit:
            if growth.run(1, generator) == "nodes":
                break
        if growth.best_cost <= optimum * (1 + _EQUAL):
            found[place] = growth.iterations
    return found


def binomial_interval(successes: FloatArray, trials: int) -> tuple[FloatArray, FloatArray]:
    """Clopper-Pearson interval of 95 % of a probability.

    Args:
        successes: Shape (n,).
        trials: Out of how many.

    Returns:
        Lower and upper limits, shape (n,).
    """
    from scipy.stats import beta

    failures = trials - successes
    low = beta.ppf(0.025, np.maximum(successes, 0.5), failures + 1)
    high = beta.ppf(0.975, successes + 1, np.maximum(failures, 0.5))
    return np.where(successes == 0, 0.0, low), np.where(failures == 0, 1.0, high)


def run(options: CommandOptions) -> CommandOutcome:
    """Measure the probability of the optimal path by iteration.

    Args:
        options: ``seeds`` trees of each density; argument ``iterations``; ``out`` takes the figure.

    Returns:
        Probabilities beside the bound.

    Raises:
        InvalidInputError: If ``iterations`` is less than 1.
    """
    seeds = options.seed_range(SEEDS, QUICK_SEEDS)
    limit = min(options.arguments.get("iterations", SHOWN), SHOWN)
    if limit < 1:
        raise InvalidInputError(f"--iterations: expected at least 1, got {limit}")
    problem = tiny_scene()
    best = optimal_path(problem)
    reachable = reachable_configurations(problem)
    controls = len(problem.robots[0].primitives)
    count = np.arange(1, SHOWN + 1, dtype=np.float64)
    rows: list[dict[str, Any]] = []
    curves: dict[str, dict[str, FloatArray]] = {}
    constants: dict[str, Any] = {
        "robots": 1,
        "targets": problem.targets,
        "optimal_cost": best.cost,
        "horizon": best.horizon,
        "reachable_configurations": reachable,
        "controls": controls,
        "bound": "1 - exp(-sum(alpha) / 2 + F), reconstructed: (7) prints a further factor n",
    }
    for name, tree in densities().items():
        found: list[float] = []
        for start in range(0, len(seeds), 10):
            options.progress(start, len(seeds), f"{name} densities")
            some = seeds[start : start + 10]
            found += first_iterations(problem, tree, best.cost, some, limit).tolist()
        # A seed that was cut off says nothing of later iterations.
        known = count[:limit] if np.isinf(found).any() else count
        alpha = least_alpha(known, reachable, controls, tree)
        curve = compare(
            np.array(found),
            probability_bound(alpha, best.horizon),
            probability_bound(alpha, best.horizon, printed=True),
        )
        curves[name] = curve
        rows.append({"densities": name, "alpha_end": float(alpha[-1])} | summarise(found, curve))
        options.record({"constants": constants, "rows": rows})
    figures: tuple[Path, ...] = ()
    if options.out is not None:
        drawn = draw_convergence(curves, len(seeds), best.horizon)
        figures = (save(drawn, options.out / "convergence.png"),)
    return CommandOutcome(
        results={"constants": constants, "rows": rows},
        requirements=requirements(rows),
        seeds=seeds,
        summary=summary(constants, rows),
        figures=figures,
    )


def compare(found: FloatArray, bound: FloatArray, printed: FloatArray) -> dict[str, FloatArray]:
    """Empirical probability by iteration, its interval, and the bounds.

    Args:
        found: Shape (seeds,), iteration of each.
        bound: Shape (n,), of iterations 1, 2, ....
        printed: Shape (n,), as (7) is printed.

    Returns:
        Curves of shape (n,) by name.
    """
    count = np.arange(1, len(bound) + 1)
    successes = np.searchsorted(np.sort(found), count, side="right").astype(np.float64)
    low, high = binomial_interval(successes, len(found))
    return {
        "iteration": count.astype(np.float64),
        "empirical": successes / len(found),
        "low": low,
        "high": high,
        "bound": bound,
        "printed": printed,
    }


def summarise(found: Sequence[float], curve: dict[str, FloatArray]) -> dict[str, Any]:
    """Numbers of one density.

    Args:
        found: Iteration of each seed.
        curve: As ``compare`` makes it.

    Returns:
        Row of the results; ``margin`` is the least of upper limit less bound.
    """

    def reaches(name: str, level: float) -> int | None:
        above = np.flatnonzero(curve[name] >= level)
        return int(curve["iteration"][above[0]]) if len(above) else None

    below = np.flatnonzero(curve["high"] < curve["printed"])
    return {
        "first_iterations": [int(one) if np.isfinite(one) else None for one in found],
        "seeds_optimal": int(np.isfinite(found).sum()),
        "seeds": len(found),
        "empirical_reaches": {str(level): reaches("empirical", level) for level in _LEVELS},
        "bound_reaches": {str(level): reaches("bound", level) for level in _LEVELS},
        "margin": float((curve["high"] - curve["bound"]).min()),
        "margin_of_the_estimate": float((curve["empirical"] - curve["bound"]).min()),
        "printed_form_fails_at": int(curve["iteration"][below[0]]) if len(below) else None,
    }


def requirements(rows: Sequence[dict[str, Any]]) -> tuple[Requirement, ...]:
    """Nowhere below the bound beyond the interval, and optimal on every seed.

    Args:
        rows: As ``summarise`` makes them.

    Returns:
        The requirements.
    """
    needs = []
    for row in rows:
        name = row["densities"]
        needs.append(
            require_at_least(f"{name}: upper confidence limit less bound", row["margin"], 0.0)
        )
        optimal = row["seeds_optimal"] == row["seeds"]
        needs.append(require_true(f"{name}: every seed reaches the optimum", optimal))
    return tuple(needs)


def summary(constants: dict[str, Any], rows: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """Lines to print.

    Args:
        constants: Of the scene.
        rows: As ``summarise`` makes them.

    Returns:
        The scene's constants, then a line a density.
    """
    lines = [
        f"1 robot, 2 targets: optimum {constants['optimal_cost']:.6f}, F {constants['horizon']}, "
        f"R {constants['reachable_configurations']}, |U| {constants['controls']}",
        f"bound: {constants['bound']}",
    ]
    for row in rows:
        reached = ", ".join(
            f"{level}: n {row['empirical_reaches'][level] or 'not reached'} "
            f"(bound {row['bound_reaches'][level] or 'not reached'})"
            for level in row["bound_reaches"]
        )
        fails = row["printed_form_fails_at"]
        told = "holds" if fails is None else f"fails at n {fails}"
        lines.append(
            f"{row['densities']:<12} {row['seeds_optimal']}/{row['seeds']} optimal; probability "
            f"{reached}; (7) as printed {told}"
        )
    return tuple(lines)
