"""From covariances to the values of objective terms: what is read, where, and what it is worth.

An uncertainty term reads a set of variables at one or several look-ahead steps (the *cuts*). The
belief at cut l holds every factor all of whose states have step <= l (equation 21 of Regev and
Indelman 2017), and a robot whose path has ended keeps its last state, so at cut l

    pose of robot r        its state at step min(l, L_r); its current pose where that is 0
    trajectory of robot r  its states 1 to min(l, L_r) jointly; its current pose where that is 0
    prior variables        themselves

``end`` is the cut max_r L_r, beyond which nothing changes; ``arrival`` is L_q of one robot q; given
steps are summed over. Which variables are read depends on the paths only through their numbers of
steps, so candidates of one length share their readings and their arithmetic, which is batched:
covariances have shape (N, n, n).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.errors import IllPosedBeliefError, InvalidInputError
from fgplan.evaluation.objective import Block, PosesOf, Trajectory, UncertaintyTerm
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.pose import heading_slice, position_slice
from fgplan.models.uncertainty import uncertainty_function
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import Covariance, FloatArray, IntArray, Key


@dataclass(frozen=True, slots=True)
class PoseAt:
    """Pose of a robot at a step of its path; step 0 is its current pose in the prior."""

    robot: str
    step: int


@dataclass(frozen=True, slots=True)
class PriorKey:
    """A variable of the prior."""

    key: Key


VariableRef = PoseAt | PriorKey


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One reading of one objective term.

    Attributes:
        term: Place of the term in the objective.
        function: Name of its uncertainty function.
        variables: Variables read, jointly, in order.
        rows: Scalars of the term's block within the stacked tangents of ``variables``.
        joint_rows: The same scalars within the stacked tangents of the cut's variables.
    """

    term: int
    function: str
    variables: tuple[VariableRef, ...]
    rows: IntArray
    joint_rows: IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class CutReadings:
    """All that the objective reads from the belief at one look-ahead step.

    Attributes:
        cut: Look-ahead step; the last cut holds every factor.
        final: Whether no path goes beyond this cut.
        variables: Distinct variables of all readings, in order of first use.
        dims: Tangent dimension of each, shape (len(variables),).
        readings: Readings by term.
    """

    cut: int
    final: bool
    variables: tuple[VariableRef, ...]
    dims: IntArray
    readings: tuple[Reading, ...]


def path_steps(paths: Mapping[str, CandidatePath]) -> dict[str, int]:
    """Number of steps of each robot's path: all that readings depend on."""
    return {robot: path.steps for robot, path in paths.items()}


def objective_readings(
    problem: PlanningProblem, steps: Mapping[str, int]
) -> tuple[CutReadings, ...]:
    """What the objective reads when the robots' paths have these numbers of steps.

    Args:
        problem: Objective and prior.
        steps: Number of steps of each robot's path; a robot left out stays at its current pose.

    Returns:
        Readings by increasing cut.

    Raises:
        InvalidInputError: If a term compares future poses with a prior that does not hold them.
    """
    last = max(steps.values(), default=0)
    by_cut: dict[int, list[tuple[int, UncertaintyTerm]]] = {}
    for place, term in enumerate(problem.objective.terms):
        if isinstance(term, UncertaintyTerm):
            for cut in _cuts(term, steps, last):
                by_cut.setdefault(cut, []).append((place, term))
    return tuple(
        _cut_readings(problem, steps, cut, cut == last, by_cut[cut]) for cut in sorted(by_cut)
    )


def prior_covariances(problem: PlanningProblem) -> dict[int, Covariance]:
    """Covariance under the prior of each term that compares with it (mutual information).

    Returns:
        By place of the term, the covariance of the block that the term reads, shape (n, n).

    Raises:
        InvalidInputError: If such a term reads future poses, which the prior does not hold.
    """
    found = {}
    for place, term in enumerate(problem.objective.terms):
        if not isinstance(term, UncertaintyTerm):
            continue
        if not uncertainty_function(term.function).needs_prior:
            continue
        if isinstance(term.of, PosesOf | Trajectory):
            raise InvalidInputError(
                f"objective term {place}: {term.function} compares with the prior, so it needs "
                "PriorVariables (landmarks, past or current poses), got future poses of "
                f"{term.of.robots if isinstance(term.of, PosesOf) else term.of.robot}"
            )
        rows = _block_rows(problem, [PriorKey(key) for key in term.of.keys], term.block)
        covariance = problem.prior.covariance(term.of.keys)
        found[place] = covariance[np.ix_(rows, rows)]
    return found


def reading_value(
    reading: Reading, covariance: FloatArray, prior: Mapping[int, Covariance]
) -> FloatArray:
    """Unweighted value of one reading.

    Args:
        reading: The reading.
        covariance: Covariance of the term's block (of ``reading.rows``), shape (N, n, n).
        prior: From ``prior_covariances``.

    Returns:
        Shape (N,).

    Raises:
        IllPosedBeliefError: If a covariance is not positive definite.
        InvalidInputError: If the function does not give one number a covariance.
    """
    function = uncertainty_function(reading.function)
    try:
        values = function.evaluate(covariance, prior.get(reading.term))
    except np.linalg.LinAlgError as error:
        raise IllPosedBeliefError(
            f"objective term {reading.term} ({function.name}): a covariance of "
            f"{covariance.shape[-1]} rows is not positive definite; a direction without any "
            "uncertainty has no determinant or entropy"
        ) from error
    found = np.asarray(values, dtype=np.float64)
    if found.shape != covariance.shape[:-2]:
        raise InvalidInputError(
            f"uncertainty function {function.name!r}: expected {covariance.shape[:-2]} numbers "
            f"for covariances of shape {covariance.shape}, got shape {found.shape}; write it for "
            "the last two axes, as in np.trace(covariance, axis1=-2, axis2=-1)"
        )
    return found


