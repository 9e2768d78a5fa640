"""What teammates of an intermittently connected team cannot have to say is refused."""

import math

import msgspec
import numpy as np
import pytest
from hostile_messages import digest
from intermittent_meeting import at_a_meeting

from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.estimate import Record
from fgplan.planners.intermittent.message import (
    Agreed,
    Known,
    Numbers,
    Sensed,
    numbers_of,
    unwrap,
    wrap,
)
from fgplan.planners.intermittent.robot import step
from fgplan.team.envelope import Inbox


@pytest.fixture(scope="module", name="meeting")
def a_robot_at_a_meeting_and_what_it_is_told():
    """The state, what it is told there, and what is agreed at the end."""
    state, letters = at_a_meeting(1)
    told = [(sender, unwrap(letter)) for sender, letter in letters]
    known = next(item for item in told if isinstance(item[1], Known))
    agreed = next(item for item in told if isinstance(item[1], Agreed))
    return state, known, agreed


def tell(state, sender, content):
    """The robot afterwards; the message went over the wire."""
    envelope = wrap(sender, state.leg.team, state.leg.epoch, content)
    return step(state, Inbox(0.0, (msgspec.structs.replace(envelope),)))[0]


def refused(state, sender, content, says):
    before = digest(state)
    with pytest.raises(InvalidInputError, match=says):
        tell(state, sender, content)
    assert digest(state) == before


def changed(content, **changes):
    return msgspec.structs.replace(content, **changes)


def test_what_teammates_do_say_is_taken_in(meeting):
    state, (sender, known), (leader, agreed) = meeting
    assert set(tell(state, sender, known).offers) > set(state.offers)
    assert tell(state, leader, agreed).phase == "moving"


def test_only_the_own_sensors_say_what_was_sensed(meeting):
    state, (sender, _), _ = meeting
    record = Record(state.now + 1, state.position)
    envelope = wrap(sender, 0, record.time, Sensed(record))
    with pytest.raises(InvalidInputError, match="expected what the own sensors"):
        step(state, Inbox(0.0, (envelope,)))


FAR = 2**60


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda k: {"logs": k.logs[1:]}, "expected logs and times of 3 robots"),
        (lambda k: {"heard": k.heard[1:]}, "expected logs and times of 3 robots"),
        (lambda k: {"time": FAR}, "expected what was measured by step"),
        (lambda k: {"heard": (FAR, *k.heard[1:])}, "expected what was measured by step"),
        (lambda k: {"robot": 7}, "robot: expected the sender's row, got 7"),
        (lambda k: {"mean": numbers_of(np.zeros(4))}, r"mean: expected shape \(9,\)"),
        (lambda k: {"covariance": numbers_of(np.eye(3))}, "covariance: expected shape"),
        (lambda k: {"mean": numbers_of(np.full(9, math.nan))}, "expected finite numbers"),
        (lambda k: {"mean": numbers_of(np.full(9, 1e200))}, "mean: expected numbers of at most"),
        (lambda k: {"mean": Numbers((2**62, 4), b"")}, "bytes for shape"),
        (lambda k: {"mean": Numbers((9,), b"123")}, "expected 72 bytes"),
        (lambda k: {"offers": {"zoe": next(iter(k.offers.values()))}}, "'zoe' is not of the team"),
    ],
)
def test_knowledge_that_nobody_can_have_is_refused(meeting, change, says):
    state, (sender, known), _ = meeting
    refused(state, sender, changed(known, **change(known)), says)


def test_knowledge_of_another_row_or_another_team_is_refused(meeting):
    state, (sender, known), _ = meeting
    members = state.setup.schedule.graph.teams[state.leg.team]
    other = next(name for name in state.setup.robots if name not in members)
    refused(state, other, known, "expected one of")
    own = state.setup.robots.index(state.robot)
    refused(state, sender, changed(known, robot=own), "expected the sender's row")


