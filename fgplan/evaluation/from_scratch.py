"""The Standard approach: every candidate's joint belief from scratch.

For each candidate path the joint factor graph of equation (11) is put together, eliminated, and the
objective read. What does not depend on the candidate (the prior, the announced paths and the
factors among them) is built once a turn and shared; factors between a candidate and an announced
path are kept until that path changes. The elimination itself is done anew for every candidate.

``marginals`` is what a good engineer writes with GTSAM, ``fastest`` the fastest that we found GTSAM
to be, ``qr`` the oracle (see fgplan/beliefs/from_scratch.py). All three are exact.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from fgplan.beliefs.from_scratch import (
    CandidatePart,
    CommonGraph,
    Elimination,
    GraphPart,
    candidate_part,
    check_elimination,
    common_graph,
    own_part,
    pair_part,
    wanted_covariances,
)
from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.evaluation.evaluations import Evaluations, ReevaluationReport, weigh
from fgplan.evaluation.problem import PlanningProblem
from fgplan.evaluation.term_values import (
    CutReadings,
    PriorKey,
    VariableRef,
    objective_readings,
    path_steps,
    path_values,
    prior_covariances,
    reading_value,
)
from fgplan.factors.path_factors import pose_key
from fgplan.paths.candidate_path import CandidatePath
from fgplan.threads import one_blas_thread
from fgplan.typing import Covariance, Key


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FromScratchState:
    """What is kept from one evaluation to the next: factors, never a result.

    Attributes:
        problem: The problem.
        robot: The robot whose candidates these are.
        candidates: Its candidate paths.
        own: Of each candidate, its poses and the factors that no announcement changes.
        priors: Covariances under the prior, for mutual information.
        announced: Announced paths that the next two were built for.
        others: By robot, the factors of its path; by two robots, those between them.
        between: By robot, the factors between each candidate and its path.
    """

    problem: PlanningProblem
    robot: str
    candidates: tuple[CandidatePath, ...]
    own: tuple[CandidatePart, ...] = field(repr=False)
    priors: Mapping[int, Covariance] = field(repr=False)
    announced: Mapping[str, CandidatePath] = field(repr=False, default_factory=dict)
    others: Mapping[tuple[str, ...], GraphPart] = field(repr=False, default_factory=dict)
    between: Mapping[str, tuple[GraphPart, ...]] = field(repr=False, default_factory=dict)


@dataclass(frozen=True, slots=True)
class FromScratch:
    """Evaluator of the Standard approach.

    Attributes:
        elimination: ``marginals``, ``fastest`` or ``qr``.
        name: Name in reports and scenario files.
    """

    elimination: Elimination = "marginals"
    name: str = "from_scratch"

    def __post_init__(self) -> None:
        """Check the elimination."""
        check_elimination(self.elimination)

    @one_blas_thread()
    def start(
        self, problem: PlanningProblem, robot: str, candidates: Sequence[CandidatePath]
    ) -> FromScratchState:
        """Build what depends on the prior and the candidates alone.

        Args:
            problem: The problem.
            robot: The robot whose candidates are to be evaluated.
            candidates: Its candidate paths.

        Returns:
            The state to pass to ``evaluate``.

        Raises:
            InvalidInputError: If a candidate is another robot's or does not fit the problem.
            UnknownNameError: If the robot, a sensor or a landmark is not known.
        """
        check_candidates(problem, robot, candidates)
        return FromScratchState(
            problem=problem,
            robot=robot,
            candidates=tuple(candidates),
            own=tuple(candidate_part(problem, path) for path in candidates),
            priors=prior_covariances(problem),
        )

    @one_blas_thread()
    def evaluate(
        self, state: FromScratchState, announced: Mapping[str, CandidatePath]
    ) -> tuple[FromScratchState, Evaluations]:
        """Evaluate every candidate under the others' announced paths.

        Args:
            state: From ``start`` or an earlier ``evaluate``.
            announced: Announced path of each other robot that has one; the robot's own is ignored.

        Returns:
            The state for next time, and the values.

        Raises:
            InvalidInputError: If an announced path does not fit the problem.
            IllPosedBeliefError: If a variable is not determined.
        """
        state = with_announced(state, announced)
        commons: dict[int | None, CommonGraph] = {}

        def covariances(
            place: int,
            limit: int | None,
            wanted: Sequence[tuple[Key, ...]],
            dims: Mapping[Key, int],
        ) -> tuple[list[Covariance], bool]:
            if limit not in commons:
                parts = list(state.others.values())
                commons[limit] = common_graph(state.problem, state.announced, parts, limit)
            own = state.own[place]
            return wanted_covariances(
                commons[limit],
                candidate_parts(state, place, limit),
                own.poses,
                wanted,
                dims,
                self.elimination,
            )

        return state, evaluate_candidates(state, covariances)


CovarianceQuery = Callable[
    [int, int | None, Sequence[tuple[Key, ...]], Mapping[Key, int]], tuple[list[Covariance], bool]
]
"""(candidate, cut or None, lists of keys, their dimensions) to joint covariances, fell back."""


def evaluate_candidates(state: FromScratchState, covariances: CovarianceQuery) -> Evaluations:
    """Objective of every candidate, given a way to compute joint covariances.

    Args:
        state: The candidates and the announced paths.
        covariances: Called for every candidate and cut with the lists of keys that are read.

    Returns:
        Values and terms of all candidates, all of them counted as impacted.
    """
    problem, others = state.problem, dict(state.announced)
    fixed = path_values(problem, others, tuple(others))
    terms = np.zeros((len(state.candidates), len(problem.objective.terms)))
    plans: dict[int, tuple[_ReadPlan, ...]] = {}
    solves = fallbacks = 0
    for place, path in enumerate(state.candidates):
        if path.steps not in plans:
            steps = path_steps({**others, state.robot: path})
            plans[path.steps] = tuple(
                _read_plan(problem, cut) for cut in objective_readings(problem, steps)
            )
        terms[place] = fixed + path_values(problem, {state.robot: path}, (state.robot,))
        for plan in plans[path.steps]:
            found, fell_back = covariances(place, plan.limit, plan.wanted, plan.dims)
            by_keys = dict(zip(plan.wanted, found, strict=True))
            for reading, keys in zip(plan.cut.readings, plan.keys, strict=True):
                block = by_keys[keys][np.ix_(reading.rows, reading.rows)]
                value = reading_value(reading, block[None], state.priors)
                terms[place, reading.term] += value[0]
            solves += 1
            fallbacks += fell_back
    report = ReevaluationReport(
        impacted=tuple(range(len(state.candidates))), solves=solves, fallbacks=fallbacks
    )
    return Evaluations(robot=state.robot, values=weigh(problem, terms), terms=terms, report=report)


def candidate_parts(state: FromScratchState, place: int, limit: int | None) -> list[GraphPart]:
    """Factors of one candidate under the announced paths, cut at a step (equation 21)."""
    parts = [state.own[place].part.cut(limit)]
    parts += [between[place].cut(limit) for between in state.between.values()]
    return parts


@dataclass(frozen=True, slots=True)
class _ReadPlan:
    """Readings at one cut, as GTSAM keys."""

    cut: CutReadings
    limit: int | None
    keys: tuple[tuple[Key, ...], ...]
    wanted: tuple[tuple[Key, ...], ...]
    dims: Mapping[Key, int]


def _read_plan(problem: PlanningProblem, cut: CutReadings) -> _ReadPlan:
    """Keys of the readings at one cut; equal lists are asked for once."""
    keys = tuple(tuple(variable_key(problem, ref) for ref in r.variables) for r in cut.readings)
    dims = {
        variable_key(problem, ref): int(dim)
        for ref, dim in zip(cut.variables, cut.dims, strict=True)
    }
    return _ReadPlan(cut, None if cut.final else cut.cut, keys, tuple(dict.fromkeys(keys)), dims)


def with_announced(
    state: FromScratchState, announced: Mapping[str, CandidatePath]
) -> FromScratchState:
    """Factors for new announcements; those of paths that did not change are kept."""
    problem = state.problem
    others = check_announced(problem, state.robot, announced)
    same = {robot for robot, path in others.items() if state.announced.get(robot) is path}
    parts: dict[tuple[str, ...], GraphPart] = {}
    for robot, path in others.items():
        parts[(robot,)] = state.others[(robot,)] if robot in same else own_part(problem, path)
    for robot, other in combinations(others, 2):
        pair = (robot, other)
        kept = robot in same and other in same
        parts[pair] = (
            state.others[pair] if kept else pair_part(problem, others[robot], others[other])
        )
    between = {
        robot: state.between[robot]
        if robot in same
        else tuple(pair_part(problem, candidate, path) for candidate in state.candidates)
        for robot, path in others.items()
    }
    return replace(state, announced=others, others=parts, between=between)


def check_candidates(
    problem: PlanningProblem, robot: str, candidates: Sequence[CandidatePath]
) -> None:
    """Check that candidates belong to a robot and a problem.

    Raises:
        NoCandidatePathError: If there is no candidate.
        InvalidInputError: If a candidate is another robot's or does not fit the problem.
        UnknownNameError: If the robot, a sensor or a landmark is not known.
    """
    if not candidates:
        raise NoCandidatePathError(
            f"robot {robot!r}: expected at least one candidate path, got none; check that its "
            "goal is reachable"
        )
    for path in candidates:
        problem.check_path(path)
        if path.robot != robot:
            raise InvalidInputError(
                f"candidates of robot {robot!r}: got a path of robot {path.robot!r}"
            )


def check_announced(
    problem: PlanningProblem, robot: str, announced: Mapping[str, CandidatePath]
) -> dict[str, CandidatePath]:
    """Announced paths of the other robots in the order of the team, checked.

    Raises:
        InvalidInputError: If a path is filed under another robot or does not fit the problem.
        UnknownNameError: If a robot is not in the team.
    """
    problem.check_announced(announced)
    return {name: announced[name] for name in problem.robots if name in announced and name != robot}


def variable_key(problem: PlanningProblem, ref: VariableRef) -> Key:
    """GTSAM key of a variable that the objective reads."""
    return ref.key if isinstance(ref, PriorKey) else pose_key(problem, ref.robot, ref.step)
