"""Covariances of a joint belief by eliminating its whole graph: the Standard approach.

Three ways to eliminate the same graph:

    marginals   gtsam.Marginals, what a good engineer writes: relinearises, Cholesky
    fastest     cached linear factors, wanted variables last, partial multifrontal elimination,
                inverse of what is left: the fastest that GTSAM was found to be
    qr          Householder QR of the whitened rows, wanted columns last: the oracle

Cholesky of A'A squares the condition. The QR reads cov = R^-1 R^-T off the triangle of the wanted
variables; its rows are sorted by decreasing norm first, because Householder reflections mix rows
and a weak row must not be drowned in the rounding of a strong one.

Where GTSAM throws on a well-posed graph, QR answers and the fall-back is counted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import gtsam
import numpy as np
from scipy.linalg import solve_triangular

from fgplan.beliefs.candidate_belief import BeliefProblem, insert_poses
from fgplan.beliefs.elimination import eliminate_graph, elimination_order
from fgplan.beliefs.square_root import RANK_TOLERANCE
from fgplan.errors import IllPosedBeliefError, InvalidInputError
from fgplan.factors.boundary import gtsam_boundary
from fgplan.factors.factor_set import FactorSet
from fgplan.factors.keys import describe_keys
from fgplan.factors.path_factors import local_factors, pair_factors, past_factors, path_keys
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import Covariance, IntArray, Key

Elimination = Literal["marginals", "fastest", "qr"]

DENSE_LIMIT = 600
"""Scalars up to which the QR is one dense LAPACK call."""


@dataclass(frozen=True, slots=True, eq=False)
class GraphPart:
    """Some planned factors as graphs that are built once and pushed often.

    Attributes:
        factors: The factors.
        graph: The same, nonlinear.
        linear: The same, linearised at the planned states.
    """

    factors: FactorSet
    graph: gtsam.NonlinearFactorGraph
    linear: gtsam.GaussianFactorGraph

    def cut(self, step: int | None) -> "GraphPart":
        """The part that the belief at a look-ahead step holds (equation 21)."""
        if step is None or step >= self.factors.last_step:
            return self
        graph, linear = gtsam.NonlinearFactorGraph(), gtsam.GaussianFactorGraph()
        for place, planned in enumerate(self.factors):
            if planned.step <= step:
                graph.push_back(planned.factor)
                linear.push_back(self.linear.at(place))
        return GraphPart(self.factors.cut(step), graph, linear)


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePart:
    """A candidate's own part: what no announcement changes.

    Attributes:
        part: Local factors, and those with past states of the others.
        poses: Planned poses, steps 1 to L.
    """

    part: GraphPart
    poses: gtsam.Values


@dataclass(frozen=True, slots=True, eq=False)
class CommonGraph:
    """What does not depend on the candidate: prior, announced paths, factors among them.

    Attributes:
        graph: Nonlinear factors.
        linear: The same, linearised.
        values: Estimates of the prior and poses of the announced paths.
    """

    graph: gtsam.NonlinearFactorGraph
    linear: gtsam.GaussianFactorGraph
    values: gtsam.Values


def graph_part(factors: FactorSet, values: gtsam.Values) -> GraphPart:
    """Build the graphs of some planned factors."""
    graph = factors.graph()
    with gtsam_boundary("linearising planned factors"):
        return GraphPart(factors, graph, graph.linearize(values))


def joint_values(problem: BeliefProblem, paths: Sequence[CandidatePath]) -> gtsam.Values:
    """Estimates of the prior and the planned poses of some paths."""
    values = gtsam.Values(problem.prior.values)
    values.insert(planned_poses(problem, paths))
    return values


def planned_poses(
    problem: BeliefProblem, paths: Sequence[CandidatePath], cut: int | None = None
) -> gtsam.Values:
    """The planned poses of some paths, from step 1 to L or the cut."""
    values = gtsam.Values()
    for path in paths:
        keys = path_keys(problem, path)
        insert_poses(values, keys if cut is None else keys[: cut + 1], path)
    return values


def own_part(problem: BeliefProblem, path: CandidatePath) -> GraphPart:
    """Factors of one path that no announcement changes: local, and with past states of others."""
    factors = local_factors(problem, path).factors + past_factors(problem, path).factors
    return graph_part(FactorSet(factors), joint_values(problem, [path]))


def candidate_part(problem: BeliefProblem, path: CandidatePath) -> CandidatePart:
    """A candidate's own part."""
    return CandidatePart(own_part(problem, path), planned_poses(problem, [path]))


def pair_part(problem: BeliefProblem, path: CandidatePath, other: CandidatePath) -> GraphPart:
    """Multi-robot factors between two paths."""
    return graph_part(pair_factors(problem, path, other), planned_poses(problem, [path, other]))


def common_graph(
    problem: BeliefProblem,
    announced: Mapping[str, CandidatePath],
    parts: Sequence[GraphPart],
    cut: int | None,
) -> CommonGraph:
    """Prior and announced paths as one graph.

    Args:
        problem: The prior.
        announced: Paths of the others.
        parts: Their factors.
        cut: Look-ahead step, or None for all.

    Returns:
        The graph that every candidate adds to.
    """
    graph = gtsam.NonlinearFactorGraph(problem.prior.graph)
    linear = problem.prior.linear()
    for part in parts:
        held = part.cut(cut)
        graph.push_back(held.graph)
        linear.push_back(held.linear)
    return CommonGraph(graph, linear, joint_values(problem, list(announced.values())))


