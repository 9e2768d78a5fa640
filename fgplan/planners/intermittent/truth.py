"""The true state and the noise of every measurement, drawn before anybody moves.

Noise is a table over step, robot and observation, so that methods which send robots elsewhere meet
the same targets and the same noise.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.models.hidden_state import HiddenState
from fgplan.planners.intermittent.estimate import Estimate
from fgplan.planners.intermittent.segment_problem import StateModel
from fgplan.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What robots cannot see.

    Attributes:
        states: Shape (steps + 1, n).
        normals: Standard normal numbers, shape (steps + 1, N, O, 3).
    """

    states: FloatArray
    normals: FloatArray

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.states) - 1


def draw_truth(
    hidden: HiddenState,
    start: FloatArray,
    steps: int,
    model: StateModel,
    robots: int,
    generator: np.random.Generator,
) -> Truth:
    """Draw states and noise.

    Args:
        hidden: Dynamics.
        start: x(0), shape (n,).
        steps: Number of steps.
        model: Says how many observations a robot has.
        robots: Number of robots.
        generator: Source of all numbers.

    Returns:
        The truth.
    """
    states = [np.asarray(start, dtype=np.float64)]
    for time in range(steps):
        states.append(hidden.sample(states[-1], time, generator))
    most = max(model.observation_count(robot) for robot in range(robots))
    return Truth(np.array(states), generator.standard_normal((steps + 1, robots, most, 3)))


def expected_truth(model: StateModel, estimate: Estimate, steps: int, robots: int) -> Truth:
    """Everything as predicted and no noise: what a plan assumes.

    Args:
        model: Of the state.
        estimate: At the start.
        steps: Number of steps.
        robots: Number of robots.

    Returns:
        Predicted means as states.
    """
    most = max(model.observation_count(robot) for robot in range(robots))
    states = model.predicted_means(estimate, steps)
    return Truth(states, np.zeros((steps + 1, robots, most, 3)))
