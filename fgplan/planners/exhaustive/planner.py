"""The optimum of a small team, and how far from it what was agreed ends.

    gap = (J agreed - J optimum) / |J optimum|

zero or more, on the same candidate paths and with the same evaluator.
"""

import dataclasses
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fgplan.evaluation.registry import INEXACT, find_evaluator
from fgplan.planners.exhaustive.search import search_all
from fgplan.planners.impacted_paths.candidates import candidate_sets
from fgplan.planners.impacted_paths.options import ImpactedPathsOptions, read_options
from fgplan.planners.impacted_paths.planner import pose_covariances, report_counts, robot_plans
from fgplan.planners.mission import Mission
from fgplan.planners.option_checks import check_count, check_switch
from fgplan.planners.plan import ObjectiveValue, Plan
from fgplan.planners.planner import Progress
from fgplan.team.coordination import coordinate
from fgplan.typing import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ExhaustiveOptions(ImpactedPathsOptions):
    """Options of the planner ``exhaustive``: those of ``impacted_paths`` and a limit.

    Attributes:
        candidates: Number of candidate paths a robot, at most.
        combinations: Most combinations that are tried.
        compare: Whether to let the team agree on the same candidates, for the gap.
    """

    candidates: int = 10
    combinations: int = 20_000
    compare: bool = True

    def __post_init__(self) -> None:
        """Check the limit and the rest."""
        ImpactedPathsOptions.__post_init__(self)
        check_count("combinations", self.combinations)
        check_switch("compare", self.compare)


class ExhaustivePlanner:
    """Planner ``exhaustive``; its options are ``ExhaustiveOptions``."""

    name = "exhaustive"
    option_tables: tuple[type, ...] = (ExhaustiveOptions,)

    def check_options(self, given: Mapping[str, Any]) -> None:
        """Refuse what ``plan`` would refuse of its options; see ``CheckedPlanner``.

        Args:
            given: By name.

        Raises:
            OptionError: If one is not known or not usable.
            UnknownNameError: If an evaluator is not known.
        """
        find_evaluator(read_options(ExhaustiveOptions, given, self.name).evaluator)

    def plan(
        self, mission: Mission, generator: np.random.Generator, progress: Progress | None = None
    ) -> Plan:
        """Plan by trying every combination of candidate paths.

        Args:
            mission: What is given.
            generator: Source of every random number.
            progress: Told how far it is.

        Returns:
            The optimum; ``details`` holds ``optimum``, ``agreed``, ``gap`` and ``combinations``.

        Raises:
            InvalidInputError: If there are too many combinations.
            OptionError: If an option is not known or has a value that is not usable.
            NoCandidatePathError: If a robot has no candidate and may not stay; names it.
            UnknownNameError: If an evaluator or sensor is not known.
        """
        options = read_options(ExhaustiveOptions, mission.options, self.name)
        evaluator = find_evaluator(options.evaluator)
        began = time.perf_counter()
        sets = candidate_sets(mission, options, generator, without_path=options.without_path)
        seconds = {"candidates": time.perf_counter() - began}
        began = time.perf_counter()
        optimum = search_all(
            sets.problem,
            sets.candidates,
            evaluator,
            limit=options.combinations,
            progress=progress,
        )
        seconds["search"] = time.perf_counter() - began
        paths = {robot: sets.candidates[robot][index] for robot, index in optimum.chosen.items()}
        details: dict[str, object] = {
            "optimum": optimum.value,
            "combinations": optimum.combinations,
        }
        report = {"combinations": optimum.combinations, "evaluations": optimum.evaluations}
        traffic: dict[str, dict[str, int]] = {}
        warnings = [f"robot {robot!r} stays: {reason}" for robot, reason in sets.reasons.items()]
        if options.compare:
            exact = options.evaluator not in INEXACT
            agreement = coordinate(
                sets.problem,
                sets.candidates,
                evaluator,
                options=options.coordination(mission.seed, exact=exact),
                transport=options.transport(sets.problem.robots, generator),
            )
            agreed = float(agreement.value)
            details["agreed"] = agreed
            loss = agreed - optimum.value
            details["gap"] = loss / abs(optimum.value) if optimum.value else loss
            details["agreed_chosen"] = dict(agreement.chosen)
            report |= {f"agreed_{key}": n for key, n in report_counts(agreement).items()}
            seconds |= {f"agreed_{key}": value for key, value in agreement.seconds.items()}
            traffic = {k: dataclasses.asdict(c) for k, c in agreement.traffic.kinds.items()}
        began = time.perf_counter()
        known: dict[str, FloatArray] = {}
        if options.covariances:
            known = pose_covariances(sets.problem, paths)
        seconds["covariances"] = time.perf_counter() - began
        return Plan(
            planner=self.name,
            mission=mission.name,
            scenario_digest=mission.digest,
            seed=mission.seed,
            robots=robot_plans(mission, sets, paths, optimum.chosen, known),
            objective=(ObjectiveValue(0, "", optimum.value),),
            report=report,
            traffic=traffic,
            seconds=seconds,
            warnings=tuple(warnings),
            options=dataclasses.asdict(options),
            details=details,
        )
