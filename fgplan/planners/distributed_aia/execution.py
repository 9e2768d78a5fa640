"""A plan executed with noisy measurements: every robot has its own estimate of every target.

At step t robot i, at its planned pose, pools its belief with those of the robots it is linked to,
measures, and predicts:

    Sigma^-1 = sum_j w_ij Sigma_j(t)^-1,    mu = Sigma sum_j w_ij Sigma_j(t)^-1 mu_j(t)
    update by its own measurements of t, linearised at the pooled mean (second order)
    Sigma_i(t + 1) = A Sigma A' + Q,        mu_i(t + 1) = A mu + d

which is the distributed Kalman filter of ``fgplan.riccati.distributed_mean``, taken in two halves:
the pooled mean is what a robot expects once it has heard its neighbours, and a range bends less
about it than about its own mean alone. As in the plan, entry t of means and covariances is before
measuring at t. With sensors whose rows and noise depend on nothing the covariances are the planned
ones; with others they depend on where the targets truly are.

The truth is drawn from the prior and moves by the hidden state's dynamics. Pooled beliefs share
measurements, and the weights allow for that whatever they share: the normalised squared error is n
coordinates a target on average where nothing is pooled, and at most that where something is. That
is so for linear sensors and for ranges that hardly bend within the spread. With the range sensor
of the paper, whose noise vanishes near a target, and priors of some decimetres it is not: the
median is 2.5, near n, but a few far greater values lift the mean to 27 to 43 (prior 0.2 I, scenes
of ``reproduce tzes-fig4``). There a ``bend_weight`` of 16 brings the mean to 2.0, the
median error to 0.16 m instead of 0.10 m.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.checks import frozen
from fgplan.errors import InvalidInputError
from fgplan.models.pose import between
from fgplan.planners.aia.extended_filter import update_target
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.target_world import target_sensors, target_world
from fgplan.planners.distributed_aia.extraction import team_parts
from fgplan.planners.distributed_aia.stopping_rule import (
    first_steps,
    knows_done,
    satisfied_targets,
)
from fgplan.riccati.distributed import KAPPA
from fgplan.riccati.distributed_mean import team_step_means_blocks
from fgplan.riccati.gaussian import predict_covariance
from fgplan.simulation.simulate import advance, start
from fgplan.simulation.step import SimulationStep
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TeamExecution:
    """What an executed plan did; entry t of the beliefs is before measuring at t.

    Attributes:
        poses: Shape (T + 1, N, 3), world frame.
        truth: True targets, shape (T + 1, M, 2), metres.
        means: Of each target at each robot, shape (T + 1, N, M, 2), metres.
        covariances: Shape (T + 1, N, M, 2, 2), square metres.
        knows: Whether each robot knows that the team is done, by the rule of section VI-B on these
            covariances, shape (T + 1, N).
        measurements: Number taken by each robot at each step, shape (T, N).
    """

    poses: FloatArray
    truth: FloatArray
    means: FloatArray
    covariances: FloatArray
    knows: BoolArray
    measurements: IntArray

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("poses", "truth", "means", "covariances"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in ("knows", "measurements"):
            array = np.array(getattr(self, name))
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def steps(self) -> int:
        """T, the number of steps."""
        return len(self.poses) - 1

    @property
    def errors_m(self) -> FloatArray:
        """Distance of each robot's means to the truth, shape (T + 1, N, M), metres."""
        return np.asarray(np.linalg.norm(self._offsets, axis=-1))

    @property
    def normalised_squared(self) -> FloatArray:
        """(mu - x)' Sigma^-1 (mu - x), shape (T + 1, N, M): 2 on average, or less where pooled."""
        offsets = self._offsets
        weighed = np.linalg.solve(self.covariances, offsets[..., None])[..., 0]
        return np.asarray((offsets * weighed).sum(axis=-1))

    @property
    def disagreement_m(self) -> FloatArray:
        """Largest distance between two robots' means of a target, shape (T + 1, M), metres."""
        apart = self.means[:, :, None] - self.means[:, None]
        return np.asarray(np.linalg.norm(apart, axis=-1).max(axis=(1, 2)))

    @property
    def done_at(self) -> IntArray:
        """First step at which each robot knows that the team is done, shape (N,); -1 for never."""
        return first_steps(self.knows)

    @property
    def _offsets(self) -> FloatArray:
        """Mean minus truth."""
        return self.means - self.truth[:, None]


