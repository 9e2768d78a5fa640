"""Robots of planner `intermittent` and their world, each a participant of its own."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from test_intermittent_planner import short_mission

from fgplan.errors import InvalidInputError, NoCandidatePathError, UnknownNameError
from fgplan.planners.intermittent.estimate import Record
from fgplan.planners.intermittent.planner import mission_team, read_options
from fgplan.planners.intermittent.team_run import first_legs, run_team
from fgplan.planners.intermittent.truth import draw_truth
from fgplan.planners.intermittent.world import start_world
from fgplan.planners.intermittent.world import step as step_world
from fgplan.planners.intermittent.world_message import (
    WORLD,
    Over,
    Quiet,
    Stood,
    Tick,
    unwrap_world,
    wrap_world,
)
from fgplan.planners.program import participants, run_programs, step_program
from fgplan.planners.registry import find_planner
from fgplan.team.envelope import Envelope, Inbox, decode_envelope
from fgplan.team.in_process import InProcessTransport

PLANNER = find_planner("intermittent")
SEED = 2


def programs_of(mission):
    """Every participant, made of the mission and the seed alone."""
    names = participants(PLANNER, mission)
    return {name: PLANNER.program(mission, name, np.random.default_rng(SEED)) for name in names}


def reports_of(programs):
    """What they hand in, as another process would read it."""
    return {
        name: msgspec.msgpack.decode(msgspec.msgpack.encode(one.report(one.state)))
        for name, one in programs.items()
    }


def without_work(plan):
    data = plan.to_data()
    del data["seconds"], data["traffic"]
    return data


def shuffled_run(programs, order):
    """Deliver one message at a time; who is next is drawn, each pair's messages stay in order."""
    programs = dict(programs)
    lines = {}

    def go(name, *mail):
        programs[name], outbox = step_program(programs[name], Inbox(0.0, mail))
        for outgoing in outbox:
            copy = decode_envelope(outgoing.envelope.encoded)
            lines.setdefault((name, outgoing.to), []).append(copy)

    for name in order.permutation(list(programs)):
        go(str(name))
    while True:
        waiting = [pair for pair, line in lines.items() if line]
        if not waiting:
            return programs
        pair = waiting[order.integers(len(waiting))]
        go(pair[1], lines[pair].pop(0))


def test_robots_and_world_as_programs_give_the_plan_of_one_process():
    mission = short_mission()
    expected = PLANNER.plan(mission, np.random.default_rng(SEED))
    transport = InProcessTransport(participants(PLANNER, mission))
    ended = run_programs(programs_of(mission), transport)
    assert all(program.finished for program in ended.values())
    found = PLANNER.team_plan(mission, reports_of(ended), np.random.default_rng(SEED))
    assert without_work(found) == without_work(expected)
    assert found.report["meetings"] > 2
    assert ended[WORLD].progress(ended[WORLD].state) == (40, 40, "steps")
    assert ended["ann"].progress(ended["ann"].state)[:2] == (40, 0)
    kinds = transport.traffic.kinds
    assert set(kinds) == {"tick", "quiet", "over", "stood", "known", "agreed"}
    assert kinds["tick"].sent == 40 * 4
    assert expected.traffic["agreed"]["sent"] == kinds["agreed"].sent


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.full) for s in (1, 2, 3))])
def test_the_order_in_which_messages_arrive_changes_nothing(seed):
    mission = short_mission()
    expected = PLANNER.plan(mission, np.random.default_rng(SEED))
    ended = shuffled_run(programs_of(mission), np.random.default_rng(seed))
    found = PLANNER.team_plan(mission, reports_of(ended), np.random.default_rng(SEED))
    assert without_work(found) == without_work(expected)


def test_meetings_places_and_estimates_are_those_of_a_run_in_a_noisy_world():
    mission = short_mission()
    own, segment = read_options(mission.options)
    seed = int(np.random.default_rng(SEED).integers(2**31))
    setup, starts, estimate = mission_team(mission, own, segment, seed)
    generator = np.random.default_rng(1)
    truth = draw_truth(setup.model.hidden, estimate.mean, 40, setup.model, 4, generator)
    run = run_team(setup, first_legs(setup, starts, estimate), estimate, truth)
    programs = programs_of(mission)
    world = replace(programs[WORLD], state=start_world(setup, truth, starts))
    ended = shuffled_run({**programs, WORLD: world}, np.random.default_rng(0))
    np.testing.assert_array_equal(np.array(ended[WORLD].state.places), run.positions)
    assert ended[WORLD].state.records == run.records
    assert any(record.readings for _, record in run.records)
    for state in run.robots:
        there = ended[state.robot].state.robot
        assert there.meetings == state.meetings
        np.testing.assert_array_equal(there.estimate.mean, state.estimate.mean)
        np.testing.assert_array_equal(there.estimate.covariance, state.estimate.covariance)


def test_a_robot_that_the_network_no_longer_sees_stands_still_and_the_rest_goes_on():
    mission = short_mission(wait_steps=2, recovery_steps=10)
    transport = InProcessTransport(participants(PLANNER, mission))
    programs = programs_of(mission)
    names = set(programs)

    def step_until_lost(program, inbox):
        """What the network would tell: dan is there until step 20."""
        lost = program.robot == WORLD and program.state.time >= 20
        present = frozenset(names - ({"dan"} if lost else set()))
        return step_program(program, Inbox(inbox.now_s, inbox.envelopes, present))

    from fgplan.team.loop import run_robots

    ended = run_robots(programs, step_until_lost, transport)
    assert ended[WORLD].state.gone == {"dan": 20}
    assert ended[WORLD].finished
    # Who leaves when it is over was not lost.
    after, _ = step_world(ended[WORLD].state, Inbox(0.0, (), frozenset()))
    assert after.gone == {"dan": 20}
    reports = {name: report for name, report in reports_of(ended).items() if name != "dan"}
    plan = PLANNER.team_plan(mission, reports, np.random.default_rng(SEED))
    assert not plan.agreed
    assert plan.warnings == ("robot 'dan' was lost in step 20: it stands still from then on",)
    dan = plan.paths["dan"].poses[:, :2]
    assert (dan[20:] == dan[20]).all()
    ann = plan.paths["ann"].poses[:, :2]
    assert (np.diff(ann[20:], axis=0) != 0.0).any()


