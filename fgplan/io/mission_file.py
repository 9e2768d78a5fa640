"""A scenario file to a ``Mission``: the one call behind ``fgplan run``.

The digest is the sha256 of the scenario in canonical form (so comments, order of tables and TOML
or YAML do not matter), of the map's cells, and of the prior's rows and values.
"""

import hashlib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fgplan.errors import ScenarioError
from fgplan.io.network_table import make_network
from fgplan.io.objective_table import make_objective
from fgplan.io.place import Place
from fgplan.io.prior_table import Prior, make_prior
from fgplan.io.scenario import RobotTable, Scenario, TargetTable
from fgplan.io.scenario_file import read_scenario
from fgplan.io.sensor_table import make_covariance, make_multi_robot, make_sensors
from fgplan.io.workspace_table import make_workspace
from fgplan.models.motion import MotionModel
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.multi_robot import MultiRobotModel
from fgplan.planners.mission import Mission, MissionRobot, MissionSimulation, MissionTarget
from fgplan.team.in_process import read_faults
from fgplan.typing import Key
from roadmaps import Workspace


def load_mission(path: str | Path) -> Mission:
    """Read a scenario file and make everything that it describes.

    Args:
        path: A ``.toml``, ``.yaml`` or ``.yml`` file.

    Returns:
        The mission, for a planner.

    Raises:
        ScenarioError: If anything in the file, or in a file it names, is wrong; names file, field,
            what was expected and what came.
        MissingExtraError: If the file needs a package that is not installed.

    Example:
        >>> mission = load_mission("examples/scenarios/two_robots.toml")
        >>> [robot.name for robot in mission.robots]
        ['ann', 'bob']
    """
    return make_mission(read_scenario(path), Path(path))


def make_mission(scenario: Scenario, path: Path, prior: Prior | None = None) -> Mission:
    """Make everything that a scenario describes.

    Args:
        scenario: The checked scenario.
        path: The file it was read from; what it names is relative to its folder.
        prior: What ``make_prior`` makes of it, where that is done already.

    Returns:
        The mission.

    Raises:
        ScenarioError: If anything in it is wrong.
        MissingExtraError: If it needs a package that is not installed.
    """
    place = Place(path)
    workspace = make_workspace(scenario.world, place.at("world"))
    sensors = make_sensors(scenario, place)
    multi_robot = make_multi_robot(scenario, place)
    prior = make_prior(scenario, place) if prior is None else prior
    robots = tuple(
        _make_robot(
            robot,
            prior.start_keys[robot.name],
            prior.belief.dim(prior.start_keys[robot.name]),
            place.at(f"robots[{index}]", f"robot {robot.name!r}"),
        )
        for index, robot in enumerate(scenario.robots)
    )
    for index, robot in enumerate(robots):
        where = place.at(f"robots[{index}]", f"robot {robot.name!r}")
        _check_goals(robot, workspace, where, listed=scenario.robots[index].goal is None)
    objective = make_objective(scenario, prior, place)
    _check_between(multi_robot, prior, place)
    _check_communication(scenario, place)
    make_network(scenario, path)
    targets = tuple(
        _make_target(target, place.at(f"targets[{index}]", f"target {target.name!r}"))
        for index, target in enumerate(scenario.targets)
    )
    for index, target in enumerate(targets):
        _check_target(
            target, workspace, place.at(f"targets[{index}].mean", f"target {target.name!r}")
        )
    with place.checking():
        return Mission(
            name=scenario.name or path.stem,
            workspace=workspace,
            robots=robots,
            prior=prior.belief,
            objective=objective,
            sensors=sensors,
            multi_robot=multi_robot,
            past_states=prior.past_states,
            targets=targets,
            simulation=_make_simulation(scenario),
            options=_planner_options(scenario, place),
            digest=scenario_digest(scenario, workspace, prior),
            seed=scenario.seed,
        )


def scenario_digest(scenario: Scenario, workspace: Workspace, prior: Prior) -> str:
    """Sha256, in hexadecimal, of what decides a run: scenario, map and prior.

    Args:
        scenario: The scenario.
        workspace: Its workspace, for the cells of its map.
        prior: Its prior, for the content of its graph.

    Returns:
        64 hexadecimal digits.
    """
    plain = msgspec.to_builtins(scenario)
    del plain["team"]["network"]  # how robots reach each other decides nothing
    canonical = msgspec.json.encode(plain, order="sorted")
    content = hashlib.sha256(b"fgplan scenario 1" + canonical)
    if workspace.grid is not None:
        content.update(workspace.grid.occupancy.tobytes())
        content.update(np.array([workspace.grid.resolution_m, *workspace.grid.origin]).tobytes())
    content.update(prior.belief.digest().encode())
    return content.hexdigest()


def _planner_options(scenario: Scenario, place: Place) -> dict[str, Any]:
    """Options of the planner that is named, with what ``[team]`` says of agreeing."""
    options = scenario.planner_options
    for name in (
        "order",
        "tolerance",
        "without_path",
        "lost_after_s",
        "hung_after_s",
        "drop_after_s",
        "communication",
    ):
        value = getattr(scenario.team, name)
        if value is None:
            continue
        if name in options:
            raise place.at(f"team.{name}").error(
                f"expected {name} once, got it under [planner.{scenario.planner_name}] too"
            )
        options[name] = msgspec.to_builtins(value)
    return options


