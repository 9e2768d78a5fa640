"""Robots that are killed, start again, come late, freeze or are parted: one ledger in the end."""

import math
from dataclasses import replace

import numpy as np
import pytest
from faulty_teams import Fault, FaultyTeam, can_improve, openings_of, random_faults
from table_teams import ForgetfulEvaluator, make_team, outcome

from fgplan.announcement.announcement import Withdrawal
from fgplan.errors import StaleAnnouncementError
from fgplan.team.agreement import agreement_of
from fgplan.team.content import content_of
from fgplan.team.coordination import coordinate, set_up_team
from fgplan.team.envelope import TrafficByKind
from fgplan.team.in_process import InProcessTransport, NetworkFaults, Partition
from fgplan.team.options import CoordinationOptions
from fgplan.team.replay import replay_turns
from fgplan.team.report import report_of
from fgplan.team.robot_state import same_path

DELAY = NetworkFaults(delay_s=(0.02, 0.1))
QUIET_S = 60.0
"""How long teams go on after the last fault."""
SETTLED_AFTER_S = 30.0
"""Within this time after the last fault all live robots hold one ledger and know it: lost_after_s +
drop_after_s are 12 s, an ask may be 4 s away, and 30 % of all messages are lost."""


def team_of(count, seed=1, **options):
    problem, candidates, evaluator = make_team(count, seed=seed)
    chosen = CoordinationOptions(repair_after_s=0.5, lost_after_s=4.0, time_limit_s=1e9, **options)
    setups = set_up_team(problem, candidates, evaluator, options=chosen)
    return problem, candidates, evaluator, setups


def delayed(problem, faults=DELAY, seed=0):
    return InProcessTransport(problem.robots, faults, np.random.default_rng(seed))


def checked(team, evaluator):
    """All that must hold once it is quiet."""
    assert team.is_settled()
    assert can_improve(team, evaluator, 1e-6) == []
    state = next(iter(team.states.values()))
    log, turns = replay_turns(team.setups, state.log.all_entries())
    assert log.head == state.log.head
    assert log.ledger.basis() == state.ledger.basis()
    for turn in turns:
        assert turn.found == turn.stated
    return state


def test_without_faults_it_is_what_coordinate_gives():
    problem, candidates, evaluator, setups = team_of(4)
    team = FaultyTeam(setups, network=delayed(problem)).run(QUIET_S)
    agreement = coordinate(problem, candidates, evaluator)
    state = checked(team, evaluator)
    assert state.ledger.history == agreement.ledger.history
    assert {n: s.incumbent for n, s in team.states.items()} == agreement.chosen


@pytest.mark.parametrize("start_s", [0.01, 0.15, 0.4, 1.0])
@pytest.mark.parametrize("robot", ["r0", "r1", "r3"])
def test_killed_robot_is_passed_over_and_its_path_kept(robot, start_s):
    problem, _, evaluator, setups = team_of(4)
    team = FaultyTeam(setups, (Fault(robot, start_s),), delayed(problem)).run(QUIET_S)
    state = checked(team, evaluator)
    assert robot in state.ledger.paths()
    assert state.lost == {robot}


def test_killed_before_anything_arrived_it_has_no_path():
    problem, _, evaluator, setups = team_of(3)
    team = FaultyTeam(setups, (Fault("r1", 0.0),), delayed(problem)).run(QUIET_S)
    assert set(checked(team, evaluator).ledger.paths()) == {"r0", "r2"}


def test_path_of_a_lost_robot_is_dropped_after_the_stated_time():
    problem, _, evaluator, setups = team_of(3, drop_after_s=10.0)
    team = FaultyTeam(setups, (Fault("r1", 0.3),), delayed(problem)).run(QUIET_S)
    state = checked(team, evaluator)
    assert set(state.ledger.paths()) == {"r0", "r2"}
    (gone,) = [m for m in state.ledger.messages if isinstance(m, Withdrawal)]
    assert (gone.robot, gone.by in ("r0", "r2")) == ("r1", True)


def test_dropped_robot_that_comes_back_opens_again():
    problem, _, evaluator, setups = team_of(3, drop_after_s=10.0)
    team = FaultyTeam(setups, (Fault("r1", 0.3, 30.0),), delayed(problem)).run(30.0 + QUIET_S)
    state = checked(team, evaluator)
    assert set(state.ledger.paths()) == {"r0", "r1", "r2"}
    assert openings_of(state.ledger).count("r1") == 2


