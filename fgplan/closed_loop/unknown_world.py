"""The unknown world of section 7.2 of Regev and Indelman 2017, as far as the paper prints it.

Printed: 2000 x 2500 m, 200 landmarks that nobody knows beforehand, four robots (red, green, blue,
purple) with three goals each, priors of 1e-6 m, bearing and range observations, association known,
goals such that unmapped and mapped ground is crossed, and the three scenarios of Table 1:

    scenario   large prior   factors between robots in planning
    1          none          yes
    2          none          no
    3          red, green    yes

Not printed, and ours: everything with a number below. Robots start side by side, lanes 600 m apart.
On the first and second legs nobody has mapped what lies ahead; the third lead back, some into a
neighbour's lane. From lanes two robots hardly see a common landmark, so whether they share any is a
matter of planning. The legs of a number are of one length, because an announced path ends at the
next goal: robots can only plan to meet while they are under way at the same time. (Tried with 15
candidates and 10 seeds: where two robots have their first goals much nearer than the others, or
lanes are 700 m apart, Scenario 1 has no less covariance than Scenario 2.)

A step of 100 m has odometry good to 2 m, 2 m, 0.02 rad; a sighting is good to 0.5 degrees and 2 m
within 300 m and 240 degrees. A planned step carries half of odometry's noise, because on the way
there will be landmarks that nobody has mapped yet; likewise the factor between two robots stands
for what they will see of common landmarks that nobody has mapped yet.
"""

from typing import Literal

import numpy as np

from fgplan.closed_loop.mission import LoopMission, LoopRobot
from fgplan.factors.keys import symbol_key
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.simulation.world import World, WorldRobot
from roadmaps import Workspace

Scenario = Literal[1, 2, 3]

WIDTH_M, HEIGHT_M = 2000.0, 2500.0
LANDMARKS = 200
SENSOR = "camera"
SENSOR_RANGE_M = 300.0
CRITERION_M = 300.0
FIELD_OF_VIEW_RAD = float(np.radians(240.0))
BEARING_SIGMA_RAD, RANGE_SIGMA_M = float(np.radians(0.5)), 2.0
STEP_M = 100.0
ODOMETRY_SIGMAS = (2.0, 2.0, 0.02)
PLANNED_SIGMAS = (1.0, 1.0, 0.005)
MEETING_SIGMAS = (5.0, 5.0, 0.05)
START_SIGMAS = (1e-6, 1e-6, 1e-6)
LARGE_SIGMAS = (20.0, 20.0, 0.05)
LARGE = ("red", "green")
STARTS = {
    "red": (100.0, 150.0),
    "green": (700.0, 150.0),
    "blue": (1300.0, 150.0),
    "purple": (1900.0, 150.0),
}
GOALS = {
    "red": ((100.0, 1150.0), (150.0, 2250.0), (600.0, 600.0)),
    "green": ((700.0, 1100.0), (700.0, 2300.0), (150.0, 650.0)),
    "blue": ((1300.0, 1050.0), (1300.0, 2200.0), (1850.0, 600.0)),
    "purple": ((1900.0, 1150.0), (1850.0, 2250.0), (1400.0, 650.0)),
}
"""Metres, world frame."""


def draw_mission(
    seed: int,
    scenario: Scenario = 1,
    *,
    others_landmarks: bool = True,
    candidates: int = 50,
    goals: int = 3,
    landmarks: int = LANDMARKS,
) -> LoopMission:
    """Draw the world of one seed.

    Args:
        seed: Of landmarks, roadmap, noise; the same world for all scenarios.
        scenario: Of Table 1.
        others_landmarks: Whether planning uses landmarks that only other robots have mapped.
        candidates: Candidate paths a robot.
        goals: Goals a robot, 1 to 3.
        landmarks: Number of landmarks.

    Returns:
        The mission.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(72,)))
    workspace = Workspace(lower=np.zeros(2), upper=np.array([WIDTH_M, HEIGHT_M]))
    camera = BearingRangeSensor(
        bearing_sigma_rad=BEARING_SIGMA_RAD,
        range_sigma_m=RANGE_SIGMA_M,
        max_range_m=SENSOR_RANGE_M,
        field_of_view_rad=FIELD_OF_VIEW_RAD,
    )
    odometry = _motion(ODOMETRY_SIGMAS)
    planned = _motion(PLANNED_SIGMAS)
    meeting = MultiRobotModel(
        criterion=DistanceCriterion(CRITERION_M),
        sensor=RelativePoseSensor(covariance=np.diag(np.square(MEETING_SIGMAS))),
    )
    world = World(
        robots=tuple(
            WorldRobot(
                name=name,
                pose=np.array([*place, np.pi / 2]),
                odometry=odometry,
                actuation=odometry,
                landmark_sensors=(SENSOR,),
            )
            for name, place in STARTS.items()
        ),
        workspace=workspace,
        sensors={SENSOR: camera},
        landmark_keys=tuple(symbol_key("l", index) for index in range(landmarks)),
        landmark_positions=rng.uniform([0.0, 0.0], [WIDTH_M, HEIGHT_M], (landmarks, 2)),
        step_s=10.0,
    )
    return LoopMission(
        name=f"scenario {scenario}, seed {seed}",
        world=world,
        workspace=workspace,
        robots=tuple(
            LoopRobot(
                name=name,
                goals=np.array(GOALS[name][:goals]),
                motion=planned,
                start_covariance=np.diag(
                    np.square(LARGE_SIGMAS if scenario == 3 and name in LARGE else START_SIGMAS)
                ),
                sensors=(SENSOR,),
            )
            for name in STARTS
        ),
        multi_robot=() if scenario == 2 else (meeting,),
        candidates=CandidateOptions(
            candidates=candidates, spacing_m=STEP_M, vertices=400, neighbours=8, paths="penalty"
        ),
        others_landmarks=others_landmarks,
        seed=seed,
    )


def _motion(sigmas: tuple[float, float, float]) -> MotionModel:
    """Noise of a step of ``STEP_M`` metres: its variance grows with the way."""
    spread = np.array(sigmas)
    return MotionModel(sigmas=0.05 * spread, per_metre=spread / np.sqrt(STEP_M), speed_m_per_s=10.0)
