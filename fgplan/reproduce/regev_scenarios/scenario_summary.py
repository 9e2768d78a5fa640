"""Scenarios 1, 2 and 3 over all seeds: what the missions of each come to."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fgplan.closed_loop.unknown_world import LARGE
from fgplan.reproduce.regev_scenarios.mission_run import RATIOS, ratios

Missions = Sequence[Mapping[str, Any]]
"""Results of ``run_mission``."""


def summarise(missions: Missions) -> list[dict[str, Any]]:
    """One entry a scenario and variant.

    Args:
        missions: All that are done.

    Returns:
        Plain data. Seconds are sums over all sessions and seeds, and ``ratio_total`` and the like
        are their ratios; ``least`` is over seeds; everything else that is one number of a mission
        is its median over seeds.
    """
    groups: dict[tuple[int, str], list[Mapping[str, Any]]] = {}
    for one in missions:
        groups.setdefault((one["scenario"], one["variant"]), []).append(one)
    return [_summary(*which, groups[which]) for which in sorted(groups)]


def trace_without_meetings(summaries: Missions) -> float | None:
    """How much more position covariance comes without factors between robots in planning.

    Args:
        summaries: Made by ``summarise``.

    Returns:
        Median over seeds of the largest position trace, of Scenario 2 over that of Scenario 1;
        None where one of the two is not there.
    """
    largest = {
        entry["scenario"]: entry["largest_position_trace"]
        for entry in summaries
        if entry["variant"] == "as_published"
    }
    return float(largest[2] / largest[1]) if {1, 2} <= largest.keys() else None


def messages_taken_over(missions: Missions, session: int) -> list[dict[str, Any]]:
    """What robots that kept candidates took over at a session.

    Args:
        missions: Missions of any scenario.
        session: Number of the session; missions that had fewer are left out.

    Returns:
        A row a robot: scenario, variant, seed, robot, ``messages_reused``, and ``steps_left``, the
        steps of the path it then chose.
    """
    return [
        {
            **{name: one[name] for name in ("scenario", "variant", "seed")},
            "robot": robot,
            "steps_left": held["steps_left"][robot],
            "messages_reused": held["messages_reused"].get(robot, 0),
        }
        for one in missions
        for held in one["sessions"]
        if held["session"] == session
        for robot in kept_robots(held)
    ]


def kept_robots(held: Mapping[str, Any]) -> list[str]:
    """Robots that kept candidates at a session: they did not arrive, nor was every one blocked."""
    return [robot for robot, count in held["candidates_kept"].items() if count]


def _summary(scenario: int, variant: str, missions: Missions) -> dict[str, Any]:
    """What the missions of one scenario and variant come to."""
    names = missions[0]["seconds_total"]
    seconds = {name: sum(one["seconds_total"][name] for one in missions) for name in names}
    totals = ratios(seconds, "_total")
    compared = missions[0]["same_choices"] is not None
    found: dict[str, Any] = {
        "scenario": scenario,
        "variant": variant,
        "missions": len(missions),
        "sessions": sum(len(one["sessions"]) for one in missions),
        "seconds_total": seconds,
        **totals,
    }
    if compared:
        found |= {
            "ratio_total_least": {name: min(one[name] for one in missions) for name in totals},
            "same_choices": all(one["same_choices"] for one in missions),
            "max_rel_diff": max(one["max_rel_diff"] for one in missions),
        }
    for name in ("position_trace_start", "position_trace_max", "position_trace_end"):
        robots = missions[0][name]
        found[name] = {robot: _median([one[name][robot] for one in missions]) for robot in robots}
    found["largest_position_trace"] = _median([one["largest_position_trace"] for one in missions])
    found["largest_end_of_start"] = {
        robot: max(
            one["position_trace_end"][robot] / one["position_trace_start"][robot]
            for one in missions
        )
        for robot in LARGE
        if scenario == 3
    }
    found["by_session"] = _by_session(missions)
    return found


def _by_session(missions: Missions) -> list[dict[str, Any]]:
    """Medians over the missions that had a session of this number."""
    most = max(len(one["sessions"]) for one in missions)
    rows = []
    for place in range(most):
        held = [one["sessions"][place] for one in missions if len(one["sessions"]) > place]
        kept = [count for one in held for count in _reused_by_kept(one)]
        rows.append(
            {
                "session": place + 1,
                "missions": len(held),
                "seconds": {
                    name: _median([one["seconds"][name] for one in held])
                    for name in held[0]["seconds"]
                },
                **{name: _median([one[name] for one in held]) for name in RATIOS},
                "impacted_share": _median([one["impacted_share"] for one in held]),
                "factors": {
                    kind: _median([one["factors"][kind] for one in held])
                    for kind in held[0]["factors"]
                },
                "robots_that_kept": len(kept),
                "messages_reused": _median(kept),
            }
        )
    return rows


def _reused_by_kept(held: Mapping[str, Any]) -> list[int]:
    """Messages taken over by each robot that kept candidates."""
    return [held["messages_reused"].get(robot, 0) for robot in kept_robots(held)]


def _median(values: Sequence[float | None]) -> float | None:
    """Median of those that are there; None where none is."""
    there = [value for value in values if value is not None]
    return float(np.median(there)) if there else None
