"""What a closed loop leaves behind, as it happens: a record a step, a record a planning session.

Everything that figures, animations, recordings and tables show is read from these; nothing of it
is computed again. Covariances are in the tangent of the pose they belong to (x, y, heading; in
space rotation first), as GTSAM's; positions and poses are in the world frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from fgplan.models.measurement import Measurement, Odometry
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.typing import Covariance, FloatArray, Key, Pose

Pairs = tuple[tuple[State, State], ...]
"""States of two robots that a multi-robot factor joins."""

Trigger = Literal["start", "goal", "obstacle"]
"""Why a planning session was held."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRecord:
    """One step: truth, what was read, and what SLAM makes of it.

    Attributes:
        step: Steps since the start; 0 is before anybody moved.
        time_s: Seconds since the start.
        session: Planning session under which the step was executed; 0 before the first.
        truth: True pose of each robot, shape (3,) or (4, 4).
        odometry: What the robots that moved read of their motion.
        measurements: What all robots measured.
        estimates: Estimated current pose of each robot, shape (3,) or (4, 4).
        covariances: Covariance of each estimate, shape (d, d).
        arrived: Robots that reached their goal with this step.
        collided: Robots whose true motion touched an obstacle or left the bounds.
        seconds: Seconds that the SLAM update took.
    """

    step: int
    time_s: float
    session: int
    truth: Mapping[str, Pose]
    odometry: tuple[Odometry, ...]
    measurements: tuple[Measurement, ...]
    estimates: Mapping[str, Pose]
    covariances: Mapping[str, Covariance]
    arrived: tuple[str, ...] = ()
    collided: tuple[str, ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamRecord:
    """The SLAM result at one moment: every pose so far and the map.

    Attributes:
        step: Steps since the start.
        trajectories: By robot, shape (n, 3) or (n, 4, 4), one pose a step from step 0 on (a robot
            that stands still has no new one).
        trajectory_steps: By robot, the step of each pose, n of them.
        covariances: By robot, shape (n, d, d).
        landmarks: Estimated position of each mapped landmark, shape (2,) or (3,), metres.
        landmark_covariances: Shape (2, 2) or (3, 3), square metres.
        seen_by: Robots that have measured each landmark.
    """

    step: int
    trajectories: Mapping[str, FloatArray]
    trajectory_steps: Mapping[str, tuple[int, ...]]
    covariances: Mapping[str, FloatArray]
    landmarks: Mapping[Key, FloatArray]
    landmark_covariances: Mapping[Key, Covariance]
    seen_by: Mapping[Key, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluatorRecord:
    """One evaluator's go at a planning session.

    Attributes:
        seconds: From the first evaluation to agreement, all preparation included.
        chosen: Index of the candidate that each robot ended with.
        objective: Common objective at the end.
        turns: Turns that agreement took.
        impacted_share: Mean share of a robot's candidates that an announcement impacted, over all
            evaluations but each robot's first; None where there is none.
    """

    seconds: float
    chosen: Mapping[str, int]
    objective: float
    turns: int
    impacted_share: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionRecord:
    """One planning session: what was known, what could be done, what was agreed.

    Attributes:
        session: Number, from 1.
        step: Step at which it was held.
        time_s: Seconds since the start.
        trigger: Why it was held.
        renewed: Robots that got new candidates alone; the others kept theirs, or some of them.
        goals: Current goal of each robot that has one left, shape (2,) or (3,), metres.
        goal_numbers: Which of its goals that is, from 1.
        estimate: The SLAM result that planning starts from.
        candidates: Candidate paths by robot; none for a robot that has reached its last goal.
        chosen: Path of each robot that has one.
        chosen_index: Its place among the candidates.
        covariances: Along each chosen path, every path followed to its end, shape (L + 1, d, d).
        joined: States that multi-robot factors join along the chosen paths.
        values: Objective after round 0 and after each accepted announcement.
        announced_by: Who announced; "all" for round 0; as many as values.
        runs: By evaluator, the same session planned by it; the first is the one executed.
        max_rel_diff: Largest relative difference of any objective term of any candidate under the
            final announcements, against from scratch by QR; None where not compared.
        counts: Whole numbers by name: factors, vertices, messages reused and rebuilt, solves, ...
        segments_reused: By robot, segment messages taken over from earlier sessions.
        segments_rebuilt: By robot, segment messages of kept candidates that were built anew.
        candidates_kept: By robot, candidates kept from the session before.
        candidates_replaced: By robot, candidates that are new.
        unreachable: By robot, why a goal was given up before this session.
        obstacles: Polygons seen for the first time since the session before, shape (corners, 2).
    """

    session: int
    step: int
    time_s: float
    trigger: Trigger
    renewed: tuple[str, ...]
    goals: Mapping[str, FloatArray]
    goal_numbers: Mapping[str, int]
    estimate: SlamRecord
    candidates: Mapping[str, tuple[CandidatePath, ...]]
    chosen: Mapping[str, CandidatePath]
    chosen_index: Mapping[str, int]
    covariances: Mapping[str, FloatArray]
    joined: Pairs
    values: tuple[float, ...]
    announced_by: tuple[str, ...]
    runs: Mapping[str, EvaluatorRecord]
    max_rel_diff: float | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    segments_reused: Mapping[str, int] = field(default_factory=dict)
    segments_rebuilt: Mapping[str, int] = field(default_factory=dict)
    candidates_kept: Mapping[str, int] = field(default_factory=dict)
    candidates_replaced: Mapping[str, int] = field(default_factory=dict)
    unreachable: Mapping[str, str] = field(default_factory=dict)
    obstacles: tuple[FloatArray, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenUpRecord:
    """The end of a loop in which no goal that is left can be reached.

    Attributes:
        step: Steps since the start.
        time_s: Seconds since the start.
        unreachable: By robot, why its goals were given up.
    """

    step: int
    time_s: float
    unreachable: Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopHistory:
    """A closed loop from its start to its end, or as far as it has come.

    Attributes:
        name: Title.
        robots: Names in the order of the team.
        goals: Goals of each robot in the order in which it visits them, shape (G, 2) or (G, 3),
            metres.
        landmarks: True position of every landmark, metres.
        steps: All steps so far, the first is step 0.
        sessions: All planning sessions so far.
        final: The SLAM result after the last step; None while the loop runs.
        given_up: Set if the loop ended because no goal that was left could be reached.
    """

    name: str
    robots: tuple[str, ...]
    goals: Mapping[str, FloatArray]
    landmarks: Mapping[Key, FloatArray]
    steps: tuple[StepRecord, ...]
    sessions: tuple[SessionRecord, ...]
    final: SlamRecord | None = None
    given_up: GivenUpRecord | None = None

    @property
    def unreachable(self) -> Mapping[str, tuple[str, ...]]:
        """By robot, why goals were given up, in order; robots that gave up none are left out."""
        ends = (self.given_up,) if self.given_up is not None else ()
        found: dict[str, tuple[str, ...]] = {}
        for record in (*self.sessions, *ends):
            for robot, why in record.unreachable.items():
                found[robot] = (*found.get(robot, ()), why)
        return found

    @property
    def reached(self) -> Mapping[str, int]:
        """Number of goals that each robot has reached."""
        return {
            robot: sum(robot in record.arrived for record in self.steps) for robot in self.robots
        }
