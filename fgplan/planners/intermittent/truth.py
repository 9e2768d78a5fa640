"""The true state and the noise of every measurement, drawn before anybody moves.

Noise is a table over step, robot and observation, so that methods which send robots elsewhere meet
the same targets and the same noise.

Targets avoid obstacles (section IV of Khodayi-mehr et al. 2019): a step that would touch one, or
leave the bounds, is drawn anew, so near a wall the process noise is the filter's cut off there.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.models.hidden_state import HiddenState
from fgplan.planners.intermittent.estimate import Estimate
from fgplan.planners.intermittent.segment_model import StateModel
from fgplan.typing import BoolArray, FloatArray
from roadmaps import Workspace

_DRAWS = 100
"""A target that none of so many draws takes to a free place stays where it is for a step."""


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
    workspace: Workspace | None = None,
) -> Truth:
    """Draw states and noise.

    Args:
        hidden: Dynamics.
        start: x(0), shape (n,).
        steps: Number of steps.
        model: Says how many observations a robot has.
        robots: Number of robots.
        generator: Source of all numbers.
        workspace: Whose obstacles, floor and bounds targets of two or three coordinates avoid;
            nothing is in their way if left out.

    Returns:
        The truth.
    """
    states = [np.asarray(start, dtype=np.float64)]
    for time in range(steps):
        after = hidden.sample(states[-1], time, generator)
        if workspace is not None:
            after = _free_step(hidden, states[-1], after, time, generator, workspace)
        states.append(after)
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


def _free_step(
    hidden: HiddenState,
    before: FloatArray,
    after: FloatArray,
    time: int,
    generator: np.random.Generator,
    workspace: Workspace,
) -> FloatArray:
    """A step whose targets all move freely: blocks that do not are drawn anew."""
    for _ in range(_DRAWS):
        stuck = _stuck_rows(hidden, before, after, workspace)
        if not stuck.any():
            return after
        after = np.where(stuck, hidden.sample(before, time, generator), after)
    return np.where(_stuck_rows(hidden, before, after, workspace), before, after)


def _stuck_rows(
    hidden: HiddenState, before: FloatArray, after: FloatArray, workspace: Workspace
) -> BoolArray:
    """Blocks of which a target would touch an obstacle, the floor or the bounds, by coordinate."""
    first = np.array([hidden.slice_of(name).start for name in hidden.targets])
    places = np.stack([after[first], after[first + 1]], axis=1)
    free = workspace.has_line_of_sight(np.stack([before[first], before[first + 1]], 1), places)
    free &= ((places >= workspace.lower) & (places <= workspace.upper)).all(axis=1)
    if set(hidden.sizes) == {3}:
        free &= after[first + 2] >= 0.0
    by_name = dict(zip(hidden.targets, free.tolist(), strict=True))
    return np.concatenate(
        [
            np.full(block.size, not all(by_name[name] for name in block.targets))
            for block in hidden.blocks
        ]
    )
