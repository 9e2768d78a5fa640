"""Everybody else's belief: S, the joint covariance of all that is outside a robot's candidates.

The universe of robot r holds the touched variables of the prior and every announced pose of the
others, with the prior, the others' motion and observation factors, and the multi-robot factors
among them. Its information is a sum of blocks, built anew from the factors each time (nothing is
ever subtracted), and S is its inverse by Cholesky. One S serves all candidates. Where a pivot has
cancelled - a loose prior beside tight odometry - S comes from a QR of the whitened rows instead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack, qr, solve_triangular

from fgplan.evaluation.incremental.candidate_table import step_blocks
from fgplan.evaluation.incremental.factor_blocks import (
    FactorBlocks,
    StateSet,
    merge,
    multi_robot_blocks,
    no_blocks,
    past_states_of,
    states_of,
)
from fgplan.evaluation.incremental.numbering import Numbering
from fgplan.evaluation.incremental.observation_blocks import observation_blocks
from fgplan.evaluation.incremental.observation_table import ObservationTable, observation_table
from fgplan.evaluation.incremental.prior_marginal import PriorMarginal
from fgplan.evaluation.incremental.whitened_rows import universe_rows
from fgplan.evaluation.problem import PlanningProblem
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import Covariance, FloatArray, IntArray

CANCELLATION_LIMIT = 1e-4
"""A squared pivot below this share of its diagonal entry has lost too many digits."""


@dataclass(frozen=True, slots=True)
class InformationBlocks:
    """Blocks of an information matrix by variable numbers, see ``scatter``."""

    row: IntArray
    column: IntArray
    needed: IntArray
    blocks: FloatArray


@dataclass(frozen=True, slots=True)
class Universe:
    """Others' belief at one cut.

    Attributes:
        column: Shape (V,), first scalar of each variable in S, -1 where it is not in.
        width: Shape (V,), dimension of each variable.
        covariance: S, shape (s, s).
        by_qr: Whether Cholesky had lost digits and S comes from a QR.
    """

    column: IntArray
    width: IntArray
    covariance: Covariance
    by_qr: bool


def path_blocks(
    problem: PlanningProblem, numbering: Numbering, path: CandidatePath
) -> InformationBlocks:
    """Blocks of an announced path's own factors: motion, landmarks, past poses of others."""
    late, cross, early = step_blocks(path.poses[:-1], path.poses[1:], path.motion_covariances)
    number = numbering.pose(path.robot, 1) + np.arange(path.steps)
    before = number - 1
    before[0] = numbering.prior(problem.start_keys[path.robot])
    seen = observation_table([path])
    fixed = fixed_blocks(problem, numbering, states_of(problem, [path]), seen)
    row, column, needed, blocks = _of_factors(fixed, number)
    return InformationBlocks(
        np.concatenate([number, number, before, row]),
        np.concatenate([number, before, before, column]),
        np.concatenate([number, number, number, needed]),
        np.concatenate([late, cross, early, blocks]),
    )


def fixed_blocks(
    problem: PlanningProblem,
    numbering: Numbering,
    own: StateSet,
    observations: ObservationTable,
) -> FactorBlocks:
    """Factors of some states that do not depend on announcements: landmarks and past poses.

    Args:
        problem: Prior, team and models.
        numbering: Numbers of variables.
        own: A states of one robot.
        observations: Planned observations of landmarks from each.

    Returns:
        The table over the A states.
    """
    tables = []
    if len(observations.landmark):
        tables.append(observation_blocks(problem, own.poses, observations, numbering.prior))
    robot = numbering.robots[own.places[0]]
    known = set(numbering.prior_keys)
    past = [p for p in problem.past_states if p.state.robot != robot and p.key in known]
    if past:
        variables = np.array([numbering.prior(p.key) for p in past], np.int64)
        others = past_states_of(problem, past)
        tables.append(multi_robot_blocks(problem, own, others, variables, past=True))
    return merge(tables) if tables else no_blocks(len(own.poses), problem.dim)


def meeting_blocks(
    problem: PlanningProblem, numbering: Numbering, paths: Sequence[CandidatePath]
) -> InformationBlocks:
    """Blocks of the multi-robot factors among announced paths."""
    everyone = states_of(problem, paths)
    number = np.concatenate(
        [numbering.pose(path.robot, 1) + np.arange(path.steps) for path in paths]
    )
    factors = multi_robot_blocks(problem, everyone, everyone, number, each_once=True)
    return InformationBlocks(*_of_factors(factors, number))


def _of_factors(
    factors: FactorBlocks, number: IntArray
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Blocks of a table as (row, column, needed, block)."""
    own = np.repeat(number, np.diff(factors.pointer))
    return (
        np.concatenate([own, factors.variable, factors.variable]),
        np.concatenate([own, factors.variable, own]),
        np.concatenate([factors.variable, own, own]),
        np.concatenate([factors.own, factors.other, factors.cross]),
    )


def widths(dim: int, numbering: Numbering, prior: PriorMarginal) -> IntArray:
    """Tangent dimension of each variable.

    Args:
        dim: That of a pose.
        numbering: Numbers of variables.
        prior: Marginal of ``numbering.prior_keys``.

    Returns:
        Shape (V,).
    """
    poses = np.full(len(numbering.robots) * numbering.capacity, dim, np.int64)
    return np.concatenate([poses, prior.dims])


def build_universe(
    problem: PlanningProblem,
    numbering: Numbering,
    prior: PriorMarginal,
    announced: Mapping[str, CandidatePath],
    pieces: list[InformationBlocks],
    cut: int | None,
) -> Universe:
    """Joint covariance of the prior variables and the others' announced poses.

    Args:
        problem: Team and models.
        numbering: Numbers of variables.
        prior: Marginal of ``numbering.prior_keys``.
        announced: The others' paths.
        pieces: Blocks of all their factors, from ``path_blocks`` and ``meeting_blocks``.
        cut: Look-ahead step beyond which states and their factors are left out; None for none.

    Returns:
        The universe at that cut.
    """
    from fgplan.evaluation.incremental.scatter_kernels import mirror_upper, scatter

    dim = problem.dim
    base = len(numbering.robots) * numbering.capacity
    column = np.full(base + len(prior.keys), -1, np.int64)
    width = widths(dim, numbering, prior)
    column[base:] = prior.offsets
    size = len(prior.rows)
    for robot, path in announced.items():
        steps = path.steps if cut is None else min(path.steps, cut)
        first = numbering.pose(robot, 1)
        column[first : first + steps] = size + dim * np.arange(steps)
        size += dim * steps
    information = np.zeros((size, size))
    known = len(prior.rows)
    information[:known, :known] = prior.rows.T @ prior.rows
    for piece in pieces:
        scatter(information, piece.row, piece.column, piece.needed, piece.blocks, column, width)
    diagonal = information.diagonal().copy()
    # the transpose of a symmetric C-ordered matrix is itself in LAPACK's order: nothing is copied
    factor, failed = lapack.dpotrf(information.T, lower=True, overwrite_a=True)
    if not failed and (factor.diagonal() ** 2 >= CANCELLATION_LIMIT * diagonal).all():
        inverse, _ = lapack.dpotri(factor, lower=True, overwrite_c=True)
        covariance = inverse.T
        mirror_upper(covariance)
        return Universe(column, width, covariance, False)
    rows = universe_rows(problem, numbering, prior, announced, column, size)
    (triangle,) = qr(rows, mode="r", check_finite=False)
    half = solve_triangular(triangle[:size], np.eye(size))
    return Universe(column, width, np.ascontiguousarray(half @ half.T), True)
