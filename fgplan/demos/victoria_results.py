"""What the Victoria Park demo says: lines to print, and the same as results for the result file."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fgplan.demos.announced_views import View
from fgplan.demos.arrival import Arrival
from fgplan.demos.evaluator_times import EvaluatorTimes
from fgplan.demos.victoria_log import GAUGE_SIGMAS, TeamPast, VictoriaLog
from fgplan.demos.victoria_team import (
    TREE_RADIUS_M,
    TeamOptions,
    VictoriaTeam,
    observed_trees,
    steps_with_a_view,
)
from fgplan.team.agreement import Agreement

ALL_CANDIDATES = "incremental, all candidates"
"""The run that gives the incremental evaluator all candidates of a robot, as planning does."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Session:
    """One planning session on one roadmap.

    Attributes:
        seed: Of the roadmap.
        team: Problem and candidates.
        agreement: How the team came to agree.
        views: Every evaluation in order.
        seconds: Of the whole session, from the first evaluator's start to agreement.
    """

    seed: int
    team: VictoriaTeam = field(repr=False)
    agreement: Agreement = field(repr=False)
    views: tuple[View, ...] = field(repr=False)
    seconds: float


def log_lines(log: VictoriaLog, past: TeamPast) -> list[str]:
    """What the team's past is and how it was estimated."""
    robots, counts = len(past.parts), past.factors
    by_robots = Counter(past.seen_by.values())
    shared = ", ".join(f"{by_robots[n]} by {n}" for n in sorted(by_robots, reverse=True))
    bearing, distance = log.sighting_sigmas
    x, y, heading = log.odometry_sigmas
    gauge_x, _, gauge_heading = GAUGE_SIGMAS
    return [
        f"Victoria Park: {len(log.poses)} poses of the log are the past of {robots} robots, "
        f"{len(log.poses) // robots} or so each; {counts['odometry']} odometry factors "
        f"({counts['left_out']} between the robots' parts left out), {counts['sightings']} "
        f"sightings of {len(past.seen_by)} trees",
        f"  trees tie the robots together: seen {shared} robots; {len(past.seen_once)} trees were "
        "sighted once only, so nothing checks them",
        f"  gauge: prior on the first pose of {next(iter(past.parts))}, {gauge_x:g} m and "
        f"{gauge_heading:g} rad; noise of the file: odometry {x:g} m, {y:g} m, {heading:g} rad a "
        f"step, sightings {bearing:.3g} rad and {distance:.3g} m",
        f"  joint MAP: cost {past.cost:.1f} (half the squared whitened residuals), well posed; "
        "initial values from the whole log by ISAM2 (from the file's own, LM ends in a local "
        "minimum)",
    ]


def team_lines(team: VictoriaTeam, choices: TeamOptions) -> list[str]:
    """What the robots may do."""
    width, height = team.workspace.upper - team.workspace.lower
    metre, radian = team.motion.per_metre, team.motion.per_radian
    turned = np.degrees(team.laser.field_of_view_rad)
    meeting = choices.meeting_sigmas
    lines = [
        f"park: {width:.0f} x {height:.0f} m around what was driven; there is no obstacle map, so "
        f"trees (discs of {TREE_RADIUS_M:g} m) are the only obstacles and nothing blocks a view; "
        f"PRM of {len(team.roadmap)} vertices",
        f"laser: {team.laser.max_range_m:g} m, {turned:.0f} degrees; motion noise "
        f"{metre[0]:.2g} m, {metre[1]:.2g} m, {metre[2]:.2g} rad after 1 m and {radian[0]:.2g} m, "
        f"{radian[1]:.2g} m, {radian[2]:.2g} rad after turning 1 rad (the log as driven then has "
        "its file's noise)",
        f"robots nearer than {choices.meeting_m:g} m, at any two times: relative pose, "
        f"{meeting[0]:g} m, {meeting[1]:g} m, {meeting[2]:g} rad; objective (41): "
        f"{choices.path_weight:g} a metre of way + {choices.uncertainty_weight:g} a square metre "
        f"of position variance on arrival",
    ]
    for robot, paths in team.candidates.items():
        seeing, blind = steps_with_a_view(paths)
        steps = [path.steps for path in paths]
        lengths = [path.length_m for path in paths]
        goal = team.goals[robot]
        lines.append(
            f"  {robot} to ({goal[0]:.0f}, {goal[1]:.0f}), {team.unmapped_m[robot]:.0f} m of its "
            f"straight way out of sight of any tree: {len(paths)} candidates, "
            f"{min(lengths):.0f}-{max(lengths):.0f} m, {min(steps)}-{max(steps)} steps; "
            f"{seeing} steps see mapped trees, {blind} none"
        )
    return lines


