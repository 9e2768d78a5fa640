"""What a planner is given: the scenario, checked and turned into objects.

One product serves all planners. A planner that needs roadmap and candidate paths makes them from
the workspace and its own options; one that tracks targets reads them here.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.checks import check_covariance, check_finite, check_semidefinite
from fgplan.errors import InvalidInputError
from fgplan.evaluation.objective import Objective
from fgplan.evaluation.problem import PastState
from fgplan.models.motion import MotionModel
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.multi_robot import MultiRobotModel
from fgplan.typing import Covariance, FloatArray, Key
from roadmaps import Workspace


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionRobot:
    """One robot of a mission.

    Attributes:
        name: Unique name.
        start_key: Key of its current pose in the prior.
        goals: Shape (G, 2) or (G, 3), metres, world frame, in the order of visiting.
        motion: Motion model with noise and speed.
        sensors: Names of the sensors of the mission that this robot carries.
    """

    name: str
    start_key: Key
    goals: FloatArray
    motion: MotionModel
    sensors: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the goals."""
        goals = check_finite(
            np.atleast_2d(np.asarray(self.goals)), f"goals of robot {self.name!r}", (None, None)
        )
        object.__setattr__(self, "goals", goals)


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionTarget:
    """One hidden target: x(t + 1) = A x(t) + w(t), w ~ N(d, Q).

    Attributes:
        name: Unique name.
        mean: Shape (n,), estimate at planning time, metres, world frame.
        covariance: Shape (n, n), square metres.
        transition: A, shape (n, n).
        drift: d, shape (n,), metres a step.
        process: Q, shape (n, n), square metres a step; zero for a static target.
    """

    name: str
    mean: FloatArray
    covariance: Covariance
    transition: FloatArray
    drift: FloatArray
    process: FloatArray

    def __post_init__(self) -> None:
        """Check shapes and the covariance."""
        mean = check_finite(self.mean, f"target {self.name!r} mean", (None,))
        size = mean.size
        for key, value in (
            ("mean", mean),
            ("covariance", check_covariance(self.covariance, f"target {self.name!r}", size)),
            (
                "transition",
                check_finite(self.transition, f"target {self.name!r} transition", (size, size)),
            ),
            ("drift", check_finite(self.drift, f"target {self.name!r} drift", (size,))),
            ("process", check_semidefinite(self.process, f"target {self.name!r} process", size)),
        ):
            object.__setattr__(self, key, value)


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSimulation:
    """What a scenario asks of a closed loop; planners do not read it.

    Attributes:
        steps: Number of steps to execute; None runs until every path has ended.
        seed: Seed of the truth and of measurement noise; None takes the mission's.
        runs: Number of Monte Carlo runs.
        options: Options that only the planner's own simulation understands.
    """

    steps: int | None = None
    seed: int | None = None
    runs: int = 1
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """A scenario as objects.

    Attributes:
        name: Title for figures and results.
        workspace: Bounds and obstacles.
        robots: In the order of the team.
        prior: Belief at planning time.
        objective: What the team minimises.
        sensors: Sensors by name.
        multi_robot: Models of factors between robots.
        past_states: Past poses that may take part in multi-robot factors.
        targets: Hidden targets.
        simulation: What the scenario asks of a closed loop; None where it asks nothing.
        options: Options of the planner, as the scenario gives them under ``[planner.NAME]``.
        digest: Digest of the scenario.
        seed: Seed of every random number of the run.
    """

    name: str
    workspace: Workspace
    robots: tuple[MissionRobot, ...]
    prior: Belief
    objective: Objective
    sensors: Mapping[str, AbstractSensor] = field(default_factory=dict)
    multi_robot: tuple[MultiRobotModel, ...] = ()
    past_states: tuple[PastState, ...] = ()
    targets: tuple[MissionTarget, ...] = ()
    simulation: MissionSimulation | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    digest: str = ""
    seed: int = 0

    def __post_init__(self) -> None:
        """Check that names are unique."""
        for what, names in (
            ("robot", [robot.name for robot in self.robots]),
            ("target", [target.name for target in self.targets]),
        ):
            for name in names:
                if names.count(name) > 1:
                    raise InvalidInputError(
                        f"mission: expected unique names, got {what} {name!r} twice"
                    )
