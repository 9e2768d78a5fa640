"""Options of the planner ``aia`` and its presets.

``paper`` is Algorithms 1 and 2 of Kantaros et al. 2019 as printed: the whole group is extended, a
draw that hits an obstacle is rejected, controls are drawn uniformly within sensing range (9), the
covariance of a child is rho(p of the parent, Sigma of the parent). ``reproduction`` differs in one
number, the distance below which controls are drawn uniformly, 0.3 m: chosen, like the scene of
``fgplan reproduce kantaros-table1``, so that costs come near Table I: a calibration, no
confirmation. ``pruned`` is for use: one node a visit, branch and bound, dominance.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, TypeVar, get_args

from fgplan.checks import check_not_negative, check_positive
from fgplan.errors import FgplanError, InvalidInputError, OptionError
from fgplan.planners.option_checks import check_choice, check_count, check_switch
from fgplan.planners.option_tables import check_option_names

Preset = Literal["paper", "reproduction", "pruned"]
Dominance = Literal["off", "same_time", "any_time"]
Assignment = Literal["algorithm_2", "optimal", "keep"]
Expand = Literal["group", "node"]
Near = Literal["uniform", "circle"]
Until = Literal["first_feasible", "budget"]
Switch = Literal["feasible", "never"]


class _Dataclass(Protocol):
    """Any dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


