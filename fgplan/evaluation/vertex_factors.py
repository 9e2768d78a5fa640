"""Factors as the published algorithms tell them apart: by the announced vertex.

Algorithm 1 of Regev and Indelman 2017 keeps a multi-robot factor when its announced vertex is on
both the old and the new announced path (f1 and f2 of figure 2 are "actually identical factors"),
whatever the step, the time or the heading at which the vertex is passed. So a variable of an
announced path is named by (robot, vertex, how often the path was there before), not by its step.
Where there is no vertex the pose itself stands for it. Local factors are told apart by the
vertices, poses and noise that they join (section 4.1).
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass

from fgplan.beliefs.from_scratch import own_part, pair_part
from fgplan.beliefs.information import (
    FactorInformation,
    SparseInformation,
    Variable,
    factor_informations,
)
from fgplan.evaluation.problem import PlanningProblem
from fgplan.factors.path_factors import path_keys
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import FloatArray, Key


@dataclass(frozen=True, slots=True, eq=False)
class AnnouncedFactors:
    """An announced path in terms of its vertices.

    Attributes:
        path: The path.
        names: By step, the variable of each pose; step 0 is the prior's key.
        local: Information of its local factors, by identity.
    """

    path: CandidatePath
    names: tuple[Variable, ...]
    local: Mapping[Hashable, FactorInformation]


@dataclass(frozen=True, slots=True, eq=False)
class PairFactors:
    """Multi-robot factors between a candidate and an announced path.

    Attributes:
        by_vertex: By announced variable, the informations of its factors.
        joined: Pairs (own pose's bytes, announced variable) that are joined.
        vertices: Own roadmap vertices with a factor: V_inv of Algorithm 1.
    """

    by_vertex: Mapping[Variable, tuple[FactorInformation, ...]]
    joined: frozenset[tuple[bytes, Variable]]
    vertices: frozenset[int]


@dataclass(frozen=True, slots=True, eq=False)
class CandidateInformation:
    """What is kept of one candidate.

    Attributes:
        information: Lambda.
        announced: The announced paths that it holds.
        pairs: The multi-robot factors with them that it holds.
        terms: Unweighted terms, shape (T,).
    """

    information: SparseInformation
    announced: Mapping[str, AnnouncedFactors]
    pairs: Mapping[str, PairFactors]
    terms: FloatArray


def announced_factors(problem: PlanningProblem, path: CandidatePath) -> AnnouncedFactors:
    """Vertices and local factors of an announced path.

    Factors with past states of other robots depend on this path alone, so they count as local.
    """
    names = vertex_names(problem, path)
    by_key = dict(zip(path_keys(problem, path), names, strict=True))
    part = own_part(problem, path)
    local: dict[Hashable, FactorInformation] = {}
    informations = factor_informations(part, by_key, _prior_dims(problem), problem.dim)
    for planned, information in zip(part.factors, informations, strict=True):
        found = planned.identity
        poses = tuple(state[-1] for state in found.states)
        identity = (
            found.kind,
            found.model,
            information.variables,
            poses,
            found.noise,
            found.repeat,
        )
        local[identity] = information
    return AnnouncedFactors(path, names, local)


def pair_factors_by_vertex(
    problem: PlanningProblem, candidate: CandidatePath, announced: AnnouncedFactors
) -> PairFactors:
    """Multi-robot factors between a candidate and an announced path, by announced vertex."""
    by_key = dict(zip(path_keys(problem, announced.path), announced.names, strict=True))
    part = pair_part(problem, candidate, announced.path)
    by_vertex: dict[Variable, tuple[FactorInformation, ...]] = {}
    joined, vertices = set(), set()
    informations = factor_informations(part, by_key, {}, problem.dim)
    for planned, information in zip(part.factors, informations, strict=True):
        own, theirs = planned.identity.states
        key, other = planned.identity.variables
        if own[0] != candidate.robot:
            own, other = theirs, key
        name = by_key[other]
        by_vertex[name] = (*by_vertex.get(name, ()), information)
        joined.add((own[-1], name))
        if own[3] >= 0:
            vertices.add(own[3])
    return PairFactors(by_vertex, frozenset(joined), frozenset(vertices))


def factors_among(
    problem: PlanningProblem, first: AnnouncedFactors, second: AnnouncedFactors
) -> tuple[FactorInformation, ...]:
    """Multi-robot factors between two announced paths."""
    names = {
        key: name
        for one in (first, second)
        for key, name in zip(path_keys(problem, one.path), one.names, strict=True)
    }
    part = pair_part(problem, first.path, second.path)
    return factor_informations(part, names, {}, problem.dim)


def own_factors(problem: PlanningProblem, path: CandidatePath) -> tuple[FactorInformation, ...]:
    """Factors of a candidate that no announcement changes, its poses named by their keys."""
    part = own_part(problem, path)
    return factor_informations(part, {}, _prior_dims(problem), problem.dim)


def vertex_names(problem: PlanningProblem, path: CandidatePath) -> tuple[Variable, ...]:
    """Variables of an announced path: robot, vertex, and how often the path was there before."""
    names: list[Variable] = [problem.start_keys[path.robot]]
    visits: dict[Hashable, int] = {}
    for state in path.states():
        where = state.vertex if state.vertex >= 0 else state.pose.tobytes()
        visits[where] = visits.get(where, 0) + 1
        names.append((path.robot, where, visits[where]))
    return tuple(names)


def _prior_dims(problem: PlanningProblem) -> dict[Key, int]:
    """Tangent dimensions of what the prior holds."""
    return {key: problem.prior.dim(key) for key in problem.prior.keys}
