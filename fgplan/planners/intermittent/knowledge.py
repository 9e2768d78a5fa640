"""What one robot knows of all measurements of the team, and what it may forget.

Every robot's log is known as a prefix: robot a has all measurements of robot s up to a time
heard[a, s]. So joining what two robots know takes the longer prefix of each log, and nothing can be
counted twice. A robot also keeps what it knows of the others' ``heard`` (a matrix clock): once all
have everything up to a time, the measurements up to there are filtered into a checkpoint and
dropped. The checkpoint is exactly the estimate of a filter that had all measurements at once.

Remark III.5 of Khodayi-mehr et al. 2019 forgets by the delay bound D: information has reached all
teams after D epochs. That all know this takes as long again, so that memory stops growing after 2 D
epochs here; in turn nothing is lost when meetings fail. A robot of which nothing was heard for
longer than ``gone_after`` is not waited for; what it measured since is lost if it comes back.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fgplan.planners.intermittent.estimate import Estimate, Filtered, Record
from fgplan.planners.intermittent.segment_problem import StateModel
from fgplan.typing import IntArray

Log = tuple[Record, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Knowledge:
    """Checkpoint, logs and who has heard what.

    Attributes:
        robot: Row of the robot whose knowledge it is.
        checkpoint: Estimate with all measurements up to its time.
        logs: Records of each robot after the checkpoint, as far as heard, in order of time.
        heard: Time up to which robot a (row) is known to have all of robot s (column), (N, N).
        discarded: Readings that came after the checkpoint had passed them (see ``gone_after``).
    """

    robot: int
    checkpoint: Estimate
    logs: tuple[Log, ...]
    heard: IntArray
    discarded: int = 0

    @property
    def complete_until(self) -> int:
        """t*: the latest time up to which all measurements of all robots are here."""
        return int(self.heard[self.robot].min())

    @property
    def readings(self) -> int:
        """Measurements that are stored."""
        return sum(len(record.readings) for log in self.logs for record in log)

    def records(self) -> list[tuple[int, Record]]:
        """Robot and record of all logs, in order of time, then of robot."""
        every = [(robot, record) for robot, log in enumerate(self.logs) for record in log]
        return sorted(every, key=lambda item: (item[1].time, item[0]))


def know_nothing(robot: int, robots: int, estimate: Estimate) -> Knowledge:
    """What a robot knows before the first measurement.

    Args:
        robot: Its row.
        robots: Number of robots.
        estimate: The common first estimate.

    Returns:
        Empty logs.
    """
    heard = np.full((robots, robots), estimate.time, dtype=np.int64)
    return Knowledge(robot, estimate, ((),) * robots, heard)


def remember(known: Knowledge, time: int, record: Record | None) -> Knowledge:
    """Enter an own measurement, or that there was none.

    Args:
        known: Before.
        time: Step up to which the robot has measured.
        record: What it measured in that step, if anything.

    Returns:
        After.
    """
    heard = known.heard.copy()
    heard[known.robot, known.robot] = time
    logs = known.logs
    if record is not None:
        own = (*logs[known.robot], record)
        logs = (*logs[: known.robot], own, *logs[known.robot + 1 :])
    return replace(known, logs=logs, heard=heard)


def join(mine: Knowledge, theirs: Knowledge) -> Knowledge:
    """What a robot knows after a teammate told it everything.

    Args:
        mine: The robot's own.
        theirs: The teammate's.

    Returns:
        The robot's own, with what the teammate knew.
    """
    later = theirs.checkpoint if theirs.checkpoint.time > mine.checkpoint.time else mine.checkpoint
    own, other = mine.heard[mine.robot], theirs.heard[theirs.robot]
    logs, discarded = [], mine.discarded
    for robot in range(len(mine.logs)):
        log = theirs.logs[robot] if other[robot] > own[robot] else mine.logs[robot]
        kept = tuple(record for record in log if record.time > later.time)
        known = max(own[robot] if later is mine.checkpoint else other[robot], 0)
        discarded += sum(
            len(record.readings) for record in log if known < record.time <= later.time
        )
        logs.append(kept)
    heard = np.maximum(mine.heard, theirs.heard)
    heard[mine.robot] = np.maximum(own, other)
    return Knowledge(mine.robot, later, tuple(logs), heard, discarded)


def shared_with(known: Knowledge, present: Sequence[int], common: Sequence[int]) -> Knowledge:
    """Note what robots that were at a meeting have in common.

    Args:
        known: After the exchange.
        present: Rows of the robots that took part.
        common: Time up to which all of them have each robot's measurements, shape (N,).

    Returns:
        With their rows of ``heard``.
    """
    heard = known.heard.copy()
    for robot in present:
        heard[robot] = np.maximum(heard[robot], common)
    return replace(known, heard=heard)


def forget(known: Knowledge, model: StateModel, gone_after: float = np.inf) -> Knowledge:
    """Filter into the checkpoint what everybody has, and drop it.

    Args:
        known: Before.
        model: Of the state.
        gone_after: Robots silent for longer than so many steps are not waited for.

    Returns:
        After.
    """
    last = known.heard.max(axis=0)
    active = last.max() - last <= gone_after
    active[known.robot] = True
    until = int(known.heard[np.ix_(active, active)].min())
    if until <= known.checkpoint.time:
        return known
    old = [(robot, record) for robot, record in known.records() if record.time <= until]
    checkpoint = model.run(known.checkpoint, until, old).estimate
    logs = tuple(tuple(record for record in log if record.time > until) for log in known.logs)
    return replace(known, checkpoint=checkpoint, logs=logs)


def fuse(known: Knowledge, model: StateModel, until: int) -> Filtered:
    """Algorithm 4 over all that is known, from the checkpoint on: late measurements included.

    Args:
        known: Checkpoint and logs.
        model: Of the state.
        until: Step.

    Returns:
        The estimate at ``until`` and the way from the checkpoint.
    """
    return model.run(known.checkpoint, until, known.records())
