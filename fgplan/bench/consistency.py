"""``fgplan bench consistency``: is what SLAM and planning believe what then comes true?

Missions in the unknown world of section 7.2 of Regev and Indelman 2017, one a seed.

SLAM: at every step each robot's current pose has a normalised estimation error squared
(fgplan/slam/consistency.py). Seeds are independent runs, robots of one mission are not (they share
landmarks), so the mean is taken over seeds, a robot and step at a time, and compared with the
chi-square interval for as many seeds. A robot counts up to its last arrival: from then on it stands
still, and its one last pose would be counted again and again. Missions differ in length; steps that
fewer than half of the seeds reached are left out.

Planning: the covariance that a robot was planned to arrive with against that which SLAM has at its
arrival, by the trace of the position block. Planned twice: at the session where the way to that
goal began, when much of it was still unknown, and at the last one before the arrival.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np

from fgplan.closed_loop.loop import run_loop
from fgplan.closed_loop.records import SessionRecord, StepRecord
from fgplan.closed_loop.unknown_world import Scenario, draw_mission
from fgplan.errors import FgplanError, InvalidInputError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.mission_digest import mission_digest
from fgplan.io.result_file import Requirement, package_versions, require_at_least
from fgplan.simulation.sweep import SweepTask, run_sweep
from fgplan.slam.consistency import chi_square_interval, normalised_error_squared
from fgplan.typing import Covariance

SEEDS, QUICK_SEEDS = 50, 4
CANDIDATES, QUICK_CANDIDATES = 50, 3
GOALS, QUICK_GOALS = 3, 1
DIMENSIONS = 3
SHARE = 0.95
SMALLEST_INSIDE = 0.9
MISSIONS_FILE = "missions.jsonl"
PLANNED = ("leg", "last")
"""Sessions whose plan is compared: the first of the way to a goal, the last before the arrival."""

Missions = Sequence[Mapping[str, Any]]
"""Results of ``measure_mission``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of this bench."""
    parser.add_argument(
        "--scenario",
        type=int,
        choices=(1, 2, 3),
        default=1,
        help="of Table 1 of Regev and Indelman 2017 (default: 1)",
    )
    parser.add_argument(
        "--workers", type=int, default=1, metavar="N", help="missions at a time (default: 1)"
    )
    parser.add_argument(
        "--resume", action="store_true", help="keep the missions that are in --out already"
    )


def run(options: CommandOptions) -> CommandOutcome:
    """Run the bench.

    Args:
        options: ``seeds`` is the number of missions (50 by default); ``out`` takes the figures and
            the finished missions; arguments are those of ``add_arguments``.

    Returns:
        Consistency of SLAM, and planned against reported covariance.

    Raises:
        InvalidInputError: If there are fewer than two seeds, or no worker.
        FgplanError: If a mission failed; the others are kept.
        MissingExtraError: If figures are to be drawn and matplotlib is not installed.
    """
    seeds = options.seed_range(SEEDS, quick=QUICK_SEEDS)
    workers = options.arguments.get("workers", 1)
    if len(seeds) < 2 or workers < 1:
        raise InvalidInputError(
            f"consistency: expected --seeds 2 or more and --workers 1 or more, got {len(seeds)} "
            f"and {workers}"
        )
    if options.out is not None:
        # Known now, not after a quarter of an hour.
        from fgplan.viz.figure import matplotlib_module

        matplotlib_module("figure")
    scenario = cast(Scenario, options.arguments.get("scenario", 1))
    candidates = QUICK_CANDIDATES if options.quick else CANDIDATES
    goals = QUICK_GOALS if options.quick else GOALS
    with TemporaryDirectory() as temporary:
        file = (options.out or Path(temporary)) / MISSIONS_FILE
        if not options.arguments.get("resume", False):
            file.unlink(missing_ok=True)
        swept = run_sweep(
            [make_task(seed, scenario, candidates, goals) for seed in seeds],
            measure_mission,
            out=file,
            workers=workers,
            progress=lambda done, total, _: options.progress(done, total, "missions"),
        )
    for record in swept.records:
        if record.status != "done":
            raise FgplanError(
                f"consistency, seed {record.task.seed}: the mission {record.status}; the others "
                f"are kept, run again with --resume:\n{record.error}"
            )
    missions = swept.results
    results = {"scenario": scenario, **judge_slam(missions), **judge_plans(missions)}
    results["notes"] = [
        "a robot counts up to its last arrival; from then on it stands still",
        "steps that fewer than half of the seeds reached are left out; the interval of a step is "
        "that of the seeds that reached it",
        "planned on the way to a goal: 'leg' at the session where it began (the path may be "
        "changed by later ones), 'last' at the last session before the arrival",
        "planned motion noise is less than odometry's: it stands for odometry together with the "
        "landmarks on the way that nobody has mapped yet (fgplan/closed_loop/unknown_world.py)",
    ]
    figures: list[Path] = []
    if options.out is not None:
        from fgplan.bench.consistency_figures import draw_errors, draw_plans

        figures = [draw_errors(results, options.out), draw_plans(results, options.out)]
    return CommandOutcome(
        results=results,
        requirements=_requirements(results),
        seeds=seeds,
        summary=_summary(results),
        figures=tuple(figures),
    )


def make_task(seed: int, scenario: Scenario, candidates: int, goals: int) -> SweepTask:
    """One mission as a task; with other numbers or other versions it is another task."""
    mission = draw_mission(seed, scenario, candidates=candidates, goals=goals)
    return SweepTask(
        seed=seed,
        arguments={
            "scenario": scenario,
            "candidates": candidates,
            "goals": goals,
            "mission": mission_digest(mission),
            "versions": package_versions(),
        },
    )


def measure_mission(task: SweepTask) -> dict[str, Any]:
    """Run one mission and measure errors and arrivals.

    Args:
        task: Made by ``make_task``.

    Returns:
        Plain data: ``errors`` by robot, its normalised error squared from step 0 to its last
        arrival; ``arrivals``, each with step, robot, ``reported`` trace of the position block
        (square metres) and ``planned`` ones by session.
    """
    given = task.arguments
    mission = draw_mission(
        task.seed,
        cast(Scenario, given["scenario"]),
        candidates=given["candidates"],
        goals=given["goals"],
    )
    errors: dict[str, list[float]] = {robot.name: [] for robot in mission.robots}
    goals_left = {robot.name: len(robot.goals) for robot in mission.robots}
    planned: dict[tuple[str, int], dict[str, float]] = {}
    heading_for: Mapping[str, int] = {}
    arrivals: list[dict[str, Any]] = []
    for record in run_loop(mission):
        if isinstance(record, SessionRecord):
            heading_for = record.goal_numbers
            for way in heading_for.items():
                trace = position_trace(record.covariances[way[0]][-1])
                planned.setdefault(way, {"leg": trace})["last"] = trace
        elif isinstance(record, StepRecord):
            for robot, left in goals_left.items():
                if left:
                    errors[robot].append(
                        normalised_error_squared(
                            record.estimates[robot], record.truth[robot], record.covariances[robot]
                        )
                    )
            for robot in record.arrived:
                goals_left[robot] -= 1
                arrivals.append(
                    {
                        "step": record.step,
                        "robot": robot,
                        "planned": planned[robot, heading_for[robot]],
                        "reported": position_trace(record.covariances[robot]),
                    }
                )
    return {"seed": task.seed, "errors": errors, "arrivals": arrivals}


def position_trace(covariance: Covariance) -> float:
    """Trace of the position block of a planar pose's covariance, square metres."""
    return float(np.trace(covariance[:2, :2]))


