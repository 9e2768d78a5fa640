"""Information blocks of factors between the states of a path and variables outside it.

A factor with whitened rows A_i x_i + A_v x_v enters everything only by A_i'A_i, A_v'A_i and
A_v'A_v. Blocks of one path's states stand in one table, rows sorted by state. Which factors there
are follows the rule of ``fgplan.factors``: a future state of one robot is joined with future states
of another and with the past states that the problem lists, never with one of its own robot.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fgplan.evaluation.incremental.spatial_blocks import spatial_pairs, spatial_relative_blocks
from fgplan.evaluation.problem import PastState, PlanningProblem
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.multi_robot import DistanceCriterion, MultiRobotModel
from fgplan.paths.state import State
from fgplan.typing import FloatArray, IntArray


class FactorBlocks(NamedTuple):
    """Blocks of factors, sorted by own state; a tuple, because compiled code takes it as it is.

    Attributes:
        pointer: Shape (A + 1,), where the factors of each own state begin.
        variable: Shape (M,), what each factor joins its state with: a number of the caller's.
        rank: Shape (M,), rows of each factor.
        own: Shape (M, d, d), A_i'A_i.
        cross: Shape (M, d, d), A_v'A_i; rows beyond the variable's dimension are zero.
        other: Shape (M, d, d), A_v'A_v, likewise.
    """

    pointer: IntArray
    variable: IntArray
    rank: IntArray
    own: FloatArray
    cross: FloatArray
    other: FloatArray

    @property
    def bytes(self) -> int:
        """Memory held."""
        return sum(int(array.nbytes) for array in self)


@dataclass(frozen=True, slots=True)
class StateSet:
    """Some states by their poses; the states themselves are made only where a model asks.

    Attributes:
        poses: Shape (A, 3) or (A, 4, 4), world frame.
        places: Shape (A,), place of each state's robot in the team.
        states: Makes the states.
    """

    poses: FloatArray
    places: IntArray
    states: Callable[[], Sequence[State]]


def states_of(problem: PlanningProblem, paths: Sequence[CandidatePath]) -> StateSet:
    """Future states of some paths, one path after the other."""
    places = [problem.robots.index(path.robot) for path in paths]
    return StateSet(
        np.ascontiguousarray(np.concatenate([path.poses[1:] for path in paths])),
        np.repeat(places, [path.steps for path in paths]),
        lambda: [state for path in paths for state in path.states()],
    )


def past_states_of(problem: PlanningProblem, past: Sequence[PastState]) -> StateSet:
    """Some past states of the problem."""
    return StateSet(
        np.ascontiguousarray([p.state.pose for p in past]),
        np.array([problem.robots.index(p.state.robot) for p in past], np.int64),
        lambda: [p.state for p in past],
    )


def no_blocks(states: int, dim: int) -> FactorBlocks:
    """A table without factors for a number of own states."""
    none = np.zeros(0, np.int64)
    blocks = np.zeros((0, dim, dim))
    return FactorBlocks(np.zeros(states + 1, np.int64), none, none, blocks, blocks, blocks)


def stack_rows(
    per_state: Sequence[Sequence[tuple[int, FloatArray, FloatArray]]], dim: int
) -> FactorBlocks:
    """Make a table from whitened rows.

    Args:
        per_state: For each own state (variable, A_i, A_v) of its factors, of shapes (m, d), (m, n).
        dim: Tangent dimension d of a pose, at least n.

    Returns:
        The table.
    """
    pointer = np.zeros(len(per_state) + 1, np.int64)
    pointer[1:] = np.cumsum([len(factors) for factors in per_state])
    size = int(pointer[-1])
    variable, rank = np.empty(size, np.int64), np.empty(size, np.int64)
    own, cross, other = np.zeros((3, size, dim, dim))
    m = 0
    for factors in per_state:
        for number, by_own, by_other in factors:
            width = by_other.shape[1]
            variable[m], rank[m] = number, len(by_own)
            own[m] = by_own.T @ by_own
            cross[m, :width] = by_other.T @ by_own
            other[m, :width, :width] = by_other.T @ by_other
            m += 1
    return FactorBlocks(pointer, variable, rank, own, cross, other)


def merge(tables: Sequence[FactorBlocks]) -> FactorBlocks:
    """One table of several over the same own states."""
    if len(tables) == 1:
        return tables[0]
    count = sum(np.diff(table.pointer) for table in tables)
    pointer = np.zeros(len(tables[0].pointer), np.int64)
    pointer[1:] = np.cumsum(count)
    owner = np.concatenate(
        [np.repeat(np.arange(len(t.pointer) - 1), np.diff(t.pointer)) for t in tables]
    )
    order = np.argsort(owner, kind="stable")
    return FactorBlocks(
        pointer,
        np.concatenate([t.variable for t in tables])[order],
        np.concatenate([t.rank for t in tables])[order],
        np.concatenate([t.own for t in tables])[order],
        np.concatenate([t.cross for t in tables])[order],
        np.concatenate([t.other for t in tables])[order],
    )


def joint_rows(
    model: MultiRobotModel, state: State, other: State, other_first: bool
) -> tuple[FloatArray, FloatArray] | None:
    """Whitened rows (own, other) of the factor that joins two states, or None."""
    first, second = (other, state) if other_first else (state, other)
    if not model.joins(first, second):
        return None
    by_first, by_second = model.sensor.linearise_between(first.pose, second.pose)
    return (by_second, by_first) if other_first else (by_first, by_second)


def multi_robot_blocks(
    problem: PlanningProblem,
    own: StateSet,
    others: StateSet,
    variables: IntArray,
    *,
    past: bool = False,
    each_once: bool = False,
) -> FactorBlocks:
    """Blocks of all multi-robot factors between states of different robots.

    Args:
        problem: Prior, team and models.
        own: A states.
        others: B states; those of the same robot as an own state are left alone.
        variables: Shape (B,), number of each other state for the table.
        past: Whether the others are past states, which some models leave out.
        each_once: Whether ``own`` and ``others`` are the same states and each pair is wanted
            once.

    Returns:
        The table over the A states.
    """
    models = [m for m in problem.multi_robot if m.include_past or not past]
    if not models or not len(own.poses) or not len(others.poses):
        return no_blocks(len(own.poses), problem.dim)
    return merge(
        [
            _relative_poses(model, own, others, variables, each_once)
            if is_relative_within(model, problem.dim)
            else _any_model(problem, model, own, others, variables, each_once)
            for model in models
        ]
    )


def is_relative_within(model: MultiRobotModel, dim: int) -> bool:
    """Whether a model is that of the paper: a relative pose within a distance."""
    return (
        type(model.criterion) is DistanceCriterion  # a subclass may have a rule of its own
        and isinstance(model.sensor, RelativePoseSensor)
        and len(model.sensor.covariance) == dim
    )


def _relative_poses(
    model: MultiRobotModel,
    own: StateSet,
    others: StateSet,
    variables: IntArray,
    each_once: bool,
) -> FactorBlocks:
    """The default model, all pairs at once."""
    planar = own.poses.ndim == 2
    if planar:
        from fgplan.evaluation.incremental.factor_kernels import near_pairs, relative_pose_blocks
    else:
        near_pairs, relative_pose_blocks = spatial_pairs, spatial_relative_blocks
    omega = np.linalg.inv(model.sensor.covariance)  # type: ignore[union-attr]
    pointer, found = near_pairs(
        own.poses,
        own.places,
        others.poses,
        others.places,
        model.criterion.distance_m,  # type: ignore[attr-defined]
        each_once,
    )
    blocks = relative_pose_blocks(
        own.poses, others.poses, pointer, found, own.places, others.places, omega
    )
    return FactorBlocks(pointer, variables[found], np.full(len(found), len(omega)), *blocks)


def _any_model(
    problem: PlanningProblem,
    model: MultiRobotModel,
    own: StateSet,
    others: StateSet,
    variables: IntArray,
    each_once: bool,
) -> FactorBlocks:
    """Any other criterion or sensor, pair by pair."""
    per_state: list[list[tuple[int, FloatArray, FloatArray]]] = []
    other_states = list(zip(others.states(), others.places.tolist(), strict=True))
    for state, place in zip(own.states(), own.places.tolist(), strict=True):
        factors = []
        for index, (other, other_place) in enumerate(other_states):
            if other_place == place or (each_once and other_place > place):
                continue
            rows = joint_rows(model, state, other, other_place < place)
            if rows is not None:
                factors.append((int(variables[index]), *rows))
        per_state.append(factors)
    return stack_rows(per_state, problem.dim)
