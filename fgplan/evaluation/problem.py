"""What is given to an evaluator, the same for every robot of the team.

All robots hold the same prior, objective, criterion and order; each has its own candidate paths.
The evaluator of robot r sees this problem, r's candidates and the announced paths of the others.
A robot that has announced nothing stays where the prior says it is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from fgplan.beliefs.belief import Belief
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.evaluation.objective import (
    Objective,
    PosesOf,
    PriorVariables,
    Trajectory,
    UncertaintyTerm,
)
from fgplan.factors.keys import check_no_future_keys, describe_key
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.multi_robot import MultiRobotModel
from fgplan.paths.state import State
from fgplan.typing import Key, Pose

_PARTS: tuple[tuple[str, type, str], ...] = (
    ("prior", Belief, "make one: Belief(graph, values)"),
    ("start_keys", Mapping, "give the key of each robot's current pose, as in {'ann': key}"),
    ("objective", Objective, "make one: Objective((term, ...))"),
    ("sensors", Mapping, "give each its name, as in {'lidar': sensor}"),
)
"""Of what kind a problem's parts are, and what to do about others."""


@dataclass(frozen=True, slots=True)
class PastState:
    """A past pose that may take part in multi-robot factors.

    Attributes:
        key: Its GTSAM key in the prior.
        state: Robot, step (negative), time (negative seconds) and pose.
    """

    key: Key
    state: State


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanningProblem:
    """Prior, team, objective and models: what every robot knows alike.

    Attributes:
        prior: Belief at planning time over everything so far.
        start_keys: Key of each robot's current pose in the prior, in the order of the team.
        objective: What the team minimises.
        multi_robot: Models of factors between robots; several may hold at once.
        sensors: Sensors of mapped landmarks by name.
        past_states: Past poses that may take part in multi-robot factors.
        expected_landmarks: Landmarks that paths may observe; None expects any. It only says what is
            worth keeping when the past is eliminated: a path that observes another landmark is
            evaluated as exactly, after one more elimination.
    """

    prior: Belief
    start_keys: Mapping[str, Key]
    objective: Objective
    multi_robot: tuple[MultiRobotModel, ...] = ()
    sensors: Mapping[str, AbstractSensor] = field(default_factory=dict)
    past_states: tuple[PastState, ...] = ()
    expected_landmarks: tuple[Key, ...] | None = None

    def __post_init__(self) -> None:
        """Check names and keys against each other."""
        for name, kind, remedy in _PARTS:
            if not isinstance(getattr(self, name), kind):
                raise InvalidInputError(
                    f"planning problem {name}: expected {kind.__name__}, got "
                    f"{type(getattr(self, name)).__name__}; {remedy}"
                )
        object.__setattr__(self, "start_keys", dict(self.start_keys))
        object.__setattr__(self, "sensors", dict(self.sensors))
        for name, kind in (("multi_robot", MultiRobotModel), ("past_states", PastState)):
            given = getattr(self, name)
            if not (isinstance(given, Sequence) and all(isinstance(one, kind) for one in given)):
                raise InvalidInputError(
                    f"planning problem {name}: expected a tuple of {kind.__name__}, got {given!r}; "
                    "write a single one as (it,)"
                )
            object.__setattr__(self, name, tuple(given))
        if not self.start_keys:
            raise InvalidInputError("planning problem: expected at least one robot, got none")
        if len(set(self.start_keys.values())) != len(self.start_keys):
            raise InvalidInputError(
                "planning problem: expected one current pose a robot, got two robots on one key"
            )
        dims = {robot: self.prior.dim(key) for robot, key in self.start_keys.items()}
        if len(set(dims.values())) > 1:
            raise InvalidInputError(
                f"planning problem: expected planar or spatial robots, got both: {dims}"
            )
        check_no_future_keys(self.prior.keys)
        seen: set[Key] = set()
        for past in self.past_states:
            self.prior.dim(past.key)
            if past.key in seen:
                raise InvalidInputError(
                    f"past state {describe_key(past.key)}: expected each once, got it twice"
                )
            seen.add(past.key)
            if past.state.robot not in self.start_keys:
                raise UnknownNameError(f"past state: robot {past.state.robot!r} is not in the team")
        if self.expected_landmarks is not None:
            object.__setattr__(self, "expected_landmarks", tuple(self.expected_landmarks))
            for landmark in self.expected_landmarks:
                self.prior.dim(landmark)
        for term in self.objective.terms:
            self._check_term(term)

    @property
    def robots(self) -> tuple[str, ...]:
        """Names in the order of the team."""
        return tuple(self.start_keys)

    @property
    def dim(self) -> int:
        """Dimension of a pose's tangent: 3 planar, 6 spatial."""
        return self.prior.dim(next(iter(self.start_keys.values())))

    def check_paths(self, paths: Sequence[CandidatePath]) -> None:
        """Check that paths belong to this problem.

        Raises:
            UnknownNameError: If a robot, a landmark or a sensor is not known.
            InvalidInputError: If a dimension or start pose differs from the prior's.
        """
        dim = self.dim
        starts: dict[str, Pose] = {}
        landmarks: set[Key] = set()
        for path in paths:
            if path.robot not in self.start_keys:
                known = ", ".join(self.robots)
                raise UnknownNameError(f"path of robot {path.robot!r}: expected one of {known}")
            if path.dim != dim:
                raise InvalidInputError(
                    f"path of robot {path.robot!r}: expected poses of tangent dimension {dim}, "
                    f"got {path.dim}"
                )
            if path.robot not in starts:
                starts[path.robot] = self.prior.pose(self.start_keys[path.robot])
            self._check_start(path, starts[path.robot])
            for sensor in {seen.sensor for seen in path.observations}:
                if sensor not in self.sensors:
                    known = ", ".join(self.sensors) or "none"
                    raise UnknownNameError(
                        f"path of robot {path.robot!r}: sensor {sensor!r} is not one of: {known}"
                    )
            landmarks.update(seen.landmark for seen in path.observations)
        for landmark in sorted(landmarks):
            self.prior.dim(landmark)

    def check_path(self, path: CandidatePath) -> None:
        """Check one path, see ``check_paths``."""
        self.check_paths((path,))

    def check_announced(self, announced: Mapping[str, CandidatePath]) -> None:
        """Check one path a robot: each under its own robot's name, and see ``check_paths``.

        Args:
            announced: Path of each robot that has one.

        Raises:
            UnknownNameError: If a robot, a landmark or a sensor is not known.
            InvalidInputError: If it is no mapping, a path is filed under another robot's name, or
                a dimension or start pose differs from the prior's.
        """
        if not isinstance(announced, Mapping):
            raise InvalidInputError(
                "announced paths: expected a mapping of robot to path, as in {'ann': path}, got "
                f"{type(announced).__name__}"
            )
        for robot, path in announced.items():
            if robot not in self.start_keys:
                known = ", ".join(self.robots)
                raise UnknownNameError(f"announced path of {robot!r}: expected one of {known}")
            if not isinstance(path, CandidatePath):
                raise InvalidInputError(
                    f"announced path of robot {robot!r}: expected a CandidatePath, got "
                    f"{type(path).__name__}"
                )
            if path.robot != robot:
                raise InvalidInputError(
                    f"announced path of robot {robot!r}: got a path of robot {path.robot!r}"
                )
        self.check_paths(tuple(announced.values()))

    def _check_start(self, path: CandidatePath, start: Pose) -> None:
        """Check that pose 0 is the prior's estimate."""
        if path.poses[0].tobytes() == start.tobytes():  # the usual case, several times faster
            return
        if abs(path.poses[0] - start).max() > 1e-9 * max(1.0, abs(start).max()):
            raise InvalidInputError(
                f"path of robot {path.robot!r}: expected pose 0 at the estimate {start}, got "
                f"{path.poses[0]}; paths start from the prior's current pose"
            )

    def _check_term(self, term: object) -> None:
        """Check that the robots and keys of one objective term exist."""
        if not isinstance(term, UncertaintyTerm):
            robots: tuple[str, ...] = (term.robot,)  # type: ignore[attr-defined]
        elif isinstance(term.of, PosesOf):
            robots = term.of.robots
        elif isinstance(term.of, Trajectory):
            robots = (term.of.robot,)
        else:
            robots = ()
        if isinstance(term, UncertaintyTerm):
            if isinstance(term.of, PriorVariables):
                for key in term.of.keys:
                    self.prior.dim(key)
            if term.arrival_of is not None:
                robots = (*robots, term.arrival_of)
        for robot in robots:
            if robot not in self.start_keys:
                known = ", ".join(self.robots)
                raise UnknownNameError(f"objective: robot {robot!r} is not one of {known}")
