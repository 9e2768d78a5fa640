"""Figure 6a: running time of a planning session against the number of candidate paths.

A session lasts from the first evaluation to agreement, everything included. Every evaluator plans
the same sets, one after the other, in an order that rotates; one set of every size is planned
before the next set of any, so that a change in the machine's load falls on all.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fgplan.bench.session import CONTESTANTS, plan_session
from fgplan.reproduce.regev_fig6.scenario import Scenario
from fgplan.team.agreement import Agreement

EVALUATORS = ("from_scratch", "as_published", "incremental", "incremental_choose")
EXACT = ("from_scratch", "incremental", "incremental_choose")

SLOW_SETS = {("as_published", 4, 25): 20, ("as_published", 4, 50): 20}
"""Sets that a slow evaluator plans at most, by evaluator, robots and candidates: for time only."""

PUBLISHED = {
    (2, 50): {"Standard approach": 85.0, "proposed approach": 35.0},
}
"""Seconds by robots and candidates, all that the text of section 7.1 prints (Matlab and GTSAM)."""


@dataclass(slots=True, eq=False)
class SessionTimes:
    """Sessions of one team size and number of candidates.

    Attributes:
        robots: Robots.
        candidates: Candidates a robot.
        seconds: Seconds by evaluator, then by number of the set.
        agreements: What was agreed, likewise.
    """

    robots: int
    candidates: int
    seconds: dict[str, dict[int, float]] = field(default_factory=dict)
    agreements: dict[str, dict[int, Agreement]] = field(default_factory=dict)

    def time_set(self, scenario: Scenario, number: int) -> None:
        """Plan one set by every evaluator whose turn it is."""
        world = scenario.with_candidates(self.candidates, number)
        shift = number % len(EVALUATORS)
        for name in EVALUATORS[shift:] + EVALUATORS[:shift]:
            limit = SLOW_SETS.get((name, self.robots, self.candidates))
            if limit is not None and number >= limit:
                continue
            seconds, agreement = plan_session(world, CONTESTANTS[name], scenario.digest)
            self.seconds.setdefault(name, {})[number] = seconds
            self.agreements.setdefault(name, {})[number] = agreement

    def same_choices(self, name: str) -> float:
        """Share of the sets on which an evaluator agreed on the same paths as from scratch."""
        ours, theirs = self.agreements[name], self.agreements["from_scratch"]
        shared = [number for number in ours if number in theirs]
        return float(np.mean([ours[n].chosen == theirs[n].chosen for n in shared]))

    def ratio(self, name: str) -> float:
        """How many times faster than from scratch: median of the ratios by set."""
        ours, theirs = self.seconds[name], self.seconds["from_scratch"]
        return float(np.median([theirs[n] / ours[n] for n in ours if n in theirs]))


def time_sessions(
    scenarios: Mapping[int, Scenario],
    counts: Sequence[int],
    sets: Sequence[int],
    after_set: Callable[[int, Sequence[SessionTimes]], None],
) -> list[SessionTimes]:
    """Time all sessions.

    Args:
        scenarios: By number of robots.
        counts: Numbers of candidates.
        sets: Numbers of the candidate sets.
        after_set: Told how many sets are done, and all sessions so far.

    Returns:
        Sessions by team size and number of candidates.
    """
    warm_up(scenarios)
    found = [SessionTimes(robots, count) for robots in scenarios for count in counts]
    for done, number in enumerate(sets, start=1):
        for times in found:
            times.time_set(scenarios[times.robots], number)
        after_set(done, found)
    return found


def warm_up(scenarios: Mapping[int, Scenario]) -> None:
    """Plan one small set of each scenario by every evaluator: kernels are compiled and loaded."""
    for scenario in scenarios.values():
        world = scenario.with_candidates(3, 0)
        for name in EVALUATORS:
            plan_session(world, CONTESTANTS[name], scenario.digest)


def session_results(times: SessionTimes) -> dict[str, Any]:
    """What came out for one team size and number of candidates."""
    seconds = {}
    for name, by_set in times.seconds.items():
        low, middle, high = np.percentile(list(by_set.values()), [25, 50, 75]).tolist()
        seconds[name] = {
            "median": middle,
            "quartiles": [low, high],
            "least": min(by_set.values()),
            "most": max(by_set.values()),
            "sets": len(by_set),
        }
    exact = times.agreements["incremental"]
    return {
        "robots": times.robots,
        "candidates": times.candidates,
        "seconds": {name: seconds[name] for name in EVALUATORS},
        "ratio_vs_from_scratch": {
            name: times.ratio(name) for name in EVALUATORS if name != "from_scratch"
        },
        "same_choices": all(times.same_choices(name) == 1.0 for name in EXACT),
        "same_choices_as_published_share": times.same_choices("as_published"),
        "max_rel_diff": _largest_difference(times),
        "turns": float(np.median([agreement.turns for agreement in exact.values()])),
        "impacted_share": _impacted_share(list(exact.values())),
        "published_seconds": PUBLISHED.get((times.robots, times.candidates), {}),
    }


def _largest_difference(times: SessionTimes) -> float:
    """Largest relative difference of the agreed objective, exact evaluators to from scratch."""
    theirs = times.agreements["from_scratch"]
    return max(
        abs(agreement.value - theirs[number].value) / abs(theirs[number].value)
        for name in EXACT
        for number, agreement in times.agreements[name].items()
        if number in theirs
    )


def _impacted_share(agreements: Sequence[Agreement]) -> float | None:
    """Mean share of candidates that an announcement impacts, after each robot's first evaluation.

    None where no robot evaluated twice.
    """
    shares = []
    for agreement in agreements:
        evaluated = set()
        for record in agreement.records:
            if record.decision is None:
                continue
            if record.robot in evaluated:
                report = record.decision.report
                impacted, untouched = len(report.impacted), len(report.untouched)
                shares.append(impacted / (impacted + untouched))
            evaluated.add(record.robot)
    return float(np.mean(shares)) if shares else None