def uncertainty_values(
    problem: PlanningProblem,
    cut: CutReadings,
    covariance: FloatArray,
    prior: Mapping[int, Covariance],
) -> FloatArray:
    """Unweighted values of all that is read at one cut.

    Args:
        problem: Holds the terms.
        cut: What is read.
        covariance: Joint covariance of ``cut.variables``, shape (N, n, n).
        prior: From ``prior_covariances``.

    Returns:
        Shape (N, T), zero for terms that do not read here; the sum over cuts is the terms' value.
    """
    values = np.zeros((len(covariance), len(problem.objective.terms)))
    for reading in cut.readings:
        rows = reading.joint_rows
        block = covariance[:, rows[:, None], rows]
        values[:, reading.term] += reading_value(reading, block, prior)
    return values


def path_values(
    problem: PlanningProblem, paths: Mapping[str, CandidatePath], robots: Sequence[str]
) -> FloatArray:
    """Unweighted values of the terms of some robots' paths: length, time, a user's own.

    Args:
        problem: Holds the terms.
        paths: Path of each robot that has one.
        robots: Robots whose terms are wanted; so the announced ones are asked once a turn.

    Returns:
        Shape (T,), zero for other terms and for robots without a path.
    """
    values = np.zeros(len(problem.objective.terms))
    for place, term in enumerate(problem.objective.terms):
        if isinstance(term, UncertaintyTerm) or term.robot not in robots:
            continue
        if term.robot in paths:
            values[place] = term.value(paths[term.robot])
    return values


def _cuts(term: UncertaintyTerm, steps: Mapping[str, int], last: int) -> tuple[int, ...]:
    """Cuts of one term; beyond the last step of any path nothing changes."""
    if isinstance(term.read, tuple):
        return tuple(min(step, last) for step in term.read)
    if term.read == "end" or term.arrival_of is None:
        return (last,)
    return (steps.get(term.arrival_of, 0),)


def _variables(
    term: UncertaintyTerm, steps: Mapping[str, int], cut: int
) -> tuple[VariableRef, ...]:
    """Variables that a term reads at a cut."""
    if isinstance(term.of, PosesOf):
        return tuple(PoseAt(robot, min(cut, steps.get(robot, 0))) for robot in term.of.robots)
    if isinstance(term.of, Trajectory):
        last = min(cut, steps.get(term.of.robot, 0))
        return tuple(PoseAt(term.of.robot, step) for step in range(min(1, last), last + 1))
    return tuple(PriorKey(key) for key in term.of.keys)


def _cut_readings(
    problem: PlanningProblem,
    steps: Mapping[str, int],
    cut: int,
    final: bool,
    terms: Sequence[tuple[int, UncertaintyTerm]],
) -> CutReadings:
    """Readings of all terms at one cut."""
    wanted = [(place, term, _variables(term, steps, cut)) for place, term in terms]
    variables = tuple(dict.fromkeys(ref for _, _, refs in wanted for ref in refs))
    dims = np.array([_dim(problem, ref) for ref in variables], dtype=np.int64)
    offset = dict(zip(variables, (np.cumsum(dims) - dims).tolist(), strict=True))
    readings = []
    for place, term, refs in wanted:
        rows = _block_rows(problem, refs, term.block)
        stacked = np.concatenate(
            [np.arange(_dim(problem, ref)) + offset[ref] for ref in refs], dtype=np.int64
        )
        readings.append(
            Reading(
                term=place,
                function=term.function,
                variables=refs,
                rows=rows,
                joint_rows=stacked[rows],
            )
        )
    return CutReadings(
        cut=cut, final=final, variables=variables, dims=dims, readings=tuple(readings)
    )


def _dim(problem: PlanningProblem, ref: VariableRef) -> int:
    """Tangent dimension of a variable."""
    return problem.dim if isinstance(ref, PoseAt) else problem.prior.dim(ref.key)


def _block_rows(problem: PlanningProblem, refs: Sequence[VariableRef], block: Block) -> IntArray:
    """Scalars of a block within the stacked tangents: part of every pose, all of every point."""
    rows: list[int] = []
    start = 0
    for ref in refs:
        dim = _dim(problem, ref)
        inside = range(dim)
        if block != "pose" and (isinstance(ref, PoseAt) or _is_pose(problem, ref.key)):
            part = position_slice(dim) if block == "position" else heading_slice(dim)
            inside = range(part.start, part.stop)
        rows.extend(start + i for i in inside)
        start += dim
    return np.array(rows, dtype=np.int64)


def _is_pose(problem: PlanningProblem, key: Key) -> bool:
    """Whether a variable of the prior is a pose, not a point."""
    return problem.prior.kinds[key] in ("Pose2", "Pose3")
