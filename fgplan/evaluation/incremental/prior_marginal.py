"""What planning needs of the past: the joint marginal of a few variables, kept as information.

Everything that no path touches is eliminated once a prior by QR; what QR leaves on the kept
variables, R with R'R = information, is never inverted, so a loose prior beside tight odometry
loses nothing. The variables worth keeping (current poses, landmarks, past poses that may be met)
are left by one elimination of the whole history; those touched by a path so far are left by a
small QR of that.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import qr
from scipy.sparse import csgraph

from fgplan.evaluation.objective import PriorVariables, UncertaintyTerm
from fgplan.evaluation.problem import PlanningProblem
from fgplan.typing import FloatArray, IntArray, Key

KEPT_SCALARS = 1500
"""Most scalars that the one elimination of the history leaves."""

NEARLY_ALL, FEW_SCALARS = 1.3, 100
"""Nothing is left out of a marginal that has at most so many times the scalars that are touched, or
so few: the larger S costs less than one QR more at every announcement."""


@dataclass(frozen=True, slots=True)
class PriorMarginal:
    """Joint marginal of some variables of the prior.

    Attributes:
        keys: The variables; the current poses of all robots come first, in team order.
        dims: Shape (n,), tangent dimension of each.
        offsets: Shape (n,), first scalar of each.
        rows: R, shape (s, s), upper triangular: R'R is the information.
        groups: Shape (n,), number of the connected component of each variable.
    """

    keys: tuple[Key, ...]
    dims: IntArray
    offsets: IntArray
    rows: FloatArray
    groups: IntArray


def eliminate_history(problem: PlanningProblem, touched: Iterable[Key]) -> PriorMarginal:
    """Leave everything that planning may touch: the one elimination of the whole history.

    Args:
        problem: Holds the prior.
        touched: Keys that are needed in any case.

    Returns:
        Current poses, keys of the objective and ``touched``; all landmarks that are expected and
        all past poses that may be met as well, unless they are too many.
    """
    prior = problem.prior
    # the same order for every robot of a team: the belief then remembers one elimination for all
    wide = dict.fromkeys(needed_keys(problem, ()))
    landmarks = problem.expected_landmarks
    if landmarks is None:
        landmarks = tuple(key for key in prior.keys if prior.kinds[key].startswith("Point"))
    wide.update(dict.fromkeys(landmarks))
    wide.update(dict.fromkeys(past.key for past in problem.past_states))
    wide.update(dict.fromkeys(touched))
    keys = tuple(wide)
    if sum(prior.dim(key) for key in keys) > KEPT_SCALARS:
        keys = needed_keys(problem, touched)
    return _marginal(keys, [prior.dim(key) for key in keys], prior.square_root_information(keys))


def needed_keys(problem: PlanningProblem, touched: Iterable[Key]) -> tuple[Key, ...]:
    """Current poses, variables of the objective and touched ones, in fixed order."""
    keys = dict.fromkeys(problem.start_keys.values())
    for term in problem.objective.terms:
        if isinstance(term, UncertaintyTerm) and isinstance(term.of, PriorVariables):
            keys.update(dict.fromkeys(term.of.keys))
    keys.update(dict.fromkeys(touched))
    return tuple(keys)


def numbered_keys(
    problem: PlanningProblem, wide: PriorMarginal, touched: Iterable[Key]
) -> tuple[Key, ...]:
    """Variables of the prior that take part in S.

    Args:
        problem: Holds the prior.
        wide: Marginal that holds all of ``touched``.
        touched: Keys that paths touch so far.

    Returns:
        The needed ones; all of the marginal where those are nearly all, so that announcements
        which touch the rest do not ask for another QR.
    """
    keys = needed_keys(problem, touched)
    scalars = sum(problem.prior.dim(key) for key in keys)
    return wide.keys if wide.dims.sum() <= max(FEW_SCALARS, NEARLY_ALL * scalars) else keys


def restrict(wide: PriorMarginal, keys: Sequence[Key]) -> PriorMarginal:
    """Marginal of some of the variables, by QR with the others first.

    Args:
        wide: Marginal that holds all of ``keys``.
        keys: Variables wanted, in order.

    Returns:
        Their joint marginal.
    """
    if tuple(keys) == wide.keys:
        return wide
    place = {key: index for index, key in enumerate(wide.keys)}
    kept = [place[key] for key in keys]
    dropped = sorted(set(range(len(wide.keys))) - set(kept))
    columns = np.concatenate(
        [np.arange(wide.dims[i]) + wide.offsets[i] for i in [*dropped, *kept]], dtype=np.int64
    )
    size = int(wide.dims[kept].sum())
    (triangle,) = qr(wide.rows[:, columns], mode="r", check_finite=False)
    return _marginal(tuple(keys), wide.dims[kept], triangle[: len(columns)][-size:, -size:])


def _marginal(
    keys: tuple[Key, ...], dims: Sequence[int] | IntArray, rows: FloatArray
) -> PriorMarginal:
    """Find the connected components: variables that share a row of R."""
    widths = np.asarray(dims, np.int64)
    offsets = np.cumsum(widths) - widths
    size = len(keys)
    row, scalar = np.nonzero(rows)
    owner = np.repeat(np.arange(size), widths)
    # rows and variables are the two sides of a graph
    sides = sparse.coo_array(
        (np.ones(len(row), np.int8), (owner[scalar], size + row)),
        shape=(2 * (size + len(rows)),) * 2,
    )
    _, labels = csgraph.connected_components(sides, directed=False)
    groups = np.asarray(labels[:size], np.int64)
    return PriorMarginal(keys, widths, offsets, np.ascontiguousarray(rows), groups)
