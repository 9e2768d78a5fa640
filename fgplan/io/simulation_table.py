"""``[simulation]`` of a scenario: the world as it truly is, and how long the team goes on in it.

With the planner ``impacted_paths`` the team plans, moves, observes, estimates and plans again
(fgplan.closed_loop). What the rest of the scenario says is what the team knows: starts and mapped
landmarks are priors, whose means are drawn about the truth; obstacles are those known beforehand.
"""

from typing import Annotated, Any, Literal

from msgspec import Meta, field

from fgplan.io.table import Count, NotNegative, Point, Polygon, Positive, Seed, Table


class UnmappedTable(Table, frozen=True):
    """``[simulation.landmarks]``: landmarks that nobody knows beforehand.

    Attributes:
        positions: Where they truly are, 2 coordinates or, for robots in space, 3; metres.
        count: Or their number; drawn over the free space.
        heights_m: For robots in space: least and greatest height of those drawn.
        seed: Of drawing them; the run's if left out, so that every run has its own map.
    """

    positions: tuple[Point, ...] = ()
    count: Count | None = None
    heights_m: tuple[float, float] | None = None
    seed: Seed | None = None


class NoiseTable(Table, frozen=True):
    """``[simulation.actuation]`` and ``[simulation.odometry]``: noise of a step, all robots.

    Attributes:
        sigmas: 3 (planar x, y, heading) or 6 (spatial, rotation first) standard deviations a step.
        per_metre: Same length; standard deviation after one metre.
        per_radian: Same length; standard deviation after turning one radian.
    """

    sigmas: Annotated[tuple[NotNegative, ...], Meta(min_length=3, max_length=6)]
    per_metre: tuple[NotNegative, ...] = ()
    per_radian: tuple[NotNegative, ...] = ()


class SimulationTable(Table, frozen=True):
    """``[simulation]``: what is executed, in which world.

    Attributes:
        kind: What is executed; there is one kind.
        steps: Steps after which the loop is given up.
        seed: Seed of everything that is drawn; the scenario's if left out.
        runs: Number of Monte Carlo runs, with seeds from ``seed`` on.
        step_s: Seconds a step; a step of ``spacing_m`` at the slowest robot's speed if left out.
        landmarks: Landmarks that nobody knows beforehand.
        actuation: Noise of the motion itself; each robot's planned noise if left out.
        odometry: Noise of measuring the motion; each robot's planned noise if left out.
        measure_robots: Whether robots measure each other where ``[[team.multi_robot]]`` holds.
        obstacles: Polygons that nobody knows beforehand, corners in metres.
        obstacle_range_m: Distance from which a robot sees one of these, metres.
        others_landmarks: Whether planning uses landmarks that only other robots have mapped.
        relinearise_m: A landmark or past pose that moved by more since the last session is
            linearised anew, metres.
        compare: Whether all values of each session are compared with from scratch.
        options: For the simulation of a planner of one's own.
    """

    kind: Literal["closed_loop"] = "closed_loop"
    steps: Count | None = None
    seed: Seed | None = None
    runs: Count = 1
    step_s: Positive | None = None
    landmarks: UnmappedTable = field(default_factory=UnmappedTable)
    actuation: NoiseTable | None = None
    odometry: NoiseTable | None = None
    measure_robots: bool = True
    obstacles: tuple[Polygon, ...] = ()
    obstacle_range_m: NotNegative = 0.0
    others_landmarks: bool = True
    relinearise_m: NotNegative = 0.1
    compare: bool = False
    options: dict[str, Any] = field(default_factory=dict)
