"""The world of an acquisition problem, for executing plans: targets are drawn from the prior."""

import numpy as np

from fgplan.models.sensor import AbstractSensor
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.simulation.world import World, WorldRobot


def target_world(problem: AcquisitionProblem, generator: np.random.Generator) -> World:
    """A world whose targets are drawn from the prior.

    Args:
        problem: Independent targets in the plane and sensors of points.
        generator: Draws the truth.

    Returns:
        The world; robots move exactly as commanded. Sensors are named as ``target_sensors`` does.
    """
    truth = [
        generator.multivariate_normal(mean, prior)
        for mean, prior in zip(problem.mean.reshape(-1, 2), problem.priors, strict=True)
    ]
    robots = [
        WorldRobot(
            name=robot.name,
            pose=robot.pose,
            target_sensors=tuple(f"{robot.name} {place}" for place in range(len(robot.sensors))),
        )
        for robot in problem.robots
    ]
    return World(
        robots=tuple(robots),
        workspace=problem.workspace,
        sensors=target_sensors(problem),
        hidden=problem.hidden,
        hidden_state=np.concatenate(truth),
    )


def target_sensors(problem: AcquisitionProblem) -> dict[str, AbstractSensor]:
    """Sensors by a name for each robot and place.

    Args:
        problem: Sensors of points.

    Returns:
        Sensor by name.
    """
    return {
        f"{robot.name} {place}": sensor
        for robot in problem.robots
        for place, sensor in enumerate(robot.sensors)
        if isinstance(sensor, AbstractSensor)
    }
