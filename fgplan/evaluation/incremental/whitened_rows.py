"""The reference form: whitened rows and one QR, slow and always right.

Rows are stacked factor by factor, sorted by decreasing size (Householder QR is then stable row by
row, however different the noises), with the variables that are read in the last columns; the
triangle that QR leaves on them is their square-root information. Used wherever the fast form
reports that digits were lost.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import qr, solve_triangular

from fgplan.evaluation.incremental.factor_blocks import joint_rows
from fgplan.evaluation.incremental.numbering import Numbering
from fgplan.evaluation.incremental.prior_marginal import PriorMarginal
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.pose import adjoint, between
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import Covariance, FloatArray, IntArray

Row = list[tuple[int, FloatArray]]
"""One factor: (first column, whitened block) of each variable."""


def universe_rows(
    problem: PlanningProblem,
    numbering: Numbering,
    prior: PriorMarginal,
    announced: Mapping[str, CandidatePath],
    column: IntArray,
    size: int,
) -> FloatArray:
    """Whitened rows of everybody else's belief.

    Args:
        problem: Team and models.
        numbering: Numbers of variables.
        prior: Marginal of the touched prior variables; its columns come first.
        announced: The others' paths.
        column: Shape (V,), first scalar of each variable, -1 where it is left out.
        size: Number of scalars.

    Returns:
        Shape (rows, size), sorted by decreasing size of row.
    """
    factors: list[Row] = [[(0, prior.rows)]]
    paths = list(announced.values())
    for index, path in enumerate(paths):
        at = [_start(problem, numbering, column, path.robot)]
        at += [int(column[numbering.pose(path.robot, s)]) for s in range(1, path.steps + 1)]
        factors += path_rows(problem, numbering, path, at, column)
        for other in paths[:index]:
            factors += meeting_rows(problem, numbering, path, at, other, column)
    return stacked(factors, size)


def path_rows(
    problem: PlanningProblem,
    numbering: Numbering,
    path: CandidatePath,
    at: Sequence[int],
    column: IntArray,
) -> list[Row]:
    """Rows of a path's own factors; ``at`` is the column of each pose, -1 beyond the cut."""
    factors: list[Row] = []
    past = [
        p
        for p in problem.past_states
        if p.state.robot != path.robot and p.key in numbering.prior_keys
    ]
    order = problem.robots.index(path.robot)
    for step in range(1, path.steps + 1):
        if at[step] < 0:
            break
        before, after = path.poses[step - 1], path.poses[step]
        weight = np.linalg.inv(np.linalg.cholesky(path.motion_covariances[step - 1]))
        by_old = -weight @ adjoint(between(after, before))
        factors.append([(at[step - 1], by_old), (at[step], weight)])
        for seen in path.observations:
            if seen.step == step:
                sensor, landmark = problem.sensors[seen.sensor], problem.prior.point(seen.landmark)
                noise = np.asarray(seen.covariance)
                own, other = sensor.linearise(path.poses[step], landmark, noise)
                variable = numbering.prior(seen.landmark)
                factors.append([(at[step], own), (int(column[variable]), other)])
        state = path.state(step)
        for p in past:
            first = problem.robots.index(p.state.robot) < order
            for model in problem.multi_robot:
                found = joint_rows(model, state, p.state, first) if model.include_past else None
                if found is not None:
                    where = int(column[numbering.prior(p.key)])
                    factors.append([(at[step], found[0]), (where, found[1])])
    return factors


def meeting_rows(
    problem: PlanningProblem,
    numbering: Numbering,
    path: CandidatePath,
    at: Sequence[int],
    other: CandidatePath,
    column: IntArray,
) -> list[Row]:
    """Rows of the multi-robot factors between a path and an announced one."""
    factors: list[Row] = []
    first = problem.robots.index(other.robot) < problem.robots.index(path.robot)
    for step in range(1, path.steps + 1):
        if at[step] < 0:
            break
        for second in range(1, other.steps + 1):
            where = int(column[numbering.pose(other.robot, second)])
            if where < 0:
                break
            for model in problem.multi_robot:
                found = joint_rows(model, path.state(step), other.state(second), first)
                if found is not None:
                    factors.append([(at[step], found[0]), (where, found[1])])
    return factors


def stacked(factors: Sequence[Row], size: int) -> FloatArray:
    """Factors as one dense matrix, rows sorted by decreasing size."""
    rows = np.zeros((sum(len(blocks[0][1]) for blocks in factors), size))
    r = 0
    for blocks in factors:
        height = len(blocks[0][1])
        for where, block in blocks:
            rows[r : r + height, where : where + block.shape[1]] += block
        r += height
    return rows[np.argsort(-np.abs(rows).max(axis=1), kind="stable")]


def posterior_by_qr(
    problem: PlanningProblem,
    numbering: Numbering,
    others: FloatArray,
    column: IntArray,
    path: CandidatePath,
    steps: int,
    announced: Mapping[str, CandidatePath],
    read_steps: Sequence[int],
    read_columns: IntArray,
) -> Covariance:
    """Covariance of what is read after following one candidate, by QR of all rows.

    Args:
        problem: Team and models.
        numbering: Numbers of variables.
        others: Rows of everybody else's belief, shape (rows, s).
        column: Shape (V,), first scalar of each variable in them.
        path: The candidate.
        steps: Its steps up to the cut.
        announced: The others' paths.
        read_steps: Steps of own poses that are read.
        read_columns: Shape (g,), scalars of the universe that are read after them.

    Returns:
        Shape (p d + g, p d + g).
    """
    size, dim = others.shape[1], path.dim
    at = [_start(problem, numbering, column, path.robot)]
    at += [size + dim * s if s < steps else -1 for s in range(path.steps)]
    factors = path_rows(problem, numbering, path, at, column)
    for other in announced.values():
        factors += meeting_rows(problem, numbering, path, at, other, column)
    total = size + dim * steps
    mine = stacked(factors, total)
    rows = np.vstack([np.hstack([others, np.zeros((len(others), total - size))]), mine])
    own = [size + dim * (s - 1) + np.arange(dim) for s in read_steps]
    read = np.concatenate([*own, read_columns], dtype=np.int64)
    rest = np.setdiff1d(np.arange(total), read)
    rows = rows[np.argsort(-np.abs(rows).max(axis=1), kind="stable")]
    columns = np.concatenate([rest, read])
    (triangle,) = qr(rows[:, columns], mode="r", check_finite=False)
    triangle = triangle[:total]
    half = solve_triangular(triangle[-len(read) :, -len(read) :], np.eye(len(read)))
    return half @ half.T


def _start(problem: PlanningProblem, numbering: Numbering, column: IntArray, robot: str) -> int:
    """Column of a robot's current pose."""
    return int(column[numbering.prior(problem.start_keys[robot])])
