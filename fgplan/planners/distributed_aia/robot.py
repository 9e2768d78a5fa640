"""A robot that plans with its neighbours, as a value: ``step(state, inbox) -> (state, outbox)``.

Sweeps. A robot does its sweep s + 1 when it holds what every neighbour had made by its sweep s, or
has waited long enough for it; what neighbours made later waits its turn. So trees depend neither
on the order in which messages arrive nor on who is faster. A message that is lost leaves a hole in
what is known of a neighbour, and the robot asks for it; until then it goes on with what it has
(Remark 3).

Plans. A robot that has made goal nodes claims the ways that they need, replays the team path, and
keeps the cheapest that satisfies the constraint; until then it does not sweep, and its neighbours
wait for it. It *reports* through a sweep when all its goal nodes up to there have been looked at:
with ``first_feasible`` through the sweep of the earliest goal node that any report holds a plan of,
with a budget through the last one. Who has the reports of its whole part of the team is finished,
and holds the same plan as all others: that of the earliest sweep, of these the cheapest.

Losses. A plan has a way of every robot of the part. So where the network tells that one of them has
been away for ``wait_s``, the others make no further plans: they report what they have, and end.
"""

from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.distributed_aia.claims import (
    OpenPlan,
    answer_claim,
    closed_plans,
    first_claims,
    take_way,
)
from fgplan.planners.distributed_aia.message_check import check_claim, check_report, check_way
from fgplan.planners.distributed_aia.node_message import NodeMessage, Nodes, read_nodes
from fgplan.planners.distributed_aia.plan_messages import (
    Ask,
    Claim,
    PlanMessage,
    PlanningMessage,
    Report,
    WayMessage,
    read_planning_message,
)
from fgplan.planners.distributed_aia.robot_state import RobotState
from fgplan.team.envelope import Envelope, Inbox, Outbox, Outgoing

NODES = "nodes"
REPORT = "report"
"""Kind of the only message that robots pass on."""
SWEEPS_A_STEP = 64
"""Sweeps that a robot without neighbours does in one step."""
_OVER = ("iterations", "feasible", "lost")
_FOREVER = 2**31 - 1


def step(state: RobotState, inbox: Inbox) -> tuple[RobotState, Outbox]:
    """Take in what arrived, sweep as far as that goes, answer.

    Args:
        state: The robot.
        inbox: Time and envelopes.

    Returns:
        The robot afterwards and what it sends.

    Raises:
        InvalidInputError: If a message is malformed.
    """
    before = (state.growth.sweep, len(state.reports))
    out: list[Outgoing] = []
    state = _see(state, inbox)
    began = not any(state.told.values()) and state.growth.sweep == 0
    if began:
        state = _tell(state, out)
    late = not began and inbox.now_s >= state.wake_s
    for envelope in inbox.envelopes:
        if envelope.session != state.setup.session:
            continue
        state = _take_in(state, envelope, out)
    asked = late
    if asked:
        _ask_again(state, out)
    state = _close(_answer(state, out))
    for _ in range(SWEEPS_A_STEP):
        if state.opened or state.ending in _OVER or not _is_ready(state, late=late):
            break
        late = False
        state = _close(_answer(_sweep(state, out), out))
    state = _report(state, out)
    if state.finished:
        return replace(state, wake_s=np.inf), tuple(out)
    wake_s = state.wake_s
    if asked or began or before != (state.growth.sweep, len(state.reports)):
        alone = not state.sweeps_of and not state.ending
        wake_s = inbox.now_s + (0.0 if alone else state.setup.wait_s)
    lost_s = [since + state.setup.wait_s for since in state.absent.values()]
    return replace(state, wake_s=min([wake_s, *lost_s])), tuple(out)


def _see(state: RobotState, inbox: Inbox) -> RobotState:
    """Note who is away, and who has been for too long; who has finished no longer cares."""
    if inbox.present is None or state.finished or state.lost:
        return state
    setup = state.setup
    absent = {
        robot: state.absent.get(robot, inbox.now_s)
        for robot in setup.part
        if robot != setup.robot and setup.graph.robots[robot] not in inbox.present
    }
    lost = frozenset(
        robot for robot, since in absent.items() if inbox.now_s >= since + setup.wait_s
    )
    if lost:
        return replace(state, absent={}, lost=lost, opened=())
    return replace(state, absent=absent)


