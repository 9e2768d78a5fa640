"""``fgplan reproduce kantaros-adaptive``: planning again every few measurements.

Section VI-A of Kantaros et al. 2019 says that Algorithm 1 can be coupled with Model Predictive
Control and gives no numbers. Here: four robots and six targets that move, in the world of Table I;
the truth is drawn from the prior; ranges are noisy. Each seed is run by the offline plan and by
replanning, with one truth and one noise a seed, each with a bank of extended Kalman filters a
target and with a single filter. All seeds count, those where a filter fails too.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_most
from fgplan.planners.aia.adaptive import TrackingRun, track
from fgplan.planners.aia.options import tree_options
from fgplan.typing import FloatArray
from fgplan.viz.figure import new_figure, save
from fgplan.viz.palette import ROBOT_COLORS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROBOTS, TARGETS = 4, 6
DELTA = 1e-4
STEPS = 100
EVERY = 5
BANK, SINGLE = "bank", "single filter"
OFFLINE, REPLANNED = "offline plan", "replanned"
LOST_M = 0.5
"""Error at the end above which a target counts as lost, metres."""
_BANK = 7


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of this reproduction."""
    parser.add_argument(
        "--every", type=int, default=EVERY, help=f"steps between plans (default {EVERY})"
    )


def run(options: CommandOptions) -> CommandOutcome:
    """Run every seed offline and with replanning.

    Args:
        options: Argument ``every``; ``out`` takes the picture.

    Returns:
        Errors by seed, filter and plan.
    """
    seeds = options.seed_range(10)
    every = options.arguments["every"]
    rows: list[dict[str, Any]] = []
    errors: dict[tuple[str, str], list[FloatArray]] = {}
    for place, seed in enumerate(seeds):
        for name, hypotheses in ((BANK, _BANK), (SINGLE, 1)):
            for plan, period in ((OFFLINE, None), (REPLANNED, every)):
                options.progress(place, len(seeds), f"seed {seed}: {name}, {plan}")
                done = run_seed(seed, hypotheses, period)
                errors.setdefault((name, plan), []).append(done.rms_m)
                rows.append({"seed": seed, "filter": name, "plan": plan} | numbers_of(done))
        options.record({"rows": rows})
    table = [summarised(rows, name, plan) for name, plan in errors]
    figures: tuple[Path, ...] = ()
    if options.out is not None:
        figures = (save(draw_errors(errors), options.out / "errors.png"),)
    return CommandOutcome(
        results={"rows": rows, "summary": table, "robots": ROBOTS, "targets": TARGETS}
        | {"steps": STEPS, "every": every, "delta": DELTA, "lost_m": LOST_M},
        requirements=requirements(table),
        seeds=seeds,
        summary=lines_of(table, len(seeds)),
        figures=figures,
    )


def run_seed(seed: int, hypotheses: int, every: int | None) -> TrackingRun:
    """One closed loop.

    Args:
        seed: Of scene, truth, noise and plans.
        hypotheses: Filters along each axis of a target's prior.
        every: Steps between plans; None plans once.

    Returns:
        What happened.
    """
    problem = kantaros_scene(ROBOTS, TARGETS, np.random.default_rng(seed), moving=True, delta=DELTA)
    options = tree_options("reproduction", iterations=3000, expand="node")
    generator = np.random.default_rng(seed)
    return track(
        problem, options, generator, steps=STEPS, replan_every=every, hypotheses=hypotheses
    )


def numbers_of(done: TrackingRun) -> dict[str, Any]:
    """Numbers of one run.

    Args:
        done: The run.

    Returns:
        ``rms_m`` over targets at the start and the end, the worst target's error there, targets
        lost, the mean normalised squared error (2 where the filter is right about itself), plans.
    """
    last = done.errors_m[-1]
    return {
        "rms_first_m": float(done.rms_m[0]),
        "rms_last_m": float(done.rms_m[-1]),
        "worst_last_m": float(last.max()),
        "lost": int((last > LOST_M).sum()),
        "consistency": done.consistency,
        "plans": done.plans,
        "feasible": done.feasible,
    }