def session_lines(session: Session, arrival: Arrival, further: Sequence[Session] = ()) -> list[str]:
    """What was chosen, what will be known, and what was re-evaluated."""
    agreement, team = session.agreement, session.team
    lines = ["chosen:"]
    for robot, path in agreement.paths.items():
        seeing, _ = steps_with_a_view([path])
        lines.append(
            f"  {robot}: candidate {agreement.chosen[robot]} of {len(team.candidates[robot])}, "
            f"{path.length_m:.0f} m; position sigma on arrival {arrival.with_team_m[robot]:.3f} m, "
            f"{arrival.without_team_m[robot]:.3f} m without the team's factors (now "
            f"{arrival.now_m[robot]:.3f} m); observes {len(observed_trees(path))} mapped trees, "
            f"{len(path.observations)} times from {seeing} of {path.steps} steps"
        )
    lines.append(
        f"  {arrival.multi_robot_factors} multi-robot factors among the chosen paths; much of "
        "what is left is the map's own uncertainty far from the first pose, which all share"
    )
    values = " -> ".join(f"{value:.4f}" for value in agreement.values)
    how = "agreed" if agreement.agreed else "NOT agreed"
    lines.append(
        f"{how} after {agreement.turns} turns, {len(agreement.values) - 1} accepted announcements; "
        f"objective {values}; {session.seconds:.2f} s in all"
    )
    lines += [_round_line(account) for account in round_accounts(session)]
    if not any(view.report.untouched for view in session.views):
        lines.append(
            "  no candidate is ever untouched here: the trees that all have seen correlate the "
            "robots, so every announcement reaches every candidate"
        )
    error = abs(arrival.objective - agreement.value) / abs(arrival.objective)
    lines.append(f"  the agreed objective from scratch by QR: relative difference {error:.1e}")
    lines += [_seed_line(item) for item in further]
    return lines


def round_accounts(session: Session) -> list[dict[str, Any]]:
    """Work of each round, all robots together."""
    robots = len(session.team.candidates)
    accounts = []
    for number in sorted({view.round for view in session.views}):
        reports = [view.report for view in session.views if view.round == number]
        records = [
            record
            for record in session.agreement.records
            if record.turn > 0 and (record.turn - 1) // robots + 1 == number
        ]
        accounts.append(
            {
                "round": number,
                "robots_evaluated": len(reports),
                "candidates": sum(len(r.impacted) + len(r.untouched) for r in reports),
                "impacted": sum(len(r.impacted) for r in reports),
                "untouched": sum(len(r.untouched) for r in reports),
                "solved": sum(r.solves for r in reports),
                "skipped": sum(len(r.skipped) for r in reports),
                "factors_added": sum(r.factors_added for r in reports),
                "factors_removed": sum(r.factors_removed for r in reports),
                "factors_kept": sum(r.factors_kept for r in reports),
                "fallbacks": sum(r.fallbacks for r in reports),
                "announced": [record.robot for record in records if record.announced],
                "milliseconds": 1e3 * sum(v.seconds for v in session.views if v.round == number),
            }
        )
    return accounts


def _round_line(account: Mapping[str, Any]) -> str:
    """One round in words."""
    announced = ", ".join(account["announced"]) or "nobody"
    return (
        f"  round {account['round']}: {account['robots_evaluated']} of the robots evaluated "
        f"{account['candidates']} candidates: {account['impacted']} impacted, "
        f"{account['untouched']} untouched; {account['solved']} solved, {account['skipped']} "
        f"skipped by bounds; factors: {account['factors_added']} added, "
        f"{account['factors_removed']} removed, {account['factors_kept']} kept; "
        f"{account['milliseconds']:.0f} ms; announced: {announced}"
    )


def _seed_line(session: Session) -> str:
    """Another roadmap in one line."""
    first, last = session.agreement.values[0], session.agreement.value
    how = "agreed" if session.agreement.agreed else "NOT agreed"
    return f"  roadmap of seed {session.seed}: {how}, objective {first:.4f} -> {last:.4f}"


