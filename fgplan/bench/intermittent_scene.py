"""The indoor scene of section IV of Khodayi-mehr et al. 2019, and what the paper leaves open.

Printed: 10 x 10 x 5 m, ground robots of 0.1 m a step, communication range 0.2 m, range sensors
of 5 m with line of sight and noise (12), starts and first estimates of eight targets, C(0) =
0.25 I, delta = 0.12^2 m^2, the two team graphs. Not printed, and ours: the walls, A, B u and Q of
the targets, the robots' first paths, samples, steps and duration. They are all in ``UNPRINTED``
and go into every result. Those of the targets and the walls were chosen so that the two baselines
come near their published figures: a calibration, no confirmation.

Targets follow straight or circular paths and are pushed off them: with r(t) the path,

    x(t + 1) = a x(t) + (r(t + 1) - a r(t)) + w,   w ~ N(0, q diag(1, 1, share))

where the share of the height is small: they move on level paths. An unseen target's variance tends
to q / (1 - a^2), a square metre. Targets avoid walls, as printed: noise that would push one into a
wall or out of the floor is drawn anew (``truth.draw_truth``); the filter knows nothing of it.
"""

from typing import Any

import numpy as np

from fgplan.models.clamped_range import ClampedRangeSensor
from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.planners.intermittent.block_model import BlockModel
from fgplan.planners.intermittent.estimate import Estimate
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.team_graph import TeamGraph
from fgplan.typing import FloatArray
from roadmaps import Workspace

STARTS_M = np.array(
    [
        (1.0, 2.0, 1.5),
        (1.0, 1.0, 1.3),
        (8.5, 1.5, 0.8),
        (9.2, 9.0, 1.0),
        (7.0, 8.0, 1.1),
        (5.9, 9.0, 1.2),
        (3.0, 9.0, 1.3),
        (1.8, 8.2, 0.9),
    ]
)
"""Where the targets start, metres."""

ESTIMATES_M = np.array(
    [
        (1.0, 1.0, 1.0),
        (1.0, 1.0, 1.0),
        (9.0, 1.0, 1.0),
        (9.0, 9.5, 1.0),
        (7.0, 9.5, 1.0),
        (4.0, 9.0, 1.0),
        (2.5, 7.0, 1.0),
        (1.0, 9.0, 1.0),
    ]
)
"""Where the filter believes that they start, metres."""

PRIOR_VARIANCE = 0.25
FOUR_TARGETS = (0, 2, 4, 6)
"""Which of the eight are the four of Table I: ours, one in each corner."""

G1_TEAMS = (
    ("r12", "r18"),
    ("r12", "r23"),
    ("r23", "r34"),
    ("r34", "r45"),
    ("r45", "r56"),
    ("r56", "r67"),
    ("r67", "r78"),
    ("r18", "r78"),
)
"""Figure 1(a); T4 is printed with r14, which must be r34."""

G2_TEAMS = (
    ("r12", "r14", "r15"),
    ("r12", "r23", "r25"),
    ("r23", "r34", "r35"),
    ("r14", "r34", "r45"),
    ("r15", "r25", "r35", "r45"),
)
"""Figure 1(b)."""

FOUR_TEAMS = (("r12", "r14"), ("r12", "r23"), ("r23", "r34"), ("r14", "r34"))
"""The four robots of section IV-B."""

WALL_M = 0.1
WALLS = (
    ((3.4, 0.0), (3.4, 2.4)),
    ((0.0, 3.4), (2.4, 3.4)),
    ((6.6, 0.0), (6.6, 2.4)),
    ((7.6, 3.4), (10.0, 3.4)),
    ((6.4, 7.6), (6.4, 10.0)),
    ((7.6, 6.6), (10.0, 6.6)),
    ((3.9, 7.6), (3.9, 10.0)),
    ((0.0, 6.6), (2.4, 6.6)),
    ((4.4, 4.4), (5.6, 5.6)),
    ((2.4, 5.0), (2.4, 6.6)),
    ((7.6, 3.4), (7.6, 5.0)),
)
"""Middle lines of the walls, metres: a room with one door in each corner."""

UNPRINTED: dict[str, Any] = {
    "walls": WALLS,
    "wall_thickness_m": WALL_M,
    "a": 0.998,
    "q_m2": 4.5e-3,
    "q_height_share": 0.1,
    "target_speed_m": 0.02,
    "targets_at_walls": "steps that would touch a wall or leave the floor are drawn anew",
    "circle_radius_m": 0.4,
    "line_length_m": 1.6,
    "steps": 600,
    "figure_steps": 1200,
    "every": 1,
    "samples": 600,
    "explore": 300,
    "epsilon_m": 1.0,
    "horizon_steps": 400,
    "sync": "strict",
    "four_targets": FOUR_TARGETS,
    "robot_starts": "uniform in the free space, by seed",
    "first_paths": "planned like all others, from the first estimate",
    "formation": "two rows, 0.15 m apart, from (5.0, 6.3)",
    "meeting_points": "uniform in the free space",
}
"""What the paper does not print."""

