"""What a robot believes of others: no claims, ways and reports that its team cannot have sent.

The graph says over whom a claim and its way go (``extraction.claim_order``). A tree grows by at
most one step a sweep, so a way that a goal node of sweep s needs has at most s + 1 steps, and those
that ``constraint_at = "all"`` adds. A way starts at its robot and follows free controls. A plan
that would be the best one is replayed before it is believed. What is refused changes nothing.
"""

import math
from collections.abc import Mapping

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.aia.pose_kernels import find_cell, follow_controls
from fgplan.planners.distributed_aia.extraction import claim_order, extra_steps, replayed
from fgplan.planners.distributed_aia.forest_growth import ForestGrowth
from fgplan.planners.distributed_aia.plan_messages import (
    Claim,
    PlanMessage,
    Report,
    WayMessage,
    read_way,
)
from fgplan.planners.distributed_aia.way import Way
from fgplan.typing import FloatArray

_SAME = 1e-5
"""Metres and radians: poses of a tree are one below a micrometre and a millionth of a turn."""
_SAME_COST = 1e-9


def check_claim(growth: ForestGrowth, sender: int, claim: Claim) -> None:
    """Refuse a claim that nobody can have on this robot.

    Args:
        growth: The robot's tree, row 0.
        sender: From whom it came.
        claim: It.

    Raises:
        InvalidInputError: If it is on another robot, from one that does not claim this one in plans
            of its origin, or asks for more steps than a tree of its sweep has.
    """
    robot = growth.robots[0]
    by = _claimed_by(growth, claim.origin).get(robot)
    if claim.robot != robot or robot == claim.origin or by != sender:
        raise InvalidInputError(
            f"claim: expected one on robot number {robot} from who claims it in plans of robot "
            f"number {claim.origin}, got one on {claim.robot} from {sender}"
        )
    extra = extra_steps(growth.graph, claim.origin, growth.options.constraint_at)
    if claim.steps > claim.born_by + 1 + extra:
        raise InvalidInputError(
            f"claim: steps: expected at most {claim.born_by + 1 + extra} for a goal node of sweep "
            f"{claim.born_by}, got {claim.steps}"
        )


def check_way(growth: ForestGrowth, sender: int, message: WayMessage) -> None:
    """Refuse a way that does not come from where it should, or that its robot cannot go.

    Args:
        growth: The robot's tree, row 0.
        sender: From whom it came.
        message: The way.

    Raises:
        InvalidInputError: If so.
    """
    robot, by = growth.robots[0], _claimed_by(growth, message.origin)
    hop = message.robot
    while hop in by and hop != message.origin and by[hop] != robot:
        hop = by[hop]
    if hop != sender or by.get(hop) != robot:
        raise InvalidInputError(
            f"way of robot number {message.robot} for a plan of {message.origin}: expected from "
            f"whom it passes on its way to robot number {robot}, got from {sender}"
        )
    if message.origin == robot:
        _check_moves(growth, {message.robot: read_way(message.poses, message.assigned)})


def check_report(
    growth: ForestGrowth, part: tuple[int, ...], report: Report, best: PlanMessage | None
) -> None:
    """Refuse a report with a plan that is none.

    Args:
        growth: The robot's tree, row 0.
        part: The robot's part of the team.
        report: It.
        best: The best plan that this robot believes in.

    Raises:
        InvalidInputError: If the plan is not one of the reporter for its part of the team; if it is
            better than ``best``, also if a robot cannot follow it, or a replay gives another cost
            or does not satisfy the constraint.
    """
    plan = report.plan
    if report.robot not in part:
        raise InvalidInputError(
            f"report: expected one of a robot with number {', '.join(map(str, part))}, got "
            f"{report.robot}"
        )
    if plan is None:
        return
    ranked = growth.options.until == "first_feasible"
    if (
        plan.robots != part
        or plan.origin != report.robot
        or plan.rank >= report.through
        or (plan.rank > 0 and not ranked)
        or not math.isfinite(plan.cost)
    ):
        raise InvalidInputError(
            f"report of robot number {report.robot}: expected a plan of its own for robots "
            f"{list(part)} with a finite cost and a rank below {report.through}, got one of "
            f"{plan.origin} for {list(plan.robots)}, cost {plan.cost}, rank {plan.rank}"
        )
    ways = plan.ways()
    lengths = {len(way.poses) for way in ways.values()}
    most = plan.rank + 1 if ranked else growth.options.node_budget
    most += extra_steps(growth.graph, plan.origin, growth.options.constraint_at)
    if len(lengths) != 1 or max(lengths) > most + 1:
        raise InvalidInputError(
            f"report of robot number {report.robot}: expected ways of one length, at most {most} "
            f"steps, got {sorted(length - 1 for length in lengths)}"
        )
    if best is not None and best.key <= plan.key:
        return
    _check_moves(growth, ways)
    found = replayed(growth, ways, ((plan.origin, plan.goal),))
    if found is None or not math.isclose(found.cost, plan.cost, rel_tol=_SAME_COST):
        raise InvalidInputError(
            f"report of robot number {report.robot}: expected a plan that satisfies the terminal "
            f"constraint at cost {plan.cost}, got "
            + ("one that does not" if found is None else f"cost {found.cost} in the replay")
        )


def _claimed_by(growth: ForestGrowth, origin: int) -> dict[int, int]:
    """Who claims whom in plans of a robot; nobody where there is no such robot."""
    return dict(claim_order(growth.graph, origin)) if origin < len(growth.graph.robots) else {}


def _check_moves(growth: ForestGrowth, ways: Mapping[int, Way]) -> None:
    """Refuse ways that do not begin at their robots, or go where no free control leads."""
    setting = growth.prepared.setting
    for robot, way in ways.items():
        name = growth.graph.robots[robot]
        start = growth.problem.robots[robot].pose
        if not _is_same(way.poses[0], start) or way.assigned.max() >= growth.problem.targets:
            raise InvalidInputError(
                f"way of robot {name!r}: expected from {np.asarray(start).tolist()} with targets "
                f"below {growth.problem.targets}, got from {way.poses[0].tolist()} with target "
                f"{way.assigned.max()}"
            )
        kind = int(setting.kind[robot])
        controls = int(setting.motions.controls[kind])
        ends, found = np.empty((controls, 3)), np.empty(controls, dtype=np.int64)
        for t, (pose, after) in enumerate(zip(way.poses[:-1], way.poses[1:], strict=True)):
            if _is_same(pose, after):
                continue
            cell = find_cell(setting.fields.frame, pose[0], pose[1])
            follow_controls(setting.motions, setting.obstacles, pose, kind, cell, ends, found)
            if not any(_is_same(end, after) for end in ends[found != -1]):
                raise InvalidInputError(
                    f"way of robot {name!r}: expected the end of a free control after step {t}, "
                    f"got {after.tolist()} after {pose.tolist()}"
                )


def _is_same(first: FloatArray, second: FloatArray) -> bool:
    """Whether two poses are one, up to rounding."""
    x, y, heading = (float(a) - float(b) for a, b in zip(first, second, strict=True))
    return max(abs(x), abs(y), abs(math.remainder(heading, 2.0 * math.pi))) < _SAME
