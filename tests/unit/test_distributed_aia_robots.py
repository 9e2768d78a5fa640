"""Robots of distributed_aia that talk through messages alone."""

import msgspec
import numpy as np
import pytest
from aia_scenes import lattice_problem
from node_messages import two_nodes

from fgplan.errors import InvalidInputError
from fgplan.planners.distributed_aia.message_search import (
    plan_of_reports,
    search_by_messages,
    set_up_robots,
)
from fgplan.planners.distributed_aia.node_message import NodeMessage, read_nodes
from fgplan.planners.distributed_aia.options import distributed_options
from fgplan.planners.distributed_aia.plan_messages import (
    Claim,
    read_planning_message,
    read_way,
)
from fgplan.planners.distributed_aia.robot import step
from fgplan.planners.distributed_aia.search import search_distributed
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.envelope import Envelope, Inbox, decode_envelope
from fgplan.team.in_process import InProcessTransport, NetworkFaults, Partition

NAMES = ("r0", "r1", "r2", "r3")
GRAPHS = {
    "complete": CommunicationGraph.complete(NAMES),
    "line": CommunicationGraph.of_edges(NAMES, [("r0", "r1"), ("r1", "r2"), ("r2", "r3")]),
    "two parts": CommunicationGraph.of_edges(NAMES, [("r0", "r2"), ("r1", "r3")]),
    "range": CommunicationGraph.within_range(NAMES, 5.0),
    "schedule": CommunicationGraph.on_schedule(
        [
            CommunicationGraph.of_edges(NAMES, [("r0", "r1"), ("r2", "r3")]),
            CommunicationGraph.of_edges(NAMES, [("r1", "r2")]),
        ],
        period=2,
    ),
}


def problem():
    """Four robots and three targets, one of which moves."""
    return lattice_problem(
        [(1.0, 1.0), (5.0, 1.0), (5.0, 5.0), (1.0, 5.0)],
        [(2.6, 1.3), (4.4, 4.7), (1.4, 4.3)],
        boxes=[(2.2, 2.2, 3.8, 3.8)],
        drifts=[(0.0, 0.01), (0.0, 0.0), (0.0, 0.0)],
        process=1e-6,
    )


def options(**changes):
    """A short search."""
    return distributed_options(**{"iterations": 2000} | changes)


def together(graph, seed=0, **changes):
    """In one process on shared arrays."""
    return search_distributed(problem(), options(**changes), graph, np.random.default_rng(seed))


def shuffled_run(graph, seed, order, **changes):
    """Step all robots round by round; what arrives in a round is handed over in any order."""
    states = set_up_robots(problem(), options(**changes), graph, np.random.default_rng(seed))
    inboxes = {name: [] for name in states}
    for _ in range(5000):
        arrived, inboxes = inboxes, {name: [] for name in states}
        for name in order.permutation(list(states)):
            mail = [arrived[name][i] for i in order.permutation(len(arrived[name]))]
            states[name], outbox = step(states[name], Inbox(0.0, tuple(mail)))
            for outgoing in outbox:
                copy = decode_envelope(outgoing.envelope.encoded)
                inboxes[outgoing.to].append(copy)
        if all(state.finished for state in states.values()):
            return plan_of_reports(list(states.values())), states
    raise AssertionError("the robots did not come to an end")


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        *[(kind, {}) for kind in GRAPHS],
        *[(kind, {"until": "budget", "iterations": 60}) for kind in GRAPHS],
        # Robots out of range of each other never all know.
        *[(kind, {"constraint_at": "all"}) for kind in GRAPHS if kind != "range"],
        *[(kind, {"preset": "paper", "node_budget": 20_000}) for kind in GRAPHS],
    ],
)
def test_robots_that_exchange_messages_find_the_plan_of_shared_arrays(kind, changes):
    graph = GRAPHS[kind]
    shared = together(graph, 3, **changes)
    talked = search_by_messages(
        problem(), options(**changes), graph, np.random.default_rng(3), InProcessTransport(NAMES)
    )
    assert (shared.plan is None) == (talked.plan is None)
    if shared.plan is not None:
        np.testing.assert_array_equal(shared.plan.poses, talked.plan.poses)
        assert shared.plan.cost == talked.plan.cost
        assert shared.plan.origins == talked.plan.origins


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_order_of_messages_within_a_sweep_changes_nothing(seed):
    graph = GRAPHS["line"]
    expected = together(graph, 5).plan
    plan, states = shuffled_run(graph, 5, np.random.default_rng(seed))
    np.testing.assert_array_equal(plan.poses, expected.poses)
    assert plan.cost == expected.cost
    assert len({state.plan.key for state in states.values()}) == 1  # all hold the same


def test_delays_and_reordering_change_nothing_where_robots_wait():
    graph = GRAPHS["complete"]
    faults = NetworkFaults(duplication=0.3, reordering=0.4, delay_s=(0.0, 0.3))
    network = InProcessTransport(NAMES, faults, np.random.default_rng(1))
    talked = search_by_messages(
        problem(), options(), graph, np.random.default_rng(7), network, wait_s=100.0
    )
    np.testing.assert_array_equal(talked.plan.poses, together(graph, 7).plan.poses)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("kind", ["complete", "line"])
