"""What the team minimises: a weighted sum of terms over robots and look-ahead steps.

Equations (4) and (5) of Regev and Indelman 2017,

    J = E[ sum_l sum_r c_l^r(b[X_{k+l}^r], u_{k+l}^r) ],

with (41) as the usual case: J = sum_r kappa_goal t_goal + kappa_Sigma tr(Sigma_goal). A term reads
the belief of some variables at some look-ahead step; the belief at step l holds only factors all
of whose states have step <= l (equation 21), for all robots, and a path that has ended keeps its
last state. ``end``: every announced path followed to its end. ``arrival``: the last step of one
robot. Otherwise the steps given, and the term is the sum over them.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any, Literal

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.models.uncertainty import uncertainty_function
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import Key

Block = Literal["position", "pose", "heading"]
Read = Literal["end", "arrival"] | tuple[int, ...]


@dataclass(frozen=True, slots=True)
class PosesOf:
    """The poses of some robots at the step that is read, jointly; one robot is the usual case.

    Attributes:
        robots: Names; one robot is ``PosesOf(("ann",))``.
    """

    robots: tuple[str, ...]

    def __post_init__(self) -> None:
        """Check that there are several names, not the letters of one."""
        object.__setattr__(self, "robots", _listed(self.robots, str, "PosesOf robots", "a name"))
        if len(set(self.robots)) != len(self.robots):
            raise InvalidInputError(f"PosesOf robots: expected each once, got {self.robots}")


@dataclass(frozen=True, slots=True)
class Trajectory:
    """All future poses of one robot up to the step that is read, jointly."""

    robot: str


@dataclass(frozen=True, slots=True)
class PriorVariables:
    """Variables that the prior holds, jointly: landmarks, past or current poses.

    Attributes:
        keys: GTSAM keys; one variable is ``PriorVariables((key,))``.
    """

    keys: tuple[Key, ...]

    def __post_init__(self) -> None:
        """Check that there are keys."""
        object.__setattr__(
            self, "keys", _listed(self.keys, Integral, "PriorVariables keys", "a key")
        )


VariableSet = PosesOf | Trajectory | PriorVariables


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyTerm:
    """Uncertainty of some variables.

    Attributes:
        of: The variables.
        function: Name in the registry of ``fgplan.models.uncertainty``.
        block: Part of every pose: position (square metres, the default), pose or heading.
        weight: Factor in the objective.
        read: ``end``, ``arrival`` or look-ahead steps.
        arrival_of: Whose arrival is meant; by default the only robot of ``of``.
    """

    of: VariableSet
    function: str = "trace"
    block: Block = "position"
    weight: float = 1.0
    read: Read = "end"
    arrival_of: str | None = None

    def __post_init__(self) -> None:
        """Check the combination of fields."""
        if not isinstance(self.of, PosesOf | Trajectory | PriorVariables):
            raise InvalidInputError(
                "objective term: expected of = PosesOf((robot,)), Trajectory(robot) or "
                f"PriorVariables((key,)), got {self.of!r}"
            )
        uncertainty_function(self.function)
        _check_weight(self.weight)
        if self.block not in ("position", "pose", "heading"):
            raise InvalidInputError(
                f"objective term: expected block position, pose or heading, got {self.block!r}"
            )
        if isinstance(self.read, tuple):
            whole = all(isinstance(s, int) and not isinstance(s, bool) for s in self.read)
            if not self.read or not whole or min(self.read) < 0:
                raise InvalidInputError(
                    "objective term: expected look-ahead steps, whole numbers of zero or more, got "
                    f"{self.read}"
                )
        elif self.read not in ("end", "arrival"):
            raise InvalidInputError(
                f"objective term: expected read 'end', 'arrival' or steps, got {self.read!r}"
            )
        if self.read == "arrival" and self.arrival_of is None:
            only = self.of.robot if isinstance(self.of, Trajectory) else None
            if isinstance(self.of, PosesOf) and len(self.of.robots) == 1:
                only = self.of.robots[0]
            if only is None:
                raise InvalidInputError(
                    "objective term: read 'arrival' of several variables needs arrival_of, the "
                    "robot whose last step is meant"
                )
            object.__setattr__(self, "arrival_of", only)


@dataclass(frozen=True, slots=True, kw_only=True)
class PathLengthTerm:
    """Length of one robot's path, metres."""

    robot: str
    weight: float = 1.0

    def __post_init__(self) -> None:
        """Check the weight."""
        _check_weight(self.weight)

    def value(self, path: CandidatePath) -> float:
        """Length of a path, metres."""
        return path.length_m


