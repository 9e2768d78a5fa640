"""Options of the planner ``distributed_aia`` and its presets.

``paper`` is Algorithms 1 and 2 of Tzes et al. 2021 as far as their text goes: the whole group is
extended, a draw that hits an obstacle is rejected, controls are drawn uniformly within sensing
range (9), the covariance of a neighbour's node that lags is fused as it is (Remark 3).
``reproduction`` extends one node of a group a visit, draws controls uniformly within 0.3 m only,
and predicts covariances that lag. What the text does not give, p_C and kappa among it, is ours
everywhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args

from fgplan.checks import check_not_negative
from fgplan.errors import InvalidInputError
from fgplan.planners.aia.options import (
    MOST,
    GrowthOptions,
    TreeOptions,
    preset_options,
)
from fgplan.planners.option_checks import check_choice, check_count

EmptySet = Literal["predict", "literal"]
ConstraintAt = Literal["one", "all"]

_MASSES = ("p_group", "p_control", "p_candidate")


@dataclass(frozen=True, slots=True, kw_only=True)
class DistributedOptions(GrowthOptions):
    """How the trees are grown; iterations and node budget are those of each robot.

    Attributes:
        p_candidate: p_C of (10): probability that a neighbour's least uncertain node is fused.
        of_robot: By name of a robot, which of p_group, p_control and p_candidate it has otherwise:
            the mass functions may differ by robot.
        kappa: Weight of the most certain robot in the filter (4), target by target; the others
            share the rest.
        empty_set: What is fused where a neighbour has no admissible node: its last covariance
            predicted forward, or ``literal``, as it is (Remark 3).
        constraint_at: Whether the terminal constraint holds at ``one`` robot at least, or at all.
        goals_kept: Goal nodes of each robot, cheapest first, of which team paths are made.
    """

    p_candidate: float = 0.9
    of_robot: Mapping[str, Mapping[str, float]] | None = None
    kappa: float = 0.9
    empty_set: EmptySet = "predict"
    constraint_at: ConstraintAt = "one"
    node_budget: int = 100_000
    goals_kept: int = 32

    def __post_init__(self) -> None:
        """Check names and numbers."""
        GrowthOptions.__post_init__(self)
        for name, allowed in (
            ("empty_set", get_args(EmptySet)),
            ("constraint_at", get_args(ConstraintAt)),
        ):
            check_choice(name, getattr(self, name), allowed)
        for name in ("p_candidate", "kappa"):
            check_not_negative(getattr(self, name), f"planner option {name}")
        if not 0.0 < self.p_candidate < 1.0:
            raise InvalidInputError(
                "planner option p_candidate: expected a number between 0 and 1, or Assumption 4 "
                f"fails, got {self.p_candidate!r}"
            )
        if not 0.5 <= self.kappa < 1.0:
            raise InvalidInputError(
                "planner option kappa: expected at least 0.5 and less than 1, the weight of the "
                f"most certain robot, got {self.kappa!r}"
            )
        check_count("goals_kept", self.goals_kept, 1, MOST)
        self._check_robots()

    def masses(self, robot: str) -> tuple[float, float, float]:
        """p_V, p_U and p_C of a robot.

        Args:
            robot: Its name.
        """
        own = (self.of_robot or {}).get(robot, {})
        p_group, p_control, p_candidate = (own.get(n, getattr(self, n)) for n in _MASSES)
        return p_group, p_control, p_candidate

    def tree(self) -> TreeOptions:
        """The options of one robot's tree, as those of ``aia``.

        Raises:
            InvalidInputError: If one is not usable.
        """
        return TreeOptions(**{one.name: getattr(self, one.name) for one in fields(GrowthOptions)})

    def _check_robots(self) -> None:
        """Refuse mass functions of a robot that would not do for all."""
        if self.of_robot is None:
            return
        if not isinstance(self.of_robot, Mapping):
            raise InvalidInputError(
                f"planner option of_robot: expected a table by robot, got {self.of_robot!r}"
            )
        for robot, own in self.of_robot.items():
            if not isinstance(own, Mapping) or not set(own) <= set(_MASSES):
                raise InvalidInputError(
                    f"planner option of_robot: {robot}: expected a table of {', '.join(_MASSES)}, "
                    f"got {own!r}"
                )
            try:
                changes: dict[str, Any] = {"of_robot": None, **own}
                replace(self, **changes)
            except InvalidInputError as error:
                raise InvalidInputError(f"of_robot: {robot}: {error}") from error


PRESETS: dict[str, dict[str, Any]] = {
    "paper": {"reject_jointly": True, "empty_set": "literal"},
    "reproduction": {"near_m": 0.3, "expand": "node"},
}
"""What each preset changes of the defaults."""


def distributed_options(preset: str = "reproduction", **kwargs: Any) -> DistributedOptions:  # noqa: ANN401
    """Options of a preset, some changed.

    Args:
        preset: ``paper`` or ``reproduction``.
        **kwargs: Options by name.

    Returns:
        The options.

    Raises:
        OptionError: If the preset or an option is not known, or a value is not usable.
    """
    return preset_options(DistributedOptions, PRESETS, "distributed_aia", preset, kwargs)
