"""``fgplan reproduce regev-fig6``: section 7.1 of Regev and Indelman 2017.

Running times by evaluator beside the two that the paper's text prints, and figures 5, 6 and 7. The
paper's machine, Matlab code, roadmap and noise are not ours: what can be compared is how the
approaches relate, and that they choose the same.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fgplan.bench.blas_threads import blas_threads, blas_warning
from fgplan.bench.open_world import CRITERION_M
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_least, require_at_most, require_true
from fgplan.reproduce.regev_fig6.announcement_change import AnnouncementChange, find_change
from fgplan.reproduce.regev_fig6.running_times import (
    MOST_TURNS,
    PUBLISHED,
    SessionTimes,
    session_results,
    time_sessions,
)
from fgplan.reproduce.regev_fig6.scenario import WORLD_SEEDS, draw_scenario

COUNTS, QUICK_COUNTS = (5, 10, 25, 50), (5, 10)
SETS, QUICK_SETS = 50, 2
SHOWN_CANDIDATES = 25
PUBLISHED_AT = (2, 50)
LARGEST_DIFFERENCE = 1e-9


def run(options: CommandOptions) -> CommandOutcome:
    """Run the reproduction.

    Args:
        options: ``seeds`` is the number of candidate sets (50 by default, as in the paper);
            ``out`` takes the figures.

    Returns:
        Running times, and what is required of them.
    """
    counts = QUICK_COUNTS if options.quick else COUNTS
    sets = options.seed_range(SETS, quick=QUICK_SETS)
    scenarios = {robots: draw_scenario(robots) for robots in WORLD_SEEDS}
    change = find_change(2, SHOWN_CANDIDATES)
    figures: list[Path] = []
    if options.out is not None:
        # Before the long work, so that a missing matplotlib is known at once.
        from fgplan.reproduce.regev_fig6.pictures import draw_belief, draw_candidates, draw_change

        figures += [
            draw_candidates(scenario, SHOWN_CANDIDATES, options.out)
            for scenario in scenarios.values()
        ]
        figures.append(draw_belief(scenarios[2], SHOWN_CANDIDATES, options.out))
        if change is not None:
            figures.append(draw_change(change, scenarios[2].goals, options.out))

    def after_set(done: int, found: Sequence[SessionTimes]) -> None:
        """Show and keep what is there."""
        options.progress(done, len(sets), "candidate sets")
        options.record({"cases": [session_results(times) for times in found]})

    times = time_sessions(scenarios, counts, sets, after_set)
    if options.out is not None:
        from fgplan.reproduce.regev_fig6.pictures import draw_running_times

        figures.append(draw_running_times(times, counts, options.out))
    results = _results(times, change)
    return CommandOutcome(
        results=results,
        requirements=_requirements(results),
        seeds=sets,
        summary=_summary(results),
        figures=tuple(figures),
    )


def _results(times: Sequence[SessionTimes], change: AnnouncementChange | None) -> dict[str, Any]:
    """Everything that the issue of this reproduction asks for."""
    cases = [session_results(item) for item in times]
    threads = blas_threads()
    warning = blas_warning(threads)
    return {
        "cases": cases,
        "same_choices": all(case["same_choices"] for case in cases),
        "max_rel_diff": max(case["max_rel_diff"] for case in cases),
        "published": [
            {"robots": robots, "candidates": count, "seconds": seconds}
            for (robots, count), seconds in PUBLISHED.items()
        ],
        "published_ratio": _published_ratio(),
        "figure_7": None if change is None else _change_results(change),
        "world_seeds": {str(robots): seed for robots, seed in WORLD_SEEDS.items()},
        "notes": [
            "published seconds are of a prototype in Matlab and GTSAM on another machine, with a "
            "roadmap and noise that are not printed: compare ratios, not seconds",
            "seconds.sets says on how many candidate sets an evaluator was timed; those on which "
            f"it had not agreed after {MOST_TURNS} turns are counted apart and not timed",
            "as_published is our implementation of Algorithms 1-3 on sparse matrices in Python; as "
            "published it knows a factor by its announced vertex alone, so a vertex that the old "
            "and the new path reach by other edges, with other headings, counts as unchanged: its "
            "values and choices can differ, with two robots too",
        ],
        "blas_threads": threads,
        "warnings": [] if warning is None else [warning],
    }


def _published_ratio() -> float:
    """How many times faster the published approach is than theirs from scratch."""
    seconds = PUBLISHED[PUBLISHED_AT]
    return seconds["Standard approach"] / seconds["proposed approach"]


def _change_results(change: AnnouncementChange) -> dict[str, Any]:
    """What figure 7 shows."""
    return {
        "candidate_set": change.number,
        "criterion_m": change.criterion_m,
        "as_in_paper": change.criterion_m == CRITERION_M,
        "turn": change.turn,
        "robot": change.robot,
        "candidates": len(change.world.candidates[change.robot]),
        "impacted": len(change.impacted),
        "factors_kept": len(change.kept),
        "factors_removed": len(change.removed),
        "factors_added": len(change.added),
    }


def _requirements(results: Mapping[str, Any]) -> tuple[Requirement, ...]:
    """Same decisions as from scratch; at the published size at least the published ratio."""
    found = [
        require_true("same_choices", results["same_choices"]),
        require_at_most("max_rel_diff", results["max_rel_diff"], LARGEST_DIFFERENCE),
    ]
    for case in results["cases"]:
        if (case["robots"], case["candidates"]) == PUBLISHED_AT:
            ratio = case["ratio_vs_from_scratch"]["incremental"]
            name = "ratio_vs_from_scratch at 2 robots, 50 candidates"
            found.append(require_at_least(name, ratio, results["published_ratio"]))
    return tuple(found)


def _summary(results: Mapping[str, Any]) -> tuple[str, ...]:
    """Lines for the terminal."""
    names = tuple(results["cases"][0]["seconds"])
    lines = ["median seconds until agreement (times faster than from_scratch)"]
    lines.append(f"{'robots':>6s} {'candidates':>10s}" + "".join(f"{n:>22s}" for n in names))
    for case in results["cases"]:
        line = f"{case['robots']:6d} {case['candidates']:10d}"
        for name in names:
            ratio = case["ratio_vs_from_scratch"].get(name)
            times = "" if ratio is None else f" ({ratio:.1f})"
            median = case["seconds"][name]["median"]
            line += ("no agreement" if median is None else f"{median:.4f}{times}").rjust(22)
        lines.append(line)
    for item in results["published"]:
        told = ", ".join(f"{name} {value:g} s" for name, value in item["seconds"].items())
        lines.append(
            f"published, {item['robots']} robots, {item['candidates']} candidates: {told} "
            f"(ratio {results['published_ratio']:.1f})"
        )
    shown = results["figure_7"]
    if shown is None:
        lines.append("figure 7: no moment with impacted and untouched candidates was found")
    else:
        lines.append(
            f"figure 7: {shown['impacted']} of {shown['candidates']} candidates of "
            f"{shown['robot']} impacted, criterion {shown['criterion_m']:g} m"
        )
    return (*lines, *(f"warning: {warning}" for warning in results["warnings"]))