@dataclass(frozen=True, slots=True, kw_only=True)
class TravelTimeTerm:
    """Time of arrival of one robot, seconds."""

    robot: str
    weight: float = 1.0

    def __post_init__(self) -> None:
        """Check the weight."""
        _check_weight(self.weight)

    def value(self, path: CandidatePath) -> float:
        """Time at the last pose, seconds."""
        return float(path.times_s[-1])


@dataclass(frozen=True, slots=True, kw_only=True)
class PathTerm:
    """A user's own number of one robot's path.

    Attributes:
        robot: Name of the robot.
        name: Name in reports.
        function: Maps the path to a number; the same for the same path, however often it is asked.
        weight: Factor in the objective.
    """

    robot: str
    name: str
    function: Callable[[CandidatePath], float]
    weight: float = 1.0

    def __post_init__(self) -> None:
        """Check the weight."""
        _check_weight(self.weight)

    def value(self, path: CandidatePath) -> float:
        """The user's number.

        Raises:
            InvalidInputError: If it is not finite.
        """
        number = float(self.function(path))
        if not np.isfinite(number):
            raise InvalidInputError(
                f"objective term {self.name!r} of robot {self.robot!r}: expected a finite number, "
                f"got {number}"
            )
        return number


OfPath = PathLengthTerm | TravelTimeTerm | PathTerm
Term = UncertaintyTerm | PathLengthTerm | TravelTimeTerm | PathTerm


@dataclass(frozen=True, slots=True)
class Objective:
    """A weighted sum of terms, the same for the whole team.

    Attributes:
        terms: In fixed order; a robot without a path contributes its current pose and no length.
    """

    terms: tuple[Term, ...]

    def __post_init__(self) -> None:
        """Check that there is something to minimise."""
        object.__setattr__(self, "terms", _listed(self.terms, Term, "objective terms", "a term"))

    @property
    def bounded(self) -> bool:
        """Whether lower bounds on covariances bound the objective from below."""
        return all(
            uncertainty_function(term.function).monotone and term.weight >= 0.0
            for term in self.terms
            if isinstance(term, UncertaintyTerm)
        )


def length_and_uncertainty(
    robots: Sequence[str], path_weight: float = 0.1, uncertainty_weight: float = 1.0
) -> Objective:
    """Objective (41) of Regev and Indelman 2017: path length and position uncertainty at the goal.

    Args:
        robots: Names of all robots of the team.
        path_weight: kappa_goal of (41), called kappa_path in the text; the paper uses 0.1.
        uncertainty_weight: kappa_Sigma of (41), called kappa_uncert in the text; the paper uses 1.

    Returns:
        Two terms a robot: weight times length in metres, weight times trace in square metres.

    Raises:
        InvalidInputError: If there is no robot, or a name in place of a list of names.
    """
    terms: list[Term] = []
    for robot in _listed(robots, str, "length_and_uncertainty robots", "a name"):
        terms.append(PathLengthTerm(robot=robot, weight=path_weight))
        terms.append(UncertaintyTerm(of=PosesOf((robot,)), weight=uncertainty_weight))
    return Objective(tuple(terms))


def _listed(given: Any, kind: Any, name: str, what: str) -> tuple[Any, ...]:  # noqa: ANN401
    """What a caller lists, as a tuple; one by itself or nothing is refused."""
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise InvalidInputError(
            f"{name}: expected a tuple or list, got {given!r}; write ({given!r},)"
        )
    listed = tuple(given)
    if not listed:
        raise InvalidInputError(f"{name}: expected at least one, got none")
    for item in listed:
        if not isinstance(item, kind):
            raise InvalidInputError(f"{name}: expected {what} each, got {item!r}")
    return listed


def _check_weight(weight: float) -> None:
    """Refuse a weight that is not a finite number."""
    if not np.isfinite(weight):
        raise InvalidInputError(f"objective term: expected a finite weight, got {weight!r}")
