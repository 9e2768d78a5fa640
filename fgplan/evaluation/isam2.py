"""Every candidate by gtsam.ISAM2: its factors are added, marginals are read, and it is removed.

The others' belief (prior, announced paths, factors among them) stays in the smoother from candidate
to candidate and, where paths did not change, from turn to turn. Exact, like the Standard approach;
built for comparison. Each look-ahead step that the objective reads has a smoother of its own, since
a cut belief (equation 21 of Regev and Indelman 2017) is another graph.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from fgplan.beliefs.from_scratch import (
    CommonGraph,
    common_graph,
    graph_of_parts,
    planned_poses,
    wanted_covariances,
)
from fgplan.beliefs.incremental_smoother import IncrementalSmoother
from fgplan.errors import IllPosedBeliefError
from fgplan.evaluation.evaluations import Evaluations
from fgplan.evaluation.from_scratch import (
    FromScratch,
    FromScratchState,
    candidate_parts,
    evaluate_candidates,
    with_announced,
)
from fgplan.evaluation.problem import PlanningProblem
from fgplan.factors.factor_set import FactorSet
from fgplan.paths.candidate_path import CandidatePath
from fgplan.threads import one_blas_thread
from fgplan.typing import Covariance, Key


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Isam2State:
    """What is kept from one evaluation to the next.

    Attributes:
        parts: Factors of the candidates and the announced paths.
        smoothers: By cut (None for all factors), the others' belief in ISAM2.
    """

    parts: FromScratchState
    smoothers: dict[int | None, IncrementalSmoother] = field(repr=False, default_factory=dict)


@dataclass(frozen=True, slots=True)
class Isam2:
    """Evaluator by incremental smoothing.

    Attributes:
        name: Name in reports and scenario files.
    """

    name: str = "isam2"

    @one_blas_thread()
    def start(
        self, problem: PlanningProblem, robot: str, candidates: Sequence[CandidatePath]
    ) -> Isam2State:
        """Build what depends on the prior and the candidates alone.

        Raises:
            InvalidInputError: If a candidate is another robot's or does not fit the problem.
            UnknownNameError: If the robot, a sensor or a landmark is not known.
        """
        return Isam2State(parts=FromScratch().start(problem, robot, candidates))

    @one_blas_thread()
    def evaluate(
        self, state: Isam2State, announced: Mapping[str, CandidatePath]
    ) -> tuple[Isam2State, Evaluations]:
        """Evaluate every candidate under the others' announced paths.

        Args:
            state: From ``start`` or an earlier ``evaluate``.
            announced: Announced path of each other robot that has one; the robot's own is ignored.

        Returns:
            The state for next time, and the values. ``messages_rebuilt`` counts smoothers that had
            to be built anew; where ISAM2 refused a candidate, QR answered and a fall-back counts.

        Raises:
            InvalidInputError: If an announced path does not fit the problem.
            IllPosedBeliefError: If a variable is not determined.
        """
        parts = with_announced(state.parts, announced)
        problem, others = parts.problem, list(parts.announced.values())
        smoothers, ready = dict(state.smoothers), set[int | None]()
        commons: dict[int | None, CommonGraph] = {}
        before = sum(smoother.rebuilds for smoother in smoothers.values())

        def covariances(
            place: int,
            limit: int | None,
            wanted: Sequence[tuple[Key, ...]],
            dims: Mapping[Key, int],
        ) -> tuple[list[Covariance], bool]:
            if limit not in ready:
                smoother = smoothers.setdefault(limit, IncrementalSmoother(problem.prior))
                held = [part.cut(limit).factors.factors for part in parts.others.values()]
                factors = FactorSet(tuple(planned for one in held for planned in one))
                smoother.announce(factors, planned_poses(problem, others, limit))
                ready.add(limit)
            own = candidate_parts(parts, place, limit)
            poses = planned_poses(problem, [parts.candidates[place]], limit)
            try:
                return smoothers[limit].covariances(graph_of_parts(own), poses, wanted), False
            except IllPosedBeliefError:
                if limit not in commons:
                    shared = list(parts.others.values())
                    commons[limit] = common_graph(problem, parts.announced, shared, limit)
                poses = parts.own[place].poses
                found, _ = wanted_covariances(commons[limit], own, poses, wanted, dims, "qr")
                return found, True

        found = evaluate_candidates(parts, covariances)
        rebuilt = sum(smoother.rebuilds for smoother in smoothers.values()) - before
        report = replace(found.report, messages_rebuilt=rebuilt)
        kept = {limit: smoothers[limit] for limit in sorted(ready, key=str)}
        return Isam2State(parts=parts, smoothers=kept), replace(found, report=report)
