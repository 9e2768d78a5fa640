"""What each robot saw when it evaluated: the others' announced paths, turn by turn, read back.

An agreement holds who announced which candidate on which turn. Played again from round 0 (everybody
announces its shortest) it gives the others' paths at every evaluation, and from two evaluations of
one robot what changed between them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from fgplan.evaluation.evaluations import ReevaluationReport
from fgplan.evaluation.problem import PlanningProblem
from fgplan.factors.factor_set import StateIdentity, state_identity
from fgplan.factors.multi_robot import joined_pairs
from fgplan.io.run_record import ImpactRecord, Pairs
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.state import State
from fgplan.team.agreement import Agreement

Candidates = Mapping[str, tuple[CandidatePath, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """One evaluation of one robot.

    Attributes:
        turn: Number of the turn, from 1.
        round: Number of the round, from 1.
        robot: Who evaluated.
        others: Announced path of each other robot.
        report: Account of the work.
        seconds: Time of the evaluation.
    """

    turn: int
    round: int
    robot: str
    others: Mapping[str, CandidatePath] = field(repr=False)
    report: ReevaluationReport = field(repr=False)
    seconds: float


def announced_views(agreement: Agreement, candidates: Candidates) -> tuple[View, ...]:
    """Every evaluation of a planning session in order.

    Args:
        agreement: How the team came to agree.
        candidates: Candidate paths by robot, in the order of the team.

    Returns:
        Views by turn.
    """
    announced = {
        robot: paths[int(np.argmin([path.length_m for path in paths]))]
        for robot, paths in candidates.items()
    }
    views = []
    for record in agreement.records:
        if record.decision is None:
            continue
        robot = record.robot
        views.append(
            View(
                turn=record.turn,
                round=(record.turn - 1) // len(candidates) + 1,
                robot=robot,
                others={name: path for name, path in announced.items() if name != robot},
                report=record.decision.report,
                seconds=record.decision.seconds,
            )
        )
        if record.announced:
            announced[robot] = candidates[robot][record.decision.index]
    return tuple(views)


def announcers(agreement: Agreement) -> tuple[str, ...]:
    """Who made each value of the common objective: all for round 0, then one robot each."""
    return ("all", *(item.robot for item in agreement.ledger.history if item.value is not None))


def views_of(views: Sequence[View], robot: str) -> tuple[View, ...]:
    """Views of one robot in order."""
    return tuple(view for view in views if view.robot == robot)


def drawn_reevaluation(views: Sequence[View]) -> tuple[View, View] | None:
    """The re-evaluation worth a figure: most candidates untouched, else fewest factors changed.

    Args:
        views: All evaluations of a session.

    Returns:
        The robot's view before and the view itself; None if nobody evaluated twice.
    """
    found = []
    for robot in dict.fromkeys(view.robot for view in views):
        mine = views_of(views, robot)
        found += [(before, view) for before, view in pairwise(mine) if view.report.impacted]
    if not found:
        return None

    def rank(pair: tuple[View, View]) -> tuple[int, int, int]:
        report = pair[1].report
        changed = report.factors_added + report.factors_removed
        one_sided = int(not (report.factors_added and report.factors_removed))
        return (-len(report.untouched), one_sided, changed)

    return min(found, key=rank)


def impact_record(
    problem: PlanningProblem, candidates: Candidates, before: View, after: View
) -> ImpactRecord:
    """What changed between two evaluations of one robot, for a figure.

    Args:
        problem: Multi-robot models and the order of the team.
        candidates: Candidate paths by robot.
        before: Its earlier evaluation.
        after: Its later one.

    Returns:
        Pairs of states joined in both, before alone, after alone.
    """
    robot = after.robot
    old, new = (
        _pairs_of_candidates(problem, candidates[robot], view.others) for view in (before, after)
    )
    return ImpactRecord(
        robot=robot,
        impacted=after.report.impacted,
        before=before.others,
        after=after.others,
        kept=tuple(pair for key, pair in new.items() if key in old),
        removed=tuple(pair for key, pair in old.items() if key not in new),
        added=tuple(pair for key, pair in new.items() if key not in old),
    )


def joined_states(problem: PlanningProblem, paths: Mapping[str, CandidatePath]) -> Pairs:
    """Future states that multi-robot factors join when every path is followed.

    Args:
        problem: Multi-robot models and the order of the team.
        paths: Path of each robot that has one.

    Returns:
        Pairs of states, the robot earlier in the team first.
    """
    team = [robot for robot in problem.robots if robot in paths]
    states = {robot: paths[robot].states() for robot in team}
    return tuple(
        (states[robot][i], states[other][j])
        for model in problem.multi_robot
        for place, robot in enumerate(team)
        for other in team[place + 1 :]
        for i, j in joined_pairs(model, states[robot], states[other])
    )


PairIdentity = tuple[StateIdentity, StateIdentity]


def _pairs_of_candidates(
    problem: PlanningProblem,
    candidates: Sequence[CandidatePath],
    others: Mapping[str, CandidatePath],
) -> dict[PairIdentity, tuple[State, State]]:
    """Joined states of all candidates of a robot with the others' paths, by identity."""
    found: dict[PairIdentity, tuple[State, State]] = {}
    for path in candidates:
        for other in others.values():
            for pair in joined_states(problem, {path.robot: path, other.robot: other}):
                found[(state_identity(pair[0]), state_identity(pair[1]))] = pair
    return found