FORMATION_START_M = (5.0, 6.3)


def indoor_world() -> Workspace:
    """The 10 m x 10 m floor with its walls."""
    return Workspace(
        lower=np.zeros(2), upper=np.full(2, 10.0), obstacles=[_wall(*wall) for wall in WALLS]
    )


def team_graph(name: str) -> TeamGraph:
    """A team graph of the paper.

    Args:
        name: ``G1``, ``G2`` or ``four``.

    Returns:
        Robots and teams.
    """
    teams = {"G1": G1_TEAMS, "G2": G2_TEAMS, "four": FOUR_TEAMS}[name]
    names = dict.fromkeys(robot for team in teams for robot in team)
    return TeamGraph(tuple(sorted(names)), teams)


def target_paths(targets: tuple[int, ...], steps: int) -> FloatArray:
    """r(t): even targets go to and fro on a line, odd ones round a circle.

    Args:
        targets: Which of the eight.
        steps: Number of steps.

    Returns:
        Shape (steps + 1, M, 3), metres; the first row is ``STARTS_M``.
    """
    time = np.arange(steps + 1)
    speed, radius = UNPRINTED["target_speed_m"], UNPRINTED["circle_radius_m"]
    length = UNPRINTED["line_length_m"]
    paths = np.repeat(STARTS_M[list(targets)][None], steps + 1, axis=0)
    for column, target in enumerate(targets):
        start = STARTS_M[target]
        inwards = np.arctan2(*(5.0 - start[:2])[::-1])
        heading = np.array([np.cos(inwards), np.sin(inwards)])
        if target % 2 == 0:
            way = length - np.abs((speed * time) % (2.0 * length) - length)
            paths[:, column, :2] += way[:, None] * heading
        else:
            turned = inwards + np.pi + speed / radius * time
            circle = np.stack([np.cos(turned), np.sin(turned)], axis=1)
            paths[:, column, :2] += radius * (heading + circle)
    return paths


def segment_options() -> SegmentOptions:
    """Options of planning, as printed or as in ``UNPRINTED``.

    Returns:
        The options.
    """
    return SegmentOptions(
        samples=UNPRINTED["samples"],
        explore=UNPRINTED["explore"],
        epsilon_m=UNPRINTED["epsilon_m"],
        sync=UNPRINTED["sync"],
        horizon_steps=UNPRINTED["horizon_steps"],
    )


def hidden_targets(targets: tuple[int, ...], steps: int) -> HiddenState:
    """Dynamics of the targets.

    Args:
        targets: Which of the eight.
        steps: Number of steps for which the controls are known.

    Returns:
        One block of three coordinates a target.
    """
    a, q = UNPRINTED["a"], UNPRINTED["q_m2"]
    paths = target_paths(targets, steps)
    controls = paths[1:] - a * paths[:-1]
    return HiddenState(
        tuple(
            HiddenBlock(
                targets=(f"target{target + 1}",),
                transition=a * np.eye(3),
                drift=controls[:, column],
                process=q * np.diag([1.0, 1.0, UNPRINTED["q_height_share"]]),
            )
            for column, target in enumerate(targets)
        )
    )


def indoor_model(targets: tuple[int, ...], robots: int, steps: int) -> BlockModel:
    """Targets and sensors of the scene.

    Args:
        targets: Which of the eight.
        robots: Their number; all carry the sensor of (12).
        steps: Number of steps for which the controls are known.

    Returns:
        The model.
    """
    return BlockModel(
        hidden=hidden_targets(targets, steps),
        sensors=((ClampedRangeSensor(),),) * robots,
        workspace=indoor_world(),
        every=UNPRINTED["every"],
    )


def first_estimate(targets: tuple[int, ...]) -> Estimate:
    """x(0) and C(0) of the filter.

    Args:
        targets: Which of the eight.

    Returns:
        The estimate at time 0.
    """
    count = len(targets)
    return Estimate(
        0,
        ESTIMATES_M[list(targets)].reshape(-1),
        np.repeat(PRIOR_VARIANCE * np.eye(3)[None], count, axis=0),
    )


def _wall(start: tuple[float, float], end: tuple[float, float]) -> FloatArray:
    """A wall as a thin box about its middle line."""
    a, b = np.array(start), np.array(end)
    along = (b - a) / np.hypot(*(b - a))
    across = 0.5 * WALL_M * np.array([-along[1], along[0]])
    return np.array([a - across, b - across, b + across, a + across])
