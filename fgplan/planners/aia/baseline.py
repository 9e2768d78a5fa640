"""What all planners that gather information have in common: a budget, a result, one interface."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from fgplan.checks import check_generator, check_positive
from fgplan.errors import FgplanError, InvalidInputError, OptionError
from fgplan.planners.aia.mission_problem import (
    PROBLEM_OPTIONS,
    ProblemOptions,
    mission_plan,
    mission_problem,
    no_plan,
    read_problem_options,
)
from fgplan.planners.aia.options import split_options
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.team_path import TeamPath
from fgplan.planners.mission import Mission
from fgplan.planners.option_tables import check_option_names
from fgplan.planners.plan import Plan
from fgplan.planners.planner import Progress


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """When a baseline gives up.

    Attributes:
        steps: Longest horizon, steps.
        nodes: Most states kept or simulated.
        seconds: Longest time, seconds.
    """

    steps: int = 400
    nodes: int = 100_000
    seconds: float = 60.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("steps", "nodes"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise InvalidInputError(
                    f"planner option {name}: expected a whole number of at least 1, got {value!r}"
                )
        check_positive(self.seconds, "planner option seconds")

    def start(self) -> "Clock":
        """Begin to count."""
        return Clock(self, time.perf_counter())


@dataclass(slots=True)
class Clock:
    """A budget that is being spent.

    Attributes:
        budget: The budget.
        began: When.
        nodes: States so far.
    """

    budget: Budget
    began: float
    nodes: int = 0

    @property
    def late(self) -> bool:
        """Whether time or nodes are spent."""
        over = time.perf_counter() - self.began >= self.budget.seconds
        return over or self.nodes >= self.budget.nodes

    def result(
        self,
        path: TeamPath | None,
        shortfall: float,
        farthest: str,
        walked: TeamPath | None = None,
    ) -> "BaselineResult":
        """Close the account.

        Args:
            path: What was found.
            shortfall: Least shortfall reached.
            farthest: Target farthest from its limit there; empty of a joint constraint.
            walked: Where a myopic planner went.

        Returns:
            The result.
        """
        seconds = time.perf_counter() - self.began
        return BaselineResult(
            plan=path,
            shortfall=shortfall,
            farthest=farthest,
            nodes=self.nodes,
            seconds=seconds,
            walked=walked,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BaselineResult:
    """What a baseline found.

    Attributes:
        plan: The path; None if no feasible one was found within the budget.
        shortfall: Worst target's number over its limit at the best state.
        farthest: That target; empty of a joint constraint.
        nodes: States kept or simulated.
        seconds: Real seconds.
        walked: Where a myopic planner went, though it may not have come to its end; None of those
            that search before they go.
    """

    plan: TeamPath | None
    shortfall: float
    farthest: str
    nodes: int
    seconds: float
    walked: TeamPath | None = None


Solve = Callable[[AcquisitionProblem, Budget, np.random.Generator], BaselineResult]
"""A baseline as a function."""


@dataclass(frozen=True, slots=True)
class BaselinePlanner:
    """A baseline as a planner; its options are those of ``Budget`` and ``ProblemOptions``.

    Attributes:
        name: Name in scenarios and results.
        solve: The baseline.
        option_tables: Its options.
    """

    option_tables: ClassVar[tuple[type, ...]] = (Budget, ProblemOptions)
    name: str
    solve: Solve

    def check_options(self, given: Mapping[str, Any]) -> None:
        """Refuse what ``plan`` would refuse of its options; see ``CheckedPlanner``.

        Args:
            given: By name.

        Raises:
            OptionError: If one is not known or not usable.
        """
        self._options(given)

    def plan(
        self, mission: Mission, generator: np.random.Generator, progress: Progress | None = None
    ) -> Plan:
        """Plan for every robot of a mission.

        Args:
            mission: Robots with sensors, and targets.
            generator: Source of every random number.
            progress: Told that it has begun.

        Returns:
            The plan.

        Raises:
            NoCandidatePathError: If no feasible plan was found within the budget.
            OptionError: If an option is not known or not usable.
        """
        check_generator(generator, f"planner {self.name!r}")
        own, budget, used = self._options(mission.options)
        problem = mission_problem(mission, own)
        if progress is not None:
            progress(0, 0, self.name)
        found = self.solve(problem, budget, generator)
        if found.plan is None:
            raise no_plan(
                self.name, problem, found.shortfall, "the budget is spent", found.farthest
            )
        return mission_plan(
            mission,
            problem,
            found.plan,
            planner=self.name,
            report={"nodes": found.nodes},
            seconds={"search": found.seconds},
            options=used,
        )

    def _options(self, given: Mapping[str, Any]) -> tuple[ProblemOptions, Budget, dict[str, Any]]:
        """Of the problem, the budget; and all as used, for the plan."""
        check_option_names(given, self.option_tables, self.name)
        own, others = split_options(given, PROBLEM_OPTIONS)
        try:
            budget = Budget(**others)
        except FgplanError as error:
            raise OptionError(str(error)) from error
        return read_problem_options(own), budget, {**asdict(budget), **own}
