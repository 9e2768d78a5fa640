"""Plan, move, observe, estimate, plan again: section 7.2 of Regev and Indelman 2017.

    step 0: everybody senses, SLAM starts
    while a goal is left:
        a planning session                       new candidates for robots that arrived
        until a goal is reached, or an obstacle is seen for the first time:
            every robot steers from its estimate to the next pose of its path
            odometry and measurements are drawn; one SLAM update

A command is the relative pose from where the robot thinks it is to the next pose of its path: a
change of heading, a straight way, and the heading of the path. A robot that stands still does not
measure again.

Everything is handed on as it happens. What a run has handed on so far is enough to go on with it:
recorded steps are fed to SLAM as they were measured, recorded sessions are planned again by the
evaluator that is executed (its messages are needed later) and must end as recorded.
"""

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fgplan.closed_loop.comparison import EXECUTED, OURS, Contestant
from fgplan.closed_loop.loop_state import begin_loop, estimate_step
from fgplan.closed_loop.mission import LoopMission
from fgplan.closed_loop.records import GivenUpRecord, SessionRecord, SlamRecord, StepRecord
from fgplan.closed_loop.session import slam_record
from fgplan.errors import InvalidInputError

Record = StepRecord | SessionRecord | GivenUpRecord | SlamRecord
"""What a loop hands on; the SLAM record is its last."""


def run_loop(
    mission: LoopMission,
    *,
    past: Sequence[Record] = (),
    contestants: Mapping[str, Contestant] = OURS,
    compare: bool | Collection[int] = False,
) -> Iterator[Record]:
    """Run a mission until every goal is reached, or given up because no way leads there.

    Args:
        mission: What is given.
        past: Records that an earlier run of the same mission handed on, from its first; they are
            not handed on again.
        contestants: Ways of planning each session; ``incremental_choose`` is among them, and its
            choice is executed. Recorded sessions are not planned by the others again.
        compare: Whether all values of each session are compared with from scratch by QR, or the
            numbers of the sessions in which they are.

    Yields:
        A record a step and a session, as they happen; the final SLAM result at the end.

    Raises:
        InvalidInputError: If the past is another mission's, or was written by other versions.
        NoCandidatePathError: If no robot can reach a goal at the first session.

    Example:
        >>> from fgplan.closed_loop.unknown_world import draw_mission
        >>> records = list(run_loop(draw_mission(0, candidates=3, goals=1, landmarks=20)))
        >>> type(records[0]).__name__, type(records[-1]).__name__
        ('StepRecord', 'SlamRecord')
    """
    if EXECUTED not in contestants:
        raise InvalidInputError(
            f"closed loop: expected {EXECUTED!r} among the contestants, got {list(contestants)}"
        )
    told = deque(past)
    if told and isinstance(told[-1], SlamRecord):
        return
    alone = {EXECUTED: replace(contestants[EXECUTED], repeats=1)}
    state, zero = begin_loop(mission)
    recorded = _next(told, StepRecord)
    first = estimate_step(state.slam, zero, 0, state.slam.robots, ())
    state.look_for_obstacles()
    if recorded is None:
        yield first
    elif not _same_step(first, recorded):
        raise InvalidInputError(
            "closed loop: expected records of this mission from step 0 on, got others"
        )
    while state.pending and state.simulation.step < mission.max_steps:
        again = _next(told, SessionRecord, GivenUpRecord)
        if again is None:
            yield state.plan(contestants, compare)
        else:
            _check_session(state.plan(alone, False), again)
        while state.trigger is None and state.simulation.step < mission.max_steps:
            recorded = _next(told, StepRecord)
            step = state.move(recorded)
            if recorded is None:
                yield step
    yield slam_record(state.slam, state.slam.belief(), state.simulation.step)


def _next(told: deque[Record], *kinds: type) -> Any:  # noqa: ANN401 - of a kind asked for
    """Take the next recorded event, which must be of a kind; None where the records end."""
    if not told:
        return None
    record = told.popleft()
    if not isinstance(record, kinds):
        raise InvalidInputError(
            f"closed loop: expected a {' or '.join(kind.__name__ for kind in kinds)} next, got a "
            f"{type(record).__name__}: the records are another mission's, or not in order"
        )
    return record


def _same_step(one: StepRecord, other: StepRecord) -> bool:
    """Whether two records are of one step of the same truth."""
    same = one.truth.keys() == other.truth.keys() and one.step == other.step
    return same and all(np.array_equal(one.truth[name], other.truth[name]) for name in one.truth)


def _check_session(
    again: SessionRecord | GivenUpRecord, recorded: SessionRecord | GivenUpRecord
) -> None:
    """Refuse records of which a session does not end as recorded."""
    chosen = [
        dict(one.chosen_index) if isinstance(one, SessionRecord) else "given up"
        for one in (again, recorded)
    ]
    if again.step != recorded.step or chosen[0] != chosen[1]:
        raise InvalidInputError(
            f"session at step {again.step}: expected the recorded choice {chosen[1]} at step "
            f"{recorded.step}, got {chosen[0]}: the records are another mission's, or other "
            "versions wrote them"
        )
