"""A mission as an acquisition problem, and a team's path as a plan.

For every planner that gathers information: one is swapped for another by its name in the scenario.
Poses are taken as known, so the plan holds no covariances of poses. What it is about, the targets'
covariances, is in ``details``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from fgplan.checks import check_positive
from fgplan.errors import FgplanError, InvalidInputError, NoCandidatePathError, OptionError
from fgplan.evaluation.registry import find_object
from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.models.motion_primitives import MotionPrimitives, differential_drive, first_order
from fgplan.paths.candidate_path import KNOWN_MOTION, CandidatePath
from fgplan.planners.aia.problem import (
    SCALED,
    AcquisitionProblem,
    Scope,
    SensingRobot,
    TerminalConstraint,
    TerminalGoal,
    TerminalScope,
)
from fgplan.planners.aia.team_path import TeamPath
from fgplan.planners.mission import Mission
from fgplan.planners.option_checks import check_switch
from fgplan.planners.plan import ObjectiveValue, Plan, RobotPlan
from fgplan.typing import FloatArray

_WHOLE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class ProblemOptions:
    """What a scenario says of the problem under ``[planner.NAME]``.

    Attributes:
        dynamics: ``first_order``, ``differential_drive``, or "module:object": motion primitives of
            a user's own, or a function without arguments that returns them.
        step_m: Length of a step of the built-in dynamics, metres.
        step_s: Duration of a step, seconds.
        delta: Limit of the terminal constraint.
        constraint: Uncertainty function of the terminal constraint.
        constraint_scope: Whether the constraint holds for ``each`` target, or for the ``joint``
            covariance.
        objective: Uncertainty function that is summed over steps.
        objective_scope: Whether it is a ``sum`` over targets, or of the ``joint`` covariance.
        terminal_goals: Whether each robot must end within ``goal_radius_m`` of its last goal.
        goal_radius_m: Greatest distance to that goal at the end, metres.
    """

    dynamics: str = "first_order"
    step_m: float = 0.2
    step_s: float = 1.0
    delta: float = 1.8e-6
    constraint: str = "determinant"
    constraint_scope: TerminalScope = "each"
    objective: str = "determinant"
    objective_scope: Scope = "sum"
    terminal_goals: bool = False
    goal_radius_m: float = 0.3

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("step_m", "step_s", "goal_radius_m"):
            check_positive(getattr(self, name), f"planner option {name}")
        check_switch("terminal_goals", self.terminal_goals)

    def primitives(self) -> MotionPrimitives:
        """The control set that ``dynamics`` names.

        Raises:
            UnknownNameError: If there is none of that name.
            InvalidInputError: If a user's own is none.
        """
        if self.dynamics == "first_order":
            return first_order(self.step_m, step_s=self.step_s)
        if self.dynamics == "differential_drive":
            speeds = (0.0, self.step_m / self.step_s)
            return differential_drive(speeds, step_s=self.step_s)
        built_in = {"first_order": "", "differential_drive": ""}
        found = find_object(self.dynamics, built_in, "dynamics")
        made = found() if callable(found) else found
        if not isinstance(made, MotionPrimitives):
            raise InvalidInputError(
                f"dynamics {self.dynamics!r}: expected MotionPrimitives, got {type(made).__name__}"
            )
        return made


PROBLEM_OPTIONS = tuple(option.name for option in fields(ProblemOptions))


def read_problem_options(given: Mapping[str, Any]) -> ProblemOptions:
    """Options of the problem from a scenario.

    Args:
        given: By name; known ones only.

    Returns:
        The options.

    Raises:
        OptionError: If a value is not usable.
    """
    try:
        return ProblemOptions(**given)
    except FgplanError as error:
        raise OptionError(str(error)) from error


def mission_problem(mission: Mission, options: ProblemOptions) -> AcquisitionProblem:
    """The acquisition problem of a mission.

    Args:
        mission: Planar robots with sensors, and targets.
        options: What the planner's table says.

    Returns:
        The problem.

    Raises:
        InvalidInputError: If the mission has no targets, a robot is not planar, or a number is not
            usable.
        OptionError: If the constraint is not usable.
    """
    if not mission.targets:
        raise InvalidInputError(
            "mission: expected [[targets]] to gather information about, got none"
        )
    primitives = options.primitives()
    robots = []
    for robot in mission.robots:
        pose = mission.prior.pose(robot.start_key)
        if np.shape(pose) != (3,):
            raise InvalidInputError(
                f"robot {robot.name!r}: expected a planar start pose, got shape {np.shape(pose)}"
            )
        for name in robot.sensors:
            if name not in mission.sensors:
                known = ", ".join(mission.sensors) or "none"
                raise InvalidInputError(
                    f"robot {robot.name!r}: sensor {name!r} is not one of: {known}"
                )
        goal = None
        if options.terminal_goals:
            goal = TerminalGoal(position=robot.goals[-1][:2], radius_m=options.goal_radius_m)
        robots.append(
            SensingRobot(
                name=robot.name,
                pose=pose,
                primitives=primitives,
                sensors=tuple(mission.sensors[name] for name in robot.sensors),
                goal=goal,
            )
        )
    blocks = [
        HiddenBlock(
            targets=(target.name,),
            transition=target.transition,
            drift=target.drift,
            process=target.process,
        )
        for target in mission.targets
    ]
    try:
        terminal = TerminalConstraint(
            limit=options.delta, function=options.constraint, scope=options.constraint_scope
        )
    except FgplanError as error:
        raise OptionError(f"planner option delta or constraint: {error}") from error
    return AcquisitionProblem(
        workspace=mission.workspace,
        robots=tuple(robots),
        hidden=HiddenState(tuple(blocks)),
        mean=np.concatenate([target.mean for target in mission.targets]),
        priors=tuple(target.covariance for target in mission.targets),
        terminal=terminal,
        objective=options.objective,
        objective_scope=options.objective_scope,
    )


def mission_plan(
    mission: Mission,
    problem: AcquisitionProblem,
    path: TeamPath,
    *,
    planner: str,
    agreed: bool = True,
    report: Mapping[str, int],
    seconds: Mapping[str, float],
    options: Mapping[str, Any],
    warnings: tuple[str, ...] = (),
    details: Mapping[str, Any] | None = None,
) -> Plan:
    """A team's path as a plan.

    Args:
        mission: What was given.
        problem: Its problem.
        path: The path.
        planner: Name of the planner.
        agreed: Whether the planner came to its own end, not to a limit.
        report: Counts of the work.
        seconds: Real seconds by stage.
        options: Options as used.
        warnings: Plain sentences.
        details: What only this planner has to say.

    Returns:
        The plan; ``details`` holds ``horizon``, ``cost``, ``controls``, ``target_covariances`` and
        ``target_means`` by step.
    """
    means = problem.hidden.predicted_means(problem.mean, path.horizon)
    by_name = {robot.name: robot for robot in mission.robots}
    robots = []
    for j, robot in enumerate(problem.robots):
        poses = path.poses[:, j]
        own = None
        if path.horizon:
            own = CandidatePath(
                robot=robot.name,
                poses=poses,
                times_s=np.arange(len(poses), dtype=np.float64) * robot.primitives.step_s,
                motion_covariances=np.tile(KNOWN_MOTION * np.eye(3), (path.horizon, 1, 1)),
            )
        robots.append(
            RobotPlan(
                robot=robot.name,
                start=robot.pose,
                path=own,
                covariances=np.zeros((0, 3, 3)),
                goals=by_name[robot.name].goals,
                candidates=len(robot.primitives),
            )
        )
    found = {
        "horizon": path.horizon,
        "cost": path.cost,
        "controls": path.controls(problem).tolist(),
        "targets": list(problem.hidden.targets),
        "target_covariances": path.covariances.tolist(),
        "target_means": means.tolist(),
    }
    return Plan(
        planner=planner,
        mission=mission.name,
        scenario_digest=mission.digest,
        seed=mission.seed,
        robots=tuple(robots),
        agreed=agreed,
        objective=(ObjectiveValue(0, "", path.cost),),
        report=report,
        seconds=seconds,
        warnings=warnings,
        options=options,
        details=found | dict(details or {}),
    )


def no_plan(
    planner: str,
    problem: AcquisitionProblem,
    shortfall: float,
    why: str,
    farthest: str = "",
    remedy: str = "relax delta, or give a larger budget",
) -> Exception:
    """The error of a search without a feasible plan, with the best uncertainty that it reached.

    Args:
        planner: Name of the planner.
        problem: What was planned for.
        shortfall: Worst target's number over its limit at the node nearest to feasible.
        why: Why the search ended.
        farthest: Name of that target; empty where the constraint is of the joint covariance.
        remedy: What to do.

    Returns:
        The error, to be raised.
    """
    limit = np.asarray(problem.terminal.limit, dtype=np.float64)
    one = bool(np.ptp(limit) <= _WHOLE * np.abs(limit).max())
    limits = f"{limit[0]:.3g}" if one else "its limit"
    best = ""
    if np.isfinite(shortfall):
        number = ""
        if one and problem.terminal.scope == "each" and problem.terminal.function in SCALED:
            number = f"{shortfall * limit[0]:.3g}, "
        best = f"; the best uncertainty reached is {number}{shortfall:.3g} times the limit"
        if farthest:
            best += f", at target {farthest!r}, the farthest from it"
    return NoCandidatePathError(
        f"planner {planner!r}: no plan brings the {problem.terminal.function} to {limits}: {why}"
        f"{best}; {remedy}"
    )


def target_positions(problem: AcquisitionProblem, steps: int) -> FloatArray:
    """Predicted places of the targets by step, for figures.

    Args:
        problem: The problem.
        steps: Number of steps F.

    Returns:
        Shape (F + 1, M, 2), metres, world frame.
    """
    places = problem.places_until(steps)
    return np.broadcast_to(places, (steps + 1, *places.shape[1:])) if len(places) == 1 else places
