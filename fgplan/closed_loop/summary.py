"""A closed loop in numbers and lines: what commands print and result files hold."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from fgplan.closed_loop.records import LoopHistory, SessionRecord
from fgplan.models.pose import position, position_slice

_COUNTS = ("turns", "announcements", "multi_robot_factors", "landmark_factors", "messages_reused")


def loop_results(history: LoopHistory) -> dict[str, Any]:
    """The numbers of a loop.

    Args:
        history: The loop; at least one step.

    Returns:
        Plain values by name: steps, goals, what each session did, errors and spread at the end.
    """
    last = history.steps[-1]
    return {
        "steps": last.step,
        "time_s": last.time_s,
        "goals": {robot: len(goals) for robot, goals in history.goals.items()},
        "reached": dict(history.reached),
        "unreachable": {robot: list(why) for robot, why in history.unreachable.items()},
        "collided": sorted({robot for step in history.steps for robot in step.collided}),
        "measurements": sum(len(step.measurements) for step in history.steps),
        "slam_seconds": sum(step.seconds for step in history.steps),
        "position_error_m": {robot: position_error(history, robot) for robot in history.robots},
        "position_sigma_m": {
            robot: float(np.sqrt(_trace(last.covariances[robot]))) for robot in history.robots
        },
        "landmarks": 0 if history.final is None else len(history.final.landmarks),
        "sessions": [session_results(session) for session in history.sessions],
    }


def session_results(session: SessionRecord) -> dict[str, Any]:
    """The numbers of a session.

    Args:
        session: The session.

    Returns:
        Plain values by name.
    """
    counts = {name: session.counts[name] for name in _COUNTS if name in session.counts}
    return {
        "session": session.session,
        "step": session.step,
        "time_s": session.time_s,
        "trigger": session.trigger,
        "goal_numbers": dict(session.goal_numbers),
        "renewed": list(session.renewed),
        "chosen": dict(session.chosen_index),
        "objective": session.values[-1],
        "seconds": {name: run.seconds for name, run in session.runs.items()},
        "candidates_kept": dict(session.candidates_kept),
        "candidates_replaced": dict(session.candidates_replaced),
        "segments_reused": dict(session.segments_reused),
        "segments_rebuilt": dict(session.segments_rebuilt),
        "max_rel_diff": session.max_rel_diff,
        "obstacles": len(session.obstacles),
        **counts,
    }


def session_line(session: SessionRecord) -> str:
    """What a session was about, in one line.

    Args:
        session: The session.

    Returns:
        The line.
    """
    kept = {robot: count for robot, count in session.candidates_kept.items() if count}
    new = {robot: count for robot, count in session.candidates_replaced.items() if count}
    parts = [
        f"session {session.session} at step {session.step} ({session.trigger})",
        f"new candidates {_counts(new)}",
        f"kept {_counts(kept)}",
        f"{sum(session.segments_reused.values())} messages reused",
        f"{session.counts['multi_robot_factors']} factors between robots",
        f"objective {session.values[0]:.4g} -> {session.values[-1]:.4g}",
    ]
    if session.obstacles:
        parts.insert(1, f"{len(session.obstacles)} new obstacles")
    if session.max_rel_diff is not None:
        parts.append(f"from scratch to {session.max_rel_diff:.0e}")
    return "; ".join(parts)


def loop_lines(history: LoopHistory) -> list[str]:
    """What a loop came to: a line a session, a line a robot.

    Args:
        history: The loop; at least one step.

    Returns:
        Lines to print.
    """
    last = history.steps[-1]
    lines = [session_line(session) for session in history.sessions]
    for robot, reached in history.reached.items():
        sigma = float(np.sqrt(_trace(last.covariances[robot])))
        lines.append(
            f"  {robot}: {reached} of {len(history.goals[robot])} goals; position off by "
            f"{position_error(history, robot):.3g} m at the end, 1 sigma {sigma:.3g} m"
        )
    lines += [f"  gave up: {why}" for reasons in history.unreachable.values() for why in reasons]
    return lines


def position_error(history: LoopHistory, robot: str) -> float:
    """Distance of a robot's last estimate from the truth.

    Args:
        history: The loop; at least one step.
        robot: Name.

    Returns:
        Metres.
    """
    last = history.steps[-1]
    offset = position(last.estimates[robot]) - position(last.truth[robot])
    return float(np.linalg.norm(offset))


def _trace(covariance: np.ndarray) -> float:
    """Trace of the position part of a pose's covariance, square metres."""
    rows = position_slice(len(covariance))
    return float(np.trace(covariance[rows, rows]))


def _counts(by_robot: Mapping[str, int]) -> str:
    """Counts by robot, as text."""
    return ", ".join(f"{robot} {count}" for robot, count in by_robot.items()) or "none"
