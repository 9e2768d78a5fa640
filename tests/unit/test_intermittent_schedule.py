"""Team graphs and schedules of Khodayi-mehr et al. 2019, figure 1 and section IV-A."""

import numpy as np
import pytest
from example_counts import FEWER
from hypothesis import given, settings
from hypothesis import strategies as st
from intermittent_teams import random_team_graph

from fgplan.bench.intermittent_scene import team_graph
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.planners.intermittent.schedule import Schedule, make_schedule
from fgplan.planners.intermittent.team_graph import TeamGraph, propose_teams

GRAPHS = st.builds(
    lambda teams, seed: random_team_graph(teams, np.random.default_rng(seed)),
    st.integers(2, 30),
    st.integers(0, 10_000),
)


def test_first_graph_of_the_paper_has_the_printed_schedules():
    schedule = make_schedule(team_graph("G1"))
    assert schedule.period == 2
    printed = {
        "r12": (1, 2),
        "r23": (3, 2),
        "r34": (3, 4),
        "r45": (5, 4),
        "r56": (5, 6),
        "r67": (7, 6),
        "r78": (7, 8),
        "r18": (1, 8),
    }
    for robot, teams in printed.items():
        assert schedule.sequence(robot) == tuple(team - 1 for team in teams)
    assert set(schedule.graph.robots) == set(printed)
    assert schedule.graph.longest_shortest_path == 5
    assert schedule.delay_bound == 5  # as printed
    assert make_schedule(schedule.graph, "degree+1").period == 3  # the formula of section III-A


def test_second_graph_of_the_paper_has_a_bound_of_six_by_definition():
    schedule = make_schedule(team_graph("G2"))
    assert schedule.period == 3
    x = None
    printed = {
        "r12": (0, 1, x),
        "r14": (0, 3, x),  # figure 2
        "r15": (0, x, 4),
        "r23": (2, 1, x),
        "r25": (x, 1, 4),
        "r34": (2, 3, x),
        "r35": (2, x, 4),
        "r45": (x, 3, 4),
    }
    assert {robot: schedule.sequence(robot) for robot in printed} == printed
    assert set(schedule.graph.robots) == set(printed)
    # Teams 1 and 3 share no robot, so L is 3; the paper prints (3 - 1) x 2 = 4.
    assert schedule.graph.longest_shortest_path == 3
    assert schedule.delay_bound == 6
    assert make_schedule(schedule.graph, "degree+1").period == 5


@pytest.mark.parametrize("robots", [3, 4, 8, 9])
@pytest.mark.parametrize("each", [2, 3, 4])
def test_proposed_teams_hold_every_robot_as_often_as_asked(robots, each):
    if each >= robots:
        with pytest.raises(InvalidInputError, match="teams_per_robot"):
            propose_teams(robots, each)
        return
    graph = propose_teams(robots, each)
    assert all(len(graph.teams_of(robot)) == each for robot in graph.robots)
    assert all(len(team) == each for team in graph.teams)
    assert make_schedule(graph).delay_bound >= 1
    assert propose_teams(tuple("abcdefghi"[:robots]), each).robots[0] == "a"


@given(GRAPHS, st.sampled_from(["used", "degree+1"]))
def test_schedules_are_free_of_conflicts_and_periodic(graph, period):
    schedule = make_schedule(graph, period)
    assert schedule.period <= graph.greatest_degree + 1
    for epoch in range(1, 2 * schedule.period + 1):
        busy = [robot for team in schedule.teams_in(epoch) for robot in graph.teams[team]]
        assert len(busy) == len(set(busy))
        assert schedule.teams_in(epoch) == schedule.teams_in(epoch + schedule.period)
        for robot in graph.robots:
            team = schedule.team_at(robot, epoch)
            assert team == schedule.team_at(robot, epoch + schedule.period)
            assert (team in schedule.teams_in(epoch)) if team is not None else robot not in busy
    met = [team for epoch in range(1, schedule.period + 1) for team in schedule.teams_in(epoch)]
    assert sorted(met) == list(range(len(graph.teams)))


@given(GRAPHS, st.sampled_from(["used", "degree+1"]))
@settings(max_examples=FEWER)
def test_every_measurement_reaches_every_team_within_the_bound(graph, period):
    schedule = make_schedule(graph, period)
    bound = schedule.delay_bound
    epochs = 2 * bound + schedule.period + 1
    # known[r] holds (robot, epoch) of measurements; one a robot and epoch, taken after its meeting.
    known = {robot: {(robot, 0)} for robot in graph.robots}
    team_knows: dict[int, set] = {}
    arrival: dict[tuple, dict[int, int]] = {}
    for epoch in range(1, epochs + 1):
        for team in schedule.teams_in(epoch):
            shared = set().union(*(known[robot] for robot in graph.teams[team]))
            for robot in graph.teams[team]:
                known[robot] = set(shared)
            for item in shared - team_knows.get(team, set()):
                arrival.setdefault(item, {})[team] = epoch
            team_knows[team] = shared
        for robot in graph.robots:
            known[robot].add((robot, epoch))
    for robot in graph.robots:
        for taken in range(epochs - bound + 1):
            assert len(arrival[robot, taken]) == len(graph.teams)
            assert max(arrival[robot, taken].values()) - taken <= bound


@given(GRAPHS, st.integers(0, 20))
def test_next_meeting_is_the_first_entry_after_an_epoch(graph, epoch):
    schedule = make_schedule(graph)
    for robot in graph.robots:
        later, team = schedule.next_meeting(robot, epoch)
        assert schedule.team_at(robot, later) == team
        assert all(schedule.team_at(robot, e) is None for e in range(epoch + 1, later))


def test_graphs_that_information_cannot_cross_are_refused():
    with pytest.raises(InvalidInputError, match="connected"):
        TeamGraph(tuple("abcd"), (("a", "b"), ("a", "b"), ("c", "d"), ("c", "d")))
    with pytest.raises(InvalidInputError, match="two or more teams"):
        TeamGraph(tuple("abc"), (("a", "b"), ("b", "a"), ("b", "c")))
    with pytest.raises(InvalidInputError, match="two or more different robots"):
        TeamGraph(tuple("ab"), (("a",), ("a", "b")))
    with pytest.raises(UnknownNameError, match="'z'"):
        TeamGraph(tuple("ab"), (("a", "z"), ("a", "b")))
    with pytest.raises(InvalidInputError, match="twice"):
        TeamGraph(("a", "a"), (("a", "a"),))
    with pytest.raises(InvalidInputError, match="three or more"):
        propose_teams(2)


def test_schedules_with_conflicts_are_refused():
    graph = propose_teams(4)
    with pytest.raises(InvalidInputError, match="two places"):
        Schedule(graph, (1, 1, 2, 3), 3)
    with pytest.raises(InvalidInputError, match="1 to 2"):
        Schedule(graph, (1, 2, 1, 3), 2)
    with pytest.raises(InvalidInputError, match="one epoch a team"):
        Schedule(graph, (1, 2), 2)
    with pytest.raises(InvalidInputError, match="period"):
        make_schedule(graph, "longest")