@pytest.mark.parametrize(
    ("block", "says"),
    [
        (np.diag([1.0, 1.0, -0.1]), "positive semidefinite"),
        (np.full((3, 3), 1e308), "numbers of at most"),
        (np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "symmetric"),
    ],
)
def test_a_later_checkpoint_must_be_a_covariance(meeting, block, says):
    state, (sender, known), _ = meeting
    lie = changed(known, time=state.now, covariance=numbers_of(np.array([block] * 3)))
    refused(state, sender, lie, says)


@pytest.mark.parametrize(
    ("records", "says"),
    [
        ([(1, (1.0, 1.0), ()), (1, (1.0, 1.0), ())], "expected times ascending"),
        ([(10**6, (1.0, 1.0), ())], "expected times ascending"),
        ([(-3, (1.0, 1.0), ())], "expected times ascending"),
        ([(0, (math.nan, 1.0), ())], "expected finite numbers"),
        ([(0, (1.0, 1.0), ((0, (math.inf,)),))], "expected finite numbers"),
        ([(0, (1.0, 1.0), ((2**40, (1.0,)),))], "readings of things below 3, got"),
        ([(0, (1.0, 1.0), ((-1, (1.0,)),))], "readings of things below 3, got -1"),
        ([(0, (1.0, 1.0), ((0, (1.0,) * 7),))], "numbers for reading 0, got 7"),
        ([(0, (1.0, 1.0), ((0, ()),))], "numbers for reading 0, got 0"),
    ],
)
def test_logs_that_nobody_can_have_are_refused(meeting, records, says):
    state, (sender, known), _ = meeting
    row = known.robot
    first = known.logs[row][0].time if known.logs[row] else known.time + 1
    log = tuple(
        Record(first if time == 0 else time, position, readings)
        for time, position, readings in records
    )
    logs = (*known.logs[:row], log, *known.logs[row + 1 :])
    refused(state, sender, changed(known, logs=logs), says)


def leg_changed(agreed, name, **changes):
    return {**agreed.legs, name: changed(agreed.legs[name], **changes)}


def test_ways_that_cannot_be_are_refused(meeting):
    state, _, (leader, agreed) = meeting
    me = state.robot

    def says(match, legs):
        refused(state, leader, changed(agreed, legs=legs), match)

    says("expected ways of", {me: agreed.legs[me]})
    says("one meeting that is to come", leg_changed(agreed, me, team=state.leg.team + 1))
    says("one meeting that is to come", leg_changed(agreed, me, epoch=state.leg.epoch + 50))
    old = {name: changed(leg, due=0, start=0) for name, leg in agreed.legs.items()}
    short = {
        name: changed(leg, places=numbers_of(np.array([[1.0, 1.0]]))) for name, leg in old.items()
    }
    says("one meeting that is to come", short)
    for name in ("due", "start", "slack"):
        says("expected a way that is over by step", leg_changed(agreed, me, **{name: FAR}))
    says("expected an epoch near", leg_changed(agreed, me, epoch=FAR))
    far = numbers_of(np.array([[1.0, 1.0], [99.0, 1.0]]))
    says("inside the workspace", leg_changed(agreed, me, places=far))
    jump = numbers_of(np.array([[1.0, 1.0], [9.0, 1.0]]))
    says("expected steps of at most", leg_changed(agreed, me, places=jump))
    says("expected places of shape", leg_changed(agreed, me, places=numbers_of(np.zeros(3))))


def test_offers_that_cannot_be_are_refused(meeting):
    state, (sender, known), (_, agreed) = meeting
    offer, leg = known.offers[sender], next(iter(agreed.legs.values()))

    def says(match, **changes):
        offers = {**known.offers, sender: changed(offer, **changes)}
        refused(state, sender, changed(known, offers=offers), match)

    says("inside the workspace", position=(-5.0, 1.0))
    says("inside the workspace", position=(math.nan, 1.0))
    says("expected one way a team", legs=(leg, leg))
    says("expected one way a team", legs=(changed(leg, team=99),))
    says("expected a way that is over", legs=(changed(leg, due=FAR),))
