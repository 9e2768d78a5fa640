"""The closed loop: move, measure, filter, and plan again every few measurements.

"Algorithm 1 can be coupled with a Model Predictive Control approach where the robots redesign their
paths every few measurements" (section VI-A of Kantaros et al. 2019). The targets' estimate is that
of a bank of extended Kalman filters (``target_belief``), or of a single one; the truth is drawn
from the prior, in free space, and moves by the hidden state's own dynamics. Never planning again
executes the offline plan with the same filter: what the loop is compared with. Once a plan is at
its end, or none is feasible, the robots stay and go on measuring.

A plan counts what is measured where it begins. So a new one begins with the covariance from before
the last measurements, about the mean after them: nothing is counted twice.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fgplan.checks import frozen
from fgplan.errors import InvalidInputError
from fgplan.models.pose import between
from fgplan.planners.aia.geodesic_fields import GeodesicFields
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.search import search
from fgplan.planners.aia.target_belief import (
    miss_belief,
    predict_belief,
    split_prior,
    update_belief,
)
from fgplan.planners.aia.target_world import target_sensors, target_world
from fgplan.simulation.simulate import advance, start
from fgplan.simulation.step import SimulationStep
from fgplan.typing import FloatArray

_HYPOTHESES = 7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingRun:
    """What a closed loop did.

    Attributes:
        poses: Shape (T + 1, N, 3), world frame.
        truth: True targets, shape (T + 1, M, 2), metres.
        estimates: Filtered targets, after measuring, same shape.
        covariances: Of each, shape (T + 1, M, 2, 2), square metres.
        plans: Number of times planned.
        feasible: How many of these found a feasible plan.
    """

    poses: FloatArray
    truth: FloatArray
    estimates: FloatArray
    covariances: FloatArray
    plans: int
    feasible: int

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("poses", "truth", "estimates", "covariances"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def errors_m(self) -> FloatArray:
        """Distance of each estimate to the truth, shape (T + 1, M), metres."""
        return np.asarray(np.linalg.norm(self.estimates - self.truth, axis=-1))

    @property
    def rms_m(self) -> FloatArray:
        """Root mean square over targets, shape (T + 1,), metres."""
        return np.asarray(np.sqrt((self.errors_m**2).mean(axis=1)))

    @property
    def consistency(self) -> float:
        """Mean normalised squared error at the end; 2 for a filter that knows what it knows."""
        offset = self.estimates[-1] - self.truth[-1]
        weighed = np.linalg.solve(self.covariances[-1], offset[..., None])[..., 0]
        return float((offset * weighed).sum(axis=1).mean())


def track(
    problem: AcquisitionProblem,
    options: TreeOptions,
    generator: np.random.Generator,
    *,
    steps: int,
    replan_every: int | None,
    hypotheses: int = _HYPOTHESES,
) -> TrackingRun:
    """Run the closed loop.

    Args:
        problem: Independent targets in the plane and robots with sensors of points.
        options: Of the planner.
        generator: Source of every random number: the truth and the noise first, so that runs of
            one seed differ in their plans alone.
        steps: How long.
        replan_every: Steps between plans; None plans once.
        hypotheses: Filters of each target along each axis of its prior; 1 is a single one.

    Returns:
        What happened.

    Raises:
        InvalidInputError: If the problem is of another kind, or a number is not usable.
    """
    if not problem.packed:
        raise InvalidInputError(
            "closed loop: expected independent targets in the plane and sensors of points"
        )
    if steps < 1 or (replan_every is not None and replan_every < 1) or hypotheses < 1:
        raise InvalidInputError(
            f"closed loop: expected steps, replan_every and hypotheses of at least 1, got {steps}, "
            f"{replan_every} and {hypotheses}"
        )
    world = target_world(problem, generator)
    planning = generator.spawn(1)[0]
    first = start(world, generator)
    tracker = _Tracker(problem, hypotheses)
    state = first.state
    history = [tracker.measured(first)]
    planned: FloatArray = np.zeros((0, len(problem.robots), 3))
    begun = plans = feasible = 0
    fields = GeodesicFields(
        problem.workspace, problem.robots[0].pose[:2], _cell_m(problem, options)
    )
    for step in range(steps):
        due = step == 0 or (replan_every is not None and step % replan_every == 0)
        if due:
            now = tracker.problem(state.poses, fields, step)
            found = search(now, options, planning, fields=fields)
            plans += 1
            if found.plan is not None:
                feasible += 1
                planned, begun = found.plan.poses, step
        commands = {}
        place = step - begun
        if place + 1 < len(planned):
            for j, robot in enumerate(problem.robots):
                commands[robot.name] = between(planned[place, j], planned[place + 1, j])
        state, reached = advance(world, state, commands)
        tracker.predict(step)
        history.append(tracker.measured(reached))
    return TrackingRun(
        poses=np.array([one[0] for one in history]),
        truth=np.array([one[1] for one in history]),
        estimates=np.array([one[2] for one in history]),
        covariances=np.array([one[3] for one in history]),
        plans=plans,
        feasible=feasible,
    )


class _Tracker:
    """The filters of all targets, one block each."""

    def __init__(self, problem: AcquisitionProblem, hypotheses: int) -> None:
        self._problem = problem
        self._beliefs = [
            split_prior(np.array(mean), np.array(prior), hypotheses)
            for mean, prior in zip(problem.mean.reshape(-1, 2), problem.priors, strict=True)
        ]
        self._before = list(problem.priors)
        self._sensors = target_sensors(problem)

    def predict(self, time: int) -> None:
        """Predict all targets from a time to the next."""
        for i, block in enumerate(self._problem.hidden.blocks):
            self._beliefs[i] = predict_belief(self._beliefs[i], *block.at(time))
        self._before = [belief.covariance for belief in self._beliefs]

    def measured(
        self, step: SimulationStep
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Update by a step's measurements; poses, truth, estimates and covariances after it."""
        world = self._problem.workspace
        came = {(one.sensor, str(one.target)): one for one in step.measurements}
        for robot in self._problem.robots:
            for place in range(len(robot.sensors)):
                name, pose = f"{robot.name} {place}", step.poses[robot.name]
                for i, target in enumerate(self._problem.hidden.targets):
                    reading, belief = came.get((name, target)), self._beliefs[i]
                    sensor = self._sensors[name]
                    if reading is None:
                        self._beliefs[i] = miss_belief(belief, sensor, pose, world)
                    else:
                        self._beliefs[i] = update_belief(belief, sensor, pose, reading, world)
        poses = np.array([step.poses[robot.name] for robot in self._problem.robots])
        truth = np.asarray(step.state.hidden_state).reshape(-1, 2)
        means = np.array([belief.mean for belief in self._beliefs])
        return poses, truth, means, np.array([belief.covariance for belief in self._beliefs])

    def problem(
        self, poses: Mapping[str, FloatArray], fields: GeodesicFields, time: int
    ) -> AcquisitionProblem:
        """The problem as it is now: what is left to learn, from where the robots are."""
        means = [self._in_free_space(belief.mean, fields) for belief in self._beliefs]
        robots = tuple(
            dataclasses.replace(robot, pose=np.array(poses[robot.name]))
            for robot in self._problem.robots
        )
        return dataclasses.replace(
            self._problem,
            robots=robots,
            hidden=self._problem.hidden.later(time),
            mean=np.concatenate(means),
            priors=tuple(self._before),
        )

    def _in_free_space(self, mean: FloatArray, fields: GeodesicFields) -> FloatArray:
        """The estimate, or the nearest free centre of a cell where it is inside an obstacle."""
        workspace = self._problem.workspace
        if workspace.are_positions_valid(mean[None])[0]:
            return mean
        free = fields.cell_centers[workspace.are_positions_valid(fields.cell_centers)]
        return np.array(free[int(np.argmin(((free - mean) ** 2).sum(axis=1)))])


def _cell_m(problem: AcquisitionProblem, options: TreeOptions) -> float:
    """Side of the geodesic cells, as the planner would choose it."""
    longest = max(np.abs(robot.primitives.relative[:, :2]).max() for robot in problem.robots)
    return options.geodesic_cell_m or float(longest)
