"""One robot's way to one meeting, and how it is caught up with when the robot is late."""

from dataclasses import dataclass

import numpy as np

from fgplan.planners.intermittent.geodesic_way import geodesic_way, walk
from fgplan.planners.intermittent.segment import stretched
from fgplan.typing import FloatArray
from roadmaps import GeodesicGrid


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """A way to a meeting.

    Attributes:
        team: Team that meets.
        epoch: In which epoch.
        due: Agreed time of the meeting, steps.
        start: Time of the first place.
        places: One row a step, shape (S, 2), metres; the last is where the robot meets.
        slack: Steps that it may have to wait there, as far as plans with others are concerned.
    """

    team: int
    epoch: int
    due: int
    start: int
    places: FloatArray
    slack: int = 0

    @property
    def arrival(self) -> int:
        """Time at which the robot is there; later than ``due`` where it is late."""
        return self.start + len(self.places) - 1

    @property
    def ready(self) -> int:
        """Time at which the meeting can begin as far as this robot knows."""
        return max(self.due, self.arrival)

    @property
    def leaves(self) -> int:
        """Time at which it leaves again at the latest, for all that is known."""
        return self.ready + self.slack

    def place_at(self, time: int) -> FloatArray:
        """Where the robot is at a step; before its start and after its arrival it stays.

        Args:
            time: Step.

        Returns:
            Shape (2,), metres.
        """
        return self.places[min(max(time - self.start, 0), len(self.places) - 1)]


def in_turn(leg: Leg) -> tuple[int, int, int]:
    """Sorting key of a robot's legs: by agreed time, which is by epoch while no meeting fails.

    Args:
        leg: A leg.

    Returns:
        The key.
    """
    return leg.due, leg.epoch, leg.team


def departed(leg: Leg, time: int, position: FloatArray, grid: GeodesicGrid, step_m: float) -> Leg:
    """A leg as it is followed from a place at a time.

    A robot that is where and when the leg begins follows it. Any other goes the short way to its
    end, as slowly as the agreed time allows, or as fast as it can.

    Args:
        leg: As agreed.
        time: Step of departure.
        position: Where the robot is, shape (2,), metres.
        grid: Cells for short ways.
        step_m: Longest step, metres.

    Returns:
        The leg as it will be followed.
    """
    if time == leg.start and np.array_equal(position, leg.places[0]):
        return leg
    way = geodesic_way(grid, position, leg.places[-1])
    soonest = time + len(walk(way, step_m)) - 1
    places = stretched([way], np.array([time]), max(soonest, leg.due), step_m)[0]
    return Leg(leg.team, leg.epoch, leg.due, time, places, leg.slack)


def departed_in_turn(
    legs: tuple[Leg, ...], time: int, position: FloatArray, grid: GeodesicGrid, step_m: float
) -> tuple[Leg, ...]:
    """Legs one after the other, each begun when the meeting before it can take place.

    Args:
        legs: In the order of their meetings.
        time: Step of the first departure.
        position: Where the robot is, shape (2,), metres.
        grid: Cells for short ways.
        step_m: Longest step, metres.

    Returns:
        The legs as they will be followed.
    """
    followed = []
    for leg in legs:
        own = departed(leg, time, position, grid, step_m)
        followed.append(own)
        time, position = own.leaves, own.places[-1]
    return tuple(followed)
