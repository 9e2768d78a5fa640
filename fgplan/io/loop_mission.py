"""A scenario with ``[simulation]`` to a closed loop: the scenario is what the team knows.

Truth: robots stand at their starts, mapped landmarks where the file says; the priors' means are
drawn about them. Unmapped landmarks and unknown obstacles are those of ``[simulation]``. Candidate
paths are made by the options of the planner; ``spacing_m`` of these is the longest step.
"""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.closed_loop.mission import LoopMission, LoopRobot
from fgplan.errors import OptionError
from fgplan.factors.keys import symbol_key
from fgplan.io.mission_file import make_mission
from fgplan.io.place import Place
from fgplan.io.scenario import IndependentPrior, RobotTable, Scenario
from fgplan.io.scenario_file import read_scenario
from fgplan.io.sensor_table import make_covariance
from fgplan.io.simulation_table import NoiseTable, SimulationTable, UnmappedTable
from fgplan.models.motion import MotionModel
from fgplan.planners.impacted_paths.options import CandidateOptions, read_options
from fgplan.planners.mission import Mission, MissionRobot
from fgplan.simulation.world import World, WorldRobot
from fgplan.typing import Covariance, FloatArray
from roadmaps import Workspace, sample_positions

PLANNER = "impacted_paths"
"""The planner that a closed loop plans by."""

_UNMAPPED = 100
"""What random numbers are for: apart from those of the loop."""


def load_loop_mission(path: str | Path, seed: int | None = None) -> LoopMission:
    """Read a scenario file with ``[simulation]`` and make the closed loop that it describes.

    Args:
        path: A ``.toml``, ``.yaml`` or ``.yml`` file.
        seed: Seed of everything that is drawn; None takes the file's.

    Returns:
        The closed loop, for ``run_loop`` or ``run_in_folder``.

    Raises:
        ScenarioError: If anything in the file is wrong, or it has no ``[simulation]``.
        MissingExtraError: If the file needs a package that is not installed.

    Example:
        >>> mission = load_loop_mission("examples/scenarios/closed_loop.toml")
        >>> len(mission.world.landmark_keys), len(mission.unknown_obstacles)
        (40, 1)
    """
    scenario, place = read_scenario(path), Place(Path(path))
    simulation = scenario.simulation
    if simulation is None:
        raise place.at("simulation").error("expected a table that says what is executed, got none")
    if seed is None:
        seed = scenario.seed if simulation.seed is None else simulation.seed
    mission = make_mission(scenario, place.file)
    return make_loop_mission(scenario, simulation, mission, seed, place)


def make_loop_mission(
    scenario: Scenario, simulation: SimulationTable, mission: Mission, seed: int, place: Place
) -> LoopMission:
    """Make the closed loop that a scenario describes.

    Args:
        scenario: The scenario.
        simulation: Its ``[simulation]``.
        mission: What ``make_mission`` makes of it.
        seed: Seed of everything that is drawn.
        place: The whole file, for messages.

    Returns:
        The closed loop.

    Raises:
        ScenarioError: If the scenario asks for something that a closed loop does not do.
    """
    where = place.at("simulation")
    _check_scenario(scenario, simulation, place)
    options, spacing_m = _candidate_options(mission, place)
    slowest = min(robot.motion.speed_m_per_s for robot in mission.robots)
    spatial = mission.robots[0].motion.sigmas.size == 6
    with where.at("obstacles").checking():
        truth = Workspace(
            lower=mission.workspace.lower,
            upper=mission.workspace.upper,
            obstacles=(*mission.workspace.obstacles, *map(np.array, simulation.obstacles)),
            grid=mission.workspace.grid,
            robot_radius_m=mission.workspace.robot_radius_m,
            unknown_is_free=mission.workspace.unknown_is_free,
        )
    generator = np.random.default_rng(
        np.random.SeedSequence(
            seed if simulation.landmarks.seed is None else simulation.landmarks.seed,
            spawn_key=(_UNMAPPED,),
        )
    )
    size = 3 if spatial else 2
    with where.at("landmarks").checking():
        unmapped = _unmapped(simulation.landmarks, truth, size, generator, where.at("landmarks"))
    mapped = np.array([table.position for table in scenario.landmarks]).reshape(-1, size)
    known = tuple(symbol_key("l", index) for index in range(len(mapped)))
    others = tuple(symbol_key("l", len(mapped) + index) for index in range(len(unmapped)))
    robots = list(zip(mission.robots, scenario.robots, strict=True))
    with where.checking():
        world = World(
            robots=tuple(
                WorldRobot(
                    name=robot.name,
                    pose=mission.prior.pose(robot.start_key),
                    actuation=_noise(simulation.actuation, robot, where.at("actuation")),
                    odometry=_noise(simulation.odometry, robot, where.at("odometry")),
                    landmark_sensors=robot.sensors,
                )
                for robot, _ in robots
            ),
            workspace=truth,
            sensors=mission.sensors,
            landmark_keys=(*known, *others),
            landmark_positions=np.concatenate([mapped, unmapped]),
            known_landmarks=frozenset(known),
            multi_robot={
                f"team.multi_robot[{index}]": model
                for index, model in enumerate(mission.multi_robot)
                if simulation.measure_robots
            },
            step_s=simulation.step_s or spacing_m / slowest,
        )
        loop = LoopMission(
            name=mission.name,
            world=world,
            workspace=mission.workspace,
            robots=tuple(
                LoopRobot(
                    name=robot.name,
                    goals=robot.goals,
                    motion=robot.motion,
                    start_covariance=_start_covariance(table, place.at(f"robots[{index}]")),
                    sensors=robot.sensors,
                )
                for index, (robot, table) in enumerate(robots)
            ),
            multi_robot=mission.multi_robot,
            candidates=options,
            others_landmarks=simulation.others_landmarks,
            landmark_covariances={
                key: table.sigma_m**2 * np.eye(size)
                for key, table in zip(known, scenario.landmarks, strict=True)
            },
            relinearise_m=simulation.relinearise_m,
            obstacle_range_m=simulation.obstacle_range_m,
            max_steps=10_000 if simulation.steps is None else simulation.steps,
            seed=seed,
        )
    table = scenario.objective
    given: dict[str, Any] = {
        "path_weight": table.path_weight,
        "uncertainty_weight": table.uncertainty_weight,
    }
    return replace(loop, **{name: each for name, each in given.items() if each is not None})


