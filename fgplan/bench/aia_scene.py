"""Scenes in the manner of section VI of Kantaros et al. 2019, for benches and reproductions.

The paper gives the size of the world (10 m x 10 m), the sensor (range 2 m, sigma 0.25 l), the
controls and delta = 1.8e-6. It does not give the map, the starts, the targets or the prior. Ours:
seven boxes; robots on distinct lattice points of [0.2, 1.8]^2 ("the majority of the robots at their
initial locations cannot take any measurement"); targets uniform in free space, 0.15 m from the
boxes; Sigma_i(0) = 0.2 I. Prior, layout of the starts and the distance ``near`` were chosen so that
costs come near Table I: a calibration, no confirmation. Targets that move do so at up to 0.02 m a
step in a straight line, with Q = 1e-6 I.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.models.hidden_state import independent_targets
from fgplan.models.motion_primitives import MotionPrimitives, differential_drive, first_order
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.planners.aia.problem import AcquisitionProblem, SensingRobot, TerminalConstraint
from fgplan.typing import FloatArray
from roadmaps import Workspace

DynamicsName = Literal["first-order", "differential-drive"]

BOXES = (
    (2.1, 2.1, 2.9, 4.1),
    (5.1, 0.9, 5.9, 3.3),
    (1.3, 6.1, 3.9, 6.7),
    (5.3, 5.1, 6.1, 7.9),
    (7.3, 2.3, 8.9, 2.9),
    (7.7, 6.3, 8.3, 8.7),
    (3.1, 8.3, 4.7, 8.9),
)
"""Least and greatest corner of each box, metres: our map, not the paper's figure 3."""

GRAZE_M = 1e-3
"""By which each box is grown: else diagonals of the lattice graze corners and rounding decides."""

DELTA = 1.8e-6
SENSING_RANGE_M = 2.0
PRIOR_VARIANCE = 0.2
TARGET_CLEARANCE_M = 0.15
TARGET_SPEED_M = 0.02
MOVING_PROCESS = 1e-6
STEP_M = 0.2


def kantaros_world() -> Workspace:
    """The 10 m x 10 m world with seven boxes."""
    g = GRAZE_M
    return Workspace(
        lower=np.zeros(2),
        upper=np.full(2, 10.0),
        obstacles=[
            [(a - g, b - g), (c + g, b - g), (c + g, d + g), (a - g, d + g)] for a, b, c, d in BOXES
        ],
    )


def controls(dynamics: DynamicsName, step_m: float = STEP_M) -> MotionPrimitives:
    """Control set of the paper.

    Args:
        dynamics: ``first-order`` (8 controls) or ``differential-drive`` (18).
        step_m: Length of a step, metres.

    Returns:
        The primitives.

    Raises:
        InvalidInputError: If the dynamics are not known.
    """
    if dynamics == "first-order":
        return first_order(step_m)
    if dynamics == "differential-drive":
        return differential_drive((0.0, step_m))
    raise InvalidInputError(
        f"dynamics: expected 'first-order' or 'differential-drive', got {dynamics!r}"
    )


def kantaros_scene(
    robots: int,
    targets: int,
    generator: np.random.Generator,
    *,
    dynamics: DynamicsName = "first-order",
    moving: bool = False,
    delta: float = DELTA,
) -> AcquisitionProblem:
    """A scene of Table I.

    Args:
        robots: N, at most 81 (the lattice points of the start area).
        targets: M.
        generator: Draws starts and targets.
        dynamics: Of the robots.
        moving: Whether the targets move.
        delta: Limit of each target's determinant.

    Returns:
        The problem.

    Raises:
        InvalidInputError: If there are too many robots, or the dynamics are not known.
    """
    lattice = [(0.2 * x, 0.2 * y) for x in range(1, 10) for y in range(1, 10)]
    if not 1 <= robots <= len(lattice):
        raise InvalidInputError(f"scene: expected 1 to {len(lattice)} robots, got {robots}")
    chosen = generator.permutation(len(lattice))[:robots]
    primitives = controls(dynamics)
    world = kantaros_world()
    means = draw_targets(world, targets, generator)
    return scene_of(
        world,
        [np.array([*lattice[point], 0.0]) for point in chosen],
        primitives,
        SENSING_RANGE_M,
        means,
        draw_drifts(means, generator) if moving else None,
        delta,
    )


def scene_of(
    world: Workspace,
    starts: Sequence[FloatArray],
    primitives: MotionPrimitives,
    range_m: float,
    means: FloatArray,
    drifts: FloatArray | None,
    delta: float,
) -> AcquisitionProblem:
    """A problem of robots of one kind and targets that are all known alike.

    Args:
        world: The world.
        starts: Pose of each robot, shape (3,), world frame.
        primitives: Controls of every robot.
        range_m: Of every sensor, metres.
        means: Shape (M, 2), metres.
        drifts: Velocities of targets that move, shape (M, 2), metres a step; None if they stay.
        delta: Limit of each target's determinant.

    Returns:
        The problem: robots r0, r1, ... and targets t0, t1, ...
    """
    sensor = ProportionalRangeSensor(max_range_m=range_m)
    return AcquisitionProblem(
        workspace=world,
        robots=tuple(
            SensingRobot(name=f"r{j}", pose=start, primitives=primitives, sensors=(sensor,))
            for j, start in enumerate(starts)
        ),
        hidden=independent_targets(
            [f"t{i}" for i in range(len(means))],
            np.zeros(means.shape) if drifts is None else drifts,
            (0.0 if drifts is None else MOVING_PROCESS) * np.eye(2),
        ),
        mean=means.ravel(),
        priors=(PRIOR_VARIANCE * np.eye(2),) * len(means),
        terminal=TerminalConstraint(limit=delta),
    )


def draw_targets(
    world: Workspace, targets: int, generator: np.random.Generator, clearance_m: float = 0.15
) -> FloatArray:
    """Targets uniform in free space, away from obstacles and bounds.

    Args:
        world: The world.
        targets: How many.
        generator: Source of random numbers.
        clearance_m: Least distance to obstacles and bounds, metres.

    Returns:
        Shape (targets, 2), metres.
    """
    found: list[FloatArray] = []
    while len(found) < targets:
        point = generator.uniform(world.lower + clearance_m, world.upper - clearance_m)
        if not world.polygons.touch_points(point[None], clearance_m)[0]:
            found.append(point)
    return np.array(found)


def draw_drifts(
    means: FloatArray, generator: np.random.Generator, speed_m: float = TARGET_SPEED_M
) -> FloatArray:
    """Constant velocities towards the middle of the world, so that targets stay inside for long.

    Args:
        means: Shape (M, 2), metres.
        generator: Source of random numbers.
        speed_m: Greatest speed, metres a step.

    Returns:
        Shape (M, 2), metres a step.
    """
    middle = np.full(2, 5.0)
    heading = np.arctan2(*(middle - means).T[::-1]) + generator.uniform(-1.0, 1.0, len(means))
    speed = generator.uniform(0.0, speed_m, len(means))
    return speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
