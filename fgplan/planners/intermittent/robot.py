"""Algorithm 5 as a robot: ``step(state, inbox) -> (state, outbox)``.

A robot follows its leg, measures, and runs its filter with what it measures. At the end of the
leg it tells its team everything (``known``) and passes on whatever is news to it, so that all who
are connected, over several hops if need be, come to know the same. While it waits it does so every
step: there is who was heard in this step. When the whole team is there and nobody has news (the
inbox is empty), its first member plans the ways to the team's next meeting and hands them round
(``agreed``); each filters anew from its checkpoint, late measurements included, drops what is
complete, and leaves.

A teammate that does not come is waited for until ``wait_steps`` after the agreed time: so long may
who waits be late elsewhere. Those who are there have told each other everything by then and go on.
Nobody has agreed on anything new, so present and absent alike know where and when the team meets
next: at the same place, in the first of its recovery slots that is not past. What the
absent robot measured stays in its log until it meets anybody; logs are prefixes, so nothing is
lost and nothing counted twice. A robot that is late takes the short way to the end of its next leg,
unless nobody would wait there any more: then it goes to that team's next chance in its turn.
"""

from collections.abc import Mapping

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.knowledge import forget, fuse, join, remember
from fgplan.planners.intermittent.leg import Leg, departed, departed_in_turn, in_turn
from fgplan.planners.intermittent.message import (
    Agreed,
    Known,
    Offer,
    Sensed,
    knowledge_of,
    known_of,
    leg_data,
    leg_of,
    unwrap,
    wrap,
)
from fgplan.planners.intermittent.message_check import check_message
from fgplan.planners.intermittent.robot_state import MeetingRecord, RobotState, TeamSetup
from fgplan.planners.intermittent.segment import Segment
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from fgplan.team.envelope import Inbox, Outbox, Outgoing
from fgplan.typing import FloatArray


def step(state: RobotState, inbox: Inbox) -> tuple[RobotState, Outbox]:
    """Take in what the sensors and teammates say; meet, plan and leave when it is time.

    Args:
        state: The robot; not changed.
        inbox: At most one ``sensed`` from its own sensors, and messages of teammates; or nothing,
            when no message is under way any more.

    Returns:
        The robot afterwards, and what it sends to all within range.

    Raises:
        InvalidInputError: If a message is malformed.
        NoCandidatePathError: If obstacles keep a team apart.
    """
    outgoing: list[Outgoing] = []
    for envelope in inbox.envelopes:
        content = unwrap(envelope)
        if isinstance(content, Sensed):
            if envelope.robot != state.robot:
                raise InvalidInputError(
                    f"message 'sensed' of robot {envelope.robot!r}: expected what the own sensors "
                    f"of robot {state.robot!r} say"
                )
            state = _sense(state, content)
            state, news = _enter(state)
        elif envelope.session != state.leg.team or state.phase != "meeting":
            continue  # of another team that meets nearby, or of a meeting that is over
        else:
            check_message(state, envelope.robot, content)
            if isinstance(content, Known):
                state, news = _listen(state, content)
            else:
                state, news = _agree(state, content, _NOT_PLANNED)
        outgoing += news
    if state.phase == "meeting" and not inbox.envelopes:
        if len(state.offers) == len(_members(state)):
            state, news = _plan(state)
            outgoing += news
        elif state.now >= state.leg.due + state.setup.wait_steps:
            state = _leave_in_vain(state)
    return state, tuple(outgoing)


def place_at(state: RobotState, time: int) -> FloatArray:
    """Where a robot wants to be at a step.

    Args:
        state: The robot.
        time: Step.

    Returns:
        Shape (2,), metres.
    """
    return state.leg.place_at(time)


def _members(state: RobotState) -> tuple[str, ...]:
    """The team of the leg."""
    return state.setup.schedule.graph.teams[state.leg.team]


