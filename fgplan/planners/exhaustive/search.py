"""The team's optimum: the least objective over all combinations of candidate paths.

One robot, the pivot (the one with most candidates), is evaluated under every combination of the
others' paths; each evaluation gives the objective of as many combinations as it has candidates.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.evaluation.evaluations import TIE_TOLERANCE, AbstractEvaluator
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath


@dataclass(frozen=True, slots=True, kw_only=True)
class Optimum:
    """Best combination.

    Attributes:
        chosen: Index of each robot's path among its candidates; robots without candidates are
            left out.
        value: Common objective.
        combinations: How many there were.
        evaluations: How many evaluations of the pivot that took.
    """

    chosen: Mapping[str, int]
    value: float
    combinations: int
    evaluations: int


def search_all(
    problem: PlanningProblem,
    candidates: Mapping[str, Sequence[CandidatePath]],
    evaluator: AbstractEvaluator,
    *,
    limit: int,
    progress: Callable[[int, int, str], None] | None = None,
) -> Optimum:
    """Evaluate every combination.

    Args:
        problem: Prior, team, objective and models.
        candidates: Candidate paths of each robot; one without stays at its start.
        evaluator: How to evaluate; every candidate, without choosing by bounds.
        limit: Most combinations that are tried.
        progress: Called with evaluations done and in all.

    Returns:
        The best; of equal ones the one with the least indices, the pivot's last.

    Raises:
        InvalidInputError: If there are more combinations than the limit; says how many.
        NoCandidatePathError: If no robot has a candidate, or no combination a finite value.
    """
    robots = [robot for robot in problem.robots if candidates.get(robot)]
    if not robots:
        raise NoCandidatePathError("exhaustive: expected a robot with candidate paths, got none")
    combinations = math.prod(len(candidates[robot]) for robot in robots)
    if combinations > limit:
        counts = " x ".join(str(len(candidates[robot])) for robot in robots)
        raise InvalidInputError(
            f"exhaustive: expected at most {limit} combinations, got {counts} = {combinations}; "
            "use fewer robots or candidates, or raise the option combinations"
        )
    pivot = max(robots, key=lambda robot: len(candidates[robot]))
    others = [robot for robot in robots if robot != pivot]
    state = evaluator.start(problem, pivot, candidates[pivot])
    best, found = math.inf, {}
    total = combinations // len(candidates[pivot])
    ranges = (range(len(candidates[robot])) for robot in others)
    for done, indices in enumerate(itertools.product(*ranges)):
        announced = {r: candidates[r][index] for r, index in zip(others, indices, strict=True)}
        state, evaluations = evaluator.evaluate(state, announced)
        values = evaluations.values
        if np.isfinite(values).any() and values.min() < best - TIE_TOLERANCE * abs(values.min()):
            index = evaluations.best
            best = float(values[index])
            found = {**dict(zip(others, indices, strict=True)), pivot: index}
        if progress is not None:
            progress(done + 1, total, "combinations")
    if not found:
        raise NoCandidatePathError("exhaustive: no combination has a finite objective")
    return Optimum(
        chosen={robot: found[robot] for robot in robots},
        value=best,
        combinations=combinations,
        evaluations=total,
    )