@pytest.mark.parametrize("frozen", [False, True])
@pytest.mark.parametrize("away_s", [0.2, 3.0, 12.0])
def test_robot_that_comes_back_joins(away_s, frozen):
    problem, _, evaluator, setups = team_of(4)
    fault = Fault("r2", 0.25, 0.25 + away_s, frozen=frozen)
    team = FaultyTeam(setups, (fault,), delayed(problem)).run(away_s + QUIET_S)
    state = checked(team, evaluator)
    assert set(state.ledger.paths()) == set(problem.robots)
    assert state.lost == frozenset()


@pytest.mark.parametrize(("robot", "start_s"), [("r0", 0.3), ("r2", 0.7)])
def test_second_life_takes_the_log_of_the_first_though_it_would_write_other_values(robot, start_s):
    problem, candidates, evaluator = make_team(4, seed=1, evaluator=ForgetfulEvaluator)
    options = CoordinationOptions(repair_after_s=0.5, lost_after_s=4.0)
    setups = set_up_team(problem, candidates, evaluator, options=options)
    for away_s in (0.02, 6.0):
        fault = Fault(robot, start_s, start_s + away_s)
        team = FaultyTeam(setups, (fault,), delayed(problem)).run(away_s + QUIET_S)
        assert team.is_settled()
        assert team.settled_s < start_s + away_s + SETTLED_AFTER_S
        assert can_improve(team, evaluator, 1e-6) == []
        state = team.states[robot]
        assert set(state.ledger.paths()) == set(problem.robots)
        log, turns = replay_turns(setups, state.log.all_entries())
        assert log.head == state.log.head
        for turn in turns:
            assert turn.found == pytest.approx(turn.stated, rel=1e-9)


def test_late_joiner_gets_the_ledger_and_opens_on_its_turn():
    problem, _, evaluator, setups = team_of(4)
    team = FaultyTeam(setups, (Fault("r0", 0.0, 20.0),), delayed(problem)).run(20.0 + QUIET_S)
    state = checked(team, evaluator)
    assert openings_of(state.ledger) == ["r1", "r2", "r3", "r0"]
    assert state.log.changes == 1


def test_short_partition_changes_nothing_and_a_long_one_ends_in_one_ledger():
    problem, candidates, evaluator, setups = team_of(4)
    agreement = coordinate(problem, candidates, evaluator)
    for end_s, same in ((3.5, True), (15.0, False)):
        parted = Partition(0.12, end_s, (("r0", "r2"), ("r1", "r3")))
        faults = NetworkFaults(delay_s=(0.02, 0.1), partitions=(parted,))
        team = FaultyTeam(setups, network=delayed(problem, faults)).run(end_s + QUIET_S)
        state = checked(team, evaluator)
        assert set(state.ledger.paths()) == set(problem.robots)
        if same:
            assert state.ledger.history == agreement.ledger.history


def test_robots_that_end_apart_are_a_plan_that_is_not_agreed():
    problem, candidates, _, setups = team_of(4)
    parted = Partition(0.12, 1e6, (("r0", "r2", "r3"), ("r1",)))
    faults = NetworkFaults(delay_s=(0.02, 0.1), partitions=(parted,))
    team = FaultyTeam(setups, network=delayed(problem, faults)).run(QUIET_S)
    reports = [report_of(state) for state in team.states.values()]
    assert len({report.head for report in reports}) == 2
    assert all(report.finished for report in reports)
    options = setups["r0"].options
    given = {"traffic": TrafficByKind(), "clock_s": 1.0, "seconds": {}}
    agreement = agreement_of(reports, options, **given)
    assert not agreement.agreed
    assert agreement.ledger.basis() == reports[0].ledger.basis() != reports[1].ledger.basis()
    (said,) = [line for line in agreement.warnings if "apart" in line]
    assert said.startswith("robot 'r1' ended apart")
    for robot, index in agreement.chosen.items():
        assert same_path(agreement.paths[robot], candidates[robot][index])
    assert list(agreement.chosen) == ["r0", "r2", "r3"]  # r1 has chosen anew
    for report in reports:
        object.__setattr__(report, "lost", ())
    with pytest.raises(StaleAnnouncementError, match=r"'r1'.*not given the same options"):
        agreement_of(reports, options, **given)


@pytest.mark.parametrize("together", [False, True])
def test_network_that_tells_who_is_there_needs_no_signs_of_life(together):
    problem, _, evaluator, setups = team_of(4)
    faults = (Fault("r1", 0.3, 9.0), Fault("r3", 0.3 if together else 2.0))
    team = FaultyTeam(setups, faults, delayed(problem), tell_presence=True).run(QUIET_S)
    checked(team, evaluator)
    assert set(team.states) == {"r0", "r1", "r2"}


