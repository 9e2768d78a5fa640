"""Figure 6a: running time of a planning session against the number of candidate paths.

A session lasts from the first evaluation to agreement, everything included. Every evaluator plans
the same sets, one after the other, in an order that rotates; one set of every size is planned
before the next set of any, so that a change in the machine's load falls on all.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fgplan.bench.open_world import OpenWorld
from fgplan.bench.session import CONTESTANTS
from fgplan.reproduce.regev_fig6.scenario import Scenario
from fgplan.team.agreement import Agreement
from fgplan.team.coordination import coordinate
from fgplan.team.options import CoordinationOptions

EVALUATORS = ("from_scratch", "as_published", "incremental", "incremental_choose")
EXACT = ("from_scratch", "incremental", "incremental_choose")

SLOW_SETS = {("as_published", 4, 25): 10, ("as_published", 4, 50): 10}
"""Sets that a slow evaluator plans at most, by evaluator, robots and candidates: for time only."""

MOST_TURNS = 60
"""Turns after which a session is given up; exact evaluators need some twenty at most. With values
that are not exact the objective may rise and the same announcements come round for ever."""

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
        seconds: Seconds by evaluator, then by number of the set; of sessions that agreed.
        agreements: What was agreed, likewise.
        endless: By evaluator, numbers of the sets on which its session was given up.
    """

    robots: int
    candidates: int
    seconds: dict[str, dict[int, float]] = field(default_factory=lambda: _by_evaluator(dict))
    agreements: dict[str, dict[int, Agreement]] = field(default_factory=lambda: _by_evaluator(dict))
    endless: dict[str, list[int]] = field(default_factory=lambda: _by_evaluator(list))

    def time_set(self, scenario: Scenario, number: int) -> None:
        """Plan one set by every evaluator whose turn it is."""
        world = scenario.with_candidates(self.candidates, number)
        shift = number % len(EVALUATORS)
        for name in EVALUATORS[shift:] + EVALUATORS[:shift]:
            limit = SLOW_SETS.get((name, self.robots, self.candidates))
            if limit is not None and number >= limit:
                continue
            seconds, agreement = plan(world, name, scenario.digest)
            if agreement.agreed:
                self.seconds[name][number] = seconds
                self.agreements[name][number] = agreement
            else:
                self.endless[name].append(number)

    def same_choices(self, name: str) -> float | None:
        """Share of the sets on which an evaluator agreed on the same paths as from scratch.

        A set on which it did not agree counts as another choice; None if it planned none.
        """
        ours, theirs = self.agreements[name], self.agreements["from_scratch"]
        same = [n in theirs and ours[n].chosen == theirs[n].chosen for n in ours]
        same += [False] * len(self.endless[name])
        return float(np.mean(same)) if same else None

    def ratio(self, name: str) -> float | None:
        """How many times faster than from scratch: median of the ratios by set, None if none."""
        ours, theirs = self.seconds[name], self.seconds["from_scratch"]
        ratios = [theirs[n] / ours[n] for n in ours if n in theirs]
        return float(np.median(ratios)) if ratios else None


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


def plan(world: OpenWorld, name: str, digest: str) -> tuple[float, Agreement]:
    """Let the team of a world agree.

    Args:
        world: The world with its candidates.
        name: Evaluator, one of ``EVALUATORS``.
        digest: Digest of the prior.

    Returns:
        Seconds from the first evaluation to the end, and what was agreed, if it was.
    """
    contestant = CONTESTANTS[name]
    options = CoordinationOptions(
        choose=contestant.choose, check_values=contestant.exact, max_turns=MOST_TURNS
    )
    began = time.perf_counter()
    agreement = coordinate(
        world.problem, world.candidates, contestant.evaluator, options=options, prior_digest=digest
    )
    return time.perf_counter() - began, agreement


def warm_up(scenarios: Mapping[int, Scenario]) -> None:
    """Plan one small set of each scenario by every evaluator: kernels are compiled and loaded."""
    for scenario in scenarios.values():
        world = scenario.with_candidates(3, 0)
        for name in EVALUATORS:
            plan(world, name, scenario.digest)


def session_results(times: SessionTimes) -> dict[str, Any]:
    """What came out for one team size and number of candidates."""
    exact = times.agreements["incremental"]
    return {
        "robots": times.robots,
        "candidates": times.candidates,
        "seconds": {name: _second_results(times, name) for name in EVALUATORS},
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


def _second_results(times: SessionTimes, name: str) -> dict[str, Any]:
    """Median and spread of one evaluator's seconds; without them where it never agreed."""
    counts = {
        "sets": len(times.seconds[name]),
        "sets_without_agreement": len(times.endless[name]),
    }
    found = list(times.seconds[name].values())
    if not found:
        return {"median": None, **counts}
    low, middle, high = np.percentile(found, [25, 50, 75]).tolist()
    spread = {"quartiles": [low, high], "least": min(found), "most": max(found)}
    return {"median": middle, **spread, **counts}


def _by_evaluator(kind: Callable[[], Any]) -> dict[str, Any]:
    """Something empty for every evaluator."""
    return {name: kind() for name in EVALUATORS}


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
