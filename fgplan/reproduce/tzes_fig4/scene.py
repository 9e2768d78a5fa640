"""The scene of figure 4 of Tzes et al. 2021, as far as its text goes.

Printed: differential drive, range-only sensors of 1 m with line of sight, two targets that move
("oscillate between the two moving targets"), three graphs. Lost or not printed: number of robots
and targets, map, starts, targets, prior, limit delta, speeds. Ours: 6 robots and 10 targets,
uniform in free space of the map of ``fgplan.bench.aia_scene``, with its prior, limit and step; two
targets that drift by at most 0.005 m a step with Q = 2e-6 I, on a way that is free for 800 steps: a
robot on its own needs several hundred.
"""

import numpy as np

from fgplan.bench.aia_scene import (
    DELTA,
    PRIOR_VARIANCE,
    controls,
    draw_drifts,
    draw_targets,
    kantaros_world,
)
from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.planners.aia.problem import AcquisitionProblem, SensingRobot, TerminalConstraint
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.typing import FloatArray
from roadmaps import Workspace

ROBOTS, TARGETS, MOVING = 6, 10, 2
SENSING_RANGE_M = 1.0
AVERAGE_DEGREE = 3.0
_SPEED_M = 0.005
_PROCESS = 2e-6
_FREE_STEPS = 800


def figure_scene(generator: np.random.Generator) -> AcquisitionProblem:
    """The scene.

    Args:
        generator: Draws starts, targets and their drifts.

    Returns:
        The problem; the first targets move.
    """
    world = kantaros_world()
    starts = draw_targets(world, ROBOTS, generator)
    means = draw_targets(world, TARGETS, generator)
    drifts = np.zeros((TARGETS, 2))
    for i in range(MOVING):
        drifts[i] = _free_drift(world, means[i], generator)
    primitives = controls("differential-drive")
    sensor = ProportionalRangeSensor(max_range_m=SENSING_RANGE_M)
    blocks = [
        HiddenBlock(
            targets=(f"t{i}",),
            transition=np.eye(2),
            drift=drifts[i],
            process=(_PROCESS if i < MOVING else 0.0) * np.eye(2),
        )
        for i in range(TARGETS)
    ]
    return AcquisitionProblem(
        workspace=world,
        robots=tuple(
            SensingRobot(
                name=f"r{j}",
                pose=np.array([*start, 0.0]),
                primitives=primitives,
                sensors=(sensor,),
            )
            for j, start in enumerate(starts)
        ),
        hidden=HiddenState(tuple(blocks)),
        mean=means.ravel(),
        priors=(PRIOR_VARIANCE * np.eye(2),) * TARGETS,
        terminal=TerminalConstraint(limit=DELTA),
    )


def figure_graphs(
    problem: AcquisitionProblem, generator: np.random.Generator
) -> dict[str, CommunicationGraph]:
    """The three graphs.

    Args:
        problem: The scene.
        generator: Draws the connected one.

    Returns:
        By name, in the order of figure 4(a)-(c).
    """
    names = [robot.name for robot in problem.robots]
    return {
        "full": CommunicationGraph.complete(names),
        "degree 3": CommunicationGraph.random_connected(names, AVERAGE_DEGREE, generator),
        "none": CommunicationGraph.none(names),
    }


def _free_drift(world: Workspace, mean: FloatArray, generator: np.random.Generator) -> FloatArray:
    """A drift whose way stays inside the bounds and out of obstacles, shape (2,), metres a step."""
    while True:
        (drift,) = draw_drifts(mean[None], generator, _SPEED_M)
        if world.are_motions_valid(mean[None], (mean + _FREE_STEPS * drift)[None])[0]:
            return drift
