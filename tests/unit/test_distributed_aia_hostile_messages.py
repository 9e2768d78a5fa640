"""Messages that nobody in the team can have sent: refused, and nothing has changed."""

import msgspec
import numpy as np
import pytest
from aia_scenes import lattice_problem
from node_messages import two_nodes

from fgplan.errors import InvalidInputError
from fgplan.planners.distributed_aia.message_search import set_up_robots
from fgplan.planners.distributed_aia.node_message import NodeMessage
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.planners.distributed_aia.plan_messages import (
    Ask,
    Claim,
    Report,
    WayMessage,
)
from fgplan.planners.distributed_aia.robot import step
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.envelope import Envelope, Inbox
from fgplan.team.in_process import InProcessTransport
from fgplan.team.loop import run_robots

NAMES = ("r0", "r1", "r2")
LINE = CommunicationGraph.of_edges(NAMES, [("r0", "r1"), ("r1", "r2")])
STARTS = [(1.0, 1.0), (5.0, 1.0), (5.0, 5.0)]


def problem():
    """Three robots and two targets."""
    return lattice_problem(STARTS, [(2.6, 1.3), (4.4, 4.7)], boxes=[(2.2, 2.2, 3.8, 3.8)])


def states_of(**changes):
    """The robots after their first steps."""
    options = distributed_options(**{"iterations": 2000, "node_budget": 3000} | changes)
    states = set_up_robots(problem(), options, LINE, np.random.default_rng(0))
    return {name: step(state, Inbox(0.0))[0] for name, state in states.items()}


def envelope_of(message, sender, sequence=1):
    """A message on its way."""
    kind = type(message).__name__.removesuffix("Message").lower()
    return Envelope(
        robot=sender,
        session=0,
        sequence=sequence,
        kind="nodes" if isinstance(message, NodeMessage) else kind,
        payload=msgspec.msgpack.encode(message),
    )


def nodes_of(**changes):
    """Two nodes."""
    return two_nodes(2, **changes)


def way_of(robot, poses, assigned=None):
    """Poses and targets as bytes."""
    poses = np.array(poses, dtype=float)
    held = np.zeros(len(poses)) if assigned is None else np.array(assigned)
    return {"robot": robot, "poses": poses.tobytes(), "assigned": held.astype("<u2").tobytes()}


def plan_of(good, **changes):
    """A plan, some of it changed."""
    return msgspec.structs.replace(good, **changes)


def refused(state, message, sender, says):
    """The message is refused, whatever the state has been."""
    before = (state.claims, state.opened, dict(state.reports), dict(state.waiting))
    room = state.growth.forest.trees.parent.shape[1]
    with pytest.raises(InvalidInputError, match=says):
        step(state, Inbox(0.1, (envelope_of(message, sender),)))
    assert before == (state.claims, state.opened, dict(state.reports), dict(state.waiting))
    assert state.growth.forest.trees.parent.shape[1] == room


def test_nodes_beyond_the_budget_make_no_room():
    far = nodes_of(first=2_000_000_000, parents=np.array([0, 1]), depths=np.array([1, 2]))
    refused(states_of()["r0"], far, "r1", "below the node budget 3000")


def test_nodes_that_do_not_fit_those_that_are_here_are_left_out():
    growth = states_of()["r0"].growth
    growth.receive(1, nodes_of().nodes(2))
    wrong = nodes_of(first=2, parents=np.array([1, 2]), depths=np.array([5, 6])).nodes(2)
    growth.receive(1, wrong)
    row = growth.robots.index(1)
    assert growth.forest.trees.depth[row, :4].tolist() == [0, 1, -1, -1]
    assert growth.forest.trees.first_child[row, 1] == -1
    growth.receive(1, wrong._replace(depths=np.array([2, 3], dtype=np.int32)))
    assert growth.forest.trees.depth[row, :4].tolist() == [0, 1, 2, 3]


GOOD_CLAIM = {"origin": 2, "goal": 1, "robot": 0, "node": 0, "steps": 3, "born_by": 2}


@pytest.mark.parametrize(
    ("changes", "sender", "says"),
    [
        ({"origin": 77}, "r1", "claim: expected one on robot number 0"),
        ({"origin": 0}, "r1", "claim: expected one on robot number 0"),
        ({"robot": 1}, "r1", "claim: expected one on robot number 0"),
        ({"steps": 4}, "r1", "steps: expected at most 3"),
        ({"steps": 1_000_000}, "r1", "steps: expected at most 3"),
        ({}, "r2", "does not hear"),
    ],
)
def test_claims_that_nobody_can_have_are_refused(changes, sender, says):
    state = states_of()["r0"]
    kept, _ = step(state, Inbox(0.1, (envelope_of(Claim(**GOOD_CLAIM), "r1"),)))
    assert len(kept.claims) == 1
    refused(state, Claim(**GOOD_CLAIM | changes), sender, says)