def execute(
    problem: AcquisitionProblem,
    poses: FloatArray,
    graph: CommunicationGraph,
    generator: np.random.Generator,
    *,
    kappa: float = KAPPA,
    bend_weight: float = 1.0,
    steps: int | None = None,
    stop: bool = False,
) -> TeamExecution:
    """Execute a team's path.

    Args:
        problem: Independent targets in the plane and robots with sensors of points.
        poses: The path, as a plan has it, shape (F + 1, N, 3), world frame.
        graph: Who hears whom.
        generator: Source of every random number: the truth and the noise, so that runs of one seed
            differ in path and graph alone.
        kappa: Weight of the most certain robot, that of the plan.
        bend_weight: How often the noise of what bends counts in an update, see
            ``aia.extended_filter``; linear sensors do not notice.
        steps: How long; beyond the path the robots stay and go on measuring. F if left out.
        stop: Whether a part of the team stays where it is once a robot of it knows that it is
            done; the run ends when all parts do.

    Returns:
        What happened.

    Raises:
        InvalidInputError: If the problem is of another kind, the graph is of another team, the
            path does not begin where the robots are, or the constraint is of the joint covariance.
    """
    _check(problem, poses, graph)
    world = target_world(problem, generator)
    step = start(world, generator)
    filters = _Filters(problem, graph, kappa, bend_weight)
    parts = [list(part) for part in team_parts(graph)]
    resting = np.zeros(len(problem.robots), dtype=np.bool_)
    history = [filters.entry(step)]
    counts: list[list[int]] = []
    for t in range(len(poses) - 1 if steps is None else steps):
        if stop:
            for part in parts:
                resting[part] |= history[-1].knows[part].any()
            if resting.all():
                break
        commands = {
            robot.name: between(poses[t, j], poses[t + 1, j])
            for j, robot in enumerate(problem.robots)
            if t + 1 < len(poses) and not resting[j]
        }
        counts.append([len(step.measurements_of(robot.name)) for robot in problem.robots])
        filters.advance(step)
        _, step = advance(world, step.state, commands)
        history.append(filters.entry(step))
    return TeamExecution(
        poses=np.array([one.poses for one in history]),
        truth=np.array([one.truth for one in history]),
        means=np.array([one.means for one in history]),
        covariances=np.array([one.covariances for one in history]),
        knows=np.array([one.knows for one in history]),
        measurements=np.array(counts, dtype=np.int64).reshape(-1, len(problem.robots)),
    )


@dataclass(frozen=True, slots=True)
class _Entry:
    """One step of the history."""

    poses: FloatArray
    truth: FloatArray
    means: FloatArray
    covariances: FloatArray
    knows: BoolArray


class _Filters:
    """The beliefs of all robots, one filter each."""

    def __init__(
        self,
        problem: AcquisitionProblem,
        graph: CommunicationGraph,
        kappa: float,
        bend_weight: float,
    ) -> None:
        self._problem, self._graph = problem, graph
        self._kappa, self._bend_weight = kappa, bend_weight
        self._names = [robot.name for robot in problem.robots]
        self._sensors = target_sensors(problem)
        team, targets = len(self._names), problem.targets
        self._means = np.tile(problem.mean.reshape(1, targets, 2), (team, 1, 1))
        self._covariances = np.tile(np.array(problem.priors)[None], (team, 1, 1, 1))

    def entry(self, step: SimulationStep) -> _Entry:
        """What is known before measuring at a step."""
        poses = self._poses(step)
        satisfied = satisfied_targets(self._problem, self._covariances)
        return _Entry(
            poses=poses,
            truth=np.asarray(step.hidden_state).reshape(-1, 2),
            means=self._means,
            covariances=self._covariances,
            knows=knows_done(satisfied, self._links(step, poses)),
        )

    def advance(self, step: SimulationStep) -> None:
        """Pool over the links of a step, measure, and predict the next."""
        team, targets = self._means.shape[:2]
        still = np.tile(np.eye(2), (targets, 1, 1))
        means, covariances = team_step_means_blocks(
            self._means,
            self._covariances,
            self._links(step, self._poses(step)),
            np.zeros((team, targets, 1, 2)),
            np.zeros((team, targets, 1)),
            still,
            np.zeros((targets, 2)),
            np.zeros((targets, 2, 2)),
            self._kappa,
            self._names,
        )
        for measurement in step.measurements:
            i = self._names.index(measurement.robot)
            k = self._problem.hidden.targets.index(str(measurement.target))
            means[i, k], covariances[i, k], _ = update_target(
                self._sensors[measurement.sensor],
                step.poses[measurement.robot],
                means[i, k],
                covariances[i, k],
                measurement.value,
                self._bend_weight,
            )
        at = [block.at(step.state.step) for block in self._problem.hidden.blocks]
        transition, drift, process = (np.array(each) for each in zip(*at, strict=True))
        self._means = (transition @ means[..., None])[..., 0] + drift
        self._covariances = predict_covariance(covariances, transition, process)

    def _poses(self, step: SimulationStep) -> FloatArray:
        """Poses of the team at a step, shape (N, 3)."""
        return np.array([step.poses[name] for name in self._names])

    def _links(self, step: SimulationStep, poses: FloatArray) -> BoolArray:
        """Who hears whom at a step."""
        return self._graph.links(step.state.step, poses[:, :2])


def _check(problem: AcquisitionProblem, poses: FloatArray, graph: CommunicationGraph) -> None:
    """Refuse what cannot be executed."""
    if not problem.packed:
        raise InvalidInputError(
            "execution: expected independent targets in the plane and sensors of points"
        )
    names = tuple(robot.name for robot in problem.robots)
    if graph.robots != names:
        raise InvalidInputError(
            f"communication graph: expected the team {', '.join(names)}, got "
            f"{', '.join(graph.robots)}"
        )
    starts = np.array([robot.pose for robot in problem.robots])
    if np.shape(poses)[1:] != starts.shape or not np.allclose(poses[0], starts):
        raise InvalidInputError(
            f"execution: expected a path of shape (F + 1, {len(names)}, 3) from the robots' poses "
            f"{starts.tolist()}, got one of shape {np.shape(poses)}"
        )
