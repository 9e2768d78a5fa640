"""A problem as the flat arrays that the compiled kernels work on.

Nothing here computes a plan; imported on first use only, as numba is slow to import.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from fgplan.errors import InvalidInputError
from fgplan.models.hidden_state import HiddenState
from fgplan.models.uncertainty import uncertainty_function
from fgplan.planners.aia.assignment_kernels import Fields
from fgplan.planners.aia.covariance_kernels import Dynamics
from fgplan.planners.aia.criteria_arrays import BUILT_IN, criteria_arrays
from fgplan.planners.aia.geodesic_fields import GeodesicFields
from fgplan.planners.aia.information_kernels import Sight
from fgplan.planners.aia.obstacle_arrays import obstacle_arrays
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.pose_kernels import Motions
from fgplan.planners.aia.problem import AcquisitionProblem, SensingRobot
from fgplan.planners.aia.sensor_arrays import sensing_range, sensor_arrays
from fgplan.planners.aia.tree_kernels import Setting, Settings
from fgplan.typing import FloatArray, IntArray

FOREVER = 2**62
_HORIZON = 64
_MOST_KINDS = 255


class Prepared(NamedTuple):
    """A problem made ready for the kernels.

    Attributes:
        setting: What the kernels read.
        fields: Geodesic distances, which may be asked for more.
        root: Covariance row at time 0, shape (width,).
        compiled_sensors: Whether the kernels know every sensor.
        compiled_terminal: Whether they know the terminal constraint.
        compiled_objective: Whether they know the objective.
        constant: Whether nothing about the hidden state varies with time.
    """

    setting: Setting
    fields: GeodesicFields
    root: FloatArray
    compiled_sensors: bool
    compiled_terminal: bool
    compiled_objective: bool
    constant: bool


def prepare(
    problem: AcquisitionProblem,
    options: TreeOptions,
    fields: GeodesicFields | None = None,
    *,
    apart: bool = False,
) -> Prepared:
    """Make a problem ready for the kernels.

    Args:
        problem: What is planned for.
        options: How.
        fields: Geodesic distances of the same workspace and start, to be used again.
        apart: Whether every robot is a kind of its own, so that what one robot's tree reaches does
            not depend on the others': what trees of single robots need.

    Returns:
        Arrays.

    Raises:
        InvalidInputError: If there are more kinds than a table of poses can name.
    """
    kinds, kind = _kinds(problem, apart=apart)
    if len(kinds) > _MOST_KINDS:
        raise InvalidInputError(
            f"robots: expected at most {_MOST_KINDS} kinds of robots, got {len(kinds)}"
        )
    if fields is None:
        longest = max(np.abs(robot.primitives.relative[:, :2]).max() for robot in problem.robots)
        cell = options.geodesic_cell_m or float(longest)
        if not cell > 0.0:
            raise InvalidInputError(
                "geodesic_cell_m: expected a number above zero where no control moves a robot"
            )
        fields = GeodesicFields(problem.workspace, problem.robots[0].pose[:2], cell)
    criteria, compiled_terminal = criteria_arrays(problem)
    sensors, compiled_sensors = sensor_arrays(kinds)
    near = [
        options.near_m if options.near_m is not None else sensing_range(robot.sensors)
        for robot in problem.robots
    ]
    goal = np.array(
        [
            (*robot.goal.position, robot.goal.radius_m) if robot.goal else (0.0, 0.0, np.inf)
            for robot in problem.robots
        ]
    )
    goals = np.full(len(problem.robots), -1, dtype=np.int64)
    for j, robot in enumerate(problem.robots):
        if robot.goal is not None:
            goals[j] = fields.rows_of(robot.goal.position[None])[0]
    places, of_target = _predicted(problem, fields, _HORIZON)
    setting = Setting(
        obstacles=obstacle_arrays(problem.workspace),
        motions=_motions(kinds, _clearances(problem, fields)),
        sight=Sight(sensors=sensors, places=places, fixed=problem.fixed),
        dynamics=dynamics_arrays(problem.hidden)
        if problem.packed
        else Dynamics(
            still=False,
            identity=False,
            transition=np.zeros((1, 0, 4)),
            process=np.zeros((1, 0, 3)),
        ),
        criteria=criteria,
        fields=Fields(
            frame=fields.frame,
            distance_m=np.asarray(fields.distance_m),
            of_target=of_target,
            of_goal=goals,
        ),
        kind=kind,
        near_m=np.array(near, dtype=np.float64),
        goal=goal,
    )
    return Prepared(
        setting=setting,
        fields=fields,
        root=covariance_row(problem),
        compiled_sensors=compiled_sensors,
        compiled_terminal=compiled_terminal,
        compiled_objective=problem.objective in BUILT_IN,
        constant=problem.fixed
        and (problem.still or not uncertainty_function(problem.terminal.function).needs_prior)
        and all(b.transition.ndim == 2 and b.process.ndim == 2 for b in problem.hidden.blocks),
    )


def further(prepared: Prepared, problem: AcquisitionProblem) -> Prepared:
    """The same with targets predicted for twice as long.

    Args:
        prepared: Arrays so far.
        problem: Their problem.

    Returns:
        Arrays.
    """
    steps = 2 * len(prepared.setting.sight.places)
    places, of_target = _predicted(problem, prepared.fields, steps)
    setting = prepared.setting
    return prepared._replace(
        setting=setting._replace(
            sight=setting.sight._replace(places=places),
            fields=setting.fields._replace(
                distance_m=prepared.fields.distance_m, of_target=of_target
            ),
        )
    )


def settings_of(options: TreeOptions, prepared: Prepared) -> Settings:
    """Options as the kernels read them.

    Args:
        options: The options.
        prepared: The problem's arrays.

    Returns:
        Settings; dominance among all times falls back to equal times where something varies.
    """
    dominance = {"off": 0, "same_time": 1, "any_time": 2}[options.dominance]
    if dominance == 2 and not prepared.constant:
        dominance = 1
    after = options.uniform_after
    return Settings(
        at_child=options.measure_at == "child",
        bound=options.bound,
        dominance=dominance,
        assign=options.assignment == "algorithm_2",
        one_node=options.expand == "node",
        reject_jointly=options.reject_jointly,
        circle=options.near_controls == "circle",
        stop_at_goal=options.until == "first_feasible",
        uniform_after_goal=after == "feasible",
        uniform_from=after if isinstance(after, int) else FOREVER,
        p_group=options.p_group,
        p_control=options.p_control,
        node_limit=options.node_budget,
    )


def covariance_row(problem: AcquisitionProblem) -> FloatArray:
    """The covariance at time 0 as the kernels hold it.

    Args:
        problem: The problem.

    Returns:
        Shape (3 M,) packed, or (n^2,).
    """
    if problem.packed:
        return np.concatenate([[p[0, 0], p[0, 1], p[1, 1]] for p in problem.priors])
    return np.ascontiguousarray(block_diag(*problem.priors)).ravel()


def unpacked(row: FloatArray, *, packed: bool) -> FloatArray:
    """Covariances of rows as matrices.

    Args:
        row: Shape (..., width).
        packed: Whether targets are independent and planar.

    Returns:
        Shape (..., M, 2, 2) packed, or (..., n, n).
    """
    lead = row.shape[:-1]
    if not packed:
        size = round(np.sqrt(row.shape[-1]))
        return row.reshape(*lead, size, size)
    return row.reshape(*lead, -1, 3)[..., [0, 1, 1, 2]].reshape(*lead, -1, 2, 2)


def dynamics_arrays(hidden: HiddenState) -> Dynamics:
    """Dynamics as the kernels read them.

    Args:
        hidden: The hidden state.

    Returns:
        Arrays with a leading axis over time, of length one where constant.
    """
    lengths = [
        max((len(getattr(b, name)) for b in hidden.blocks if getattr(b, name).ndim == 3), default=1)
        for name in ("transition", "process")
    ]
    A = np.array([[b.at(t)[0].ravel() for b in hidden.blocks] for t in range(lengths[0])])  # noqa: N806
    full = np.array([[b.at(t)[2] for b in hidden.blocks] for t in range(lengths[1])])
    Q = np.stack([full[..., 0, 0], full[..., 0, 1], full[..., 1, 1]], axis=-1)  # noqa: N806
    identity = bool((A == [1.0, 0.0, 0.0, 1.0]).all())
    return Dynamics(
        still=identity and not Q.any(),
        identity=identity,
        transition=np.ascontiguousarray(A),
        process=np.ascontiguousarray(Q),
    )


def _clearances(problem: AcquisitionProblem, fields: GeodesicFields) -> FloatArray:
    """Clearance of each cell, where it pays: where poses recur, each is tested once anyway."""
    if all(robot.primitives.frame == "world" for robot in problem.robots):
        return np.full(len(fields.cell_centers), -1.0)
    return fields.clearances(problem.workspace)


def _predicted(
    problem: AcquisitionProblem, fields: GeodesicFields, steps: int
) -> tuple[FloatArray, IntArray]:
    """Predicted places, shape (T, M, 2), and the field of each, shape (T, M)."""
    places = np.array(problem.places_until(steps))
    rows = fields.rows_of(places.reshape(-1, 2)).reshape(places.shape[:2])
    return places, np.ascontiguousarray(rows)


def _kinds(problem: AcquisitionProblem, *, apart: bool) -> tuple[list[SensingRobot], IntArray]:
    """One robot of each kind (same primitives, same sensors), and each robot's kind."""
    if apart:
        return list(problem.robots), np.arange(len(problem.robots))
    found: list[int] = []
    kind = np.zeros(len(problem.robots), dtype=np.int64)
    for j, robot in enumerate(problem.robots):
        for place, index in enumerate(found):
            other = problem.robots[index]
            same = other.primitives is robot.primitives or (
                other.primitives.frame == robot.primitives.frame
                and np.array_equal(other.primitives.relative, robot.primitives.relative)
                and np.array_equal(other.primitives.waypoints, robot.primitives.waypoints)
            )
            if same and other.sensors == robot.sensors:
                kind[j] = place
                break
        else:
            kind[j] = len(found)
            found.append(j)
    return [problem.robots[index] for index in found], kind


def _motions(kinds: list[SensingRobot], clearance_m: FloatArray) -> Motions:
    """Primitives by kind, padded by repetition."""
    controls = max(len(robot.primitives) for robot in kinds)
    points = max(robot.primitives.waypoints.shape[1] for robot in kinds)
    relative = np.empty((len(kinds), controls, 3))
    waypoints = np.empty((len(kinds), controls, points, 2))
    for k, robot in enumerate(kinds):
        given = robot.primitives
        order = np.arange(controls)
        order[len(given) :] = 0
        relative[k] = given.relative[order]
        along = np.minimum(np.arange(points), given.waypoints.shape[1] - 1)
        waypoints[k] = given.waypoints[order][:, along]
    return Motions(
        relative=relative,
        waypoints=waypoints,
        controls=np.array([len(robot.primitives) for robot in kinds], dtype=np.int64),
        body=np.array([robot.primitives.frame == "body" for robot in kinds]),
        reach_m=np.array([robot.primitives.reach_m() for robot in kinds]),
        clearance_m=clearance_m,
    )
