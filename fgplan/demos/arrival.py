"""What the robots will know on arrival: with the factors between them, and without.

Both beliefs hold the whole past, every chosen path and every planned observation of a tree, are put
together from scratch and eliminated by QR; only the multi-robot factors differ. So the first also
checks the objective that the team agreed on, and the second says what the team's factors bring.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fgplan.beliefs.candidate_belief import candidate_belief
from fgplan.evaluation.objective import PosesOf, UncertaintyTerm
from fgplan.evaluation.problem import PlanningProblem
from fgplan.evaluation.term_values import path_values
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """What the team will know when every robot has followed its path to its end.

    Attributes:
        covariances: By robot, covariance of its pose at every step, shape (L + 1, 3, 3), tangent.
        now_m: Position sigma (root of the trace) before leaving, metres.
        with_team_m: On arrival, with the multi-robot factors.
        without_team_m: On arrival on the same paths, without them.
        multi_robot_factors: Number of them.
        objective: Of these paths, by this belief.
    """

    covariances: Mapping[str, FloatArray] = field(repr=False)
    now_m: Mapping[str, float]
    with_team_m: Mapping[str, float]
    without_team_m: Mapping[str, float]
    multi_robot_factors: int
    objective: float


def know_on_arrival(problem: PlanningProblem, paths: Mapping[str, CandidatePath]) -> Arrival:
    """Compute what the team will know on arrival.

    Args:
        problem: Objective (41) and models.
        paths: Path of each robot.

    Returns:
        Sigmas with and without the team's factors.
    """
    joint = candidate_belief(problem, paths)
    marginals = joint.belief().marginal_covariances(
        [key for keys in joint.keys.values() for key in keys]
    )
    covariances = {
        robot: np.array([marginals[key] for key in keys]) for robot, keys in joint.keys.items()
    }
    alone = candidate_belief(replace(problem, multi_robot=()), paths)
    ends = {robot: keys[-1] for robot, keys in alone.keys.items()}
    apart = alone.belief().marginal_covariances(list(ends.values()))
    now = problem.prior.marginal_covariances(list(problem.start_keys.values()))
    return Arrival(
        covariances=covariances,
        now_m={robot: _sigma_m(now[key]) for robot, key in problem.start_keys.items()},
        with_team_m={robot: _sigma_m(each[-1]) for robot, each in covariances.items()},
        without_team_m={robot: _sigma_m(apart[key]) for robot, key in ends.items()},
        multi_robot_factors=sum(f.identity.kind == "multi_robot" for f in joint.factors),
        objective=_objective(problem, paths, covariances),
    )


def _sigma_m(covariance: FloatArray) -> float:
    """Root of the trace of the position block, metres."""
    return float(np.sqrt(np.trace(covariance[:2, :2])))


def _objective(
    problem: PlanningProblem,
    paths: Mapping[str, CandidatePath],
    covariances: Mapping[str, FloatArray],
) -> float:
    """Objective (41) read off the covariances on arrival."""
    terms = path_values(problem, dict(paths), problem.robots)
    value = 0.0
    for term, of_path in zip(problem.objective.terms, terms, strict=True):
        if isinstance(term, UncertaintyTerm) and isinstance(term.of, PosesOf):
            end = covariances[term.of.robots[0]][-1]
            value += term.weight * float(np.trace(end[:2, :2]))
        else:
            value += term.weight * float(of_path)
    return value
