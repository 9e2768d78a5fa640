"""What a change of announcements added, removed and touched.

Two factors are the same if they join the same states; a state is (step, time, vertex, pose), so the
pose variables that an old and a new announcement share are the same variables, and differences are
set differences. A candidate path is impacted if one of its variables is *connected* to a changed
announcement in the union of the graphs before and after, the candidates themselves left out. A path
that is not impacted keeps its own term; the others' terms shift by one constant for all such paths.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.evaluation.incremental.factor_blocks import FactorBlocks
from fgplan.evaluation.incremental.numbering import Numbering
from fgplan.evaluation.incremental.prior_marginal import PriorMarginal
from fgplan.paths.candidate_path import CandidatePath
from fgplan.typing import BoolArray, IntArray


@dataclass(frozen=True, slots=True)
class FactorChange:
    """Multi-robot factors before and after, by distinct own state.

    Attributes:
        added: Factors that are only in the new announcements.
        removed: Factors that are only in the old ones.
        kept: Factors in both.
        dirty: Shape (A,), own states with an added or removed factor.
        involved: Shape (A,), own states with any factor before or after.
    """

    added: int
    removed: int
    kept: int
    dirty: BoolArray
    involved: BoolArray


def same_path(first: CandidatePath | None, second: CandidatePath | None) -> bool:
    """Whether two announced paths are one: the same states, noise and observations."""
    if first is second:
        return True
    if first is None or second is None:
        return False
    return bool(
        first.length_m == second.length_m
        and first.vertices == second.vertices
        and np.array_equal(first.poses, second.poses)
        and np.array_equal(first.times_s, second.times_s)
        and np.array_equal(first.motion_covariances, second.motion_covariances)
        and _same_observations(first, second)
    )


def _same_observations(first: CandidatePath, second: CandidatePath) -> bool:
    """Whether two paths observe the same landmarks alike."""
    if len(first.observations) != len(second.observations):
        return False
    return all(
        (a.step, a.landmark, a.sensor) == (b.step, b.landmark, b.sensor)
        and np.array_equal(a.covariance, b.covariance)
        for a, b in zip(first.observations, second.observations, strict=True)
    )


def factor_change(
    numbering: Numbering,
    old: Mapping[str, CandidatePath],
    new: Mapping[str, CandidatePath],
    before: FactorBlocks,
    after: FactorBlocks,
    changed: Sequence[str],
    counted: BoolArray,
) -> FactorChange:
    """Compare the factors with announced poses before and after.

    Args:
        numbering: Numbers of variables.
        old: Announced paths before.
        new: Announced paths after.
        before: Factors of the own states before.
        after: Factors of the own states after.
        changed: Robots whose announced path changed.
        counted: Shape (A,), own states whose factors are counted; states that differ only in what
            they observe have the same factors.

    Returns:
        The difference by identity.
    """
    size = len(numbering.robots) * numbering.capacity
    gone, fresh = np.zeros(size, bool), np.zeros(size, bool)
    for robot in changed:
        first = numbering.pose(robot, 1)
        was, now = old.get(robot), new.get(robot)
        shared = 0 if was is None or now is None else min(was.steps, now.steps)
        if was is not None:
            gone[first : first + was.steps] = True
        if now is not None:
            fresh[first : first + now.steps] = True
        if was is not None and now is not None and shared:
            inner = tuple(range(1, was.poses.ndim))
            same = (was.poses[1 : shared + 1] == now.poses[1 : shared + 1]).all(axis=inner)
            same &= was.times_s[1 : shared + 1] == now.times_s[1 : shared + 1]
            same &= np.equal(was.vertices[1 : shared + 1], now.vertices[1 : shared + 1])
            gone[first : first + shared] &= ~same
            fresh[first : first + shared] &= ~same
    removed, added = gone[before.variable], fresh[after.variable]
    dirty = _any_by_state(before, removed) | _any_by_state(after, added)
    involved = (np.diff(before.pointer) > 0) | (np.diff(after.pointer) > 0)
    now_counted = np.repeat(counted, np.diff(after.pointer))
    was_counted = np.repeat(counted, np.diff(before.pointer))
    return FactorChange(
        added=int((added & now_counted).sum()),
        removed=int((removed & was_counted).sum()),
        kept=int((~added & now_counted).sum()),
        dirty=dirty,
        involved=involved,
    )


def _any_by_state(blocks: FactorBlocks, flag: BoolArray) -> BoolArray:
    """Whether any factor of each own state is flagged."""
    running = np.zeros(len(flag) + 1, np.int64)
    np.cumsum(flag, out=running[1:])
    any_flag: BoolArray = running[blocks.pointer[1:]] > running[blocks.pointer[:-1]]
    return any_flag


class Components:
    """Connected components of everything but the candidates, as a union-find forest."""

    def __init__(self, numbering: Numbering, prior: PriorMarginal) -> None:
        """Start from the prior: its variables by group, and every robot on its own."""
        self.numbering = numbering
        self.groups = prior.groups
        self.parent = list(range(len(prior.keys) + len(numbering.robots)))
        self.offset = len(prior.keys)

    def _find(self, node: int) -> int:
        while self.parent[node] != node:
            self.parent[node] = self.parent[self.parent[node]]
            node = self.parent[node]
        return node

    def join(self, first: int, second: int) -> None:
        """Join two nodes."""
        self.parent[self._find(first)] = self._find(second)

    def robot(self, robot: str) -> int:
        """Node of a robot's announced chain."""
        return self.offset + self.numbering.robots.index(robot)

    def add_factors(self, robot: str, variables: IntArray) -> None:
        """Join a robot's chain with all variables that its factors touch, by number."""
        me = self.robot(robot)
        for node in np.unique(self.nodes(variables)).tolist():
            self.join(me, node)

    def join_chains(self, first: IntArray, second: IntArray) -> None:
        """Join the chains of announced poses that have a factor, by number."""
        count, capacity = len(self.numbering.robots), self.numbering.capacity
        pairs = np.unique((first // capacity) * count + second // capacity)
        for pair in pairs.tolist():
            self.join(self.offset + pair // count, self.offset + pair % count)

    def nodes(self, variables: IntArray) -> IntArray:
        """Nodes of variables by number."""
        base = len(self.numbering.robots) * self.numbering.capacity
        is_prior = variables >= base
        chain = self.offset + variables // self.numbering.capacity
        place = np.where(is_prior, variables - base, 0)
        return np.where(is_prior, self.groups[place], chain)

    def labels(self) -> IntArray:
        """Root of every node."""
        return np.array([self._find(node) for node in range(len(self.parent))], np.int64)


def touched_candidates(candidate_states: IntArray, flags: BoolArray) -> BoolArray:
    """Candidates with a flagged own state: shape (N, Lmax), -1 padded, and (A,) to (N,)."""
    padded = np.append(flags, False)
    touched: BoolArray = np.any(padded[candidate_states], axis=1)
    return touched
