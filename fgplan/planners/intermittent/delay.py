"""How late information is: t*(t) and the age of what a meeting brings, from a run.

Ages are counted in epochs as in Proposition III.2: what a robot measures after its meeting of epoch
p is of age k - p when it is first heard at a meeting of epoch k. With no meeting missed no age
exceeds D = (T - 1) L.
"""

from dataclasses import dataclass

import numpy as np

from fgplan.planners.intermittent.team_run import Snapshot, TeamRun
from fgplan.typing import FloatArray


@dataclass(frozen=True, slots=True)
class TeamDelay:
    """A team's knowledge at one of its meetings.

    Attributes:
        time: Step t of the meeting.
        epoch: Its epoch.
        complete_until: Time up to which all measurements of all robots were there.
        agrees_until: t*: last step at which the team's estimate is the global one.
        age_epochs: Largest age of what was heard there for the first time.
        error_m: (14): mean distance of team's and global estimate from t* to t; 0 where they agree.
    """

    time: int
    epoch: int
    complete_until: int
    agrees_until: int
    age_epochs: int
    error_m: float


def team_delays(run: TeamRun, team: int, tolerance_m: float = 1e-9) -> tuple[TeamDelay, ...]:
    """Delays of a team over a run.

    Args:
        run: The run.
        team: Index of the team.
        tolerance_m: Estimates nearer than this are the same.

    Returns:
        One a meeting, in order of time.
    """
    found = []
    for snapshot in run.snapshots:
        if snapshot.team != team:
            continue
        state = next(one for one in run.robots if one.robot == snapshot.robot)
        place = next(i for i, one in enumerate(state.meetings) if one.time == snapshot.time)
        record = state.meetings[place]
        before = state.meetings[place - 1].heard if place else (0,) * len(record.heard)
        age = max(
            (
                record.epoch - _epoch_at(run, row, before[row] + 1)
                for row in range(len(before))
                if record.heard[row] > before[row]
            ),
            default=0,
        )
        gaps = _gaps(run, snapshot)
        differs = np.flatnonzero(gaps > tolerance_m)
        agrees = snapshot.time if not len(differs) else snapshot.begun + int(differs[0])
        late = gaps[agrees - snapshot.begun :]
        found.append(
            TeamDelay(
                time=snapshot.time,
                epoch=record.epoch,
                complete_until=record.complete_until,
                agrees_until=agrees,
                age_epochs=age,
                error_m=float(late.mean()) if len(late) else 0.0,
            )
        )
    return tuple(found)


def team_series(run: TeamRun, snapshot: Snapshot) -> tuple[FloatArray, FloatArray]:
    """A team's estimate of every step up to a meeting, as it was fused there.

    Args:
        run: The run.
        snapshot: The meeting.

    Returns:
        Means, shape (time, n), and uncertainty, shape (time,). Up to the checkpoint they are those
        of the global estimate, which the checkpoint is.
    """
    begun = snapshot.begun
    return (
        np.concatenate([run.everything.means[:begun], snapshot.filtered.means]),
        np.concatenate([run.everything.uncertainty[:begun], snapshot.filtered.uncertainty]),
    )


def _gaps(run: TeamRun, snapshot: Snapshot) -> FloatArray:
    """Distance of team's and global estimate at each step after the checkpoint."""
    whole = run.everything.means[snapshot.begun : snapshot.time]
    return np.asarray(np.linalg.norm(snapshot.filtered.means - whole, axis=1))


def _epoch_at(run: TeamRun, row: int, time: int) -> int:
    """Epoch of a robot's last meeting before a step; 0 before the first."""
    passed = [record.epoch for record in run.robots[row].meetings if record.time < time]
    return max(passed, default=0)
