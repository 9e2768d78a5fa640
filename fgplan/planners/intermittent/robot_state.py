"""A robot of an intermittently connected team, as a value."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.estimate import Estimate, Filtered
from fgplan.planners.intermittent.knowledge import Knowledge, know_nothing
from fgplan.planners.intermittent.leg import Leg, in_turn
from fgplan.planners.intermittent.message import Offer
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.schedule import Schedule
from fgplan.planners.intermittent.segment import Segment, plan_segment
from fgplan.planners.intermittent.segment_model import StateModel
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from roadmaps import GeodesicGrid, Workspace

SegmentPlanner = Callable[[SegmentProblem, SegmentOptions, np.random.Generator], Segment]
"""Plans a team's ways to its next meeting: ``plan_segment``, or a baseline."""

Phase = Literal["moving", "meeting"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TeamSetup:
    """What all robots know before they start.

    Attributes:
        schedule: Which team meets in which epoch.
        model: Of the state.
        workspace: Where robots may be.
        grid: Cells for short ways.
        options: Of planning.
        planner: Plans to the next meeting.
        seed: Of every plan: the leader of a team draws from (seed, team, epoch).
        wait_steps: How long after the agreed time robots wait for a teammate.
        recovery_steps: After a meeting that failed, the next one is at the same place in the
            team's next slot: slots are so long, one for each epoch of a period in turn. Best as
            long as the wait and the longest way together.
        gone_after: Robots silent for longer than so many steps are not waited for in forgetting.

    Raises:
        InvalidInputError: If a number of steps is not usable.
    """

    schedule: Schedule
    model: StateModel
    workspace: Workspace
    grid: GeodesicGrid
    options: SegmentOptions
    planner: SegmentPlanner = plan_segment
    seed: int = 0
    wait_steps: int = 40
    recovery_steps: int = 150
    gone_after: float = np.inf

    def __post_init__(self) -> None:
        """Check the numbers of steps."""
        if self.wait_steps < 0 or self.recovery_steps < 1 or not self.gone_after > 0:
            raise InvalidInputError(
                "team: expected wait_steps of zero or more, recovery_steps of one or more and a "
                f"positive gone_after, got {self.wait_steps}, {self.recovery_steps} and "
                f"{self.gone_after}"
            )

    @property
    def robots(self) -> tuple[str, ...]:
        """Names in the order of the team."""
        return self.schedule.graph.robots


@dataclass(frozen=True, slots=True, kw_only=True)
class MeetingRecord:
    """What came of a meeting, as one robot saw it.

    Attributes:
        team: Team.
        epoch: Epoch.
        due: Agreed time, steps.
        time: When it ended.
        present: Robots that took part.
        complete: Whether the whole team was there.
        complete_until: t*: all measurements of all robots up to then are here.
        heard: Time up to which each robot's measurements are here.
        readings: Measurements stored afterwards.
        checkpoint: Time of the checkpoint afterwards.
        failed: What the plan made there had to give up.
        rank: As in ``Segment``; -2 where this robot did not plan.
        nodes: Nodes of the tree; 0 where this robot did not plan.
    """

    team: int
    epoch: int
    due: int
    time: int
    present: tuple[str, ...]
    complete: bool
    complete_until: int
    heard: tuple[int, ...]
    readings: int
    checkpoint: int
    failed: tuple[str, ...] = ()
    rank: int = -2
    nodes: int = 0


class RobotState(msgspec.Struct, frozen=True, kw_only=True):
    """One robot between two steps.

    Attributes:
        setup: What does not change.
        robot: Name.
        now: Step.
        position: Where it is, metres.
        legs: Its way to the next meeting of each of its teams.
        epoch: Of its last meeting; 0 before the first.
        knowledge: Of all measurements.
        estimate: Its own, with all it knows and measured, at the time of the last of it.
        fused: The way from the checkpoint to the last meeting, as fused there, and where it began.
        phase: On its way, or at the place of a meeting.
        offers: Of those present, itself included.
        meetings: What came of its meetings.
    """

    setup: TeamSetup
    robot: str
    now: int
    position: tuple[float, float]
    legs: Mapping[int, Leg]
    knowledge: Knowledge
    estimate: Estimate
    epoch: int = 0
    fused: tuple[int, Filtered] | None = None
    phase: Phase = "moving"
    offers: dict[str, Offer] = {}
    meetings: tuple[MeetingRecord, ...] = ()

    @property
    def leg(self) -> Leg:
        """The leg that it is on, or at whose end it is."""
        return min(self.legs.values(), key=in_turn)


def start_robot(
    setup: TeamSetup, robot: str, legs: Mapping[int, Leg], estimate: Estimate
) -> RobotState:
    """A robot before its first step.

    Args:
        setup: What all know.
        robot: Name.
        legs: Initial paths: to the first meeting of each of its teams.
        estimate: The common first estimate.

    Returns:
        The robot, at the start of its first leg.

    Raises:
        InvalidInputError: If a team has no initial path, or a path is of another team.
    """
    wanted = set(setup.schedule.graph.teams_of(robot))
    if set(legs) != wanted:
        raise InvalidInputError(
            f"robot {robot!r}: expected one initial path for each of its teams {sorted(wanted)}, "
            f"got {sorted(legs)}"
        )
    first = min(legs.values(), key=in_turn)
    x, y = first.places[0].tolist()
    return RobotState(
        setup=setup,
        robot=robot,
        now=estimate.time,
        position=(x, y),
        legs=dict(legs),
        knowledge=know_nothing(setup.robots.index(robot), len(setup.robots), estimate),
        estimate=estimate,
    )