Options = TypeVar("Options", bound=_Dataclass)
MOST = 2**62
"""Largest number that is counted to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthOptions:
    """How a tree is grown, a team's or one robot's.

    Attributes:
        p_group: p_V of (8): probability that one of the deepest groups is extended.
        p_control: p_U of (9): probability of the control that leads to the assigned target.
        near_m: Distance to the assigned target, metres, below which controls are drawn uniformly;
            None takes the robot's sensing range, as the paper does.
        near_controls: What is drawn within it: ``uniform``, or ``circle`` the target, for bearing
            sensors (section V-B suggests it and leaves it open).
        uniform_after: When draws become uniform (Remark 5.1): with the first feasible plan, from an
            iteration, or never.
        reject_jointly: Draw from all controls and reject; otherwise draw from the free ones.
        expand: Extend the whole group (line 6), or one node of it: the last one with probability
            p_V, else any. One node keeps teams of one robot from growing exponentially.
        until: End with the first feasible plan, or when a budget is spent.
        iterations: Most iterations; None has no limit.
        node_budget: Most nodes.
        seconds: Longest time, seconds; None has no limit.
        geodesic_cell_m: Side of the cells of geodesic distances, metres; None takes the greatest
            displacement of a control along an axis: the spacing of a lattice.
    """

    p_group: float = 0.9
    p_control: float = 0.9
    near_m: float | None = None
    near_controls: Near = "uniform"
    uniform_after: Switch | int = "feasible"
    reject_jointly: bool = False
    expand: Expand = "group"
    until: Until = "first_feasible"
    iterations: int | None = None
    node_budget: int = 1_000_000
    seconds: float | None = None
    geodesic_cell_m: float | None = None

    def __post_init__(self) -> None:
        """Check names and numbers."""
        for name, allowed in (
            ("near_controls", get_args(Near)),
            ("expand", get_args(Expand)),
            ("until", get_args(Until)),
        ):
            check_choice(name, getattr(self, name), allowed)
        check_switch("reject_jointly", self.reject_jointly)
        for name in ("p_group", "p_control"):
            check_not_negative(getattr(self, name), f"planner option {name}")
        if not 0.5 < self.p_group < 1.0:
            raise InvalidInputError(
                f"planner option p_group: expected a number between 0.5 and 1 (8), got "
                f"{self.p_group!r}; for uniform draws set uniform_after = 0"
            )
        if not 0.0 <= self.p_control < 1.0:
            raise InvalidInputError(
                "planner option p_control: expected at least 0 and less than 1, or Assumption 3.2 "
                f"fails, got {self.p_control!r}"
            )
        if self.uniform_after not in get_args(Switch):
            check_count("uniform_after", self.uniform_after, 0, MOST)
        check_count("node_budget", self.node_budget, 1, MOST)
        if self.iterations is not None:
            check_count("iterations", self.iterations, 1, MOST)
        for name in ("near_m", "seconds", "geodesic_cell_m"):
            if getattr(self, name) is not None:
                check_positive(getattr(self, name), f"planner option {name}")
        if self.until == "budget" and self.iterations is None and self.seconds is None:
            # The tree may be exhausted before the node budget is.
            raise InvalidInputError(
                "planner option until: 'budget' needs iterations or seconds: a tree that holds "
                "every reachable node never reaches its node budget"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeOptions(GrowthOptions):
    """How a team's tree is grown.

    Attributes:
        measure_at: Where measurements are taken: ``parent``, as line 7 prints it, or ``child``.
        assignment: Which robot goes to which target: ``algorithm_2``; the same with an ``optimal``
            choice in place of its lines 6 to 10; or ``keep`` what the root chose.
        bound: Leave out nodes not cheaper than the best plan.
        dominance: Leave out dominated nodes.
        restarts: Further trees from scratch, each bounded by the best plan so far.
    """

    measure_at: Literal["parent", "child"] = "parent"
    assignment: Assignment = "algorithm_2"
    bound: bool = False
    dominance: Dominance = "off"
    restarts: int = 0

    def __post_init__(self) -> None:
        """Check names and numbers."""
        GrowthOptions.__post_init__(self)  # of a class with slots ``super`` finds nothing
        for name, allowed in (
            ("measure_at", ("parent", "child")),
            ("assignment", get_args(Assignment)),
            ("dominance", get_args(Dominance)),
        ):
            check_choice(name, getattr(self, name), allowed)
        check_switch("bound", self.bound)
        check_count("restarts", self.restarts, 0, MOST)


PRESETS: dict[str, dict[str, Any]] = {
    "paper": {"reject_jointly": True},
    "reproduction": {"near_m": 0.3},
    "pruned": {"near_m": 0.3, "expand": "node", "bound": True, "dominance": "same_time"},
}
"""What each preset changes of the defaults."""


def tree_options(preset: str = "paper", **kwargs: Any) -> TreeOptions:  # noqa: ANN401
    """Options of a preset, some changed.

    Args:
        preset: ``paper``, ``reproduction`` or ``pruned``.
        **kwargs: Options by name.

    Returns:
        The options.

    Raises:
        OptionError: If the preset or an option is not known, or a value is not usable.
    """
    return preset_options(TreeOptions, PRESETS, "aia", preset, kwargs)


def preset_options(
    kind: type[Options],
    presets: Mapping[str, Mapping[str, Any]],
    planner: str,
    preset: str,
    changes: Mapping[str, Any],
) -> Options:
    """Options of a planner's preset, some changed.

    Args:
        kind: Their dataclass.
        presets: What each preset changes of the defaults.
        planner: Name of the planner.
        preset: Name of the preset.
        changes: Options by name.

    Returns:
        The options.

    Raises:
        OptionError: If the preset or an option is not known, or a value is not usable.
    """
    if not isinstance(preset, str) or preset not in presets:
        raise OptionError(
            f"planner option preset: expected one of {', '.join(presets)}, got {preset!r}"
        )
    check_option_names(changes, (kind,), planner)
    try:
        return kind(**{**presets[preset], **changes})
    except (FgplanError, TypeError) as error:
        raise OptionError(str(error)) from error


def split_options(
    given: Mapping[str, Any], own: tuple[str, ...]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Options by name, in those of a list and the others.

    Args:
        given: By name.
        own: Names of the list.

    Returns:
        Those of the list, and the others.
    """
    return (
        {name: value for name, value in given.items() if name in own},
        {name: value for name, value in given.items() if name not in own},
    )
