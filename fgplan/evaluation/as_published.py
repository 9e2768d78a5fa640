"""Algorithms 1 to 3 of Regev and Indelman 2017, as published, for comparison.

The information matrix of every candidate is kept. When announced paths change:

    Algorithm 1  marks the candidates with a multi-robot factor on an old or new announced vertex
    section 4.1  gathers the changed local factors of the announcing robots and their Delta J
    section 5.2  marks all candidates if the current pose's covariance changes by more than a
                 threshold through prior correlation (39)
    Algorithm 2  unmarked: J + Delta J. Marked: the old matrix minus removed plus added factors (21)

The first evaluation, and any after a robot announced for the first time, is from scratch. The text
is read with its misprints corrected: Algorithm 1 lines 18 and 21 test the announced vertex; (17) is
new minus old; (39) compares new with old, in absolute value; (40) means M - m impacted paths.

Its inexactnesses are its own and are kept: a path that is impacted through a third robot only is
not marked; a marked path misses changed factors between two other robots; Delta J holds local
information only (section 4.4); prior correlation is tested without the factors that the others
exchange; the threshold of (39); and a factor is known by its announced vertex alone.

Where subtraction leaves a matrix that is not positive definite, that candidate's matrix is put
together anew, and the fall-back is counted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from fgplan.beliefs.information import (
    FactorInformation,
    SparseInformation,
    Variable,
    marginal_covariance,
    prior_information,
    update_information,
    without_unused,
)
from fgplan.errors import IllPosedBeliefError, InvalidInputError
from fgplan.evaluation.evaluations import Evaluations, ReevaluationReport, weigh
from fgplan.evaluation.from_scratch import check_announced, check_candidates
from fgplan.evaluation.objective import PosesOf, UncertaintyTerm
from fgplan.evaluation.prior_correlation import (
    Measure,
    check_measure,
    covariance_difference,
    starts_correlated,
)
from fgplan.evaluation.problem import PlanningProblem
from fgplan.evaluation.term_values import (
    PoseAt,
    VariableRef,
    objective_readings,
    path_steps,
    path_values,
    uncertainty_values,
)
from fgplan.evaluation.vertex_factors import (
    AnnouncedFactors,
    CandidateInformation,
    PairFactors,
    announced_factors,
    factors_among,
    own_factors,
    pair_factors_by_vertex,
)
from fgplan.factors.path_factors import pose_key
from fgplan.models.uncertainty import uncertainty_function
from fgplan.paths.candidate_path import CandidatePath
from fgplan.threads import one_blas_thread
from fgplan.typing import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AsPublishedState:
    """What is kept from one evaluation to the next.

    Attributes:
        problem: The problem.
        robot: The robot whose candidates these are.
        candidates: Its candidate paths.
        prior: Lambda_k.
        own: Of each candidate, the informations that no announcement changes.
        correlated: Robots whose current poses the prior correlates with this robot's (22).
        announced: The announced paths of the last evaluation.
        pairs: By robot, multi-robot factors of each candidate with its announced path.
        kept: What is kept of each candidate; empty before the first evaluation.
        evaluations: How many evaluations there were: T of (40).
    """

    problem: PlanningProblem
    robot: str
    candidates: tuple[CandidatePath, ...]
    prior: SparseInformation = field(repr=False)
    own: tuple[tuple[FactorInformation, ...], ...] = field(repr=False)
    correlated: frozenset[str]
    announced: Mapping[str, AnnouncedFactors] = field(repr=False, default_factory=dict)
    pairs: Mapping[str, tuple[PairFactors, ...]] = field(repr=False, default_factory=dict)
    kept: tuple[CandidateInformation, ...] = field(repr=False, default=())
    evaluations: int = 0


@dataclass(frozen=True, slots=True)
class AsPublished:
    """Evaluator of the published algorithms.

    Attributes:
        threshold: th of (39); the paper uses 10.
        measure: What (39) compares: the determinant of the current pose's covariance as the paper
            does, its trace, or the Kullback-Leibler divergence in nats.
        name: Name in reports and scenario files.
    """

    threshold: float = 10.0
    measure: Measure = "determinant"
    name: str = "as_published"

    def __post_init__(self) -> None:
        """Check the options."""
        if not (np.isfinite(self.threshold) and self.threshold >= 0.0):
            raise InvalidInputError(
                f"as_published threshold: expected a number, zero or more, got {self.threshold!r}"
            )
        check_measure(self.measure)

    @one_blas_thread()
    def start(
        self, problem: PlanningProblem, robot: str, candidates: Sequence[CandidatePath]
    ) -> AsPublishedState:
        """Build what depends on the prior and the candidates alone.

        Raises:
            InvalidInputError: If the objective reads what the paper does not (anything but one
                robot's pose at the end), or a candidate does not fit.
            UnknownNameError: If the robot, a sensor or a landmark is not known.
        """
        _check_objective(problem)
        check_candidates(problem, robot, candidates)
        return AsPublishedState(
            problem=problem,
            robot=robot,
            candidates=tuple(candidates),
            prior=prior_information(problem.prior),
            own=tuple(own_factors(problem, path) for path in candidates),
            correlated=frozenset(
                other
                for other in problem.robots
                if other != robot and starts_correlated(problem, robot, other)
            ),
        )

    @one_blas_thread()
    def evaluate(
        self, state: AsPublishedState, announced: Mapping[str, CandidatePath]
    ) -> tuple[AsPublishedState, Evaluations]:
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
        before = state
        state, changed = _with_announced(state, announced)
        first = not before.kept or set(before.announced) != set(state.announced)
        if first:
            marked = tuple(range(len(state.candidates)))
        else:
            marked = self._marked(before, state, changed)
        shift = np.zeros(len(state.problem.objective.terms))
        if len(marked) < len(state.candidates):
            shift = sum((_local_change(before, state, robot) for robot in changed), start=shift)
        kept, fallbacks = [], 0
        common = _common_information(state) if first else state.prior
        for place in range(len(state.candidates)):
            if first:
                kept.append(_from_scratch(state, common, place))
            elif place in marked:
                updated, fell_back = _reevaluated(state, place, before.kept[place])
                kept.append(updated)
                fallbacks += fell_back
            else:
                held = before.kept[place]
                kept.append(replace(held, terms=held.terms + shift))
        state = replace(state, kept=tuple(kept))
        terms = np.array([held.terms for held in kept]).reshape(len(kept), shift.size)
        report = _report(before, state, changed, marked, fallbacks)
        return state, Evaluations(
            robot=state.robot, values=weigh(state.problem, terms), terms=terms, report=report
        )

    def _marked(
        self, before: AsPublishedState, state: AsPublishedState, changed: Sequence[str]
    ) -> tuple[int, ...]:
        """Candidates to re-evaluate: Algorithm 1, and (39) where current poses are correlated."""
        for robot in changed:
            if robot in state.correlated:
                key = state.problem.start_keys[state.robot]
                old, new = (
                    marginal_covariance(_local_information(held, robot), [key])
                    for held in (before, state)
                )
                if covariance_difference(old, new, self.measure) > self.threshold:
                    return tuple(range(len(state.candidates)))
        return tuple(
            place
            for place in range(len(state.candidates))
            if any(
                pairs[robot][place].by_vertex
                for robot in changed
                for pairs in (before.pairs, state.pairs)
            )
        )


def _check_objective(problem: PlanningProblem) -> None:
    """Refuse terms that the published algorithms do not speak of."""
    for place, term in enumerate(problem.objective.terms):
        if not isinstance(term, UncertaintyTerm):
            continue
        single = isinstance(term.of, PosesOf) and len(term.of.robots) == 1
        if not single or term.read != "end" or uncertainty_function(term.function).needs_prior:
            raise InvalidInputError(
                f"objective term {place}: as_published reads one robot's pose at the end only, got "
                f"{term.function} of {term.of} read at {term.read!r}; use the evaluator "
                "'incremental' or 'from_scratch'"
            )


def _with_announced(
    state: AsPublishedState, announced: Mapping[str, CandidatePath]
) -> tuple[AsPublishedState, tuple[str, ...]]:
    """State under new announcements, and the robots whose path changed."""
    problem = state.problem
    others = check_announced(problem, state.robot, announced)
    changed = tuple(
        robot
        for robot, path in others.items()
        if robot not in state.announced or state.announced[robot].path is not path
    )
    factors = {
        robot: announced_factors(problem, path) if robot in changed else state.announced[robot]
        for robot, path in others.items()
    }
    pairs = {
        robot: tuple(
            pair_factors_by_vertex(problem, candidate, factors[robot])
            for candidate in state.candidates
        )
        if robot in changed
        else state.pairs[robot]
        for robot in others
    }
    count = state.evaluations + 1
    return replace(state, announced=factors, pairs=pairs, evaluations=count), changed


def _common_information(state: AsPublishedState) -> SparseInformation:
    """Prior, announced paths and the factors among them: what all candidates share in (12)."""
    factors = [f for announced in state.announced.values() for f in announced.local.values()]
    for first, second in combinations(state.announced.values(), 2):
        factors += factors_among(state.problem, first, second)
    return update_information(state.prior, factors, add=True)


def _from_scratch(
    state: AsPublishedState, common: SparseInformation, place: int
) -> CandidateInformation:
    """Lambda of one candidate put together from all factors: equation (12)."""
    pairs = {robot: state.pairs[robot][place] for robot in state.announced}
    joined = [f for pair in pairs.values() for fs in pair.by_vertex.values() for f in fs]
    information = update_information(common, [*state.own[place], *joined], add=True)
    terms = _terms(state, place, information)
    return CandidateInformation(information, state.announced, pairs, terms)


def _reevaluated(
    state: AsPublishedState, place: int, held: CandidateInformation
) -> tuple[CandidateInformation, bool]:
    """Lambda of one marked candidate updated by what changed: Algorithm 2, equation (21)."""
    information = held.information
    pairs: dict[str, PairFactors] = {}
    for robot, new in state.announced.items():
        old = held.announced[robot]
        old_pairs, new_pairs = held.pairs[robot].by_vertex, state.pairs[robot][place].by_vertex
        if old is new:
            pairs[robot] = held.pairs[robot]
            continue
        removed = [f for name, fs in old_pairs.items() if name not in new.names for f in fs]
        added = [f for name, fs in new_pairs.items() if name not in old.names for f in fs]
        information = update_information(information, removed, add=False)
        information = update_information(information, added, add=True)
        local_added = [f for key, f in new.local.items() if key not in old.local]
        local_removed = [f for key, f in old.local.items() if key not in new.local]
        information = update_information(information, local_added, add=True)
        information = update_information(information, local_removed, add=False)
        # What Lambda holds from now on: a factor on a vertex of both paths is the old one.
        by_vertex = {name: fs for name, fs in old_pairs.items() if name in new.names}
        by_vertex |= {name: fs for name, fs in new_pairs.items() if name not in old.names}
        pairs[robot] = replace(state.pairs[robot][place], by_vertex=by_vertex)
    information = without_unused(information)
    try:
        terms = _terms(state, place, information)
    except IllPosedBeliefError:
        return _from_scratch(state, _common_information(state), place), True
    return CandidateInformation(information, state.announced, pairs, terms), False


def _terms(state: AsPublishedState, place: int, information: SparseInformation) -> FloatArray:
    """Unweighted terms of one candidate, shape (T,)."""
    problem, path = state.problem, state.candidates[place]
    paths = {**{r: held.path for r, held in state.announced.items()}, state.robot: path}
    terms = path_values(problem, paths, problem.robots)
    for cut in objective_readings(problem, path_steps(paths)):
        names = [_name(state, ref) for ref in cut.variables]
        covariance = marginal_covariance(information, names)
        terms = terms + uncertainty_values(problem, cut, covariance[None], {})[0]
    return terms


def _name(state: AsPublishedState, ref: VariableRef) -> Variable:
    """Variable of the information matrix that the objective reads."""
    if not isinstance(ref, PoseAt):
        return ref.key
    if ref.robot in state.announced:
        return state.announced[ref.robot].names[ref.step]
    return pose_key(state.problem, ref.robot, ref.step)


def _local_information(state: AsPublishedState, robot: str) -> SparseInformation:
    """Prior and the local factors of one announced path: b[P^r'] of section 4.1."""
    factors = list(state.announced[robot].local.values())
    return update_information(state.prior, factors, add=True)


def _local_change(before: AsPublishedState, state: AsPublishedState, robot: str) -> FloatArray:
    """Delta J of one announcing robot by term, new minus old (17): local information only."""
    values = []
    for held in (before, state):
        announced = held.announced[robot]
        terms = path_values(held.problem, {robot: announced.path}, (robot,))
        information = _local_information(held, robot)
        steps = {robot: announced.path.steps}
        for cut in objective_readings(held.problem, steps):
            names = [_name(held, ref) for ref in cut.variables]
            covariance = marginal_covariance(information, names)
            read = uncertainty_values(held.problem, cut, covariance[None], {})[0]
            theirs = [r.term for r in cut.readings if r.variables[0] == PoseAt(robot, steps[robot])]
            terms[theirs] += read[theirs]
        values.append(terms)
    return values[1] - values[0]


def _report(
    before: AsPublishedState,
    state: AsPublishedState,
    changed: Sequence[str],
    marked: Sequence[int],
    fallbacks: int,
) -> ReevaluationReport:
    """Account of the work, with the counts of (40)."""
    old = {pair for robot in changed for one in before.pairs.get(robot, ()) for pair in one.joined}
    new = {pair for robot in changed for one in state.pairs[robot] for pair in one.joined}
    vertices = {
        vertex
        for robot in changed
        for held in (before, state)
        for one in held.pairs.get(robot, ())
        for vertex in one.vertices
    }
    total = len(state.candidates)
    untouched = tuple(place for place in range(total) if place not in set(marked))
    return ReevaluationReport(
        factors_added=len(new - old),
        factors_removed=len(old - new),
        factors_kept=len(old & new),
        involved_vertices=tuple(sorted(vertices)),
        impacted=tuple(marked),
        untouched=untouched,
        solves=len(marked),
        fallbacks=fallbacks,
        bytes_held=sum(held.information.bytes_held for held in state.kept),
        notes=(
            f"equation (40): M = {total} candidate paths, m = {len(untouched)} not impacted, "
            f"M - m = {len(marked)} re-evaluated, evaluation T = {state.evaluations}",
        ),
    )
