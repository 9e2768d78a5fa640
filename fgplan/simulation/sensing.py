"""What the robots measure from where they truly are.

A sensor measures whatever is visible: within range, field of view and line of sight. Far points
are put aside for all at once, because most landmarks are far; the sensor itself decides on the
rest, so a user's own ``visible`` holds.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from fgplan.models.measurement import Kind, Measurement
from fgplan.models.pose import between, position, position_in
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.state import State
from fgplan.simulation.noise import disturb_pose, draw_measurement
from fgplan.simulation.world import World, WorldRobot
from fgplan.typing import FloatArray, Key, Pose


def sense(
    world: World,
    robot: WorldRobot,
    poses: Mapping[str, Pose],
    hidden_state: FloatArray,
    step: int,
    generator: np.random.Generator,
) -> tuple[Measurement, ...]:
    """All measurements of one robot at one step.

    Args:
        world: The world.
        robot: The robot that measures.
        poses: True pose of every robot.
        hidden_state: True stacked state of the targets, shape (n,).
        step: Steps since the start.
        generator: Source of the noise.

    Returns:
        Landmarks, targets, robots by sensors, robots by multi-robot models; each in the world's
        order.
    """
    pose = poses[robot.name]
    seen: list[Measurement] = []
    for name in robot.landmark_sensors:
        sensor = world.sensors[name]
        for row in _near(sensor, pose, world.landmark_positions):
            key, point = world.landmark_keys[row], world.landmark_positions[row]
            seen += _measure(world, robot, name, "landmark", key, pose, point, generator)
    if world.hidden is not None:
        for name in robot.target_sensors:
            for target in world.hidden.targets:
                state = hidden_state[world.hidden.slice_of(target)]
                seen += _measure(world, robot, name, "target", target, pose, state, generator)
    for name in robot.robot_sensors:
        for other in world.robots:
            if other.name != robot.name:
                point = position(poses[other.name])
                seen += _measure(world, robot, name, "robot", other.name, pose, point, generator)
    seen += _measure_jointly(world, robot, poses, step, generator)
    return tuple(seen)


def _measure(
    world: World,
    robot: WorldRobot,
    name: str,
    kind: Kind,
    target: Key | str,
    pose: Pose,
    state: FloatArray,
    generator: np.random.Generator,
) -> Iterator[Measurement]:
    """Measure one target if it is visible."""
    sensor = world.sensors[name]
    if sensor.visible(pose, state, world):
        value, covariance = draw_measurement(sensor, pose, state, generator)
        yield Measurement(
            robot=robot.name,
            sensor=name,
            kind=kind,
            target=target,
            value=value,
            covariance=covariance,
        )


def _measure_jointly(
    world: World,
    robot: WorldRobot,
    poses: Mapping[str, Pose],
    step: int,
    generator: np.random.Generator,
) -> Iterator[Measurement]:
    """Measure the robots later in the team with which a multi-robot model joins this one."""
    time = step * world.step_s
    first = State(robot.name, step, time, poses[robot.name])
    names = [other.name for other in world.robots]
    for name, model in world.multi_robot.items():
        for other in names[names.index(robot.name) + 1 :]:
            second = State(other, step, time, poses[other])
            if not model.joins(first, second):
                continue
            if isinstance(model.sensor, RelativePoseSensor):
                covariance = model.sensor.covariance
                value = disturb_pose(between(first.pose, second.pose), covariance, generator)
            else:
                point = position(second.pose)
                if not model.sensor.visible(first.pose, point, world):
                    continue
                value, covariance = draw_measurement(model.sensor, first.pose, point, generator)
            yield Measurement(
                robot=robot.name,
                sensor=name,
                kind="robot",
                target=other,
                value=value,
                covariance=covariance,
            )


def _near(sensor: AbstractSensor, pose: Pose, points: FloatArray) -> list[int]:
    """Rows of the points that are within range."""
    distance = np.linalg.norm(points - position_in(pose, points.shape[1]), axis=1)
    # A hair beyond the range, so that rounding here never overrules the sensor.
    return [int(row) for row in np.flatnonzero(distance <= sensor.max_range_m * (1.0 + 1e-9))]
