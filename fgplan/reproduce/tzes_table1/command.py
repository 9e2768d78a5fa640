"""``fgplan reproduce tzes-table1``: the scalability study of section VI-A, and figure 3.

Tzes, Kantaros and Pappas 2021, Table I: horizon F of the first plan for nine team sizes with a
random connected graph of the printed average degree, all-to-all, and the centralised planner, ten
trials each in the paper; robots alone (no communication, F of the slowest one) on 10/10 and 10/20.
Figure 3: time of one iteration, centralised and distributed.

All-to-all and the random graph differ by one to three steps, a single trial by two to seven, so the
order in the mean over ten trials is left to chance in several rows. A hundred trials are run by
default; beside their means stands how many of the blocks of ten have the order as required.

The text at hand has lost the world, the controls, delta, the weights kappa, p_C, where robots and
targets are, and whether targets move in this study. The scene is ``fgplan.bench.
distributed_aia_scene``; steps of 0.6 m, delta = 1e-3 and uniform draws within one step of the
target were chosen, on other seeds, because horizons of 10/10 then come near the table and differ
between graphs by more than chance: a calibration, no confirmation. What is compared is the order of
the horizons and the times of one machine; runtimes of the paper are of another machine and
language. Drawing controls alone makes an iteration 1 / N as dear, so with 10 robots a tenth is out
of reach unless the centralised filter is slow.
"""

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.bench.dense_iteration import FORMS, iteration_times, ratios
from fgplan.bench.distributed_aia_scene import tzes_scene
from fgplan.errors import InvalidInputError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.search import search
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.planners.distributed_aia.search import search_distributed
from fgplan.reproduce.tzes_table1.horizon_order import (
    COLUMNS,
    block_summary,
    blocks_of_ten,
    requirements,
)
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.viz.distributed_gathering import iteration_time_figure
from fgplan.viz.figure import save


@dataclass(frozen=True, slots=True)
class PublishedRow:
    """A row of Table I.

    Attributes:
        degree: Average degree of the random connected graphs.
        connected: Seconds and horizon with a random connected graph.
        all_to_all: The same with all-to-all communication.
        centralised: The same of the centralised planner.
    """

    degree: float
    connected: tuple[float, int]
    all_to_all: tuple[float, int]
    centralised: tuple[float, int]


