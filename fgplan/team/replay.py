"""Replaying recorded turns: does what the robots said follow from what they knew?

Every value in a log is computed again, from the ledger that its entry names, by evaluators that
have seen nothing but the turns before.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from fgplan.announcement.announcement import Announcement
from fgplan.errors import InvalidInputError
from fgplan.team.content import content_of
from fgplan.team.envelope import Envelope
from fgplan.team.log import Log, closed, empty_log
from fgplan.team.refusal import Refusal
from fgplan.team.robot_setup import RobotSetup
from fgplan.team.robot_state import same_path


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayedTurn:
    """One value that a robot stated, and what a replay finds.

    Attributes:
        turn: Number of the turn.
        robot: Who stated it.
        announced: Whether with an announcement; otherwise with a refusal.
        stated: Common objective with its path, as it said.
        found: The same, computed again.
        best: Common objective with the best of its candidates, computed again.
    """

    turn: int
    robot: str
    announced: bool
    stated: float
    found: float
    best: float


def replay_turns(
    setups: Mapping[str, RobotSetup], entries: Sequence[Envelope]
) -> tuple[Log, tuple[ReplayedTurn, ...]]:
    """Replay the entries of a log in one process.

    Args:
        setups: What each robot knew, by name.
        entries: Of a log, in order, as a robot's report holds them.

    Returns:
        The log that they make, and every stated value beside the one found again.

    Raises:
        InvalidInputError: If the entries do not go on from one another.
    """
    reader = next(iter(setups.values()))
    log, turns = empty_log(reader), []
    states = {
        robot: setup.evaluator.start(setup.problem, robot, setup.candidates)
        for robot, setup in setups.items()
        if setup.candidates
    }
    for parent, group in groupby(entries, key=lambda entry: entry.parent):
        if parent != log.head:
            raise InvalidInputError(
                f"replay: expected an entry that goes on from {log.head.hex()}, got one from "
                f"{parent.hex()}"
            )
        together = tuple(group)
        for entry in together:
            content = content_of(reader, entry)
            if not isinstance(content, Announcement | Refusal):
                continue
            stated = content.value
            if stated is None:
                continue
            setup = setups[entry.robot]
            held = content if isinstance(content, Announcement) else None
            path = (held or log.ledger.current[entry.robot]).path()  # type: ignore[union-attr]
            states[entry.robot], found = setup.evaluator.evaluate(
                states[entry.robot], log.ledger.paths(without=entry.robot)
            )
            index = next(i for i, c in enumerate(setup.candidates) if same_path(c, path))
            turns.append(
                ReplayedTurn(
                    turn=entry.sequence,
                    robot=entry.robot,
                    announced=held is not None,
                    stated=stated,
                    found=float(found.values[index]),
                    best=float(found.values[found.best]),
                )
            )
        log = closed(log, reader, together)
    return log, tuple(turns)
