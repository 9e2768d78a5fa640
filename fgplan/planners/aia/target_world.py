"""The world of an acquisition problem, for executing plans: targets are drawn from the prior."""

import numpy as np

from fgplan.models.sensor import AbstractSensor
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.simulation.world import World, WorldRobot
from fgplan.typing import Covariance, FloatArray

_TRIES = 1000


def target_world(problem: AcquisitionProblem, generator: np.random.Generator) -> World:
    """A world whose targets are drawn from the prior, where it is free.

    Args:
        problem: Independent targets in the plane and sensors of points.
        generator: Draws the truth.

    Returns:
        The world; robots move exactly as commanded. Sensors are named as ``target_sensors`` does.
    """
    truth = [
        _drawn(problem, mean, prior, generator)
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


def _drawn(
    problem: AcquisitionProblem, mean: FloatArray, prior: Covariance, generator: np.random.Generator
) -> FloatArray:
    """A draw that is not inside an obstacle, where no robot could see it."""
    draws = generator.multivariate_normal(mean, prior, _TRIES)
    free = problem.workspace.are_positions_valid(draws)
    return np.asarray(draws[int(np.argmax(free))])