def _sense(state: RobotState, sensed: Sensed) -> RobotState:
    """Take in where it is and what it measured; a robot off its leg finds its way back."""
    record, setup = sensed.record, state.setup
    kept = record if record.readings else None
    knowledge = remember(state.knowledge, record.time, kept)
    estimate = state.estimate
    if kept is not None:  # else the prediction can wait until there is something to filter
        own = [(state.knowledge.robot, record)]
        estimate = setup.model.run(estimate, record.time, own).estimate
    position = np.array(record.position)
    legs = state.legs
    if state.phase == "moving" and not np.array_equal(position, state.leg.place_at(record.time)):
        legs = _kept(setup, legs, record.time, position)
    return msgspec.structs.replace(
        state,
        now=record.time,
        position=record.position,
        knowledge=knowledge,
        estimate=estimate,
        legs=legs,
    )


def _enter(state: RobotState) -> tuple[RobotState, list[Outgoing]]:
    """Arrive at a meeting, or be there still, and tell everything.

    Offers of an earlier step are dropped: of a team of three one may come just when another falls
    silent, and who does not hear what is agreed would wait for its team at the old place for ever.
    """
    if state.phase == "moving" and state.now < state.leg.ready:
        return state, []
    others = sorted(
        (leg for leg in state.legs.values() if leg.team != state.leg.team),
        key=in_turn,
    )
    offer = Offer(state.position, tuple(leg_data(leg) for leg in others))
    state = msgspec.structs.replace(state, phase="meeting", offers={state.robot: offer})
    return state, _tell(state)


def _tell(state: RobotState) -> list[Outgoing]:
    """Everything it knows."""
    content = known_of(state.knowledge, state.offers)
    return [Outgoing(wrap(state.robot, state.leg.team, state.leg.epoch, content))]


def _listen(state: RobotState, known: Known) -> tuple[RobotState, list[Outgoing]]:
    """Take in what a teammate knows; pass it on if it was news."""
    before = state.knowledge
    knowledge = join(before, knowledge_of(known))
    offers = {**known.offers, **state.offers}
    news = len(offers) > len(state.offers) or bool((knowledge.heard > before.heard).any())
    state = msgspec.structs.replace(state, knowledge=knowledge, offers=offers)
    return state, _tell(state) if news else []


def _plan(state: RobotState) -> tuple[RobotState, list[Outgoing]]:
    """The first member of a complete team plans for all."""
    members = _members(state)
    if state.robot != members[0]:
        return state, []  # it waits for the ways to be handed round
    setup, leg = state.setup, state.leg
    epoch = leg.epoch + setup.schedule.period
    starts, times, tracks = [], [], []
    for name in members:
        offer = state.offers[name]
        between = tuple(leg_of(data) for data in offer.legs)
        ways = departed_in_turn(
            between, state.now, np.array(offer.position), setup.grid, setup.options.step_m
        )
        starts.append(ways[-1].places[-1] if ways else np.array(offer.position))
        times.append(ways[-1].leaves if ways else state.now)
        tracks.append(ways)
    rows = np.arange(state.now, max(times) + 1)
    problem = SegmentProblem(
        workspace=setup.workspace,
        model=setup.model,
        estimate=fuse(state.knowledge, setup.model, state.now).estimate,
        starts=np.array(starts),
        times=np.array(times),
        tracks=np.stack(
            [
                np.array([_place(ways, start, int(t)) for t in rows])
                for ways, start in zip(tracks, starts, strict=True)
            ],
            axis=1,
        ),
        carriers=np.array([setup.robots.index(name) for name in members]),
        bodies=np.arange(len(members)),
    )
    generator = np.random.default_rng([setup.seed, leg.team, epoch])
    segment = setup.planner(problem, setup.options, generator)
    legs = {
        name: leg_data(Leg(leg.team, epoch, segment.end, start, places))
        for name, start, places in zip(members, times, segment.places, strict=True)
    }
    agreed = Agreed(known_of(state.knowledge, state.offers), legs)
    return _agree(state, agreed, segment)


def _place(ways: tuple[Leg, ...], start: FloatArray, time: int) -> FloatArray:
    """Where a robot is on its ways with other teams."""
    for leg in ways:
        if time <= leg.leaves:
            return leg.place_at(time)
    return start


