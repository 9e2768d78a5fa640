"""Options of the planners that choose among candidate paths, each with its default."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, cast, get_args

import numpy as np

from fgplan.checks import check_not_negative, check_positive
from fgplan.errors import FgplanError, InvalidInputError, OptionError
from fgplan.planners.option_checks import check_choice, check_count, check_switch
from fgplan.planners.option_tables import check_option_names
from fgplan.team.in_process import InProcessTransport, NetworkFaults, read_faults
from fgplan.team.options import CoordinationOptions, Order, WithoutPath
from roadmaps import PathMethod

LOST_AFTER_S = 10.0
"""Between processes, where nothing else is said: robots do fail."""

RoadmapKind = Literal["prm", "rrg"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateOptions:
    """How candidate paths are made.

    Attributes:
        candidates: Number of candidate paths a robot, at most.
        roadmap: ``prm``, one for the team; or ``rrg``, one a robot and leg.
        paths: Way of searching: ``penalty``, ``perturbed`` or ``shortest``.
        vertices: Vertices of the PRM, or samples of each RRG.
        neighbours: Nearest vertices that a PRM tries to join.
        step_m: Longest edge of an RRG, metres; None takes a twentieth of the workspace's diagonal.
        spacing_m: Greatest distance of consecutive poses, metres; None adds none along edges.
        max_length_m: Longer candidates are left out, metres; None keeps all.
    """

    candidates: int = 50
    roadmap: RoadmapKind = "prm"
    paths: PathMethod = "penalty"
    vertices: int = 400
    neighbours: int = 10
    step_m: float | None = None
    spacing_m: float | None = None
    max_length_m: float | None = None

    def __post_init__(self) -> None:
        """Check names and numbers."""
        check_choice("roadmap", self.roadmap, get_args(RoadmapKind))
        check_choice("paths", self.paths, get_args(PathMethod))
        for name in ("candidates", "vertices", "neighbours"):
            check_count(name, getattr(self, name))
        for name in ("step_m", "spacing_m", "max_length_m"):
            if getattr(self, name) is not None:
                check_positive(getattr(self, name), f"planner option {name}")


@dataclass(frozen=True, slots=True, kw_only=True)
class ImpactedPathsOptions(CandidateOptions):
    """Options of the planner ``impacted_paths``.

    Attributes:
        evaluator: Name of the evaluator, or ``module:object`` of a user's own.
        choose: Whether the evaluator may choose by bounds if it can.
        order: Order of turns: ``fixed`` or ``random``.
        tolerance: Relative fall of the objective that is worth an announcement.
        without_path: A robot without candidates: ``refuse`` to plan, or it may ``stay``.
        max_turns: Turns after which the team gives up.
        session: Number of the planning session.
        seed: Seed of the random order; None takes the mission's.
        covariances: Whether to compute the covariance of every pose of the plan.
        repair_after_s: Seconds of silence after which a robot asks for what it misses.
        lost_after_s: Seconds without a sign of a robot after which the others go on without it;
            None: they wait for it in one process, and 10 s between processes.
        hung_after_s: Seconds of silence after which a robot whom the network sees counts as lost
            too, longer than any evaluation; None believes the network.
        drop_after_s: Seconds after which the path of a lost robot is withdrawn; None keeps it.
        time_limit_s: Seconds on the network's clock after which the team gives up.
        communication: Faults of the simulated network (or its fields by name), drawn by the run's
            generator; None is a perfect one. They change how long agreement takes, not its paths.
    """

    evaluator: str = "incremental"
    choose: bool = True
    order: Order = "fixed"
    tolerance: float = 1e-6
    without_path: WithoutPath = "refuse"
    max_turns: int = 10_000
    session: int = 0
    seed: int | None = None
    covariances: bool = True
    repair_after_s: float = 1.0
    lost_after_s: float | None = None
    hung_after_s: float | None = None
    drop_after_s: float | None = None
    time_limit_s: float = 3600.0
    communication: NetworkFaults | Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        """Check names and numbers."""
        CandidateOptions.__post_init__(self)
        check_choice("order", self.order, get_args(Order))
        check_choice("without_path", self.without_path, get_args(WithoutPath))
        check_count("max_turns", self.max_turns)
        check_not_negative(self.tolerance, "planner option tolerance")
        check_count("session", self.session, least=0)
        if self.seed is not None:
            check_count("seed", self.seed, least=0)
        for name in ("choose", "covariances"):
            check_switch(name, getattr(self, name))
        for name in ("repair_after_s", "time_limit_s"):
            check_positive(getattr(self, name), f"planner option {name}")
        for name in ("lost_after_s", "hung_after_s", "drop_after_s"):
            if getattr(self, name) is not None:
                check_positive(getattr(self, name), f"planner option {name}")
        if isinstance(self.communication, Mapping):
            object.__setattr__(self, "communication", read_faults(self.communication))
        elif not isinstance(self.communication, NetworkFaults | None):
            raise InvalidInputError(
                "planner option communication: expected a table of network faults, got "
                f"{self.communication!r}"
            )

    def transport(
        self, robots: Sequence[str], generator: np.random.Generator
    ) -> InProcessTransport:
        """What carries the messages; faults come from a stream of their own.

        Candidates are therefore drawn alike with and without faults.
        """
        if self.communication is None:
            return InProcessTransport(robots)
        faults = cast(NetworkFaults, self.communication)
        return InProcessTransport(robots, faults, generator.spawn(1)[0])

    def coordination(
        self, mission_seed: int, *, exact: bool, processes: bool = False
    ) -> CoordinationOptions:
        """How the team comes to agree, in one process or each robot in its own."""
        lost_after_s = LOST_AFTER_S if processes else math.inf
        if self.lost_after_s is not None:
            lost_after_s = self.lost_after_s
        return CoordinationOptions(
            repair_after_s=self.repair_after_s,
            lost_after_s=lost_after_s,
            hung_after_s=math.inf if self.hung_after_s is None else self.hung_after_s,
            drop_after_s=math.inf if self.drop_after_s is None else self.drop_after_s,
            time_limit_s=self.time_limit_s,
            order=self.order,
            seed=mission_seed if self.seed is None else self.seed,
            check_values=exact,
            tolerance=self.tolerance,
            choose=self.choose,
            without_path=self.without_path,
            max_turns=self.max_turns,
            session=self.session,
        )


Options = TypeVar("Options", bound=CandidateOptions)


def read_options(kind: type[Options], given: Mapping[str, Any], planner: str) -> Options:
    """Options from a scenario.

    Args:
        kind: Class of the options.
        given: By name, as the scenario gives them.
        planner: Name of the planner, for the message.

    Returns:
        The options, with defaults where none is given.

    Raises:
        OptionError: If an option is not known (lists those that are), or a value is not usable.
    """
    check_option_names(given, (kind,), planner)
    try:
        return kind(**given)
    except FgplanError as error:
        raise OptionError(str(error)) from error
