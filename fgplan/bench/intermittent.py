"""``fgplan bench intermittent``: plans of teams of two, three and four robots to a meeting.

Starts, start times and covariances are drawn anew for every plan, in the scene of Khodayi-mehr et
al. 2019, section IV. ``met_first_try`` is the share of plans whose tree holds a meeting (connected
and simultaneous); a plan in which the limit of the most uncertain target did not hold says so and
takes the next most uncertain target, or none; one without a meeting in its tree goes the straight
way. ``met`` is the share that ends in a meeting: all.
"""

import argparse
import time
from collections import Counter
from typing import Any

import numpy as np

from fgplan.bench.intermittent_scene import (
    UNPRINTED,
    first_estimate,
    indoor_model,
    indoor_world,
    segment_options,
)
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import require_at_most, require_true
from fgplan.planners.intermittent.estimate import Estimate
from fgplan.planners.intermittent.segment import Segment, algebraic_connectivity, plan_segment
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from fgplan.threads import one_blas_thread
from roadmaps import sample_positions

PLAN_SECONDS = 1.0
LATEST_START = 60
TARGETS = tuple(range(8))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of this bench."""
    parser.add_argument("--plans", type=int, default=20, help="plans a team size (default 20)")


@one_blas_thread()
def run(options: CommandOptions) -> CommandOutcome:
    """Plan for teams of every size.

    Args:
        options: Argument ``plans``.

    Returns:
        ``results.teams`` and what is required of them.
    """
    plans = 3 if options.quick else int(options.arguments.get("plans", 20))
    began = time.perf_counter()
    plan_segment(drawn_problem(2, 0), segment_options(), np.random.default_rng(0))
    compiled = time.perf_counter() - began
    teams: list[dict[str, Any]] = []
    for robots in (2, 3, 4):
        options.progress(len(teams), 3, f"{robots} robots")
        teams.append(bench_team(robots, plans))
        options.record({"teams": teams})
    results = {
        "teams": teams,
        "samples": UNPRINTED["samples"],
        "compile_or_load_seconds": compiled,
        "unprinted": UNPRINTED,
    }
    two = teams[0]
    needs = (
        require_at_most("plan_seconds_of_two_robots", two["plan_seconds"], PLAN_SECONDS),
        require_true("every_plan_meets", all(team["met"] == 1.0 for team in teams)),
        require_true(
            "every_fallback_says_why",
            all(team["unexplained"] == 0 for team in teams),
            "a plan without fallback, or what failed",
        ),
    )
    return CommandOutcome(
        results=results, requirements=needs, seeds=tuple(range(plans)), summary=_summary(teams)
    )


def drawn_problem(robots: int, seed: int) -> SegmentProblem:
    """A team's problem with starts, times and covariances drawn.

    Args:
        robots: Size of the team.
        seed: Of all draws.

    Returns:
        The problem.
    """
    generator = np.random.default_rng([robots, seed])
    world = indoor_world()
    first = first_estimate(TARGETS)
    variances = generator.uniform(0.02, 0.5, len(TARGETS))
    covariance = variances[:, None, None] * np.diag([1.0, 1.0, 0.2])
    return SegmentProblem(
        workspace=world,
        model=indoor_model(TARGETS, robots, 600),
        estimate=Estimate(0, first.mean, covariance),
        starts=sample_positions(world, robots, generator),
        times=generator.integers(0, LATEST_START, robots),
    )


def bench_team(robots: int, plans: int) -> dict[str, Any]:
    """Plans of one team size.

    Args:
        robots: Size of the team.
        plans: Number of plans, seeds from 0.

    Returns:
        Seconds, shares that met, and which constraints had to be given up how often.
    """
    seconds, segments, met = [], [], []
    chosen = segment_options()
    for seed in range(plans):
        problem = drawn_problem(robots, seed)
        began = time.perf_counter()
        segment = plan_segment(problem, chosen, np.random.default_rng(seed))
        seconds.append(time.perf_counter() - began)
        segments.append(segment)
        ends = np.array([places[-1] for places in segment.places])
        met.append(algebraic_connectivity(ends, chosen.range_m) > 0.0)
    failed = Counter(name for segment in segments for name in segment.failed)
    return {
        "robots": robots,
        "samples": chosen.samples,
        "plans": plans,
        "plan_seconds": float(np.median(seconds)),
        "slowest_plan_seconds": float(np.max(seconds)),
        "met_first_try": float(np.mean([segment.meeting_nodes > 0 for segment in segments])),
        "met": float(np.mean(met)),
        "limit_held_for": {
            "most_uncertain": sum(segment.at_first_attempt for segment in segments),
            "next_ones": sum(segment.rank > 0 for segment in segments),
            "none": sum(segment.rank < 0 for segment in segments),
        },
        "failed": dict(failed),
        "unexplained": sum(_is_unexplained(segment) for segment in segments),
        "nodes": float(np.mean([segment.nodes for segment in segments])),
        "duration_steps": float(np.median([segment.end for segment in segments])),
    }


def _is_unexplained(segment: Segment) -> bool:
    """A plan in which no target met its limit and nothing is said to have failed."""
    return segment.rank < 0 and not segment.failed


def _summary(teams: list[dict[str, Any]]) -> tuple[str, ...]:
    """Lines to print."""
    lines = ["robots  plan (median)  met in the tree  met   limit held for the 1st / next / none"]
    for team in teams:
        held = team["limit_held_for"]
        lines.append(
            f"{team['robots']:<7} {team['plan_seconds']:.3f} s        "
            f"{100 * team['met_first_try']:5.0f} %          {100 * team['met']:3.0f} %   "
            f"{held['most_uncertain']} / {held['next_ones']} / {held['none']}"
        )
    return tuple(lines)
