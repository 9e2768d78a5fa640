"""Who counts as lost: silence counts only while the robot itself was awake."""

import pytest
from table_teams import make_team

from fgplan.team.coordination import set_up_team
from fgplan.team.envelope import Inbox
from fgplan.team.options import CoordinationOptions
from fgplan.team.presence import Presence, look_round

LOST_S = 4.0


@pytest.fixture(name="setup")
def setup_of_r0():
    problem, candidates, evaluator = make_team(3, seed=1)
    options = CoordinationOptions(repair_after_s=0.5, lost_after_s=LOST_S)
    return set_up_team(problem, candidates, evaluator, options=options)["r0"]


def after(setup, *times_s, presence=None, present=None):
    presence = presence or Presence()
    for now_s in times_s:
        presence, _ = look_round(presence, setup, Inbox(now_s, (), present))
    return presence


def test_silent_teammates_are_lost_after_the_stated_time(setup):
    assert after(setup, 0.0, 1.5, 3.0, 4.0).lost(LOST_S) == frozenset()
    presence = after(setup, 0.0, 1.5, 3.0, 4.0)
    presence = after(setup, 4.1, presence=presence.hear("r2"))
    assert presence.lost(LOST_S) == {"r1"}
    assert presence.lost(float("inf")) == frozenset()
    assert presence.hear("r1").lost(LOST_S) == frozenset()


def test_whom_the_network_sees_is_not_lost(setup):
    there = after(setup, 0.0, 1.5, 3.0, 4.5, 6.0, present=frozenset({"r1"}))
    assert there.lost(LOST_S) == {"r2"}
    assert there.told
    gone = after(setup, 7.5, 9.0, 9.9, presence=there, present=frozenset())
    assert gone.lost(LOST_S) == {"r2"}
    assert after(setup, 10.1, presence=gone, present=frozenset()).lost(LOST_S) == {"r1", "r2"}


def test_whom_the_network_sees_is_lost_after_a_longer_silence(setup):
    here = frozenset({"r1", "r2"})
    presence = after(setup, 0.0, 1.5, 3.0, 4.5, 6.0, present=here)
    assert presence.lost(LOST_S) == presence.lost(LOST_S, 6.0) == frozenset()
    presence = after(setup, 6.1, presence=presence.hear("r2"), present=here)
    assert presence.lost(LOST_S, 6.0) == {"r1"}
    assert presence.lost(LOST_S) == frozenset()
    assert presence.lost(8.0, 6.0) == frozenset()  # its path may have to wait for longer
    gone = after(setup, 7.5, 9.0, 10.2, presence=presence, present=frozenset())
    assert gone.lost(LOST_S, 100.0) == here  # the network itself has missed them
    assert presence.hear("r1").lost(LOST_S, 6.0) == frozenset()
    away = after(setup, 106.1, presence=presence.hear("r1"), present=here)
    assert away.lost(LOST_S, 6.0) == frozenset()


def test_robot_that_was_frozen_has_not_lost_its_teammates(setup):
    presence = after(setup, 0.0, 1.0, 101.0)
    assert presence.lost(LOST_S) == frozenset()
    presence = after(setup, 102.5, 104.0, presence=presence)  # a second before it, three after
    assert presence.lost(LOST_S) == frozenset()
    assert after(setup, 104.1, presence=presence).lost(LOST_S) == {"r1", "r2"}


def test_who_appears_is_told_once_in_the_order_of_the_team(setup):
    presence, appeared = look_round(Presence(), setup, Inbox(0.0, (), frozenset({"r2", "r1"})))
    assert appeared == ("r1", "r2")
    presence, appeared = look_round(presence, setup, Inbox(1.0, (), frozenset({"r2"})))
    assert appeared == ()
    _, appeared = look_round(presence, setup, Inbox(2.0, (), frozenset({"r1", "r2"})))
    assert appeared == ("r1",)
