"""``fgplan reproduce khodayi-mehr-table1``: intermittent connection against two baselines.

Khodayi-mehr, Kantaros and Zavlanos, T-RO 2019, Table I: mean error (13a) and mean largest
eigenvalue (13b) over the steps of a run, for 4 targets (4 robots) and 8 targets (8 robots, teams of
figure 1(a)). Walls, process noise, duration and more are not printed; ours are in the result and
were chosen so that the baselines come near the table: a calibration, no confirmation. What is
tested is the order of the methods, with the same targets and the same noise for all three.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from fgplan.bench.intermittent_methods import METHODS, MethodRun, indoor_case, run_method
from fgplan.bench.intermittent_scene import UNPRINTED
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import (
    Requirement,
    require_at_least,
    require_at_most,
    require_true,
)
from fgplan.threads import one_blas_thread

GRAPHS = {4: "four", 8: "G1"}
QUANTITIES = ("error_m", "eigenvalue_m2")
PUBLISHED: dict[int, dict[str, dict[str, tuple[float, float]]]] = {
    4: {
        "all_time": {"error_m": (1.030, 0.466), "eigenvalue_m2": (0.226, 0.061)},
        "heuristic": {"error_m": (1.993, 0.566), "eigenvalue_m2": (0.405, 0.181)},
        "intermittent": {"error_m": (0.879, 0.461), "eigenvalue_m2": (0.167, 0.084)},
    },
    8: {
        "all_time": {"error_m": (2.517, 0.810), "eigenvalue_m2": (0.563, 0.129)},
        "heuristic": {"error_m": (1.201, 0.570), "eigenvalue_m2": (0.334, 0.161)},
        "intermittent": {"error_m": (0.929, 0.561), "eigenvalue_m2": (0.177, 0.068)},
    },
}
"""Mean and spread over time."""

CALIBRATION = (
    "walls, process noise, duration, samples and epsilon are not in the paper; they were chosen so "
    "that the baselines come near Table I: a calibration, not a confirmation"
)
WITHIN = 2.0
CONFIDENCE = 0.95
QUICK_STEPS = 60


@one_blas_thread()
def run(options: CommandOptions) -> CommandOutcome:
    """Run all methods on all seeds.

    Args:
        options: Number of seeds.

    Returns:
        ``results.cases`` and what is required of them.
    """
    steps = QUICK_STEPS if options.quick else UNPRINTED["steps"]
    seeds = options.seed_range(20, quick=2)
    cases: list[dict[str, Any]] = []
    for place, (targets, graph) in enumerate(GRAPHS.items()):
        runs: dict[str, list[MethodRun]] = {method: [] for method in METHODS}
        for turn, seed in enumerate(seeds):
            case = indoor_case(graph, seed, steps)
            for method in METHODS:
                done = place * len(seeds) + turn
                options.progress(done, len(GRAPHS) * len(seeds), f"{targets} targets, {method}")
                runs[method].append(run_method(case, method))
            options.record({"cases": [*cases, table_case(targets, runs)]})
        cases.append(table_case(targets, runs))
    results = {
        "cases": cases,
        "steps": steps,
        "unprinted": UNPRINTED,
        "calibration": CALIBRATION,
    }
    return CommandOutcome(
        results=results,
        requirements=() if options.quick else requirements(cases),
        seeds=seeds,
        summary=(*summary(cases), CALIBRATION),
    )


def table_case(targets: int, runs: Mapping[str, Sequence[MethodRun]]) -> dict[str, Any]:
    """One half of the table.

    Args:
        targets: Number of targets.
        runs: Of each method, one a seed.

    Returns:
        Means over seeds, spreads over time (as printed) and over seeds, published numbers, and
        the paired differences between each baseline and ``intermittent``.
    """
    case: dict[str, Any] = {"targets": targets, "seeds": len(runs[METHODS[0]])}
    for method in METHODS:
        case[method] = {}
        for quantity in QUANTITIES:
            series = [getattr(run, quantity) for run in runs[method]]
            means = [float(one.mean()) for one in series]
            case[method] |= {
                quantity: float(np.mean(means)),
                f"{quantity}_spread_over_time": float(np.mean([one.std() for one in series])),
                f"{quantity}_spread_over_seeds": float(np.std(means)),
                f"{quantity}_by_seed": means,
                f"{quantity}_published": PUBLISHED[targets][method][quantity][0],
                f"{quantity}_published_spread": PUBLISHED[targets][method][quantity][1],
            }
    case["differences"] = {
        f"{method}_{quantity}": paired_interval(
            case[method][f"{quantity}_by_seed"], case["intermittent"][f"{quantity}_by_seed"]
        )
        for method in METHODS[:2]
        for quantity in QUANTITIES
    }
    return case


def paired_interval(baseline: Sequence[float], ours: Sequence[float]) -> dict[str, float]:
    """How much larger a baseline is, seed by seed: mean and 95 % interval (Student's t).

    Args:
        baseline: One number a seed.
        ours: One number a seed.

    Returns:
        ``mean``, ``lower`` and ``upper``; an interval of infinite width for a single seed.
    """
    gap = np.asarray(baseline) - np.asarray(ours)
    count = len(gap)
    if count < 2:
        return {"mean": float(gap.mean()), "lower": -np.inf, "upper": np.inf}
    half = stats.t.ppf(0.5 + CONFIDENCE / 2, count - 1) * gap.std(ddof=1) / np.sqrt(count)
    return {
        "mean": float(gap.mean()),
        "lower": float(gap.mean() - half),
        "upper": float(gap.mean() + half),
    }


def requirements(cases: Sequence[Mapping[str, Any]]) -> tuple[Requirement, ...]:
    """What the table must show.

    Args:
        cases: As ``table_case`` gives them.

    Returns:
        A comparison is one quantity at one number of targets: won if both paired intervals lie
        above zero.
    """
    won, worst, needs = 0, 0, []
    for case in cases:
        for quantity in QUANTITIES:
            intervals = [case["differences"][f"{method}_{quantity}"] for method in METHODS[:2]]
            won += all(interval["lower"] > 0.0 for interval in intervals)
            worst += all(interval["mean"] < 0.0 for interval in intervals)
            for method in METHODS[:2]:
                ratio = case[method][quantity] / case[method][f"{quantity}_published"]
                name = f"{method}_{quantity}_of_{case['targets']}_targets_over_published"
                needs += [
                    require_at_least(name, ratio, 1.0 / WITHIN),
                    require_at_most(name, ratio, WITHIN),
                ]
    return (
        require_at_least("comparisons_that_intermittent_wins", won, 3),
        require_true("intermittent_is_worst_in_none", worst == 0),
        *needs,
    )


def summary(cases: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Lines to print.

    Args:
        cases: As ``table_case`` gives them.

    Returns:
        A line a method and number of targets, then the differences.
    """
    lines = ["targets method         error m (published)          eigenvalue m2 (published)"]
    for case in cases:
        for method in METHODS:
            own = case[method]
            cells = [
                f"{own[q]:.3f} ± {own[q + '_spread_over_time']:.3f} "
                f"({own[q + '_published']:.3f} ± {own[q + '_published_spread']:.3f})"
                for q in QUANTITIES
            ]
            lines.append(f"{case['targets']:<7} {method:<14} {cells[0]}   {cells[1]}")
        for name, gap in case["differences"].items():
            lines.append(
                f"{case['targets']:<7} {name} above intermittent by {gap['mean']:.3f} "
                f"[{gap['lower']:.3f}, {gap['upper']:.3f}]"
            )
    return tuple(lines)
