"""Collecting the ways that a goal node needs, by messages.

Claims follow ``extraction.claim_order``: every robot knows from the graph who claims whom, so
answering a claim needs no memory, and a claim that is doubled or sent again does no harm.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from fgplan.planners.distributed_aia.extraction import (
    claim_order,
    claimed_node,
    extra_steps,
    replayed,
)
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.plan_messages import (
    Claim,
    PlanMessage,
    WayMessage,
    read_way,
    written_way,
)
from fgplan.planners.distributed_aia.way import Way, way_through
from fgplan.team.communication_graph import CommunicationGraph


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenPlan:
    """A goal node for which ways are being collected.

    Attributes:
        goal: The goal node.
        born: Sweep in which it was made.
        steps: Steps of every way.
        ways: Those that are there, by robot.
    """

    goal: int
    born: int
    steps: int
    ways: dict[int, Way]

    @classmethod
    def of(cls, growth: ForestGrowth, goal: int) -> "OpenPlan":
        """The plan with the robot's own way.

        Args:
            growth: The robot's tree, row 0.
            goal: The goal node.
        """
        robot, born = growth.robots[0], int(growth.forest.born[0, goal])
        extra = extra_steps(growth.graph, robot, growth.options.constraint_at)
        steps = int(growth.forest.trees.depth[0, goal]) + extra
        return cls(
            goal=goal,
            born=born,
            steps=steps,
            ways={robot: way_through(growth, 0, goal, steps, born)},
        )


def first_claims(
    robot: int, graph: CommunicationGraph, plan: OpenPlan
) -> Iterator[tuple[int, Claim]]:
    """Claims on the neighbours of the robot with the goal node.

    Args:
        robot: It.
        graph: Who hears whom.
        plan: Its plan.

    Yields:
        Receiver and claim.
    """
    yield from _claims_of(robot, graph, plan.ways[robot], robot, plan.goal, plan.steps, plan.born)


def answer_claim(growth: ForestGrowth, claim: Claim) -> Iterator[tuple[int, WayMessage | Claim]]:
    """The robot's way, back to who claimed it, and its own claims on those that it claims.

    Args:
        growth: The robot's tree, row 0.
        claim: A claim on it, checked.

    Yields:
        Receiver and message.
    """
    robot, graph = growth.robots[0], growth.graph
    by = dict(claim_order(graph, claim.origin)).get(robot)
    if by is None or claim.node >= growth.nodes(0):
        return
    way = way_through(growth, 0, claim.node, claim.steps, claim.born_by)
    poses, assigned = written_way(way)
    yield (
        by,
        WayMessage(
            origin=claim.origin, goal=claim.goal, robot=robot, poses=poses, assigned=assigned
        ),
    )
    yield from _claims_of(robot, graph, way, claim.origin, claim.goal, claim.steps, claim.born_by)


def take_way(
    robot: int, graph: CommunicationGraph, opened: Sequence[OpenPlan], message: WayMessage
) -> tuple[tuple[OpenPlan, ...], int | None]:
    """A way that arrived: kept at the origin, else passed on towards it.

    Args:
        robot: Who got it.
        graph: Who hears whom.
        opened: Its open plans.
        message: The way.

    Returns:
        The open plans, and to whom to pass the message on, if to anybody.
    """
    if message.origin != robot:
        return tuple(opened), dict(claim_order(graph, message.origin)).get(robot)
    out = []
    for plan in opened:
        if plan.goal == message.goal and message.robot not in plan.ways:
            way = read_way(message.poses, message.assigned)
            if len(way.poses) == plan.steps + 1:
                plan = replace(plan, ways=plan.ways | {message.robot: way})
        out.append(plan)
    return tuple(out), None


def closed_plans(
    growth: ForestGrowth, part: Sequence[int], opened: Sequence[OpenPlan]
) -> tuple[tuple[OpenPlan, ...], list[PlanMessage], int]:
    """Replay the plans for which every way is there.

    Args:
        growth: The robot's tree, row 0.
        part: The robot's part of the team.
        opened: Its open plans.

    Returns:
        Plans still open, plans that satisfy the constraint, and how many did not.
    """
    left, plans, refused = [], [], 0
    for plan in opened:
        if len(plan.ways) < len(part):
            left.append(plan)
            continue
        origin = growth.robots[0]
        ways = {robot: plan.ways[robot] for robot in sorted(plan.ways)}
        found = replayed(growth, ways, ((origin, plan.goal),))
        if found is None:
            refused += 1
            continue
        written = [written_way(way) for way in ways.values()]
        plans.append(
            PlanMessage(
                rank=plan.born if growth.options.until == "first_feasible" else 0,
                cost=found.cost,
                origin=origin,
                goal=plan.goal,
                robots=tuple(ways),
                poses=tuple(poses for poses, _ in written),
                assigned=tuple(assigned for _, assigned in written),
            )
        )
    return tuple(left), plans, refused


def _claims_of(
    robot: int,
    graph: CommunicationGraph,
    way: Way,
    origin: int,
    goal: int,
    steps: int,
    born_by: int,
) -> Iterator[tuple[int, Claim]]:
    """Claims of one robot on those that it claims."""
    for other, by in claim_order(graph, origin):
        if by == robot and other != robot:
            yield (
                other,
                Claim(
                    origin=origin,
                    goal=goal,
                    robot=other,
                    node=claimed_node(graph, way, robot, other),
                    steps=steps,
                    born_by=born_by,
                ),
            )
