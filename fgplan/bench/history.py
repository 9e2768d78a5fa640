"""``fgplan bench history``: what a candidate costs when the past grows.

One turn of one robot of four: an announcement of another robot arrives, the others' joint
covariance and everything that rests on it are computed anew, every candidate is evaluated. The
candidates (fgplan/bench/landmark_tours.py) and, in the synthetic world, their multi-robot factors
are the same for every length, so growth is that of the history alone. On Victoria Park there are no
multi-robot factors: how many there were would depend on where a prefix ends.

All lengths are held at once and timed in turn, so that a change in the machine's load falls on all
of them. What depends on the past alone - the elimination of the history - is timed on beliefs
that have never eliminated anything.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.bench.blas_threads import blas_threads, blas_warning
from fgplan.bench.landmark_tours import SENSOR_NAME, draw_tours
from fgplan.bench.long_past import LongPast, synthetic_past, victoria_park_past
from fgplan.evaluation.evaluations import AbstractEvaluator
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.evaluation.incremental.prior_marginal import eliminate_history
from fgplan.evaluation.isam2 import Isam2
from fgplan.evaluation.objective import length_and_uncertainty
from fgplan.evaluation.problem import PlanningProblem
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import Requirement, require_at_most
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel

MEETING_M = 300.0
MEETING_SIGMAS = (5.0, 5.0, 0.05)
STEP_SIGMAS = (1.0, 1.0, 0.01)
SIGHT = BearingRangeSensor(bearing_sigma_rad=0.02, range_sigma_m=1.0)
SPEED_M_PER_S = 10.0
SLOW = ("from_scratch", "isam2")
LARGEST_DIFFERENCE = 1e-9
LARGEST_GROWTH = 1.5
PREPARATION_EVALUATIONS = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HistorySize:
    """How much is measured.

    Attributes:
        synthetic: Past poses of the synthetic world.
        victoria_park: Lengths of the prefixes.
        candidates: Candidates a robot.
        slow_candidates: Candidates that ``from_scratch`` and ``isam2`` evaluate a turn.
        slow_turns: Turns on which they are timed.
        turns: Turns on which ``incremental`` is timed.
        preparations: Fresh beliefs on which the elimination is timed.
        compared: Candidates compared with from scratch by QR.
    """

    synthetic: tuple[int, ...] = (100, 1_000, 10_000)
    victoria_park: tuple[int, ...] = (1_000, 3_000, 6_969)
    candidates: int = 40
    slow_candidates: int = 5
    slow_turns: int = 5
    turns: int = 40
    preparations: int = 5
    compared: int = 4


QUICK = HistorySize(
    synthetic=(100, 400),
    victoria_park=(800, 1_000),
    candidates=20,
    slow_candidates=2,
    slow_turns=2,
    turns=8,
    preparations=2,
    compared=2,
)


@dataclass(slots=True, eq=False)
class HistoryCase:
    """One past with its contestants, and what was measured.

    Attributes:
        past: The past.
        problem: The planning problem on it.
        candidates: Candidates by robot.
        states: Evaluator's state by name.
        seconds: Seconds a candidate by evaluator, one a turn.
        new_landmarks: Seconds a candidate of ``incremental``, on the turns that touched a landmark
            for the first time.
        beliefs: Seconds that building the belief took, one a preparation.
        preparations: Seconds that eliminating the history took.
        starts: Seconds that the rest of ``Incremental.start`` took: the candidates as arrays.
    """

    past: LongPast
    problem: PlanningProblem
    candidates: dict[str, list[CandidatePath]]
    states: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, list[float]] = field(default_factory=dict)
    new_landmarks: list[float] = field(default_factory=list)
    beliefs: list[float] = field(default_factory=list)
    preparations: list[float] = field(default_factory=list)
    starts: list[float] = field(default_factory=list)

    @property
    def robot(self) -> str:
        """The robot that evaluates: the first."""
        return self.problem.robots[0]

    def announced(self, turn: int) -> dict[str, CandidatePath]:
        """Announced paths of the others on a turn: the last robot has announced another path."""
        others = {robot: self.candidates[robot][0] for robot in self.problem.robots[1:]}
        last = self.problem.robots[-1]
        return {**others, last: self.candidates[last][turn % len(self.candidates[last])]}


def run(options: CommandOptions) -> CommandOutcome:
    """Run the bench.

    Args:
        options: ``quick`` measures short pasts; the seed count is not used, there is one team.

    Returns:
        The results and what is required of them.
    """
    size = QUICK if options.quick else HistorySize()
    makers: list[tuple[Callable[[int], LongPast], int]] = [
        *((synthetic_past, poses) for poses in size.synthetic),
        *((victoria_park_past, poses) for poses in size.victoria_park),
    ]
    cases = []
    for place, (make, poses) in enumerate(makers):
        options.progress(place, len(makers), f"past of {poses} poses")
        cases.append(_make_case(make(poses), size))
    contestants: dict[str, tuple[AbstractEvaluator, int]] = {
        "from_scratch": (FromScratch(elimination="marginals"), size.slow_candidates),
        "isam2": (Isam2(), size.slow_candidates),
        "incremental": (Incremental(), size.candidates),
    }
    _prepare(cases, size, options)
    for case in cases:
        for name, (evaluator, count) in contestants.items():
            paths = case.candidates[case.robot][:count]
            case.states[name] = evaluator.start(case.problem, case.robot, paths)
    _meet_landmarks(cases, contestants, size)
    for turn in range(size.turns):
        options.progress(turn, size.turns, "turns")
        for name, contestant in contestants.items():
            if name in SLOW and turn >= size.slow_turns:
                continue
            for case in cases:
                case.seconds.setdefault(name, []).append(_turn(case, name, contestant, turn))
    results = _results(cases, contestants, size)
    return CommandOutcome(
        results=results,
        requirements=_requirements(results),
        seeds=(0,),
        summary=_summary(results),
    )


def _make_case(past: LongPast, size: HistorySize) -> HistoryCase:
    """Problem and candidates on a past; the same draw for every past."""
    meeting = MultiRobotModel(
        criterion=DistanceCriterion(MEETING_M),
        sensor=RelativePoseSensor(covariance=np.diag(np.array(MEETING_SIGMAS) ** 2)),
    )
    problem = PlanningProblem(
        prior=Belief(past.graph, past.values),
        start_keys=past.start_keys,
        objective=length_and_uncertainty(tuple(past.start_keys)),
        multi_robot=(meeting,) if past.kind == "synthetic" else (),
        sensors={SENSOR_NAME: SIGHT},
    )
    motion = MotionModel(sigmas=np.array(STEP_SIGMAS), speed_m_per_s=SPEED_M_PER_S)
    generator = np.random.default_rng(0)
    tours = draw_tours(problem.prior, past.start_keys, size.candidates, SIGHT, motion, generator)
    return HistoryCase(past, problem, tours)


def _prepare(cases: Sequence[HistoryCase], size: HistorySize, options: CommandOptions) -> None:
    """Time the elimination of the history on beliefs that have not eliminated anything."""
    evaluator = Incremental()
    for repeat in range(size.preparations + 1):
        options.progress(repeat, size.preparations + 1, "preparation")
        for case in cases:
            began = time.perf_counter()
            prior = Belief(case.past.graph, case.past.values)
            built = time.perf_counter()
            problem = replace(case.problem, prior=prior)
            paths = case.candidates[case.robot]
            touched = [seen.landmark for path in paths for seen in path.observations]
            eliminating = time.perf_counter()
            eliminate_history(problem, touched)
            eliminated = time.perf_counter()
            evaluator.start(problem, case.robot, paths)
            if repeat:  # the first compiles or loads the kernels
                case.beliefs.append(built - began)
                case.preparations.append(eliminated - eliminating)
                case.starts.append(time.perf_counter() - eliminated)


def _meet_landmarks(
    cases: Sequence[HistoryCase],
    contestants: Mapping[str, tuple[AbstractEvaluator, int]],
    size: HistorySize,
) -> None:
    """Untimed turns: kernels are compiled, smoothers built, all landmarks touched once."""
    for case in cases:
        known = 0
        for turn in range(size.candidates):
            seconds = _turn(case, "incremental", contestants["incremental"], turn)
            touched = len(case.states["incremental"].numbering.prior_keys)
            if turn and touched > known:
                case.new_landmarks.append(seconds)
            known = touched
        for name in SLOW:
            _turn(case, name, contestants[name], size.candidates - 1)


def _turn(
    case: HistoryCase, name: str, contestant: tuple[AbstractEvaluator, int], turn: int
) -> float:
    """Evaluate all candidates of a contestant under a new announcement; seconds a candidate."""
    evaluator, count = contestant
    announced = case.announced(turn)
    began = time.perf_counter()
    case.states[name], _ = evaluator.evaluate(case.states[name], announced)
    return (time.perf_counter() - began) / count


def _results(
    cases: Sequence[HistoryCase],
    contestants: Mapping[str, tuple[AbstractEvaluator, int]],
    size: HistorySize,
) -> dict[str, Any]:
    """Everything that the issue of this bench asks for."""
    found = [_case_results(case, contestants["incremental"], size) for case in cases]
    by_past = {
        past: [item for item in found if item["past"] == past]
        for past in ("synthetic", "victoria_park")
    }
    synthetic, park = by_past["synthetic"], by_past["victoria_park"]
    names = ("poses", "from_scratch_ms", "isam2_ms", "incremental_ms", "prepare_ms")
    threads = blas_threads()
    warning = blas_warning(threads)
    return {
        **{name: [item[name] for item in synthetic] for name in names},
        "incremental_growth": _growth(synthetic),
        "incremental_growth_victoria_park": _growth(park),
        "prepare_evaluations": synthetic[-1]["prepare_evaluations"],
        "max_rel_diff": max(item["max_rel_diff"] for item in found),
        "cases": found,
        "robots": len(cases[0].problem.robots),
        "candidates": size.candidates,
        "candidates_from_scratch_and_isam2": size.slow_candidates,
        "turns": size.turns,
        "turns_from_scratch_and_isam2": size.slow_turns,
        "landmarks_observed_by_a_candidate": _landmarks_of_a_candidate(cases),
        "notes": [
            "medians over turns; one turn: another robot has announced another path, S and all "
            "that rests on it is computed anew",
            "every candidate of every past: 12 poses, 24 observations of 6 mapped landmarks; the "
            "number of mapped landmarks differs between Victoria Park prefixes (landmarks), the "
            "number that the team touches does not (landmarks_touched)",
            "multi-robot factors in the synthetic world only",
            "from_scratch and isam2 evaluate fewer candidates a turn, so what they share over a "
            "turn weighs more in their ms a candidate",
            "new_landmark_ms: ms a candidate on the turns on which an announced path touches a "
            "mapped landmark that no path has touched before; not part of incremental_ms",
        ],
        "blas_threads": threads,
        "warnings": [] if warning is None else [warning],
    }


def _case_results(
    case: HistoryCase, incremental: tuple[AbstractEvaluator, int], size: HistorySize
) -> dict[str, Any]:
    """What was measured on one past, milliseconds."""
    prior = case.problem.prior
    milliseconds = {
        f"{name}_ms": 1e3 * float(np.median(seconds)) for name, seconds in case.seconds.items()
    }
    prepare_ms = 1e3 * float(np.median(case.preparations))
    state = case.states["incremental"]
    touched = set(state.table.observations.landmarks())
    for path in state.announced.values():
        touched.update(seen.landmark for seen in path.observations)
    return {
        "past": case.past.kind,
        "poses": case.past.poses,
        **milliseconds,
        "incremental_quartiles_ms": (
            1e3 * np.percentile(case.seconds["incremental"], [25, 75])
        ).tolist(),
        "prepare_ms": prepare_ms,
        "prepare_evaluations": prepare_ms / milliseconds["from_scratch_ms"],
        "max_rel_diff": _largest_difference(case, incremental[0], size.compared),
        "belief_ms": 1e3 * float(np.median(case.beliefs)),
        "candidates_ms": 1e3 * float(np.median(case.starts)),
        "new_landmark_ms": 1e3 * float(np.median(case.new_landmarks))
        if case.new_landmarks
        else None,
        "factors": case.past.graph.size(),
        "landmarks": sum(kind == "Point2" for kind in prior.kinds.values()),
        "landmarks_touched": len(touched),
        "start_correlation": _start_correlation(case),
    }


def _largest_difference(case: HistoryCase, evaluator: AbstractEvaluator, count: int) -> float:
    """Largest relative difference of any term, incremental against from scratch by QR."""
    paths, others = case.candidates[case.robot][:count], case.announced(1)
    oracle = FromScratch(elimination="qr")
    _, want = oracle.evaluate(oracle.start(case.problem, case.robot, paths), others)
    _, got = evaluator.evaluate(case.states["incremental"], others)
    return float(np.max(np.abs(got.terms[:count] - want.terms) / np.abs(want.terms)))


def _start_correlation(case: HistoryCase) -> float:
    """Largest correlation between the current poses of the first robot and another, by the prior.

    The least over the other robots.
    """
    keys = tuple(case.problem.start_keys.values())
    joint = case.problem.prior.covariance(keys)
    scale = 1.0 / np.sqrt(np.diagonal(joint))
    across = np.abs(joint * np.outer(scale, scale))[:3, 3:]
    return float(across.reshape(3, -1, 3).max(axis=(0, 2)).min())


def _landmarks_of_a_candidate(cases: Sequence[HistoryCase]) -> int:
    """Fewest mapped landmarks that any candidate observes."""
    return min(
        len({seen.landmark for seen in path.observations})
        for case in cases
        for path in case.candidates[case.robot]
    )


def _growth(found: Sequence[Mapping[str, Any]]) -> float:
    """Largest over smallest milliseconds a candidate."""
    times = [item["incremental_ms"] for item in found]
    return max(times) / min(times)


def _requirements(results: Mapping[str, Any]) -> tuple[Requirement, ...]:
    """What is required."""
    return (
        require_at_most("incremental_growth", results["incremental_growth"], LARGEST_GROWTH),
        require_at_most(
            "incremental_growth_victoria_park",
            results["incremental_growth_victoria_park"],
            LARGEST_GROWTH,
        ),
        require_at_most(
            "prepare_evaluations", results["prepare_evaluations"], PREPARATION_EVALUATIONS
        ),
        require_at_most("max_rel_diff", results["max_rel_diff"], LARGEST_DIFFERENCE),
    )


def _summary(results: Mapping[str, Any]) -> tuple[str, ...]:
    """Lines for the terminal."""
    lines = [
        f"{results['robots']} robots, {results['candidates']} candidates, each observing "
        f"{results['landmarks_observed_by_a_candidate']} mapped landmarks; ms a candidate",
        f"{'past':14s} {'poses':>6s} {'from_scratch':>13s} {'isam2':>9s} {'incremental':>12s} "
        f"{'prepare':>9s} {'max_rel_diff':>13s}",
    ]
    lines += [
        f"{item['past']:14s} {item['poses']:6d} {item['from_scratch_ms']:13.2f} "
        f"{item['isam2_ms']:9.2f} {item['incremental_ms']:12.3f} {item['prepare_ms']:9.1f} "
        f"{item['max_rel_diff']:13.1e}"
        for item in results["cases"]
    ]
    return (*lines, *(f"warning: {warning}" for warning in results["warnings"]))
