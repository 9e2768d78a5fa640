"""Small worlds for tests of SLAM: a team that drives about among landmarks that nobody knows."""

from dataclasses import replace

import gtsam
import numpy as np

from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.simulation.command import Commands, heading_changes
from fgplan.simulation.noise import disturb_pose, exponential
from fgplan.simulation.simulate import simulate
from fgplan.simulation.world import World, WorldRobot
from fgplan.slam.team_slam import SlamOptions, SlamStart, TeamSlam

PLANAR_NOISE = MotionModel(sigmas=[0.02, 0.02, 0.003], per_metre=[0.03, 0.03, 0.002])
SPATIAL_NOISE = MotionModel(sigmas=[0.002, 0.002, 0.003, 0.02, 0.02, 0.02])
BEARING_RANGE = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.1, max_range_m=30.0)


def landmark(index):
    return gtsam.symbol("l", index)


def planar_world(sensor=BEARING_RANGE, *, seed=0, robots=2, landmarks=25, **fields):
    generator = np.random.default_rng(seed)
    team = tuple(
        WorldRobot(
            name=f"r{i}",
            pose=np.array([20.0 + 12.0 * i, 20.0 + 15.0 * i, 0.5 * i]),
            actuation=PLANAR_NOISE,
            landmark_sensors=("sees",),
        )
        for i in range(robots)
    )
    return World(
        robots=team,
        sensors={"sees": sensor},
        landmark_keys=tuple(landmark(i) for i in range(landmarks)),
        landmark_positions=generator.uniform(0.0, 80.0, (landmarks, 2)),
        **fields,
    )


def spatial_world(sensor=BEARING_RANGE, *, seed=0, robots=2, landmarks=25, **fields):
    generator = np.random.default_rng(seed)
    team = []
    for i in range(robots):
        pose = exponential(np.array([0.1 * i, -0.1, 0.4 * i, 0.0, 0.0, 0.0]))
        pose[:3, 3] = [20.0 + 12.0 * i, 20.0 + 15.0 * i, 10.0]
        team.append(
            WorldRobot(name=f"r{i}", pose=pose, actuation=SPATIAL_NOISE, landmark_sensors=("sees",))
        )
    return World(
        robots=tuple(team),
        sensors={"sees": sensor},
        landmark_keys=tuple(landmark(i) for i in range(landmarks)),
        landmark_positions=generator.uniform([0.0, 0.0, 0.0], [80.0, 80.0, 20.0], (landmarks, 3)),
        **fields,
    )


def with_relative_poses(world, sigma=0.05, distance_m=60.0):
    size = 3 if world.robots[0].pose.ndim == 1 else 6
    model = MultiRobotModel(
        criterion=DistanceCriterion(distance_m=distance_m),
        sensor=RelativePoseSensor(covariance=sigma**2 * np.eye(size)),
    )
    return replace(world, multi_robot={"meets": model})


def turning_plans(world, steps, seed=1):
    """Curved ways, so that ranges alone can tell left from right."""
    generator = np.random.default_rng(seed)
    plans = {}
    for robot in world.robots:
        turns = generator.normal(0.15, 0.2, steps)
        if robot.pose.ndim == 1:
            plans[robot.name] = heading_changes(turns, np.full(steps, 2.0))
            continue
        climbs = generator.normal(0.0, 0.15, steps)
        twists = [
            exponential(np.array([0.05, climb, turn, 2.0, 0.0, 0.0]))
            for turn, climb in zip(turns, climbs, strict=True)
        ]
        plans[robot.name] = Commands(np.array(twists))
    return plans


def run_of(world, steps=20, seed=0):
    """All steps of a simulation."""
    return list(simulate(world, turning_plans(world, steps), np.random.default_rng(seed)))


def slam_of(world, options=None, *, sigma=1e-6, generator=None, **fields):
    """SLAM at the start of a world: at the true starts, or disturbed as the prior says."""
    sensors = dict(world.sensors)
    sensors.update({name: model.sensor for name, model in world.multi_robot.items()})
    starts = {}
    for robot in world.robots:
        dim = 3 if robot.pose.ndim == 1 else 6
        covariance = sigma**2 * np.eye(dim)
        turned = slice(2, 3) if dim == 3 else slice(0, 3)
        covariance[turned, turned] = min(sigma, 0.05) ** 2 * np.eye(1 if dim == 3 else 3)
        pose = robot.pose
        if generator is not None:
            pose = disturb_pose(pose, covariance, generator)
        starts[robot.name] = SlamStart(pose=pose, covariance=covariance)
    return TeamSlam(starts, sensors, options or SlamOptions(), **fields)


def fed(slam, steps):
    """SLAM after all steps."""
    for step in steps:
        slam.update(step.state.step, step.odometry, step.measurements)
    return slam
