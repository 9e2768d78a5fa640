"""What an information-gathering planner is given: Problem 1 of Kantaros et al. 2019.

    minimise over F, u_0:F   sum_{t=0..F} g(Sigma(t))
    such that                h(Sigma(F)) <= delta, every pose and motion free, (5d), (5e)

g must be positive, or the best horizon would be infinite (Remark 2.1); h may be any uncertainty
function, or mutual information from below. With targets, g is summed over them and h holds for
each, by default. ``near`` and everything else that says how to search is an option of the planner.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.linalg import block_diag

from fgplan.checks import check_covariance, check_finite, check_positive
from fgplan.errors import InvalidInputError
from fgplan.models.hidden_state import HiddenState
from fgplan.models.linear_observation import AbstractLinearObservation
from fgplan.models.motion_primitives import MotionPrimitives
from fgplan.models.sensor import AbstractSensor
from fgplan.models.uncertainty import UncertaintyFunction, uncertainty_function
from fgplan.riccati.covariance_path import propagate
from fgplan.typing import ArrayLike, Covariance, FloatArray
from roadmaps import Workspace

SCALED = ("determinant", "trace", "largest_eigenvalue")
"""Functions of which a node's shortfall is the number over its limit."""

Scope = Literal["sum", "joint"]
TerminalScope = Literal["each", "joint"]
MeasureAt = Literal["parent", "child"]
Observer = AbstractSensor | AbstractLinearObservation


@dataclass(frozen=True, slots=True, kw_only=True)
class TerminalGoal:
    """A disc in which a robot must be at the end.

    Attributes:
        position: Shape (2,), metres, world frame.
        radius_m: Radius, metres.
    """

    position: FloatArray
    radius_m: float

    def __post_init__(self) -> None:
        """Check the numbers."""
        position = check_finite(self.position, "terminal goal: position", (2,))
        object.__setattr__(self, "position", position)
        check_positive(self.radius_m, "terminal goal: radius_m")