def judge_slam(missions: Missions) -> dict[str, Any]:
    """Mean normalised error squared by robot and step, and how often it is inside its interval.

    Args:
        missions: Results of ``measure_mission``, at least two.

    Returns:
        ``errors``, a row a robot and step: seeds, mean, interval; ``inside`` over all rows and
        ``inside_by_robot``; ``mean_error``, over all rows, to be compared with ``dimensions``.
    """
    rows = []
    for robot in missions[0]["errors"]:
        runs = [one["errors"][robot] for one in missions]
        for step in range(max(map(len, runs))):
            reached = [run[step] for run in runs if len(run) > step]
            count = len(reached)
            if 2 * count < len(runs):
                continue
            low, high = chi_square_interval(DIMENSIONS * count, SHARE)
            mean = float(np.mean(reached))
            rows.append(
                {
                    "robot": robot,
                    "step": step,
                    "seeds": count,
                    "mean": mean,
                    "interval": [low / count, high / count],
                    "inside": bool(low <= mean * count <= high),
                }
            )
    robots = tuple(missions[0]["errors"])
    return {
        "dimensions": DIMENSIONS,
        "errors": rows,
        "inside": float(np.mean([row["inside"] for row in rows])),
        "above": float(np.mean([row["mean"] > row["interval"][1] for row in rows])),
        "below": float(np.mean([row["mean"] < row["interval"][0] for row in rows])),
        "inside_by_robot": {
            robot: float(np.mean([row["inside"] for row in rows if row["robot"] == robot]))
            for robot in robots
        },
        "mean_error": float(np.mean([row["mean"] for row in rows])),
    }


def judge_plans(missions: Missions) -> dict[str, Any]:
    """Planned position covariance at arrival against what SLAM then reports.

    Args:
        missions: Results of ``measure_mission``.

    Returns:
        ``arrivals`` with their seeds, and by session of the plan the mean, geometric mean and
        quartiles of planned over reported.
    """
    arrivals = [{"seed": one["seed"], **each} for one in missions for each in one["arrivals"]]
    ratios = {
        which: np.array([each["planned"][which] / each["reported"] for each in arrivals])
        for which in PLANNED
    }
    return {
        "arrivals": arrivals,
        "planned_over_reported": {
            which: {
                "mean": float(np.mean(each)),
                "geometric_mean": float(np.exp(np.mean(np.log(each)))),
                "quartiles": np.percentile(each, [25, 50, 75]).tolist(),
            }
            for which, each in ratios.items()
        },
    }


def _requirements(results: Mapping[str, Any]) -> tuple[Requirement, ...]:
    """The interval holds the mean at nine of ten steps."""
    name = f"share of robot-steps whose mean error is inside its {SHARE:.0%} interval"
    return (require_at_least(name, results["inside"], SMALLEST_INSIDE),)


def _summary(results: Mapping[str, Any]) -> tuple[str, ...]:
    """Lines for the terminal."""
    by_robot = ", ".join(f"{k} {v:.1%}" for k, v in results["inside_by_robot"].items())
    lines = [
        f"mean normalised error squared {results['mean_error']:.2f} ({DIMENSIONS} expected)",
        f"inside the interval at {results['inside']:.1%} of {len(results['errors'])} robot-steps, "
        f"above at {results['above']:.1%}, below at {results['below']:.1%} ({by_robot})",
    ]
    for which, words in zip(PLANNED, ("session of the leg", "last session before"), strict=True):
        ratio = results["planned_over_reported"][which]
        lines.append(
            f"position covariance at arrival, planned ({words}) over reported: mean "
            f"{ratio['mean']:.2f}, geometric mean {ratio['geometric_mean']:.2f}, median "
            f"{ratio['quartiles'][1]:.2f}, {len(results['arrivals'])} arrivals"
        )
    return tuple(lines)
