"""Planned factors with their provenance, and what an announcement adds and removes.

The identity of a factor is (type, variables, states, noise). A state is a robot's pose at a step
and time over a vertex: heading depends on the edge by which a vertex was reached, so the state, not
the vertex, is the key. Two factors of one identity are the same factor, and the difference of two
sets is the set difference over identities (the FG^add and FG^rmv of section 4.1 of Regev and
Indelman 2017).

A factor enters the belief at look-ahead step l when all of its states have step <= l (equation
21, getFactorsCausal): its own *step* is the largest of them. Past and current states have steps of
zero and below, so only future states count.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import gtsam

from fgplan.paths.state import State
from fgplan.typing import Key

FactorKind = Literal["motion", "observation", "multi_robot"]
StateIdentity = tuple[str, int, float, int, bytes]
"""Robot, step, time, vertex and the bytes of the pose."""


def state_identity(state: State) -> StateIdentity:
    """What tells one state from another."""
    return (state.robot, state.step, state.time_s, state.vertex, state.pose.tobytes())


@dataclass(frozen=True, slots=True)
class FactorId:
    """Identity of a planned factor.

    Attributes:
        kind: Motion, observation or multi-robot.
        model: Which model of that kind: a sensor's name, or the place of a multi-robot model.
        variables: GTSAM keys, in the order of the factor.
        states: Identities of the states, in the order of the factor; a landmark has none.
        noise: Digest of the noise covariance.
        repeat: Counts equal observations planned twice, which are two measurements.
    """

    kind: FactorKind
    model: str
    variables: tuple[Key, ...]
    states: tuple[StateIdentity, ...]
    noise: bytes
    repeat: int = 0

    @property
    def robots(self) -> tuple[str, ...]:
        """Robots whose states the factor joins, in the order of the factor, each once."""
        return tuple(dict.fromkeys(state[0] for state in self.states))

    @property
    def step(self) -> int:
        """Look-ahead step from which the factor takes part: the largest of its states."""
        return max(state[1] for state in self.states)


@dataclass(frozen=True, slots=True)
class PlannedFactor:
    """A GTSAM factor and where it came from.

    Attributes:
        identity: Its identity; also kind and robots.
        factor: The factor, with zero error at the planned states.
        step: Largest step of its states.
    """

    identity: FactorId
    factor: gtsam.NonlinearFactor
    step: int


@dataclass(frozen=True, slots=True)
class FactorSet:
    """Planned factors in a fixed order, no identity twice.

    Attributes:
        factors: The factors.
    """

    factors: tuple[PlannedFactor, ...] = ()

    def __len__(self) -> int:
        """Number of factors."""
        return len(self.factors)

    def __iter__(self) -> Iterator[PlannedFactor]:
        """Factors in order."""
        return iter(self.factors)

    def identities(self) -> tuple[FactorId, ...]:
        """Identities in order."""
        return tuple(planned.identity for planned in self.factors)

    @property
    def last_step(self) -> int:
        """Largest step of any factor; 0 without factors."""
        return max((planned.step for planned in self.factors), default=0)

    def cut(self, step: int | None) -> "FactorSet":
        """Factors all of whose states have a step of at most ``step`` (equation 21); None: all."""
        if step is None or step >= self.last_step:
            return self
        return FactorSet(tuple(planned for planned in self.factors if planned.step <= step))

    def graph(self) -> gtsam.NonlinearFactorGraph:
        """The factors as a GTSAM graph, in order."""
        graph = gtsam.NonlinearFactorGraph()
        for planned in self.factors:
            graph.push_back(planned.factor)
        return graph


def join_factor_sets(sets: Iterable[FactorSet]) -> FactorSet:
    """Factors of several sets in order, each identity once."""
    distinct = {planned.identity: planned for one in sets for planned in one}
    return FactorSet(tuple(distinct.values()))


@dataclass(frozen=True, slots=True)
class FactorDifference:
    """What changed between two sets of factors.

    Attributes:
        added: Factors only in the new set, in its order.
        removed: Factors only in the old set, in its order.
        kept: Factors in both, in the order of the new set.
    """

    added: FactorSet
    removed: FactorSet
    kept: FactorSet


def factor_difference(before: FactorSet, after: FactorSet) -> FactorDifference:
    """Set difference over identities.

    Args:
        before: Factors under the old announcements.
        after: Factors under the new ones.

    Returns:
        FG^add and FG^rmv of section 4.1 of Regev and Indelman 2017, and what both share.
    """
    old, new = set(before.identities()), set(after.identities())
    return FactorDifference(
        added=FactorSet(tuple(f for f in after if f.identity not in old)),
        removed=FactorSet(tuple(f for f in before if f.identity not in new)),
        kept=FactorSet(tuple(f for f in after if f.identity in old)),
    )