def _check_scenario(scenario: Scenario, simulation: SimulationTable, place: Place) -> None:
    """Refuse what a closed loop would leave out."""
    if not isinstance(scenario.prior, IndependentPrior):
        raise place.at("prior.kind").error(
            "expected independent with [simulation]: a closed loop makes the team's past itself; "
            "leave [simulation] out to plan from this one"
        )
    if scenario.targets:
        raise place.at("targets").error(
            "expected none with [simulation]: a closed loop maps landmarks"
        )
    if scenario.objective.terms:
        raise place.at("objective.terms").error(
            "expected the preset length_and_uncertainty with [simulation], got terms"
        )
    if simulation.options:
        raise place.at("simulation.options").error(
            f"expected none for the planner {PLANNER}, got {', '.join(simulation.options)}"
        )


def _candidate_options(mission: Mission, place: Place) -> tuple[CandidateOptions, float]:
    """Options of the planner, which are those of candidate paths; and the longest step."""
    where = place.at(f"planner.{PLANNER}")
    known = [option.name for option in fields(CandidateOptions)]
    for name in mission.options:
        # a robot whose goal cannot be reached stays in any case
        if name not in (*known, "without_path"):
            raise where.at(name).error(
                f"expected one of {', '.join(known)} with [simulation]: a closed loop plans by the "
                f"defaults of the others, got {name}"
            )
    given = {name: value for name, value in mission.options.items() if name in known}
    try:
        options = read_options(CandidateOptions, given, PLANNER)
    except OptionError as error:
        raise where.error(str(error)) from error
    if options.spacing_m is None:
        raise where.at("spacing_m").error(
            "expected the longest step of a closed loop in metres, got nothing"
        )
    return options, options.spacing_m


def _unmapped(
    table: UnmappedTable,
    workspace: Workspace,
    size: int,
    generator: np.random.Generator,
    place: Place,
) -> FloatArray:
    """Positions of the landmarks that nobody knows beforehand, shape (n, size)."""
    if table.positions and table.count is not None:
        raise place.error("expected positions or count, one of the two, got both")
    if (table.count is not None and size == 3) != (table.heights_m is not None):
        raise place.at("heights_m").error(
            "expected least and greatest height with count for robots in space, and only there"
        )
    for index, point in enumerate(table.positions):
        if len(point) != size:
            raise place.at(f"positions[{index}]").error(
                f"expected {size} coordinates in metres, got {len(point)}"
            )
    if table.count is None:
        return np.array(table.positions).reshape(-1, size)
    flat = sample_positions(workspace, table.count, generator)
    if table.heights_m is None:
        return flat
    lowest, highest = table.heights_m
    if highest < lowest:
        raise place.at("heights_m").error(f"expected the least first, got {list(table.heights_m)}")
    return np.column_stack([flat, generator.uniform(lowest, highest, table.count)])


def _noise(table: NoiseTable | None, robot: MissionRobot, place: Place) -> MotionModel:
    """True noise of a robot's motion: as given, or as planned."""
    if table is None:
        return robot.motion
    with place.checking():
        return MotionModel(
            sigmas=np.array(table.sigmas),
            per_metre=np.array(table.per_metre),
            per_radian=np.array(table.per_radian),
        )


def _start_covariance(table: RobotTable, place: Place) -> Covariance:
    """Prior of a robot's first pose."""
    size = 3 if table.start is not None and len(table.start) == 3 else 6
    return make_covariance(
        (table.start_sigmas, table.start_covariance),
        ("start_sigmas", "start_covariance"),
        (size,),
        place,
    )