def time_lines(times: Sequence[EvaluatorTimes]) -> list[str]:
    """How long each evaluator takes, and how far its values are from the incremental ones."""
    ours, standard = times[0], _labelled(times, "from_scratch")
    count = next(iter(ours.evaluations.values()))
    lines = [
        f"evaluators, milliseconds a candidate: {count} candidates of the first round, each robot "
        "under the paths that it saw then, and again where it re-evaluated (preparation apart); "
        "times faster than from_scratch; largest relative difference of values from incremental"
    ]
    for item in times:
        parts = []
        for session in item.seconds:
            faster = standard.milliseconds(session) / item.milliseconds(session)
            part = f"{session} {item.milliseconds(session):.1f} ms ({faster:.1f} x"
            if item is not ours:
                part += f", {item.difference(ours, session):.0e}"
            if item.fallbacks[session]:
                part += f", fell back {item.fallbacks[session]} x"
            parts.append(part + ")")
        lines.append(f"  {item.label}: {', '.join(parts)}; prepared in {item.start_s:.2f} s")
    lines.append(
        "  incremental's cost is mostly a turn's, not a candidate's. GTSAM's Cholesky, which "
        "from_scratch and isam2 use, is itself off by up to 1e-7 on Victoria Park. as_published "
        "re-evaluates inexactly by design: it misses what changed between two other robots and "
        "takes a vertex reached with another heading for the same pose (a fall-back puts a matrix "
        "together anew)"
    )
    return lines


def _labelled(times: Sequence[EvaluatorTimes], label: str) -> EvaluatorTimes:
    """The run of a label."""
    return next(item for item in times if item.label == label)


def values_agree(times: Sequence[EvaluatorTimes]) -> float:
    """Largest relative difference of the exact evaluators from incremental."""
    ours = times[0]
    return max(
        item.difference(ours, session)
        for item in times[1:]
        if item.label != "as_published"
        for session in item.seconds
    )


def results_of(
    log: VictoriaLog,
    past: TeamPast,
    sessions: Sequence[Session],
    arrival: Arrival,
    times: Sequence[EvaluatorTimes],
    seconds: Mapping[str, float],
) -> dict[str, Any]:
    """Everything that was found, as plain data."""
    session = sessions[0]
    agreement, team = session.agreement, session.team
    ours, standard = times[0], _labelled(times, "from_scratch")
    return {
        "past": {
            "poses": len(log.poses),
            "trees": len(past.seen_by),
            "trees_seen_once": len(past.seen_once),
            "trees_by_robots": dict(sorted(Counter(past.seen_by.values()).items())),
            "factors": past.factors,
            "map_cost": past.cost,
            "gauge_sigmas": GAUGE_SIGMAS,
        },
        "robots": {
            robot: {
                "goal": team.goals[robot],
                "unmapped_m": team.unmapped_m[robot],
                "candidates": len(team.candidates[robot]),
                "candidate_steps": [path.steps for path in team.candidates[robot]],
                "steps_with_a_view": steps_with_a_view(team.candidates[robot])[0],
                "steps_without": steps_with_a_view(team.candidates[robot])[1],
                "chosen": agreement.chosen[robot],
                "length_m": path.length_m,
                "steps": path.steps,
                "sigma_now_m": arrival.now_m[robot],
                "sigma_on_arrival_m": arrival.with_team_m[robot],
                "sigma_without_team_m": arrival.without_team_m[robot],
                "trees_observed": len(observed_trees(path)),
                "observations": len(path.observations),
            }
            for robot, path in agreement.paths.items()
        },
        "agreed": agreement.agreed,
        "turns": agreement.turns,
        "objective": agreement.values,
        "objective_by_qr": arrival.objective,
        "multi_robot_factors": arrival.multi_robot_factors,
        "rounds": round_accounts(session),
        "planning_seconds": session.seconds,
        "evaluators": {
            item.label: {
                "start_seconds": item.start_s,
                "milliseconds": {s: item.milliseconds(s) for s in item.seconds},
                "ratio_vs_from_scratch": {
                    s: standard.milliseconds(s) / item.milliseconds(s) for s in item.seconds
                },
                "max_rel_diff": {s: item.difference(ours, s) for s in item.seconds},
                "evaluations": item.evaluations,
                "fallbacks": item.fallbacks,
            }
            for item in times
        },
        "further_seeds": [
            {
                "seed": item.seed,
                "agreed": item.agreement.agreed,
                "objective": item.agreement.values,
                "chosen": item.agreement.chosen,
            }
            for item in sessions[1:]
        ],
        "seconds": dict(seconds),
    }