def summarised(rows: list[dict[str, Any]], name: str, plan: str) -> dict[str, Any]:
    """All seeds of one filter and one kind of plan.

    Args:
        rows: By seed.
        name: The filter.
        plan: The kind of plan.

    Returns:
        Means, medians and worst, over all seeds.
    """
    own = [row for row in rows if (row["filter"], row["plan"]) == (name, plan)]
    last = np.array([row["rms_last_m"] for row in own])
    return {
        "filter": name,
        "plan": plan,
        "seeds": len(own),
        "mean_rms_m": float(last.mean()),
        "median_rms_m": float(np.median(last)),
        "worst_rms_m": float(last.max()),
        "worst_target_m": max(row["worst_last_m"] for row in own),
        "lost": sum(row["lost"] for row in own),
        "consistency": float(np.mean([row["consistency"] for row in own])),
    }


def requirements(table: list[dict[str, Any]]) -> tuple[Requirement, ...]:
    """Replanning with the bank errs less than the offline plan, loses nobody, and knows it.

    Args:
        table: As ``summarised``.

    Returns:
        The requirements.
    """
    of = {(row["filter"], row["plan"]): row for row in table}
    ours, offline = of[BANK, REPLANNED], of[BANK, OFFLINE]
    # Chi-square of two degrees of freedom, so many of them: mean 2, deviation 2 / sqrt(n).
    limit = 2.0 + 4.0 * 2.0 / np.sqrt(TARGETS * ours["seeds"])
    needs = [
        require_at_most("lost targets, replanned", ours["lost"], 0),
        require_at_most("mean normalised squared error, replanned", ours["consistency"], limit),
    ]
    if ours["seeds"] > 1:  # of one seed the noise decides
        ratio = ours["mean_rms_m"] / offline["mean_rms_m"]
        needs.append(require_at_most("error replanned over offline", ratio, 1.0))
    return tuple(needs)


def lines_of(table: list[dict[str, Any]], seeds: int) -> tuple[str, ...]:
    """Lines to print.

    Args:
        table: As ``summarised``.
        seeds: How many.

    Returns:
        A head and a line a row.
    """
    head = (
        f"{ROBOTS} robots, {TARGETS} moving targets, {STEPS} steps, {seeds} seeds; error of the "
        "estimates at the end, root mean square over targets"
    )
    return (
        head,
        *(
            f"{row['filter']:<14} {row['plan']:<13} mean {row['mean_rms_m']:.3f} m, median "
            f"{row['median_rms_m']:.3f} m, worst seed {row['worst_rms_m']:.3f} m, worst target "
            f"{row['worst_target_m']:.2f} m, lost {row['lost']} of {seeds * TARGETS}, "
            f"normalised squared error {row['consistency']:.1f} (2 is right)"
            for row in table
        ),
    )


def draw_errors(errors: Mapping[tuple[str, str], list[FloatArray]]) -> "Figure":
    """Error against time, the median and the range over seeds.

    Args:
        errors: By filter and plan, the root mean square of each seed, shape (T + 1,).

    Returns:
        The figure.
    """
    figure = new_figure(height_px=640)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, name in zip(panels, (BANK, SINGLE), strict=True):
        for color, plan in zip(ROBOT_COLORS, (OFFLINE, REPLANNED), strict=False):
            values = np.array(errors[name, plan])
            time = np.arange(values.shape[1])
            axes.fill_between(
                time, values.min(axis=0), values.max(axis=0), color=color, alpha=0.15, lw=0
            )
            axes.plot(time, np.median(values, axis=0), color=color, lw=2, label=plan)
        axes.set_yscale("log")
        axes.set_ylabel("error (m)")
        axes.grid(color="#E0E0E0", lw=0.8)
        what = "bank of filters" if name == BANK else name
        axes.set_title(
            f"{what}: median and range over {len(values)} seeds", fontsize=11, loc="left"
        )
    panels[0].legend(frameon=False, loc="lower left")
    panels[-1].set_xlabel("time (steps)")
    return figure
