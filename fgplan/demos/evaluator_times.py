"""The evaluators side by side on what robots really evaluated: seconds and values.

Every evaluator gets candidates of each robot under the announced paths of that robot's first
evaluation of the session, then under those of its second (a re-evaluation after announcements).
What it prepares before the first (``start``) is timed apart. Compiled kernels must be warm.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fgplan.demos.announced_views import Candidates, View, views_of
from fgplan.evaluation.evaluations import AbstractEvaluator
from fgplan.evaluation.problem import PlanningProblem
from fgplan.typing import FloatArray, IntArray

SESSIONS = ("first evaluation", "re-evaluation")


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedEvaluator:
    """What is to be timed.

    Attributes:
        label: Unique name of the run.
        evaluator: The evaluator.
        every_candidate: All candidates of a robot; otherwise only those that all runs have.
    """

    label: str
    evaluator: AbstractEvaluator
    every_candidate: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluatorTimes:
    """What one evaluator needed and found.

    Attributes:
        label: Name of the run.
        start_s: Seconds of preparation, all robots together.
        seconds: By session that took place: seconds of evaluation, all robots together.
        evaluations: By session: candidates evaluated, all robots together.
        fallbacks: By session: solves that the evaluator's own way refused.
        values: By session: objective of the candidates that all runs have, shape (n,).
    """

    label: str
    start_s: float
    seconds: Mapping[str, float]
    evaluations: Mapping[str, int]
    fallbacks: Mapping[str, int]
    values: Mapping[str, FloatArray] = field(repr=False)

    def milliseconds(self, session: str) -> float:
        """Milliseconds a candidate in one session."""
        return 1e3 * self.seconds[session] / self.evaluations[session]

    def difference(self, reference: "EvaluatorTimes", session: str) -> float:
        """Largest relative difference of the values from a reference's."""
        expected = reference.values[session]
        return float((np.abs(self.values[session] - expected) / np.abs(expected)).max())


@dataclass(slots=True)
class _Clock:
    """Sums of one run while it goes on."""

    start_s: float = 0.0
    seconds: dict[str, float] = field(default_factory=dict)
    evaluations: dict[str, int] = field(default_factory=dict)
    fallbacks: dict[str, int] = field(default_factory=dict)
    values: dict[str, list[float]] = field(default_factory=dict)


def time_evaluators(
    problem: PlanningProblem,
    candidates: Candidates,
    views: Sequence[View],
    timed: Sequence[TimedEvaluator],
    *,
    count: int,
    progress: Callable[[int, int, str], None],
) -> tuple[EvaluatorTimes, ...]:
    """Time evaluators on the views of a session, interleaved robot by robot.

    Args:
        problem: The problem.
        candidates: Candidate paths by robot.
        views: Evaluations of the session.
        timed: What to time.
        count: Candidates a robot that all runs have, spread evenly over its candidates by length.
        progress: Called as ``progress(done, total, doing)``.

    Returns:
        Times and values of each run, in the order given.
    """
    clocks = {item.label: _Clock() for item in timed}
    done = 0
    for robot, paths in candidates.items():
        shared = np.unique(np.linspace(0, len(paths) - 1, min(count, len(paths))).astype(np.int64))
        for item in timed:
            progress(done, len(candidates) * len(timed), "timing evaluators")
            done += 1
            places = np.arange(len(paths)) if item.every_candidate else shared
            _time_robot(problem, robot, candidates, views, item, places, shared, clocks[item.label])
    return tuple(
        EvaluatorTimes(
            label=label,
            start_s=clock.start_s,
            seconds=clock.seconds,
            evaluations=clock.evaluations,
            fallbacks=clock.fallbacks,
            values={session: np.array(values) for session, values in clock.values.items()},
        )
        for label, clock in clocks.items()
    )


def _time_robot(
    problem: PlanningProblem,
    robot: str,
    candidates: Candidates,
    views: Sequence[View],
    item: TimedEvaluator,
    places: IntArray,
    shared: IntArray,
    clock: _Clock,
) -> None:
    """Add one robot's times and values of one run to its clock."""
    # What another evaluator left in the prior's memory must not help this one.
    problem.prior.eliminations.clear()
    chosen = [candidates[robot][place] for place in places]
    compared = np.searchsorted(places, shared)
    began = time.perf_counter()
    state = item.evaluator.start(problem, robot, chosen)
    clock.start_s += time.perf_counter() - began
    for session, view in zip(SESSIONS, views_of(views, robot), strict=False):
        began = time.perf_counter()
        state, found = item.evaluator.evaluate(state, view.others)
        passed = time.perf_counter() - began
        clock.seconds[session] = clock.seconds.get(session, 0.0) + passed
        clock.evaluations[session] = clock.evaluations.get(session, 0) + len(chosen)
        clock.fallbacks[session] = clock.fallbacks.get(session, 0) + found.report.fallbacks
        clock.values.setdefault(session, []).extend(found.values[compared].tolist())
