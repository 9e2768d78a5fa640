"""Robots as real processes over zenoh that are killed, frozen, late or parted, on a real problem."""

import pytest
from crossing_teams import crossing, mission_with, plan_of
from process_teams import RobotServer, checked, process_team

OPTIONS = {"repair_after_s": 0.4, "lost_after_s": 2.0}


@pytest.fixture(name="server", scope="module")
def server_of_this_module(tmp_path_factory):
    server = RobotServer(crossing(tmp_path_factory.mktemp("server"), 4))
    try:
        yield server
    finally:
        server.end()


@pytest.mark.parametrize("count", [2, 4])
def test_plain(server, tmp_path, count):
    path = crossing(tmp_path, count)
    plan = plan_of(mission_with(path))
    with process_team(server, tmp_path, path, count, OPTIONS, leaves=True) as team:
        team.start()
        at_s = team.until_agreed(*team.names)
        print(at_s - min(team.said(n, "began") for n in team.names))
        reports, _ = checked(team, *team.names)
        print(team.lines("ann")[-1]["sent"])
        assert [reports[n].chosen for n in team.names] == [r.candidate for r in plan.robots]
