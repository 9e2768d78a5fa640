"""Planner ``aia``: a sampling tree over team configurations and covariances.

Kantaros, Schlotfeldt, Atanasov and Pappas, "Asymptotically Optimal Planning for Non-myopic
Multi-Robot Information Gathering", RSS 2019: Algorithm 1 with the assignment of Algorithm 2.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from fgplan.checks import check_generator
from fgplan.errors import InvalidInputError, OptionError
from fgplan.evaluation.registry import find_object
from fgplan.planners.aia.densities import Densities
from fgplan.planners.aia.mission_problem import (
    PROBLEM_OPTIONS,
    ProblemOptions,
    mission_plan,
    mission_problem,
    no_plan,
    read_problem_options,
)
from fgplan.planners.aia.options import PRESETS, Preset, TreeOptions, split_options, tree_options
from fgplan.planners.mission import Mission
from fgplan.planners.option_tables import check_option_names
from fgplan.planners.plan import Plan
from fgplan.planners.planner import Progress

_WHY = {
    "iterations": "the iterations are spent",
    "nodes": "the node budget is spent",
    "seconds": "the time is over",
    "stalled": "the tree holds every node that it can reach",
    "interrupted": "interrupted",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PresetOptions:
    """Which preset the planner starts from.

    Attributes:
        preset: What the defaults of the other options are changed to.
    """

    preset: Preset = "pruned"


@dataclass(frozen=True, slots=True, kw_only=True)
class DensityOptions:
    """A user's own densities in place of (8) and (9).

    Attributes:
        f_group: f_V as "module:function"; (8) if left out.
        f_control: f_U as "module:function"; (9) if left out.
        least_group: Every probability of ``f_group`` must be at least this, above zero.
        least_control: Every probability of ``f_control`` must be at least this, above zero.
    """

    f_group: str | None = None
    f_control: str | None = None
    least_group: float = 0.0
    least_control: float = 0.0


class AiaPlanner:
    """Planner ``aia``; ``option_tables`` are its options."""

    name = "aia"
    option_tables: tuple[type, ...] = (PresetOptions, ProblemOptions, TreeOptions, DensityOptions)
    presets: Mapping[str, Mapping[str, Any]] = PRESETS

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
            progress: Told nodes, the budget, and the best value so far.

        Returns:
            The best plan found; after an interrupt the best so far, not ``agreed``.

        Raises:
            NoCandidatePathError: If no feasible plan was found; says the best uncertainty reached.
            OptionError: If an option is not known or not usable.
            InvalidInputError: If the mission is not one of gathering information.
        """
        from fgplan.planners.aia.search import search

        check_generator(generator, f"planner {self.name!r}")
        own, options, densities, used = self._options(mission.options)
        problem = mission_problem(mission, own)
        found = search(problem, options, generator, progress=progress, densities=densities)
        if found.plan is None:
            if found.ending == "interrupted":
                raise KeyboardInterrupt
            why = found.reason or _WHY.get(found.ending, found.ending)
            if found.reason:
                raise no_plan(self.name, problem, np.inf, why, remedy="relax delta")
            raise no_plan(self.name, problem, found.shortfall, why, found.farthest)
        warnings = () if found.ending != "interrupted" else ("interrupted: the best plan so far",)
        return mission_plan(
            mission,
            problem,
            found.plan,
            planner=self.name,
            agreed=found.ending != "interrupted",
            report=found.counts,
            seconds=found.seconds,
            options=used,
            warnings=warnings,
            details={
                "ending": found.ending,
                "shortfall": found.shortfall,
                "bytes_per_node": found.bytes_per_node,
                "improvements": [list(one) for one in found.improvements],
            },
        )

    def _options(
        self, given: Mapping[str, Any]
    ) -> tuple[ProblemOptions, TreeOptions, Densities | None, dict[str, Any]]:
        """Of the problem, of the tree, a user's densities; and all as used, for the plan."""
        check_option_names(given, self.option_tables, self.name)
        own, others = split_options(given, PROBLEM_OPTIONS)
        densities, others = _densities(others)
        preset = others.pop("preset", PresetOptions().preset)
        options = tree_options(preset, **others)
        used = {"preset": preset, **asdict(options), **own}
        return read_problem_options(own), options, densities, used


def _densities(given: Mapping[str, Any]) -> tuple[Densities | None, dict[str, Any]]:
    """A user's own densities, and the other options."""
    own, others = split_options(given, tuple(option.name for option in fields(DensityOptions)))
    if not own:
        return None, others
    made = {}
    for name in ("f_group", "f_control"):
        made[name] = None if name not in own else find_object(own[name], {}, f"option {name}")
    for name in ("least_group", "least_control"):
        if not isinstance(own.get(name, 0.0), int | float):
            raise OptionError(f"planner option {name}: expected a number, got {own[name]!r}")
    try:
        return (
            Densities(
                groups=made["f_group"],
                controls=made["f_control"],
                least_group=float(own.get("least_group", 0.0)),
                least_control=float(own.get("least_control", 0.0)),
            ),
            others,
        )
    except InvalidInputError as error:
        raise OptionError(str(error)) from error