@pytest.mark.parametrize(
    ("robot", "drop"),
    [
        pytest.param(robot, drop, marks=[] if drop == (robot == "r0") else pytest.mark.full)
        for robot in ("r0", "r1", "r3")
        for drop in (False, True)
    ],
)
def test_robot_that_hangs_is_passed_over_and_joins_again(robot, drop):
    options = {"hung_after_s": 6.0} | ({"drop_after_s": 8.0} if drop else {})
    problem, _, evaluator, setups = team_of(4, **options)
    for end_s in (math.inf, 40.0):
        fault = Fault(robot, 0.3, end_s, frozen=True, hangs=True)
        given = {"network": delayed(problem), "tell_presence": True}
        team = FaultyTeam(setups, (fault,), **given).run(40.0 + QUIET_S)
        state = checked(team, evaluator)
        back = end_s < math.inf
        assert state.lost == (frozenset() if back else {robot})
        assert (robot in state.ledger.paths()) == (back or not drop)
        if not back:
            assert team.settled_s < SETTLED_AFTER_S


def test_robot_that_hangs_is_waited_for_where_the_network_is_believed():
    problem, _, _, setups = team_of(4)
    fault = Fault("r1", 0.3, frozen=True, hangs=True)
    team = FaultyTeam(setups, (fault,), delayed(problem), tell_presence=True).run(QUIET_S)
    assert not team.is_settled()
    assert all(state.lost == frozenset() for state in team.states.values())


def test_looking_for_robots_that_hang_changes_no_agreement():
    problem, candidates, evaluator, setups = team_of(4, hung_after_s=6.0)
    agreement = coordinate(problem, candidates, evaluator)
    team = FaultyTeam(setups, network=delayed(problem), tell_presence=True).run(QUIET_S)
    assert checked(team, evaluator).ledger.history == agreement.ledger.history


def check_random(seed, *, drop):
    """A random team, random network faults, random robot faults."""
    generator = np.random.default_rng([7, seed])
    options = {"drop_after_s": 8.0} if drop else {}
    hung = seed % 4 < 2
    if hung:
        options["hung_after_s"] = 6.0
    count = int(generator.integers(2, 6))
    order = "random" if seed % 3 == 0 else "fixed"
    problem, _, evaluator, setups = team_of(count, seed=seed, order=order, **options)
    parted = []
    if seed % 2:
        names = list(generator.permutation(problem.robots))
        cut = int(generator.integers(1, count))
        start_s = float(generator.uniform(0.0, 3.0))
        end_s = start_s + float(generator.uniform(0.5, 12.0))
        parted = [Partition(start_s, end_s, (tuple(names[:cut]), tuple(names[cut:])))]
    faults = NetworkFaults(
        loss=0.3,
        duplication=0.2,
        reordering=0.3,
        delay_s=(0.0, 0.2),
        partitions=tuple(parted),
    )
    network = InProcessTransport(problem.robots, faults, generator)
    robots = random_faults(problem.robots, generator, 12.0)
    robots = tuple(replace(fault, hangs=hung and fault.frozen) for fault in robots)
    team = FaultyTeam(setups, robots, network, tell_presence=bool(generator.integers(2)))
    ends = [fault.end_s for fault in (*robots, *parted) if fault.end_s < math.inf]
    last_s = max([12.0, *ends])
    team.run(last_s + QUIET_S)
    checked(team, evaluator)
    assert team.settled_s < last_s + SETTLED_AFTER_S
    killed = {fault.robot for fault in robots if not fault.frozen}
    assert_numbers_are_used_once(team, set(problem.robots) - killed)
    return team


def assert_numbers_are_used_once(team, robots):
    """Robots that kept their memory have never given one number to two announcements."""
    said = {}
    for state in team.states.values():
        for log in state.logs.known.values():
            for entry in log.entries:
                if entry.robot in robots and entry.kind == "announcement":
                    number = content_of(state.setup, entry).sequence
                    said.setdefault((entry.robot, number), set()).add(entry.payload)
    assert all(len(payloads) == 1 for payloads in said.values())


@pytest.mark.parametrize(
    "seed",
    [pytest.param(seed, marks=[] if seed < 12 else pytest.mark.full) for seed in range(30)],
)
def test_any_faults_end_in_one_ledger_that_nobody_improves(seed):
    check_random(seed, drop=seed % 5 == 0)


@pytest.mark.full
def test_any_faults_many_times():
    for seed in range(30, 1030):
        check_random(seed, drop=seed % 5 == 0)


def test_outcome_of_a_team_with_loss_rules_is_that_without():
    problem, candidates, evaluator, _ = team_of(4)
    options = CoordinationOptions(lost_after_s=4.0, drop_after_s=8.0)
    plain = coordinate(problem, candidates, evaluator)
    assert outcome(coordinate(problem, candidates, evaluator, options=options)) == outcome(plain)
