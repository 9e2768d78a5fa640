"""Where a robot stands in the middle of a planning session."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from fgplan.announcement.announcement import Announcement, Message
from fgplan.announcement.ledger import Ledger
from fgplan.errors import NoCandidatePathError
from fgplan.paths.candidate_path import CandidatePath
from fgplan.team.decision import Decision
from fgplan.team.envelope import Envelope
from fgplan.team.known_logs import KnownLogs, know_nothing
from fgplan.team.log import Log
from fgplan.team.presence import Presence
from fgplan.team.robot_setup import RobotSetup


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnRecord:
    """What a robot did on one of its turns.

    Attributes:
        turn: Number of the turn.
        robot: Name.
        announced: Whether it announced; otherwise it refused.
        decision: What it found, or None where nothing had changed and nothing was evaluated.
    """

    turn: int
    robot: str
    announced: bool
    decision: Decision | None


class RobotState(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A robot in the middle of a planning session; a value (a struct, because it copies fast).

    Attributes:
        setup: What does not change.
        evaluator_state: The evaluator's own.
        logs: Turns that it has heard of.
        presence: Who is there.
        heads: Head of each teammate's log, as its last status said.
        proposed: Index of the candidate in each announcement that it wrote, by sequence.
        evaluated: Messages of the others at the last evaluation, and its best candidate then.
        records: What it did on its turns.
        dropped: Envelopes that were not for this session.
        asks: Statuses sent since something happened.
        answered: Its last answer to each teammate: what the two of them had, and when.
        asked_s: When it asked a teammate that has a better log.
        timer_s: When the next status is due.
        wake_s: When it wants to be woken.
        over: Whether its session has ended, as far as its own log says.
        agreed: Whether it ended by refusals of all that are not lost.
    """

    setup: RobotSetup
    evaluator_state: Any
    logs: KnownLogs
    presence: Presence = Presence()
    heads: Mapping[str, bytes] = {}
    proposed: dict[int, int] = {}
    evaluated: tuple[Mapping[str, Message], int] | None = None
    records: tuple[TurnRecord, ...] = ()
    dropped: int = 0
    asks: int = 0
    answered: Mapping[str, tuple[Any, float]] = {}
    asked_s: float = -np.inf
    timer_s: float = np.inf
    wake_s: float = 0.0
    over: bool = False
    agreed: bool = False

    @property
    def log(self) -> Log:
        """Its own log."""
        return self.logs.current

    @property
    def ledger(self) -> Ledger:
        """Accepted announcements."""
        return self.logs.current.ledger

    @property
    def turn(self) -> int:
        """Number of the turn that is open."""
        return self.logs.current.turn

    @property
    def pending(self) -> Mapping[str, Envelope]:
        """Entries of the open turn, by robot, where it belongs to everybody."""
        return self.logs.pending

    @property
    def lost(self) -> frozenset[str]:
        """Teammates that count as lost."""
        options = self.setup.options
        return self.presence.lost(options.lost_after_s, options.hung_after_s)

    @property
    def at_rest(self) -> bool:
        """Whether its session is over and it knows that all who are there hold the same log."""
        lost = self.lost
        there = [robot for robot in self.setup.others if robot not in lost]
        return self.over and all(self.heads.get(r) == self.log.head for r in there)

    @property
    def finished(self) -> bool:
        """Whether it may leave: a network that tells who is there can lose robots, and so logs."""
        return self.at_rest if self.presence.told else self.over

    @property
    def incumbent(self) -> int | None:
        """Index of the candidate that the ledger holds of this robot.

        None where it holds none, or a path that is not among the candidates: one announced before
        a restart, with other candidates.
        """
        held = self.ledger.current.get(self.setup.robot)
        if not isinstance(held, Announcement):
            return None
        path, candidates = held.path(), self.setup.candidates
        index = self.proposed.get(held.sequence)
        if index is not None and same_path(candidates[index], path):
            return index
        return next((i for i, other in enumerate(candidates) if same_path(other, path)), None)


def same_path(first: CandidatePath, second: CandidatePath) -> bool:
    """Whether two paths are one, to the last bit.

    Args:
        first: A path.
        second: Another, perhaps as it came over the wire.

    Returns:
        Whether poses, times, noise, vertices and planned observations are equal.
    """
    if first is second:
        return True
    return (
        np.array_equal(first.poses, second.poses)
        and np.array_equal(first.times_s, second.times_s)
        and np.array_equal(first.vertices, second.vertices)
        and np.array_equal(first.motion_covariances, second.motion_covariances)
        and len(first.observations) == len(second.observations)
        and all(
            (a.step, a.landmark, a.sensor) == (b.step, b.landmark, b.sensor)
            and np.array_equal(a.covariance, b.covariance)
            for a, b in zip(first.observations, second.observations, strict=True)
        )
    )


def start_robot(setup: RobotSetup) -> RobotState:
    """Start a robot on a planning session, or again after it had failed.

    Args:
        setup: What it knows.

    Returns:
        Its state before the first step.

    Raises:
        NoCandidatePathError: If it has no candidate path and may not stay.
    """
    options = setup.options
    if not setup.candidates and options.without_path == "refuse":
        raise NoCandidatePathError(
            f"robot {setup.robot!r}: expected at least one candidate path, got none; check that "
            "its goal is reachable, or go on without it by without_path='stay'"
        )
    prepared = None
    if setup.candidates:
        evaluator: Any = setup.evaluator
        known = {"carried": setup.carried} if hasattr(evaluator, "carry") else {}
        prepared = evaluator.start(setup.problem, setup.robot, setup.candidates, **known)
    return RobotState(setup=setup, evaluator_state=prepared, logs=know_nothing(setup))
