"""What one robot knows of all measurements of the team, and what it may forget.

Every robot's log is known as a prefix: all measurements of robot s are here up to a time heard[s].
So joining what two robots know takes the longer prefix of each log, and nothing can be counted
twice. Up to t* = min_s heard[s] everything that anybody measured is here; it is filtered into a
checkpoint and dropped. The checkpoint is exactly the estimate of a filter that had all measurements
at once, so a robot that misses some of what was dropped loses nothing: it takes the later
checkpoint in its place.

Nothing older than D epochs is kept then (Remark III.5 of Khodayi-mehr et al. 2019), and nothing is
lost when meetings fail: they only hold t* back. A robot of which nothing was heard for longer than
``gone_after`` does not hold it back; what it measures meanwhile is lost if it comes back.
"""

from dataclasses import dataclass, replace

import numpy as np

from fgplan.planners.intermittent.estimate import Estimate, Filtered, Record
from fgplan.planners.intermittent.segment_model import StateModel
from fgplan.typing import IntArray

Log = tuple[Record, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Knowledge:
    """Checkpoint and logs.

    Attributes:
        robot: Row of the robot whose knowledge it is.
        checkpoint: Estimate with all measurements up to its time.
        logs: Records of each robot after the checkpoint, as far as heard, in order of time.
        heard: Time up to which all measurements of each robot are here, shape (N,).
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
        return int(self.heard.min())

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
    heard = np.full(robots, estimate.time, dtype=np.int64)
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
    heard[known.robot] = time
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
    own, other = mine.heard, theirs.heard
    logs, discarded = [], mine.discarded
    for robot in range(len(mine.logs)):
        log = theirs.logs[robot] if other[robot] > own[robot] else mine.logs[robot]
        kept = tuple(record for record in log if record.time > later.time)
        known = own[robot] if later is mine.checkpoint else other[robot]
        discarded += sum(
            len(record.readings) for record in log if known < record.time <= later.time
        )
        logs.append(kept)
    return Knowledge(mine.robot, later, tuple(logs), np.maximum(own, other), discarded)


def forget(known: Knowledge, model: StateModel, gone_after: float = np.inf) -> Knowledge:
    """Filter into the checkpoint what is complete, and drop it.

    Args:
        known: Before.
        model: Of the state.
        gone_after: Robots silent for longer than so many steps are not waited for.

    Returns:
        After.
    """
    active = known.heard.max() - known.heard <= gone_after
    until = int(known.heard[active].min())
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