PUBLISHED: dict[tuple[int, int], PublishedRow] = {
    (10, 10): PublishedRow(5.6, (2.09, 28), (1.45, 15), (7.67, 11)),
    (10, 20): PublishedRow(5.0, (3.63, 33), (2.93, 26), (15.03, 18)),
    (10, 35): PublishedRow(5.4, (5.69, 40), (3.37, 25), (25.37, 19)),
    (15, 20): PublishedRow(8.1, (2.72, 26), (2.60, 26), (14.30, 13)),
    (15, 35): PublishedRow(8.5, (4.41, 34), (3.77, 26), (25.24, 15)),
    (20, 20): PublishedRow(11.1, (2.93, 28), (2.11, 17), (23.14, 14)),
    (20, 25): PublishedRow(10.5, (4.00, 33), (2.51, 19), (21.27, 12)),
    (20, 35): PublishedRow(10.7, (4.64, 32), (3.51, 24), (26.02, 11)),
    (30, 50): PublishedRow(17.0, (5.32, 26), (4.29, 19), (46.02, 10)),
}
ALONE = ((10, 10), (10, 20))
"""Rows that are planned without communication too."""
STEP_M, DELTA, NEAR_M = 0.6, 1e-3, 0.6
CALIBRATION = (
    "steps of 0.6 m, delta = 1e-3 and uniform draws within 0.6 m of the target were chosen so that "
    "horizons come near Table I; world, starts, targets, kappa = 0.9 and p_C = 0.9 are not in the "
    "text: a calibration, not a confirmation"
)
_ITERATIONS = 20_000
_NODES = 200_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of this reproduction."""
    parser.add_argument("--rows", default="all", help="such as 10/10,10/20 (default all)")
    parser.add_argument("--trials", type=int, default=100, help="trials a row (default 100)")


def run(options: CommandOptions) -> CommandOutcome:
    """Plan every row.

    Args:
        options: Arguments ``rows`` and ``trials``; ``out`` takes figure 3.

    Returns:
        ``results.rows`` and what is required of them.

    Raises:
        InvalidInputError: If a row is not one of the table, or there is no trial.
    """
    sizes = read_rows(options.arguments["rows"])
    if options.quick and options.arguments["rows"] == "all":
        sizes = [(10, 10), (10, 20)]
    if options.arguments["trials"] < 1:
        raise InvalidInputError(f"--trials: expected at least 1, got {options.arguments['trials']}")
    seeds = options.seed_range(options.arguments["trials"], quick=2)
    plan_row(2, 2, (0,))  # loads the compiled code
    rows: list[dict[str, Any]] = []
    for robots, targets in sizes:
        options.progress(len(rows), len(sizes), f"{robots}/{targets}")
        row = plan_row(robots, targets, seeds)
        rows.append(row | iteration_row(robots, targets, quick=options.quick))
        options.record({"rows": rows})
    figures: tuple[Path, ...] = ()
    if options.out is not None:
        figures = (save(iteration_time_figure(figure_3_rows(rows)), options.out / "figure-3.png"),)
    return CommandOutcome(
        results={
            "rows": rows,
            "blocks_of_ten": blocks_of_ten(rows),
            "calibration": CALIBRATION,
            "step_m": STEP_M,
            "delta": DELTA,
            "near_m": NEAR_M,
            "preset": "reproduction",
        },
        requirements=requirements(rows) if not options.quick else (),
        seeds=seeds,
        summary=(*summary(rows), *block_summary(blocks_of_ten(rows)), CALIBRATION),
        figures=figures,
    )


def figure_3_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What figure 3 shows of the rows: the dense form as published, and the library's.

    Args:
        rows: As ``run`` collects them.

    Returns:
        Rows with a key for each bar.
    """
    bars = {"published": "dense, as published", "block": "targets apart, compiled"}
    return [
        {"robots": row["robots"], "targets": row["targets"]}
        | {
            f"iteration_us_{way} ({words})": row[f"iteration_us_{way}_{form}"]
            for form, words in bars.items()
            for way in ("centralised", "distributed")
        }
        for row in rows
    ]


def read_rows(text: str) -> list[tuple[int, int]]:
    """Rows asked for.

    Args:
        text: ``all``, or sizes such as ``10/10,10/20``.

    Returns:
        Robots and targets of each.

    Raises:
        InvalidInputError: If a size is not one of the table.
    """
    if text == "all":
        return list(PUBLISHED)
    found = []
    for part in text.split(","):
        size = next((size for size in PUBLISHED if f"{size[0]}/{size[1]}" == part.strip()), None)
        if size is None:
            names = ", ".join(f"{n}/{m}" for n, m in PUBLISHED)
            raise InvalidInputError(f"--rows: expected some of {names}, got {part!r}")
        found.append(size)
    return found


