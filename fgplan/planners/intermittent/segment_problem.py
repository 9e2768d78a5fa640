"""What a team plans when it meets: problem (5), from each robot's next start to the next meeting.

Robot r_ij of team i starts at the place and time of its next meeting with its other team, which
is agreed already: starts differ in place and time. What the robots will measure until then on
tracks that are agreed counts towards the estimate.
"""

from dataclasses import dataclass, field

import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.estimate import Estimate
from fgplan.planners.intermittent.segment_model import StateModel
from fgplan.typing import FloatArray, IntArray
from roadmaps import Workspace


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SegmentProblem:
    """One team's problem.

    Attributes:
        workspace: Where bodies may be.
        model: How the state moves and is measured.
        estimate: The team's, at the time of planning.
        starts: Place of each body at its start, shape (B, 2), metres.
        times: Start of each body, steps, not before the estimate, shape (B,).
        tracks: Agreed places from the estimate's time on, one row a step, shape (H, B, 2); rows
            after a body's start are not read. Left out: nothing is measured before the start.
        carriers: Robot (of the model) of each carrier of sensors, shape (K,); one a body if left
            out.
        bodies: Body that each carrier rides on, shape (K,).
        offsets: Of each carrier from its body, shape (K, 2), metres.
        meets: Whether bodies must be connected at the end; a fixed formation always is.

    Raises:
        InvalidInputError: If shapes differ or a start is not free.
    """

    workspace: Workspace
    model: StateModel
    estimate: Estimate
    starts: FloatArray
    times: IntArray
    tracks: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 2)))
    carriers: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    bodies: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    offsets: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    meets: bool = True

    def __post_init__(self) -> None:
        """Check shapes and starts."""
        starts = check_finite(self.starts, "segment problem: starts", (None, 2))
        count = len(starts)
        times = np.asarray(self.times, dtype=np.int64)
        if times.shape != (count,) or count == 0 or times.min() < self.estimate.time:
            raise InvalidInputError(
                f"segment problem: expected one start time a body, not before the estimate's "
                f"{self.estimate.time}, got {times.tolist()} for {count} bodies"
            )
        plain = not len(self.carriers)
        carriers = np.arange(count) if plain else np.asarray(self.carriers, dtype=np.int64)
        bodies = np.arange(count) if not len(self.bodies) else np.asarray(self.bodies)
        offsets = np.zeros((len(carriers), 2)) if not len(self.offsets) else self.offsets
        offsets = check_finite(offsets, "segment problem: offsets", (len(carriers), 2))
        if bodies.shape != carriers.shape or (bodies < 0).any() or (bodies >= count).any():
            raise InvalidInputError(
                f"segment problem: expected a body of 0 to {count - 1} for each of "
                f"{len(carriers)} carriers, got {bodies.tolist()}"
            )
        tracks = np.asarray(self.tracks, dtype=np.float64)
        if tracks.size == 0:
            tracks = np.zeros((0, count, 2))
        tracks = check_finite(tracks, "segment problem: tracks", (None, count, 2))
        free = self.workspace.are_positions_valid(starts[bodies] + offsets)
        if not free.all():
            body = int(bodies[int(np.argmin(free))])
            raise InvalidInputError(
                f"segment problem: body {body}: expected a start in free space, got "
                f"{starts[body].tolist()}"
            )
        for name, value in (
            ("starts", starts),
            ("times", times),
            ("tracks", tracks),
            ("carriers", carriers.astype(np.int64)),
            ("bodies", bodies.astype(np.int64)),
            ("offsets", offsets),
        ):
            object.__setattr__(self, name, value)