def test_lost_and_late_messages_leave_a_plan_that_holds_in_the_replay(kind, seed):
    faults = NetworkFaults(
        loss=0.3,
        duplication=0.2,
        reordering=0.3,
        delay_s=(0.0, 0.4),
        partitions=(Partition(2.0, 6.0, (("r0", "r1"), ("r2", "r3"))),),
    )
    network = InProcessTransport(NAMES, faults, np.random.default_rng(seed))
    talked = search_by_messages(
        problem(), options(), GRAPHS[kind], np.random.default_rng(seed), network, wait_s=0.3
    )
    assert network.traffic.of("nodes").lost > 0
    assert talked.ending == "feasible"
    assert talked.plan.satisfied.any()
    # The same seeds, the same faults, the same plan.
    again = InProcessTransport(NAMES, faults, np.random.default_rng(seed))
    second = search_by_messages(
        problem(), options(), GRAPHS[kind], np.random.default_rng(seed), again, wait_s=0.3
    )
    np.testing.assert_array_equal(talked.plan.poses, second.plan.poses)


def test_a_hole_is_asked_for_and_filled():
    graph = GRAPHS["line"]
    states = set_up_robots(problem(), options(), graph, np.random.default_rng(0))
    first, outbox = step(states["r0"], Inbox(0.0))
    told = {outgoing.to: outgoing.envelope for outgoing in outbox}
    assert set(told) == {"r1"}
    second, _ = step(states["r1"], Inbox(0.0))
    # The root of r0 is lost; its next nodes are not.
    later = first.growth
    later.run(3)
    nodes = later.made(0, 1)
    envelope = Envelope(
        robot="r0",
        session=0,
        sequence=1,
        kind="nodes",
        payload=msgspec.msgpack.encode(NodeMessage.of(nodes)),
    )
    second, outbox = step(second, Inbox(2.0, (envelope,)))
    wanted = [
        read_nodes(out.envelope.payload, 3).wants
        for out in outbox
        if out.to == "r0" and out.envelope.kind == "nodes"
    ]
    assert wanted[-1] == 0


def test_a_message_is_as_large_as_its_header_says():
    graph = GRAPHS["line"]
    states = set_up_robots(problem(), options(), graph, np.random.default_rng(0))
    growth = states["r0"].growth
    growth.run(50)
    few, many = NodeMessage.of(growth.made(0, 11)), NodeMessage.of(growth.made(0, 1))
    apart = len(many) - len(few)
    assert len(many) == growth.nodes(0) - 1
    assert apart == 10
    per_node = (many.byte_size - few.byte_size) / apart
    assert per_node == pytest.approx(4 + 4 + 2 + 16 + 24 * 3, abs=0.5)


def nodes_of(**changes):
    """A message of two nodes, some of it changed."""
    return msgspec.msgpack.encode(two_nodes(3, **changes))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"parents": np.array([-1, 1])}, "parent before its child"),
        ({"parents": np.array([-2, 0])}, "parent before its child"),
        ({"depths": np.array([1, 1])}, "parent before its child"),
        ({"depths": np.array([0, -1])}, "depths"),
        ({"depths": np.array([0, 2])}, "depths one more"),
        ({"assigned": np.array([0, 3])}, "targets below 3"),
        ({"assigned": np.array([0])}, "assigned: expected 4 bytes"),
        ({"covariances": np.full((2, 9), np.nan)}, "finite"),
        ({"covariances": np.tile([0.2, 0.3, 0.2], (2, 3))}, "positive definite"),
        ({"covariances": np.tile([-0.2, 0.0, -0.2], (2, 3))}, "positive definite"),
        ({"covariances": np.tile([1e-155, 0.0, 1e-155], (2, 3))}, "inverses"),
        ({"covariances": np.tile([1e150, 0.0, 1e150], (2, 3))}, "inverses"),
        ({"positions": np.full((2, 2), np.inf)}, "finite"),
        ({"positions": np.zeros((1, 2))}, "positions: expected 32 bytes"),
    ],
)
def test_nodes_that_cannot_be_are_refused(changes, says):
    assert read_nodes(nodes_of(), 3).parents.tolist() == [-1, 0]
    with pytest.raises(InvalidInputError, match=says):
        read_nodes(nodes_of(**changes), 3)


def test_malformed_messages_are_refused():
    for data in (b"", b"\x00", nodes_of()[:-3], msgspec.msgpack.encode({"schema": "nodes.v2"})):
        with pytest.raises(InvalidInputError, match="nodes"):
            read_nodes(data, 3)
        with pytest.raises(InvalidInputError, match="planning message"):
            read_planning_message(data)
    claim = Claim(origin=0, goal=1, robot=1, node=0, steps=3, born_by=2)
    assert read_planning_message(msgspec.msgpack.encode(claim)) == claim
    bad = msgspec.msgpack.encode(claim).replace(b"steps", b"stept")
    with pytest.raises(InvalidInputError, match="planning message"):
        read_planning_message(bad)
    with pytest.raises(InvalidInputError, match="24 bytes"):
        read_way(b"\0" * 20, b"\0\0")
    with pytest.raises(InvalidInputError, match="finite"):
        read_way(np.full(3, np.nan).tobytes(), b"\0\0")


def test_a_stranger_and_a_robot_out_of_hearing_are_refused():
    states = set_up_robots(problem(), options(), GRAPHS["line"], np.random.default_rng(0))
    for robot, says in (("x9", "expected one of"), ("r3", "does not hear")):
        envelope = Envelope(robot=robot, session=0, sequence=0, kind="nodes", payload=nodes_of())
        with pytest.raises(InvalidInputError, match=says):
            step(states["r0"], Inbox(0.0, (envelope,)))
