"""Finite control sets: what a robot of a sampling-based planner can do in one step.

A control is a relative pose and the way to it. In the *world* frame it displaces (first-order
dynamics, p(t + 1) = p(t) + u(t)); in the *body* frame it is composed with the pose (differential
drive). The way from the pose to its successor is a polyline of waypoints, for obstacle tests.

Differential drive with speed v and turn rate w over a step tau follows an arc whose chord is

    v tau sinc(w tau / 2) long, at angle w tau / 2 from the heading,  sinc(a) = sin(a) / a,

and the heading turns by w tau. (Section VI-A of Kantaros et al. 2019 names the sets of v and w and
not the integration; the arc is exact.)
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from fgplan.checks import check_finite, check_positive, frozen
from fgplan.errors import InvalidInputError
from fgplan.typing import ArrayLike, FloatArray

Frame = Literal["world", "body"]

KANTAROS_TURNS_RAD_PER_S = tuple(k * np.pi / 4 for k in (0, 1, -1, 2, -2, 3, -3, 4, -4))
"""Turn rates of section VI-A of Kantaros et al. 2019; pi / 1.33 is read as 3 pi / 4."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionPrimitives:
    """A finite control set.

    Attributes:
        relative: Shape (U, 3), (x, y, heading) of each control's end: metres and radians.
        frame: ``body``: composed with the pose; ``world``: added to it.
        waypoints: Shape (U, W, 2), positions along each control from the first after the start to
            its end, in the same frame; the straight way to the end if left out.
        step_s: Duration of a step, seconds.
    """

    relative: FloatArray
    frame: Frame = "body"
    waypoints: FloatArray = field(default_factory=lambda: np.zeros(0))
    step_s: float = 1.0

    def __post_init__(self) -> None:
        """Check shapes and that there is a control."""
        relative = check_finite(self.relative, "motion primitives: relative", (None, 3))
        if len(relative) == 0:
            raise InvalidInputError(
                "motion primitives: expected at least one control, got an empty set; a robot that "
                "stays has the control [0, 0, 0]"
            )
        if self.frame not in ("world", "body"):
            raise InvalidInputError(
                f"motion primitives: frame: expected 'world' or 'body', got {self.frame!r}"
            )
        check_positive(self.step_s, "motion primitives: step_s")
        given = self.waypoints if np.size(self.waypoints) else relative[:, None, :2]
        waypoints = check_finite(given, "motion primitives: waypoints", (len(relative), None, 2))
        if np.abs(waypoints[:, -1] - relative[:, :2]).max() > 1e-9:
            raise InvalidInputError(
                "motion primitives: expected the last waypoint of each control to be its end"
            )
        object.__setattr__(self, "relative", relative)
        object.__setattr__(self, "waypoints", waypoints)

    def __len__(self) -> int:
        """Number of controls U."""
        return len(self.relative)

    def reach_m(self) -> float:
        """Longest way from a pose to a point on the way of a control, metres."""
        return float(np.linalg.norm(self.waypoints, axis=-1).max())

    def successors(self, pose: ArrayLike) -> FloatArray:
        """Poses after each control.

        Args:
            pose: Shape (3,), world frame.

        Returns:
            Shape (U, 3), headings in (-pi, pi].
        """
        x, y, heading = np.asarray(pose, dtype=np.float64)
        out = np.array(self.relative)
        if self.frame == "body":
            cos, sin = np.cos(heading), np.sin(heading)
            out[:, 0] = cos * self.relative[:, 0] - sin * self.relative[:, 1]
            out[:, 1] = sin * self.relative[:, 0] + cos * self.relative[:, 1]
        out += (x, y, heading)
        out[:, 2] -= 2.0 * np.pi * (out[:, 2] > np.pi)
        out[:, 2] += 2.0 * np.pi * (out[:, 2] <= -np.pi)
        return out


def first_order(
    step_m: float = 0.2, *, stay: bool = False, step_s: float = 1.0
) -> MotionPrimitives:
    """First-order dynamics of section VI-A of Kantaros et al. 2019: eight displacements.

    Args:
        step_m: u_max times the step, metres; diagonal controls move by it on both axes.
        stay: Whether staying is a ninth control; the paper's set has none.
        step_s: Duration of a step, seconds.

    Returns:
        Controls in the order of the paper: [0, +-u], [+-u, 0], [+-u, +-u].

    Raises:
        InvalidInputError: If the step is not positive.
    """
    u = check_positive(step_m, "first-order step_m")
    moves = [(0, u), (0, -u), (u, 0), (-u, 0), (u, u), (u, -u), (-u, u), (-u, -u)]
    if stay:
        moves.append((0.0, 0.0))
    return MotionPrimitives(
        relative=np.array([(x, y, 0.0) for x, y in moves]), frame="world", step_s=step_s
    )


def differential_drive(
    speeds_m_per_s: Sequence[float] = (0.0, 0.2),
    turns_rad_per_s: Sequence[float] = KANTAROS_TURNS_RAD_PER_S,
    *,
    step_s: float = 1.0,
    spacing_m: float = 0.05,
) -> MotionPrimitives:
    """Differential drive: every speed with every turn rate, held for one step.

    Args:
        speeds_m_per_s: Forward speeds.
        turns_rad_per_s: Turn rates.
        step_s: Duration of a step, seconds.
        spacing_m: Greatest distance of waypoints along an arc, metres.

    Returns:
        Controls ordered by speed, then turn rate.

    Raises:
        InvalidInputError: If there is no control, or a number is not usable.
    """
    check_positive(step_s, "differential drive step_s")
    check_positive(spacing_m, "differential drive spacing_m")
    speeds = check_finite(speeds_m_per_s, "differential drive speeds", (None,))
    turns = check_finite(turns_rad_per_s, "differential drive turn rates", (None,))
    if not (speeds.size and turns.size):
        raise InvalidInputError(
            f"differential drive: expected at least one speed and one turn rate, got {speeds.size} "
            f"and {turns.size}"
        )
    longest = float(np.abs(speeds).max()) * step_s
    shares = np.arange(1, max(1, int(np.ceil(longest / spacing_m - 1e-9))) + 1, dtype=np.float64)
    times = step_s * shares / shares[-1]
    waypoints, relative = [], []
    for speed in speeds:
        for turn in turns:
            half = 0.5 * turn * times
            chord = speed * times * np.sinc(half / np.pi)
            way = np.stack([chord * np.cos(half), chord * np.sin(half)], axis=1)
            waypoints.append(way)
            relative.append((*way[-1], turn * step_s))
    return MotionPrimitives(
        relative=frozen(relative), frame="body", waypoints=frozen(waypoints), step_s=step_s
    )