def plan_row(robots: int, targets: int, seeds: Sequence[int]) -> dict[str, Any]:
    """Plan one row for every seed.

    Args:
        robots: N.
        targets: M.
        seeds: Of scene, graph and planner.

    Returns:
        Means over the trials beside the published numbers; NaN where a trial was not solved.
        Seconds are those of a robot: of the whole team, planned in turn, over N.
    """
    published = PUBLISHED.get((robots, targets))
    degree = published.degree if published is not None else robots - 1.0
    columns = COLUMNS if (robots, targets) in ALONE else COLUMNS[:3]
    horizons: dict[str, list[float]] = {name: [] for name in columns}
    seconds: dict[str, list[float]] = {name: [] for name in columns}
    degrees = []
    for seed in seeds:
        problem = tzes_scene(
            robots, targets, np.random.default_rng(seed), step_m=STEP_M, delta=DELTA
        )
        names = [robot.name for robot in problem.robots]
        drawn = CommunicationGraph.random_connected(names, degree, np.random.default_rng(seed))
        degrees.append(drawn.average_degree())
        graphs = {
            "all_to_all": CommunicationGraph.complete(names),
            "connected": drawn,
            "none": CommunicationGraph.none(names),
        }
        for name in columns:
            began = time.perf_counter()
            if name == "centralised":
                horizon = _centralised_horizon(problem, seed)
            else:
                horizon = _distributed_horizon(problem, graphs[name], seed)
            share = 1 if name == "centralised" else robots
            seconds[name].append((time.perf_counter() - began) / share)
            horizons[name].append(horizon)
    row: dict[str, Any] = {
        "robots": robots,
        "targets": targets,
        "trials": len(seeds),
        "degree": float(np.mean(degrees)),
    }
    for name in columns:
        row[f"solved_{name}"] = int(np.isfinite(horizons[name]).sum())
        row[f"horizon_{name}"] = float(np.mean(horizons[name]))
        row[f"horizon_{name}_std"] = float(np.std(horizons[name]))
        row[f"horizons_{name}"] = horizons[name]
        row[f"runtime_{name}"] = float(np.median(seconds[name]))
        if published is not None and name != "none":
            row[f"published_runtime_{name}"], row[f"published_horizon_{name}"] = getattr(
                published, name
            )
    return row


def iteration_row(robots: int, targets: int, *, quick: bool) -> dict[str, float]:
    """Time of one iteration in every form, with the row's random connected graph.

    Args:
        robots: N.
        targets: M.
        quick: Short runs.

    Returns:
        ``iteration_us_centralised_FORM``, ``iteration_us_distributed_FORM`` and ``ratio_FORM``.
    """
    problem = tzes_scene(robots, targets, np.random.default_rng(0), step_m=STEP_M, delta=DELTA)
    names = [robot.name for robot in problem.robots]
    degree = PUBLISHED[robots, targets].degree
    graph = CommunicationGraph.random_connected(names, degree, np.random.default_rng(0))
    times = iteration_times(
        problem, graph, near_m=NEAR_M, repeats=3 if quick else 5, part_s=0.02 if quick else 0.2
    )
    named = {f"iteration_us_{key.removesuffix('_us')}": value for key, value in times.items()}
    return named | ratios(times)


def _centralised_horizon(problem: AcquisitionProblem, seed: int) -> float:
    """Horizon of the first plan of ``aia``; NaN for none."""
    options = tree_options("reproduction", near_m=NEAR_M, node_budget=_NODES)
    found = search(problem, options, np.random.default_rng(seed))
    return float("nan") if found.plan is None else float(found.plan.horizon)


def _distributed_horizon(
    problem: AcquisitionProblem, graph: CommunicationGraph, seed: int
) -> float:
    """Horizon of the first plan of ``distributed_aia``; of robots alone that of the slowest."""
    options = distributed_options("reproduction", near_m=NEAR_M, iterations=_ITERATIONS)
    found = search_distributed(problem, options, graph, np.random.default_rng(seed))
    return float("nan") if found.plan is None else float(found.plan.horizon)


def summary(rows: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Lines to print.

    Args:
        rows: As ``run`` collects them.

    Returns:
        A line a row: horizons beside the published ones, and times of an iteration.
    """
    lines = [
        "N/M    degree  F centralised  all-to-all   connected    none   "
        "iteration, distributed/centralised: published  information  seen  block"
    ]
    for row in rows:
        cells = [f"{row['robots']}/{row['targets']:<4} {row['degree']:5.2f} "]
        for name in COLUMNS:
            if f"horizon_{name}" not in row:
                cells.append(" " * 6)
                continue
            published = row.get(f"published_horizon_{name}")
            beside = "" if published is None else f" ({published})"
            cells.append(f"{row[f'horizon_{name}']:6.1f}{beside:<5}")
        ratio_cells = [f"{row[f'ratio_{form}']:.3f}" for form in FORMS]
        lines.append(" ".join(cells) + "   " + "  ".join(ratio_cells))
    return tuple(lines)
