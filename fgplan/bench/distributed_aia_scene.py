"""Scenes in the manner of section VI of Tzes et al. 2021, for benches and reproductions.

The text at hand gives differential drive, sensors of 1 m range and that targets are linear systems.
It has lost the environment of its figure 4, the controls, the noise law, the limit delta, the prior
and where robots and targets are. Ours: the world, controls, noise and prior of
``fgplan.bench.aia_scene``; starts and targets uniform over free space, headings a whole number of
quarter turns; ``delta``, ``step_m`` and the range are arguments.
"""

import numpy as np

from fgplan.bench.aia_scene import (
    DELTA,
    STEP_M,
    TARGET_CLEARANCE_M,
    DynamicsName,
    controls,
    draw_drifts,
    draw_targets,
    kantaros_world,
    scene_of,
)
from fgplan.checks import check_positive
from fgplan.errors import InvalidInputError
from fgplan.planners.aia.problem import AcquisitionProblem

SENSING_RANGE_M = 1.0
START_CLEARANCE_M = 0.15


def tzes_scene(
    robots: int,
    targets: int,
    generator: np.random.Generator,
    *,
    dynamics: DynamicsName = "differential-drive",
    moving: bool = False,
    delta: float = DELTA,
    step_m: float = STEP_M,
    range_m: float = SENSING_RANGE_M,
) -> AcquisitionProblem:
    """A scene of section VI-A.

    Args:
        robots: N.
        targets: M.
        generator: Draws starts, then targets, then how they move.
        dynamics: Of the robots.
        moving: Whether the targets move.
        delta: Limit of each target's determinant.
        step_m: Length of a step of the robots, metres.
        range_m: Of the sensors, metres.

    Returns:
        The problem.

    Raises:
        InvalidInputError: If there is no robot or no target, a number is not usable, or the
            dynamics are not known.
    """
    for name, count in (("robots", robots), ("targets", targets)):
        if count < 1:
            raise InvalidInputError(f"scene: expected at least one of {name}, got {count}")
    primitives = controls(dynamics, check_positive(step_m, "scene: step_m"))
    range_m = check_positive(range_m, "scene: range_m")
    world = kantaros_world()
    starts = draw_targets(world, robots, generator, START_CLEARANCE_M)
    quarters = generator.integers(-1, 3, robots) if primitives.frame == "body" else [0] * robots
    means = draw_targets(world, targets, generator, TARGET_CLEARANCE_M)
    return scene_of(
        world,
        [
            np.array([*start, 0.5 * np.pi * quarter])
            for start, quarter in zip(starts, quarters, strict=True)
        ],
        primitives,
        range_m,
        means,
        draw_drifts(means, generator) if moving else None,
        delta,
    )