def wanted_covariances(
    common: CommonGraph,
    parts: Sequence[GraphPart],
    poses: gtsam.Values,
    wanted: Sequence[tuple[Key, ...]],
    dims: Mapping[Key, int],
    elimination: Elimination,
) -> tuple[list[Covariance], bool]:
    """Joint covariances of several lists of variables under one candidate.

    Args:
        common: What does not depend on the candidate.
        parts: Factors of the candidate, cut already.
        poses: Planned poses of the candidate.
        wanted: Lists of keys; a joint covariance of each is returned.
        dims: Tangent dimension of each of those keys.
        elimination: How to eliminate.

    Returns:
        One covariance for each list, in the tangents of its keys; and whether GTSAM refused and
        QR answered.

    Raises:
        IllPosedBeliefError: If a variable is not determined.
    """
    if elimination == "marginals":
        graph, values = gtsam.NonlinearFactorGraph(common.graph), gtsam.Values(common.values)
        for part in parts:
            graph.push_back(part.graph)
        values.insert(poses)
        try:
            return _by_marginals(graph, values, wanted), False
        except IllPosedBeliefError:
            pass
    linear = gtsam.GaussianFactorGraph()
    linear.push_back(common.linear)
    for part in parts:
        linear.push_back(part.linear)
    keys = tuple(dict.fromkeys(key for group in wanted for key in group))
    if elimination == "fastest":
        try:
            return _split(_by_partial_elimination(linear, keys), keys, dims, wanted), False
        except IllPosedBeliefError:
            pass
    return _split(covariance_by_qr(linear, keys), keys, dims, wanted), elimination != "qr"


def covariance_by_qr(linear: gtsam.GaussianFactorGraph, keys: Sequence[Key]) -> Covariance:
    """Joint covariance of some keys of a linear graph by QR of its rows.

    Args:
        linear: The linear graph.
        keys: Keys in the order wanted.

    Returns:
        Shape (d, d), d the sum of the keys' dimensions.

    Raises:
        IllPosedBeliefError: If a variable is not determined.
        UnknownNameError: If a key is not in the graph.
    """
    zero = linear.gradientAtZero()
    order = elimination_order(linear, keys)
    if zero.vector().size > DENSE_LIMIT:
        return eliminate_graph(linear, keys).covariance(keys)
    ordering = gtsam.Ordering()
    for key in order:
        ordering.push_back(key)
    with gtsam_boundary("reading the rows of a linear graph"):
        rows = np.asarray(linear.jacobian(ordering)[0])
    strongest = np.argsort(-np.linalg.norm(rows, axis=1), kind="stable")
    triangle = np.asarray(np.linalg.qr(rows[strongest], mode="r"))
    pivots = np.abs(np.diagonal(triangle))
    if pivots.size < rows.shape[1] or (pivots < RANK_TOLERANCE * np.abs(rows).max(axis=0)).any():
        raise IllPosedBeliefError(
            f"joint belief: a variable is not determined by the factors, so {describe_keys(keys)} "
            "may have no covariance; add the missing factor (Belief names the variable)"
        )
    size = sum(zero.at(key).size for key in keys)
    inverse = solve_triangular(triangle[-size:, -size:], np.eye(size))
    return inverse @ inverse.T


def check_elimination(name: str) -> Elimination:
    """Check the name of a way to eliminate.

    Raises:
        InvalidInputError: If there is none of that name.
    """
    if name not in ("marginals", "fastest", "qr"):
        raise InvalidInputError(
            f"elimination: expected 'marginals', 'fastest' or 'qr', got {name!r}"
        )
    return name  # type: ignore[return-value]


def _by_marginals(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, wanted: Sequence[tuple[Key, ...]]
) -> list[Covariance]:
    """Covariances by gtsam.Marginals: single variables are cheaper than joint ones."""
    with gtsam_boundary("marginals of the joint belief"):
        marginals = gtsam.Marginals(graph, values)
        return [
            marginals.marginalCovariance(group[0])
            if len(group) == 1
            else marginals.jointMarginalCovariance(list(group)).fullMatrix()
            for group in wanted
        ]


def _by_partial_elimination(linear: gtsam.GaussianFactorGraph, keys: Sequence[Key]) -> Covariance:
    """Joint covariance: all other variables eliminated, what is left inverted.

    GTSAM puts the wanted variables last in an order of its own, so they are read by key.
    """
    with gtsam_boundary("partial elimination of the joint belief"):
        order = gtsam.Ordering.ColamdConstrainedLastGaussianFactorGraph(linear, list(keys))
        first = gtsam.Ordering()
        for place in range(order.size() - len(keys)):
            first.push_back(order.at(place))
        _, left = linear.eliminatePartialMultifrontal(first)
        ordering = gtsam.Ordering()
        for key in keys:
            ordering.push_back(key)
        information = np.asarray(left.hessian(ordering)[0])
    try:
        lower = np.linalg.cholesky(information)
    except np.linalg.LinAlgError as error:
        raise IllPosedBeliefError(
            f"joint belief: the information of {describe_keys(keys)} is not positive definite"
        ) from error
    inverse = solve_triangular(lower, np.eye(len(lower)), lower=True)
    return inverse.T @ inverse


def _split(
    joint: Covariance,
    keys: Sequence[Key],
    dims: Mapping[Key, int],
    wanted: Sequence[tuple[Key, ...]],
) -> list[Covariance]:
    """Blocks of a joint covariance for each list of keys."""
    place: dict[Key, IntArray] = {}
    start = 0
    for key in keys:
        place[key] = np.arange(start, start + dims[key])
        start += dims[key]
    blocks = []
    for group in wanted:
        rows = np.concatenate([place[key] for key in group])
        blocks.append(joint[np.ix_(rows, rows)])
    return blocks


def graph_of_parts(parts: Sequence[GraphPart]) -> gtsam.NonlinearFactorGraph:
    """The nonlinear factors of several parts as one graph."""
    graph = gtsam.NonlinearFactorGraph()
    for part in parts:
        graph.push_back(part.graph)
    return graph
