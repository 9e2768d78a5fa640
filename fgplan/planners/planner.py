"""What every planner offers: a mission in, a plan out.

A planner is stateless: what it draws comes from the generator that it is given, so the same seed
gives the same plan on the same machine and versions.
"""

from collections.abc import Callable, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

from fgplan.planners.mission import Mission
from fgplan.planners.plan import Plan

Progress = Callable[[int, int, str], None]
"""Called as ``progress(done, total, doing)``; total is 0 where it is not known."""


@runtime_checkable
class AbstractPlanner(Protocol):
    """One way of planning for a team; it may name its ``option_tables``.

    Attributes:
        name: Name in scenario files and results.
    """

    name: str

    def plan(
        self, mission: Mission, generator: np.random.Generator, progress: Progress | None = None
    ) -> Plan:
        """Plan for every robot of a mission.

        Args:
            mission: What is given; ``mission.options`` are this planner's.
            generator: Source of every random number.
            progress: Told how far it is.

        Returns:
            The plan.

        Raises:
            NoCandidatePathError: If there is no feasible plan; names the robot.
            OptionError: If an option is not known (lists those that are) or not usable.
        """
        ...


@runtime_checkable
class CheckedPlanner(Protocol):
    """A planner that can say that its options are wrong before it plans; all of fgplan's can."""

    def check_options(self, given: Mapping[str, Any]) -> None:
        """Refuse what ``plan`` would refuse of its options, without planning.

        Args:
            given: By name, as ``mission.options``.

        Raises:
            OptionError: If an option is not known (lists those that are) or not usable.
            UnknownNameError: If an option names something that there is not.
        """
        ...
