"""How a team plans to its next meeting; the defaults are those of the paper where it prints them.

Not printed and ours: samples, explore, epsilon_m, every, horizon_steps, travel_m.
"""

from dataclasses import dataclass
from typing import Literal, get_args

from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError

Sync = Literal["slowdown", "strict", "relaxed"]
Goal = Literal["uncertainty", "travel"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentOptions:
    """Options of Algorithm 1.

    Attributes:
        samples: n_sample, samples drawn.
        explore: B, the first of them, which are uniform over the free joint space (f_1).
        epsilon_m: Longest way of a body on one edge, metres.
        step_m: u_max, longest way of a robot in one step, metres.
        range_m: R, communication range, metres.
        spread_m: Standard deviation of f_2 about a meeting point, metres; None takes 2 R.
        sync: How arrival times are brought together: ``slowdown`` (robots may move slower),
            ``strict`` (Algorithms 3 and 6 as printed) or ``relaxed`` (section III-E).
        goal: What must hold before a meeting: ``uncertainty`` below ``delta``, or every robot has
            travelled ``travel_m``.
        delta: Limit of the uncertainty of the most uncertain target.
        travel_m: Least way of every robot, metres.
        horizon_steps: Longest plan after the last robot's start, steps.

    Raises:
        InvalidInputError: If a value is not usable.
    """

    samples: int = 600
    explore: int = 300
    epsilon_m: float = 1.0
    step_m: float = 0.1
    range_m: float = 0.2
    spread_m: float | None = None
    sync: Sync = "slowdown"
    goal: Goal = "uncertainty"
    delta: float = 0.12**2
    travel_m: float = 5.0
    horizon_steps: int = 400

    def __post_init__(self) -> None:
        """Check names and numbers."""
        for name, allowed in (("sync", get_args(Sync)), ("goal", get_args(Goal))):
            if getattr(self, name) not in allowed:
                raise InvalidInputError(
                    f"planner option {name}: expected one of {', '.join(allowed)}, got "
                    f"{getattr(self, name)!r}"
                )
        for name in ("epsilon_m", "step_m", "range_m", "delta", "travel_m"):
            check_positive(getattr(self, name), f"planner option {name}")
        if self.spread_m is not None:
            check_positive(self.spread_m, "planner option spread_m")
        for name, least in (("samples", 1), ("explore", 0), ("horizon_steps", 1)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise InvalidInputError(
                    f"planner option {name}: expected a whole number of at least {least}, got "
                    f"{value!r}"
                )
        if self.epsilon_m < self.step_m:
            raise InvalidInputError(
                f"planner option epsilon_m: expected at least one step of {self.step_m} m, got "
                f"{self.epsilon_m}"
            )