_NOT_PLANNED = Segment(
    end=0, places=(), cost=0.0, target=-1, rank=-2, failed=(), nodes=0, meeting_nodes=0
)


def _agree(
    state: RobotState, agreed: Agreed, segment: Segment
) -> tuple[RobotState, list[Outgoing]]:
    """Take over the ways to the next meeting, pass them on, and leave."""
    team, epoch = state.leg.team, state.leg.epoch
    knowledge = join(state.knowledge, knowledge_of(agreed.known))
    state = msgspec.structs.replace(state, knowledge=knowledge)
    message = Outgoing(wrap(state.robot, team, epoch, agreed))
    state = _fuse_and_forget(state, tuple(agreed.legs), segment)
    return _depart(state, leg_of(agreed.legs[state.robot])), [message]


def _leave_in_vain(state: RobotState) -> RobotState:
    """Go on without those who did not come."""
    leg = state.leg
    state = _fuse_and_forget(state, tuple(state.offers), _NOT_PLANNED)
    return _depart(state, _next_chance(state.setup, leg, state.now))


def _next_chance(setup: TeamSetup, leg: Leg, time: int) -> Leg:
    """The first slot of a team after a meeting that failed for which a time is not too late.

    Slots are ``recovery_steps`` long, one for each epoch of the period in turn, so a robot has time
    to go from one of its teams to the next: were failed meetings put off by the same number of
    steps each, teams that once were too close for a shared robot would remain so for ever.
    """
    schedule, length = setup.schedule, setup.recovery_steps
    first, apart = schedule.colors[leg.team] * length, schedule.period * length
    due, epoch = leg.due, leg.epoch
    while due == leg.due or due + setup.wait_steps < time:
        due = first + ((due - first) // apart + 1) * apart
        epoch += schedule.period
    # Who did not come once is planned with as if it would be waited for in vain again.
    return Leg(leg.team, epoch, due, due, leg.places[-1:], slack=setup.wait_steps)


def _fuse_and_forget(state: RobotState, present: tuple[str, ...], segment: Segment) -> RobotState:
    """Filter anew with all that is known, and drop what is complete."""
    setup, leg = state.setup, state.leg
    everybody = [name for name in setup.robots if name in present]
    filtered = fuse(state.knowledge, setup.model, state.now)
    begun = state.knowledge.checkpoint.time
    knowledge = forget(state.knowledge, setup.model, setup.gone_after)
    record = MeetingRecord(
        team=leg.team,
        epoch=leg.epoch,
        due=leg.due,
        time=state.now,
        present=tuple(everybody),
        complete=len(everybody) == len(_members(state)),
        complete_until=knowledge.complete_until,
        heard=tuple(knowledge.heard.tolist()),
        readings=knowledge.readings,
        checkpoint=knowledge.checkpoint.time,
        failed=segment.failed,
        rank=segment.rank,
        nodes=segment.nodes,
    )
    return msgspec.structs.replace(
        state,
        knowledge=knowledge,
        estimate=filtered.estimate,
        fused=(begun, filtered),
        epoch=leg.epoch,
        meetings=(*state.meetings, record),
    )


def _depart(state: RobotState, agreed: Leg) -> RobotState:
    """Leave for the next meeting in turn."""
    position = np.array(state.position)
    legs = {**state.legs, agreed.team: agreed}
    legs = _kept(state.setup, legs, state.now, position)
    return msgspec.structs.replace(state, legs=legs, phase="moving", offers={})


def _kept(
    setup: TeamSetup, legs: Mapping[int, Leg], time: int, position: FloatArray
) -> dict[int, Leg]:
    """Legs from a place at a time on: the first as it is followed, and none that comes too late.

    A robot that went on to a meeting which is over would be late for all that follow, for ever.
    """
    legs = dict(legs)
    while True:
        leg = min(legs.values(), key=in_turn)
        followed = departed(leg, time, position, setup.grid, setup.options.step_m)
        if followed.arrival <= leg.due + setup.wait_steps:
            return {**legs, leg.team: followed}
        legs[leg.team] = _next_chance(setup, leg, followed.arrival)