def _make_robot(table: RobotTable, key: Key, dim: int, place: Place) -> MissionRobot:
    """One robot with its goals and motion model."""
    if (table.goal is None) == (not table.goals):
        came = "neither" if table.goal is None else "both"
        raise place.at("goal").error(f"expected goal or goals, one of the two, got {came}")
    goals = table.goals if table.goal is None else (table.goal,)
    size = 2 if dim == 3 else 3
    for index, goal in enumerate(goals):
        if len(goal) != size:
            where = place.at("goal" if table.goal is not None else f"goals[{index}]")
            raise where.error(f"expected {size} coordinates in metres, got {len(goal)}")
    motion = table.motion
    if len(motion.sigmas) != dim:
        raise place.at("motion.sigmas").error(
            f"expected {dim} numbers for this robot's pose, got {len(motion.sigmas)}"
        )
    with place.at("motion").checking():
        model = MotionModel(
            sigmas=np.array(motion.sigmas),
            per_metre=np.array(motion.per_metre),
            per_radian=np.array(motion.per_radian),
            speed_m_per_s=motion.speed_m_per_s,
        )
    with place.checking():
        return MissionRobot(
            name=table.name,
            start_key=key,
            goals=np.array(goals),
            motion=model,
            sensors=table.sensors,
        )


def _check_goals(robot: MissionRobot, workspace: Workspace, place: Place, *, listed: bool) -> None:
    """Refuse a goal where the robot cannot be; spatial goals are checked by their footprint."""
    valid = workspace.are_positions_valid(robot.goals[:, :2])
    for index, goal in enumerate(robot.goals):
        if valid[index]:
            continue
        where = place.at(f"goals[{index}]" if listed else "goal")
        inside = (goal[:2] >= workspace.lower).all() and (goal[:2] <= workspace.upper).all()
        if not inside:
            raise where.error(
                f"expected a goal within the bounds {workspace.lower.tolist()} to "
                f"{workspace.upper.tolist()}, got {goal.tolist()}; move the goal or the bounds"
            )
        raise where.error(
            f"expected a goal in free space, got {goal.tolist()}, which is inside an obstacle or "
            f"unknown cell or nearer to one than the robot's radius "
            f"({workspace.robot_radius_m:g} m); move the goal"
        )


def _check_target(target: MissionTarget, workspace: Workspace, place: Place) -> None:
    """Refuse a target outside the bounds, where no robot can go to look for it."""
    position = target.mean[:2]
    if position.size == 2 and not (
        (position >= workspace.lower).all() and (position <= workspace.upper).all()
    ):
        raise place.error(
            f"expected a mean within the bounds {workspace.lower.tolist()} to "
            f"{workspace.upper.tolist()}, got {target.mean.tolist()}; move the target or the bounds"
        )


def _check_between(models: tuple[MultiRobotModel, ...], prior: Prior, place: Place) -> None:
    """Refuse a relative-pose sensor whose noise does not fit the robots' poses."""
    dim = prior.belief.dim(next(iter(prior.start_keys.values())))
    for index, model in enumerate(models):
        sensor = model.sensor
        if isinstance(sensor, RelativePoseSensor) and len(sensor.covariance) != dim:
            raise place.at(f"team.multi_robot[{index}].sensor").error(
                f"expected noise of {dim} numbers for these robots' poses, got "
                f"{len(sensor.covariance)}"
            )


def _check_communication(scenario: Scenario, place: Place) -> None:
    """Refuse network faults that no transport can have, and partitions of strangers."""
    table = scenario.team.communication
    if table is None:
        return
    where = place.at("team.communication")
    with where.checking():
        read_faults(msgspec.to_builtins(table))
    names = [robot.name for robot in scenario.robots]
    for index, partition in enumerate(table.partitions):
        for name in (name for group in partition.groups for name in group):
            if name not in names:
                raise where.at(f"partitions[{index}].groups").error(
                    f"expected names of robots ({', '.join(names)}), got {name!r}"
                )


def _make_simulation(scenario: Scenario) -> MissionSimulation | None:
    """What the scenario asks of a closed loop, or None where it says nothing."""
    table = scenario.simulation
    if table is None:
        return None
    return MissionSimulation(
        steps=table.steps, seed=table.seed, runs=table.runs, options=dict(table.options)
    )


def _make_target(table: TargetTable, place: Place) -> MissionTarget:
    """One hidden target; what is left out is static."""
    size = len(table.mean)
    covariance = make_covariance(
        (table.sigmas, table.covariance), ("sigmas", "covariance"), (size,), place
    )
    with place.checking():
        try:
            return MissionTarget(
                name=table.name,
                mean=np.array(table.mean),
                covariance=covariance,
                transition=np.eye(size) if table.transition is None else _rows(table.transition),
                drift=np.zeros(size) if table.drift is None else np.array(table.drift),
                process=np.zeros((size, size)) if table.process is None else _rows(table.process),
            )
        except ValueError as error:
            if isinstance(error, ScenarioError):
                raise
            raise place.error(str(error)) from error


def _rows(matrix: tuple[tuple[float, ...], ...]) -> np.ndarray:
    """Rows of a matrix as an array; unequal rows raise ValueError."""
    return np.array(matrix, dtype=np.float64)