@dataclass(frozen=True, slots=True, kw_only=True)
class SensingRobot:
    """A robot whose pose is known and which looks for targets.

    Attributes:
        name: Unique name.
        pose: Shape (3,), metres and radians, world frame.
        primitives: Its finite control set.
        sensors: What it carries; several add up.
        goal: Where it must be at the end; None for anywhere.
    """

    name: str
    pose: FloatArray
    primitives: MotionPrimitives
    sensors: tuple[Observer, ...]
    goal: TerminalGoal | None = None

    def __post_init__(self) -> None:
        """Check pose and sensors."""
        pose = check_finite(self.pose, f"robot {self.name!r}: pose", (3,))
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "sensors", tuple(self.sensors))
        for sensor in self.sensors:
            if not isinstance(sensor, AbstractSensor | AbstractLinearObservation):
                raise InvalidInputError(
                    f"robot {self.name!r}: expected sensors or linear observations, got "
                    f"{type(sensor).__name__}"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class TerminalConstraint:
    """h(Sigma(F)) <= limit; for mutual information, at least the limit (nats).

    Mutual information is that of the state at the end, x(F), and all measurements: the covariance
    at F is compared with the one that F would have had without any.

    Attributes:
        limit: One number for all targets, or one a target, shape (M,).
        function: Name in the registry of uncertainty functions.
        scope: Holds for each target, or for the joint covariance.
    """

    limit: ArrayLike
    function: str = "determinant"
    scope: TerminalScope = "each"

    def __post_init__(self) -> None:
        """Check name and numbers."""
        uncertainty_function(self.function)
        if self.scope not in ("each", "joint"):
            raise InvalidInputError(
                f"terminal constraint: scope: expected 'each' or 'joint', got {self.scope!r}"
            )
        limit = check_finite(np.atleast_1d(self.limit), "terminal constraint: limit", (None,))
        if self.function in SCALED and (limit <= 0).any():
            raise InvalidInputError(
                f"terminal constraint: expected a {self.function} above zero, got {limit.min():g}"
            )
        object.__setattr__(self, "limit", limit)

    def limits(self, targets: int) -> FloatArray:
        """One limit a target, shape (M,); of a joint constraint shape (1,).

        Args:
            targets: Number of targets M.

        Raises:
            InvalidInputError: If there are not one or M limits, or several for a joint one.
        """
        limit = np.asarray(self.limit, dtype=np.float64)
        wanted = 1 if self.scope == "joint" else targets
        if limit.size not in (1, wanted):
            raise InvalidInputError(
                f"terminal constraint: expected one limit or {wanted}, got {limit.size}"
            )
        return np.broadcast_to(limit, (wanted,)).copy()


@dataclass(frozen=True, slots=True, kw_only=True)
class AcquisitionProblem:
    """Problem 1: robots, hidden state, what is minimised and what must hold at the end.

    Attributes:
        workspace: Where robots may be; obstacles block sight.
        robots: In the order of the team.
        hidden: Dynamics of the hidden state.
        mean: Its mean at time 0, shape (n,).
        priors: Covariance at time 0 of each block of ``hidden``.
        terminal: What must hold at the end.
        objective: Name of a positive uncertainty function.
        objective_scope: Sum over targets, or of the joint covariance.
        places: Where the targets are, shape (M, 2), if they are no points in the plane (cells of
            a field); such targets stay. Left out, the targets' means are their places.
        packed: Whether the targets are independent points in the plane, measured one at a time.
    """

    workspace: Workspace
    robots: tuple[SensingRobot, ...]
    hidden: HiddenState
    mean: FloatArray
    priors: tuple[Covariance, ...]
    terminal: TerminalConstraint
    objective: str = "determinant"
    objective_scope: Scope = "sum"
    places: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    packed: bool = field(init=False)

    def __post_init__(self) -> None:
        """Check everything that a planner would otherwise trip over."""
        if not self.robots or not self.hidden.targets:
            raise InvalidInputError(
                f"acquisition problem: expected at least one robot and one target, got "
                f"{len(self.robots)} and {len(self.hidden.targets)}"
            )
        names = [robot.name for robot in self.robots]
        for name in names:
            if names.count(name) > 1:
                raise InvalidInputError(
                    f"acquisition problem: expected unique names, got robot {name!r} twice"
                )
        if not any(robot.sensors for robot in self.robots):
            raise InvalidInputError(
                "acquisition problem: expected a sensor on at least one robot, got none"
            )
        object.__setattr__(self, "robots", tuple(self.robots))
        mean = check_finite(self.mean, "mean of the hidden state", (self.hidden.size,))
        object.__setattr__(self, "mean", mean)
        if len(self.priors) != len(self.hidden.blocks):
            raise InvalidInputError(
                f"acquisition problem: expected one prior a block of the hidden state "
                f"({len(self.hidden.blocks)}), got {len(self.priors)}"
            )
        priors = tuple(
            check_covariance(prior, f"prior of {', '.join(block.targets)}", block.size)
            for prior, block in zip(self.priors, self.hidden.blocks, strict=True)
        )
        object.__setattr__(self, "priors", priors)
        points = all(isinstance(s, AbstractSensor) for r in self.robots for s in r.sensors)
        planar = self.hidden.independent and all(n == 2 for n in self.hidden.sizes)
        object.__setattr__(self, "packed", points and planar)
        self._check_places()
        self._check_starts()
        self.terminal.limits(self.targets)
        if not self.objective_function.positive or self.objective_function.needs_prior:
            raise InvalidInputError(
                f"objective {self.objective!r}: expected a positive function, or the best horizon "
                "would be infinite (Remark 2.1); take determinant, trace or largest_eigenvalue"
            )
        if self.objective_scope not in ("sum", "joint"):
            raise InvalidInputError(
                f"objective scope: expected 'sum' or 'joint', got {self.objective_scope!r}"
            )

    @property
    def targets(self) -> int:
        """Number of targets M."""
        return len(self.hidden.targets)

    @property
    def objective_function(self) -> UncertaintyFunction:
        """The function that is summed."""
        return uncertainty_function(self.objective)

    @property
    def fixed(self) -> bool:
        """Whether the predicted places do not change."""
        if len(self.places):
            return True
        means = self.hidden.predicted_means(self.mean, 1)
        return bool((means[1] == means[0]).all()) and all(
            block.transition.ndim == 2 and block.drift.ndim == 1 for block in self.hidden.blocks
        )

    @property
    def still(self) -> bool:
        """Whether predicting changes no covariance: every A is the identity, every Q zero."""
        return all(
            bool((block.transition == np.eye(block.size)).all() and not block.process.any())
            for block in self.hidden.blocks
        )

    def open_loop_covariances(self, steps: int) -> FloatArray:
        """Covariance of the stacked state if nothing were measured.

        Args:
            steps: Number of steps.

        Returns:
            Shape (steps + 1, n, n).
        """
        nothing = [np.zeros((0, self.hidden.size))] * (steps + 1)
        return propagate(self.hidden, block_diag(*self.priors), nothing)

    def open_loop_of(self, target: int, steps: int) -> FloatArray:
        """Covariance of one target if nothing were measured.

        Args:
            target: Its place among the targets.
            steps: Number of steps.

        Returns:
            Shape (steps + 1, n_i, n_i).
        """
        part = self.hidden.slice_of(self.hidden.targets[target])
        return self.open_loop_covariances(steps)[:, part, part]

    def places_until(self, steps: int) -> FloatArray:
        """Predicted places of the targets.

        Args:
            steps: Number of steps.

        Returns:
            Shape (steps + 1, M, 2), metres, world frame; one row if they stay.
        """
        if len(self.places):
            return self.places[None]
        means = self.hidden.predicted_means(self.mean, 0 if self.fixed else steps)
        return np.ascontiguousarray(means.reshape(len(means), self.targets, -1)[:, :, :2])

    def _check_places(self) -> None:
        """Refuse targets without a place, and those inside an obstacle."""
        places = np.asarray(self.places, dtype=np.float64)
        if places.size:
            places = check_finite(places, "places of the targets", (self.targets, 2))
            for robot in self.robots:
                for sensor in robot.sensors:
                    if isinstance(sensor, AbstractSensor):
                        raise InvalidInputError(
                            f"robot {robot.name!r}: sensor {sensor.kind!r} measures points, and "
                            "targets with given places are none; use a linear observation"
                        )
        elif set(self.hidden.sizes) not in ({2}, {3}):
            raise InvalidInputError(
                "acquisition problem: expected targets of two or three coordinates, or their "
                f"places, got sizes {self.hidden.sizes}"
            )
        object.__setattr__(self, "places", places)
        places = self.places_until(0)[0]
        hidden_in = self.workspace.has_line_of_sight(places, places)
        for name, place, free in zip(self.hidden.targets, places, hidden_in, strict=True):
            if not free:
                raise InvalidInputError(
                    f"target {name!r}: expected a place in free space, got {place.tolist()}, which "
                    "is inside an obstacle: no robot could see it; move the target or the obstacle"
                )

    def _check_starts(self) -> None:
        """Refuse robots that start inside an obstacle or out of bounds."""
        starts = np.array([robot.pose[:2] for robot in self.robots])
        for robot, free in zip(
            self.robots, self.workspace.are_positions_valid(starts), strict=True
        ):
            if not free:
                raise InvalidInputError(
                    f"robot {robot.name!r}: expected a start in free space within the bounds, got "
                    f"{robot.pose[:2].tolist()}"
                )
            if (
                robot.goal is not None
                and not self.workspace.are_positions_valid(robot.goal.position[None]).all()
            ):
                raise InvalidInputError(
                    f"robot {robot.name!r}: expected a terminal goal in free space, got "
                    f"{robot.goal.position.tolist()}"
                )


def is_monotone(problem: AcquisitionProblem) -> bool:
    """Whether a smaller covariance is never worse, neither for the objective nor at the end.

    Args:
        problem: The problem.
    """
    terminal = uncertainty_function(problem.terminal.function)
    # Mutual information falls with the covariance, and at least the limit is wanted.
    return problem.objective_function.monotone and (
        terminal.monotone or terminal.name == "mutual_information"
    )


def check_monotone(problem: AcquisitionProblem) -> None:
    """Refuse a problem in which dominated nodes must not be left out.

    Args:
        problem: The problem.

    Raises:
        InvalidInputError: If a larger covariance may give a smaller number.
    """
    if not is_monotone(problem):
        raise InvalidInputError(
            f"planner option dominance: expected 'off' where objective {problem.objective!r} or "
            f"constraint {problem.terminal.function!r} is not monotone: a node that knows less may "
            "then be the better one; set dominance = 'off'"
        )