def test_a_claim_said_often_is_kept_once():
    state = states_of()["r0"]
    for _ in range(5):
        state, _ = step(state, Inbox(0.1, (envelope_of(Claim(**GOOD_CLAIM), "r1"),)))
    assert len(state.claims) == 1


@pytest.mark.parametrize(
    ("way", "says"),
    [
        (way_of(5, [[5.0, 1.0, 0.0]]), "expected from whom it passes"),
        (way_of(1, [[5.0, 1.0, 0.0]]), "expected from whom it passes"),
        (way_of(0, [[9.0, 1.0, 0.0]]), "expected from"),
        (way_of(0, [[1.0, 1.0, 0.0]], [7]), "targets below 2"),
        (way_of(0, [[1.0, 1.0, 0.0], [5.0, 5.0, 0.0]]), "end of a free control after step 0"),
    ],
)
def test_ways_that_cannot_be_are_refused(way, says):
    state = states_of()["r1"]
    good = WayMessage(origin=1, goal=0, **way_of(0, [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0]]))
    step(state, Inbox(0.1, (envelope_of(good, "r0"),)))
    refused(state, WayMessage(origin=1, goal=0, **way), "r0", says)
    refused(state, WayMessage(origin=99, goal=0, **way), "r0", "expected from whom it passes")


@pytest.fixture(scope="module", name="good")
def good_plan():
    """The report that three honest robots end with."""
    options = distributed_options(iterations=2000, node_budget=3000)
    found = set_up_robots(problem(), options, LINE, np.random.default_rng(0))
    states = run_robots(found, step, InProcessTransport(NAMES))
    plan = states["r0"].plan
    return next(report for report in states["r0"].reports.values() if report.plan == plan)


def test_an_honest_report_is_believed(good):
    state = states_of()["r0" if good.robot else "r1"]
    after, _ = step(state, Inbox(0.1, (envelope_of(good, "r1" if good.robot else "r0"),)))
    assert after.reports == {good.robot: good}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"cost": float("nan")}, "finite cost"),
        ({"cost": 0.0}, "in the replay"),
        ({"robots": (0, 1, 9)}, "for robots"),
        ({"robots": (0, 1)}, "for robots"),
        ({"rank": 5000}, "rank below"),
        ({"origin": 9}, "plan of its own"),
    ],
)
def test_reports_with_plans_that_are_none_are_refused(good, changes, says):
    state = states_of()["r0" if good.robot else "r1"]
    lie = msgspec.structs.replace(good, plan=plan_of(good.plan, **changes))
    refused(state, lie, "r1" if good.robot else "r0", says)


def test_a_plan_that_does_not_satisfy_the_constraint_is_not_believed(good):
    state = states_of()["r0" if good.robot else "r1"]
    stay = [np.array([[*start, 0.0]] * 3).tobytes() for start in STARTS]
    lazy = plan_of(good.plan, poses=tuple(stay), assigned=(bytes(6),) * 3, rank=2)
    lie = msgspec.structs.replace(good, plan=lazy)
    refused(state, lie, "r1" if good.robot else "r0", "got one that does not")
    short = plan_of(
        good.plan, poses=(stay[0][:24], *stay[1:]), assigned=(bytes(2), *(bytes(6),) * 2)
    )
    lie = msgspec.structs.replace(good, plan=short)
    refused(state, lie, "r1" if good.robot else "r0", "one length")


def test_nobody_reports_for_another():
    state = states_of()["r0"]
    for number in (9, 2, 0):
        refused(state, Report(robot=number, through=3), "r1", "expected one of itself")
    own = envelope_of(Report(robot=0, through=3), "r0")  # its own, passed on by a teammate
    after, out = step(state, Inbox(0.1, (own,)))
    assert after.reports == {}
    assert out == ()


def test_a_report_is_passed_on_as_it_was_written():
    state = states_of()["r0"]
    letter = envelope_of(Report(robot=2, through=3), "r2", sequence=7)
    after, out = step(state, Inbox(0.1, (letter,)))
    assert after.reports == {2: Report(robot=2, through=3)}
    assert [one.envelope for one in out] == [letter] * len(out)
    assert {one.to for one in out} == {"r1"}


def test_a_robot_does_not_answer_whom_it_does_not_hear():
    refused(states_of()["r0"], Ask(has=()), "r2", "does not hear")
