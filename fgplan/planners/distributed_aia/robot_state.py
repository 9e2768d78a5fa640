"""What a robot of ``distributed_aia`` knows before it plans and between two steps.

The arrays of its tree are appended to in place: go on with the state that comes back from a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fgplan.planners.aia.geodesic_fields import GeodesicFields
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.distributed_aia.claims import OpenPlan
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.node_message import Nodes
from fgplan.planners.distributed_aia.options import DistributedOptions
from fgplan.planners.distributed_aia.plan_messages import Claim, PlanMessage, Report
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.envelope import Envelope


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotSetup:
    """What a robot knows before it plans.

    Attributes:
        robot: Its place in the team.
        part: Robots with which it communicates, over others or not, itself included.
        options: How trees are grown.
        graph: Who hears whom.
        wait_s: Seconds after which it no longer waits for a neighbour.
        session: Number of the planning session.
    """

    robot: int
    part: tuple[int, ...]
    options: DistributedOptions
    graph: CommunicationGraph
    wait_s: float = 1.0
    session: int = 0

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.graph.robots[self.robot]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotState:
    """A robot between two steps.

    Attributes:
        setup: What it knew before.
        growth: Its tree and what it holds of its neighbours' trees; appended to in place.
        told: Nodes that each neighbour has been told of; it may want some of them again.
        has: Nodes of each neighbour's tree that are here without a hole, and whether it is to be
            told that some are missing.
        sweeps_of: Sweeps that each neighbour was heard to have done, -1 for none.
        waiting: Messages of nodes by (sweep, neighbour) whose turn has not come.
        claims: Claims that are not answered yet.
        opened: Plans for which ways are still being collected.
        accepted: Whether the replay has accepted one of the plans that were opened together.
        best: The best plan of its own goal nodes.
        looked_at: Sweeps whose goal nodes have been claimed for.
        reports: By robot.
        letters: The envelope of each, as its writer sent it.
        replayed: Candidates replayed and refused.
        absent: Robots of its part that the network does not see, and since when.
        lost: Those that it has not seen for ``wait_s``: it plans no further without them.
        wake_s: When it wants to be stepped at the latest.
    """

    setup: RobotSetup
    growth: ForestGrowth
    told: dict[int, int] = field(default_factory=dict)
    has: dict[int, tuple[int, bool]] = field(default_factory=dict)
    sweeps_of: dict[int, int] = field(default_factory=dict)
    waiting: dict[tuple[int, int], Nodes] = field(default_factory=dict)
    claims: tuple[Claim, ...] = ()
    opened: tuple[OpenPlan, ...] = ()
    accepted: bool = False
    best: PlanMessage | None = None
    looked_at: int = 0
    reports: dict[int, Report] = field(default_factory=dict)
    letters: dict[int, Envelope] = field(default_factory=dict)
    replayed: tuple[int, int] = (0, 0)
    absent: dict[int, float] = field(default_factory=dict)
    lost: frozenset[int] = frozenset()
    wake_s: float = 0.0

    @property
    def finished(self) -> bool:
        """Whether it has the reports of its whole part, or of what it can reach of it."""
        wanted = self._reached() if self.lost else self.setup.part
        return all(robot in self.reports for robot in wanted)

    @property
    def plan(self) -> PlanMessage | None:
        """The best plan of all reports: the team's, once finished."""
        plans = [report.plan for report in self.reports.values() if report.plan is not None]
        return min(plans, key=lambda plan: plan.key, default=None)

    @property
    def ending(self) -> str:
        """Why it grows no more, or nothing."""
        options, growth = self.setup.options, self.growth
        if self.lost:
            return "lost"
        if options.iterations is not None and growth.sweep >= options.iterations:
            return "iterations"
        if growth.is_full(0):
            return "nodes"
        plan = self.plan
        if options.until == "first_feasible" and plan is not None and growth.sweep > plan.rank:
            return "feasible"
        return ""

    def _reached(self) -> set[int]:
        """Robots that it reaches over others without those that are lost, itself included."""
        reached, ring = {self.setup.robot}, [self.setup.robot]
        while ring:
            near = {other for robot in ring for other in self.setup.graph.ever(robot)}
            ring = sorted(near - reached - self.lost)
            reached.update(ring)
        return reached


def start_robot(
    problem: AcquisitionProblem,
    setup: RobotSetup,
    generators: Sequence[np.random.Generator],
    fields: GeodesicFields | None = None,
) -> RobotState:
    """A robot before its first step.

    Args:
        problem: What is planned for.
        setup: What it knows.
        generators: Source of random numbers of each robot of the team, the same at all.
        fields: Geodesic distances to be used again.

    Returns:
        Its state; its first step tells the neighbours of its root.
    """
    growth = ForestGrowth(
        problem, setup.options, setup.graph, generators, robot=setup.robot, fields=fields
    )
    neighbours = setup.graph.ever(setup.robot)
    return RobotState(
        setup=setup,
        growth=growth,
        told=dict.fromkeys(neighbours, 0),
        has=dict.fromkeys(neighbours, (0, False)),
        sweeps_of=dict.fromkeys(neighbours, -1),
    )