def _take_in(state: RobotState, envelope: Envelope, out: list[Outgoing]) -> RobotState:
    """One message."""
    sender = _place(state, envelope.robot)
    if envelope.kind == REPORT:
        return _believe(state, sender, envelope, out)
    if sender not in state.sweeps_of:
        raise InvalidInputError(
            f"{envelope.kind} of robot {envelope.robot!r}: robot {state.setup.name!r} does not "
            "hear it"
        )
    if envelope.kind == NODES:
        if state.ending in _OVER:
            return state
        nodes = envelope.content or read_nodes(envelope.payload, state.growth.problem.targets)
        return _hold(state, sender, envelope.sequence, nodes)
    message = envelope.content or read_planning_message(envelope.payload)
    if isinstance(message, Claim):
        check_claim(state.growth, sender, message)
        if message in state.claims:
            return state
        return replace(state, claims=(*state.claims, message))
    if isinstance(message, WayMessage):
        check_way(state.growth, sender, message)
        opened, forwarded = take_way(state.setup.robot, state.setup.graph, state.opened, message)
        if forwarded is not None:
            _send(state, out, message, to=forwarded)
        return replace(state, opened=opened)
    if isinstance(message, Ask):
        for robot, letter in state.letters.items():
            if robot not in message.has:
                out.append(Outgoing(letter, envelope.robot))
        return state
    raise InvalidInputError(
        f"message of robot {envelope.robot!r}: kind: expected {REPORT!r} of a report, got "
        f"{envelope.kind!r}"
    )


def _believe(state: RobotState, writer: int, envelope: Envelope, out: list[Outgoing]) -> RobotState:
    """A report that says more than what is known of that robot; it is passed on as it was written.

    It may have come by others that passed it on, so a team that signs its messages knows all the
    same who wrote it.
    """
    report = envelope.content or read_planning_message(envelope.payload)
    if not isinstance(report, Report) or report.robot != writer:
        raise InvalidInputError(
            f"report of robot {envelope.robot!r}: expected one of itself, got "
            f"{type(report).__name__.lower()} of robot number {getattr(report, 'robot', None)}"
        )
    known = state.reports.get(report.robot)
    if report.robot == state.setup.robot or (known and known.through >= report.through):
        return state
    check_report(state.growth, state.setup.part, report, state.plan)
    held = known.plan if known is not None else None
    if held is not None and (report.plan is None or report.plan.key > held.key):
        raise InvalidInputError(
            f"report of robot number {report.robot}: expected a plan at least as good as the one "
            f"that it reported through sweep {known.through if known else 0}"
        )
    names = state.setup.graph.robots
    out.extend(Outgoing(envelope, names[other]) for other in state.sweeps_of if other != writer)
    return _keep_report(state, report, envelope)


def _keep_report(state: RobotState, report: Report, envelope: Envelope) -> RobotState:
    """A report, and the envelope that it came in."""
    return replace(
        state,
        reports=state.reports | {report.robot: report},
        letters=state.letters | {report.robot: envelope},
    )


def _hold(state: RobotState, sender: int, sequence: int, nodes: Nodes) -> RobotState:
    """Keep nodes until their turn; notice a hole, and what the sender misses."""
    has, hole = state.has[sender]
    end, budget = nodes.first + len(nodes.parents), state.setup.options.node_budget
    if end > budget:
        raise InvalidInputError(
            f"nodes of robot {state.setup.graph.robots[sender]!r}: expected numbers below the node "
            f"budget {budget}, got up to {end - 1}"
        )
    hole = hole or nodes.first > has
    if nodes.first <= has < end:
        has, hole = end, False
    told = state.told
    if 0 <= nodes.wants < told[sender]:
        told = told | {sender: nodes.wants}
    waiting = state.waiting
    key = (sequence, sender)
    if key not in waiting or waiting[key].first > nodes.first:
        waiting = waiting | {key: nodes}
    return replace(
        state,
        has=state.has | {sender: (has, hole)},
        told=told,
        waiting=waiting,
        sweeps_of=state.sweeps_of | {sender: max(state.sweeps_of[sender], sequence)},
    )


def _is_ready(state: RobotState, *, late: bool) -> bool:
    """Whether every neighbour was heard to have done as many sweeps, or it waited enough."""
    return late or all(done >= state.growth.sweep for done in state.sweeps_of.values())


def _sweep(state: RobotState, out: list[Outgoing]) -> RobotState:
    """One iteration with what the neighbours had made by as many sweeps; tell them."""
    growth, now = state.growth, state.growth.sweep
    due = sorted(key for key in state.waiting if key[0] <= now)
    for key in due:
        growth.receive(key[1], state.waiting[key])
    growth.run(1)
    waiting = {key: message for key, message in state.waiting.items() if key not in due}
    state = _tell(replace(state, waiting=waiting), out)
    if state.setup.options.until == "first_feasible":
        state = _look(state, out, growth.goal_nodes(0, born_since=now))
    elif state.ending and state.looked_at == 0:
        state = _look(state, out, growth.goal_nodes(0))
    return state