def test_robots_whose_world_has_gone_come_to_an_end():
    mission = short_mission()
    program = programs_of(mission)["ann"]
    program, outbox = step_program(program, Inbox(0.0, (), frozenset({"bob"})))
    assert [outgoing.to for outgoing in outbox] == [WORLD]
    assert not program.finished  # it has only begun: the world may not have been there yet
    program, outbox = step_program(program, Inbox(0.0, (), frozenset({"bob"})))
    assert program.finished
    assert not outbox


def test_a_robot_that_cannot_go_on_ends_the_run_for_all(monkeypatch):
    mission = short_mission()
    programs = programs_of(mission)

    def no_way(*_):
        raise NoCandidatePathError("robots 'ann' and 'bob': obstacles keep them apart")

    robots = {}
    for name, one in programs.items():
        state = one.state
        if name != WORLD:
            setup = replace(state.robot.setup, planner=no_way)
            state = replace(state, robot=msgspec.structs.replace(state.robot, setup=setup))
        robots[name] = replace(one, state=state)
    ended = run_programs(robots, InProcessTransport(tuple(robots)))
    assert all(program.finished for program in ended.values())
    with pytest.raises(NoCandidatePathError, match="keep them apart"):
        PLANNER.team_plan(mission, reports_of(ended), np.random.default_rng(SEED))


def test_messages_to_and_from_the_world_are_checked():
    mission = short_mission()
    programs = programs_of(mission)
    world, ann = programs[WORLD], programs["ann"]
    stood = Stood(number=0, meeting=False, place=(1.0, 4.0), sent={}, heard={})
    assert unwrap_world(decode_envelope(wrap_world("ann", 1, stood).encoded)) == stood
    record = Record(1, (1.0, 4.0))
    late = wrap_world("bob", 3, stood)
    for program, envelope, match in (
        (world, wrap_world("zoe", 1, stood), "expected 'stood' of one of"),
        (world, wrap_world("ann", 1, Quiet(number=1)), "expected 'stood'"),
        (
            world,
            wrap_world("ann", 1, msgspec.structs.replace(stood, place=(np.nan, 0.0))),
            "finite",
        ),
        (world, Envelope(robot="ann", session=0, sequence=1, kind="stood"), "'stood' of 'ann'"),
        (world, Envelope(robot="ann", session=0, sequence=1, kind="gossip"), "expected one of"),
        (ann, wrap_world(WORLD, 1, stood), "after number 0"),
        (ann, wrap_world(WORLD, 0, Over(number=0)), "after number 0"),
        (ann, wrap_world(WORLD, 1, Tick(number=1, record=record, in_range=("zoe",))), "teammates"),
        (
            ann,
            wrap_world(WORLD, 1, Tick(number=1, record=Record(7, (1.0, 4.0)), in_range=())),
            "expected step 1",
        ),
        (ann, late, "of a teammate in step 0 or the next, got one of step -1"),
    ):
        with pytest.raises(InvalidInputError, match=match):
            step_program(program, Inbox(0.0, (envelope,)))
    # An answer that comes twice, or after a later one, changes nothing.
    once, _ = step_world(world.state, Inbox(0.0, (late,)))
    twice, _ = step_world(
        once,
        Inbox(
            0.0,
            (
                late,
                wrap_world(
                    "bob", 2, Stood(number=0, meeting=True, place=(0.0, 0.0), sent={}, heard={})
                ),
            ),
        ),
    )
    assert twice.stood == once.stood
    # A malformed message of a teammate counts as heard, and changes nothing else.
    hostile = Envelope(robot="bob", session=0, sequence=1, kind="known", basis={WORLD: 0})
    heard, outbox = step_program(ann, Inbox(0.0, (hostile,)))
    assert heard.state.refused == 1
    assert heard.state.robot is ann.state.robot
    assert unwrap_world(outbox[0].envelope).heard == {"bob": 1}


def test_programs_and_reports_that_cannot_be_used_are_refused():
    mission = short_mission()
    generator = np.random.default_rng(SEED)
    with pytest.raises(UnknownNameError, match="'zoe': expected one of ann, bob, cat, dan, world"):
        PLANNER.program(mission, "zoe", generator)
    named = replace(mission, robots=(replace(mission.robots[0], name=WORLD), *mission.robots[1:]))
    with pytest.raises(InvalidInputError, match="robot 'world': planner 'intermittent' needs"):
        PLANNER.program(named, WORLD, generator)
    with pytest.raises(InvalidInputError, match="expected one of the world"):
        PLANNER.team_plan(mission, {}, generator)
    whole = {"places": [[[0.0, 0.0]] * 4], "records": [], "gone": {}, "failed": ""}
    with pytest.raises(InvalidInputError, match="not brought to its end"):
        PLANNER.team_plan(mission, {WORLD: whole}, generator)
    with pytest.raises(InvalidInputError, match="report of 'world'"):
        PLANNER.team_plan(mission, {WORLD: {"places": 1}}, generator)
