"""Figure 7: one re-evaluation in which an announcement impacts some candidate paths and not all.

A planning session is followed turn by turn: which paths a robot knew at its last evaluation, which
it knows now, which candidates are impacted, and which multi-robot factors its candidates lost, kept
and gained between the two.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.bench.open_world import OpenWorld
from fgplan.bench.session import CONTESTANTS, plan_session
from fgplan.factors.multi_robot import joined_pairs
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.reproduce.regev_fig6.scenario import draw_scenario

CRITERIA_M = (300.0, 200.0, 100.0)
"""Criteria tried, the paper's first; with a shorter one fewer candidates are impacted."""

SETS_TRIED = 5

Pair = tuple[State, State]


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnouncementChange:
    """What a robot found when others had changed their announcements.

    Attributes:
        world: The world with its candidates.
        number: Number of the candidate set.
        criterion_m: Distance below which poses are joined, metres.
        turn: Turn of the session.
        robot: Who evaluated.
        before: The others' paths at its last evaluation.
        after: The others' paths now.
        impacted: Indices of its impacted candidates.
        kept: Multi-robot factors of its candidates before and now, as pairs of states.
        removed: Those of before alone.
        added: Those of now alone.
    """

    world: OpenWorld
    number: int
    criterion_m: float
    turn: int
    robot: str
    before: Mapping[str, CandidatePath]
    after: Mapping[str, CandidatePath]
    impacted: tuple[int, ...]
    kept: tuple[Pair, ...]
    removed: tuple[Pair, ...]
    added: tuple[Pair, ...]

    @property
    def factors(self) -> int:
        """Number of factors in the picture."""
        return len(self.kept) + len(self.removed) + len(self.added)

    @property
    def shows_all(self) -> bool:
        """Whether the picture has impacted and untouched candidates and factors of all kinds."""
        some = 0 < len(self.impacted) < len(self.world.candidates[self.robot])
        return some and all(len(pairs) > 0 for pairs in (self.kept, self.removed, self.added))


def find_change(robots: int, candidates: int) -> AnnouncementChange | None:
    """Find a moment worth a picture, with the paper's criterion if there is one.

    Args:
        robots: Robots of the scenario.
        candidates: Candidates a robot.

    Returns:
        Of the changes that show all, under the first criterion that has one, that with the fewest
        factors: it is the easiest to see. None if no criterion has one.
    """
    for criterion in CRITERIA_M:
        scenario = draw_scenario(robots, criterion)
        found = [
            change
            for number in range(SETS_TRIED)
            for change in changes_of(
                scenario.with_candidates(candidates, number), number, criterion, scenario.digest
            )
            if change.shows_all
        ]
        if found:
            return min(found, key=lambda change: change.factors)
    return None


def changes_of(
    world: OpenWorld, number: int, criterion_m: float, digest: str
) -> Iterator[AnnouncementChange]:
    """Follow a planning session: every evaluation of a robot but its first.

    Args:
        world: The world with its candidates.
        number: Number of the candidate set, for the record.
        criterion_m: The criterion of the world, for the record.
        digest: Digest of the prior.

    Yields:
        The changes, in the order of turns.
    """
    _, agreement = plan_session(world, CONTESTANTS["incremental"], digest)
    # Round 0: everybody announces the shortest candidate.
    announced = {
        robot: paths[int(np.argmin([path.length_m for path in paths]))]
        for robot, paths in world.candidates.items()
    }
    known: dict[str, dict[str, CandidatePath]] = {}
    for record in agreement.records:
        if record.decision is None:
            continue
        robot = record.robot
        others = {name: path for name, path in announced.items() if name != robot}
        if robot in known:
            before, after = (joined_to(world, robot, paths) for paths in (known[robot], others))
            yield AnnouncementChange(
                world=world,
                number=number,
                criterion_m=criterion_m,
                turn=record.turn,
                robot=robot,
                before=known[robot],
                after=others,
                impacted=record.decision.report.impacted,
                kept=tuple(pair for key, pair in after.items() if key in before),
                removed=tuple(pair for key, pair in before.items() if key not in after),
                added=tuple(pair for key, pair in after.items() if key not in before),
            )
        known[robot] = others
        if record.announced:
            announced[robot] = world.candidates[robot][record.decision.index]


def joined_to(
    world: OpenWorld, robot: str, others: Mapping[str, CandidatePath]
) -> dict[tuple[object, ...], Pair]:
    """Multi-robot factors between all candidates of a robot and some announced paths.

    Args:
        world: The world with its candidates.
        robot: Whose candidates.
        others: Announced paths by robot.

    Returns:
        Pairs of states (the robot's first) by what makes them the same factor; each once.
    """
    pairs: dict[tuple[object, ...], Pair] = {}
    for path in world.candidates[robot]:
        for announced in others.values():
            for pair in joined_states(world, path, announced):
                pairs.setdefault(_identity(pair), pair)
    return pairs


def joined_states(world: OpenWorld, path: CandidatePath, other: CandidatePath) -> Sequence[Pair]:
    """Pairs of states of two paths that a multi-robot factor joins; the criterion is symmetric."""
    first, second = path.states(), other.states()
    return [
        (first[i], second[j])
        for model in world.problem.multi_robot
        for i, j in joined_pairs(model, first, second)
    ]


def _identity(pair: Pair) -> tuple[object, ...]:
    """What makes two pairs of states the same: vertex with pose, step and time."""
    return tuple((s.robot, s.step, s.time_s, s.pose.tobytes()) for s in pair)