def _look(state: RobotState, out: list[Outgoing], goals: Sequence[int]) -> RobotState:
    """Claim ways for goal nodes."""
    state.growth.goals_looked_at()
    opened = list(state.opened)
    for goal in goals:
        plan = OpenPlan.of(state.growth, goal)
        opened.append(plan)
        for other, claim in first_claims(state.setup.robot, state.setup.graph, plan):
            _send(state, out, claim, to=other)
    return replace(state, opened=tuple(opened), looked_at=state.growth.sweep)


def _answer(state: RobotState, out: list[Outgoing]) -> RobotState:
    """Answer claims, once the sweep in which their goal nodes were made is over here too."""
    left = []
    over = state.ending in _OVER
    for claim in state.claims:
        if state.growth.sweep <= claim.born_by:
            if not over:  # else its plan comes after the one that is held
                left.append(claim)
            continue
        for other, message in answer_claim(state.growth, claim):
            _send(state, out, message, to=other)
    return replace(state, claims=tuple(left))


def _close(state: RobotState) -> RobotState:
    """Replay the plans whose ways are all there."""
    opened, plans, refused = closed_plans(state.growth, state.setup.part, state.opened)
    count = len(state.opened) - len(opened)
    accepted = state.accepted or bool(plans)
    if state.opened and not opened:
        if not accepted:
            state.growth.tighten(0)
        accepted = False
    best = min([*plans, *([state.best] if state.best else [])], key=_key, default=None)
    replays = (state.replayed[0] + count, state.replayed[1] + refused)
    return replace(state, opened=opened, accepted=accepted, best=best, replayed=replays)


def _report(state: RobotState, out: list[Outgoing]) -> RobotState:
    """Report through a sweep, where all goal nodes up to there have been looked at."""
    robot, options = state.setup.robot, state.setup.options
    held = min([plan.rank for plan in (state.plan, state.best) if plan is not None], default=None)
    if state.ending in ("iterations", "nodes", "lost"):
        through = _FOREVER
    elif options.until == "first_feasible" and held is not None:
        through = held + 1
        if state.growth.sweep < through:
            return state
    else:
        return state
    if any(plan.born < through for plan in state.opened):
        return state
    known = state.reports.get(robot)
    if known is not None and known.through <= through:
        return state
    best = state.best if state.best is not None and state.best.rank < through else None
    report = Report(robot=robot, through=through, plan=best)
    return _keep_report(state, report, _send(state, out, report))


def _tell(state: RobotState, out: list[Outgoing]) -> RobotState:
    """Tell each neighbour of the nodes made since the last time, or since what it misses."""
    growth, setup = state.growth, state.setup
    written: dict[tuple[int, int], Envelope] = {}
    for other, first in state.told.items():
        has, hole = state.has[other]
        key = (first, has if hole else -1)
        if key not in written:
            nodes = growth.made(0, *key)
            written[key] = Envelope(
                robot=setup.name,
                session=setup.session,
                sequence=growth.sweep,
                kind=NODES,
                payload=msgspec.msgpack.encode(NodeMessage.of(nodes)),
            ).keep(nodes)
        out.append(Outgoing(written[key], setup.graph.robots[other]))
    return replace(state, told=dict.fromkeys(state.told, growth.nodes(0)))


def _ask_again(state: RobotState, out: list[Outgoing]) -> None:
    """Nothing has come for long: ask for reports, claim again what has not been answered."""
    _send(state, out, Ask(has=tuple(sorted(state.reports))))
    for plan in state.opened:
        for other, claim in first_claims(state.setup.robot, state.setup.graph, plan):
            _send(state, out, claim, to=other)


def _send(
    state: RobotState,
    out: list[Outgoing],
    message: PlanningMessage,
    *,
    to: int | None = None,
) -> Envelope:
    """Send to one neighbour, or to all; what was sent."""
    setup = state.setup
    kind = type(message).__name__.removesuffix("Message").lower()
    envelope = Envelope(
        robot=setup.name,
        session=setup.session,
        sequence=state.growth.sweep,
        kind=kind,
        payload=msgspec.msgpack.encode(message),
    ).keep(message)
    receivers = [to] if to is not None else list(state.sweeps_of)
    out.extend(Outgoing(envelope, setup.graph.robots[other]) for other in receivers)
    return envelope


def _place(state: RobotState, name: str) -> int:
    """Place of a robot in the team."""
    robots = state.setup.graph.robots
    if name not in robots:
        raise InvalidInputError(f"message of robot {name!r}: expected one of {', '.join(robots)}")
    return robots.index(name)


def _key(plan: PlanMessage) -> tuple[int, float, int, int]:
    """Order of plans."""
    return plan.key
