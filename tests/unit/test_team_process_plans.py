"""Impacted paths by real processes over zenoh, with network faults too: the plan of one process."""

import json
import os
import signal
import threading

import numpy as np
import pytest
from crossing_teams import NAMES, crossing, mission_with, plan_of, program_of
from process_teams import process_team

import fgplan.processes.team_processes
from fgplan.cli import main
from fgplan.planners.plan import plan_of as plan_of_data
from fgplan.planners.registry import find_planner
from fgplan.processes.child import Child
from fgplan.team.coordination import coordinate
from fgplan.team.report import encode_report

PARTED_S = 1.5
FAULTS = {"loss": 0.3, "doubled": 0.2, "delay_s": (0.0, 0.2)}


def assert_same(found, expected):
    """All that must not depend on who carries the messages: bytes of paths, values, turns."""
    one, other = found.to_data(), expected.to_data()
    for part in ("agreed", "objective", "robots"):
        assert one[part] == other[part], part
    for item, wanted in zip(found.robots, expected.robots, strict=True):
        assert item.candidate == wanted.candidate
        assert item.path.poses.tobytes() == wanted.path.poses.tobytes()
        assert item.covariances.tobytes() == wanted.covariances.tobytes()
    turns, wanted = one["details"]["turns"], other["details"]["turns"]
    assert [{**turn, "seconds": 0} for turn in turns] == [{**turn, "seconds": 0} for turn in wanted]


def check_same(team, mission):
    """What the processes have agreed on, and each robot's ledger, against one process."""
    reports = team.reports(*team.names)
    setups = {name: program_of(mission, name).state.setup for name in team.names}
    setup = setups[team.names[0]]
    agreement = coordinate(
        setup.problem,
        {name: one.candidates for name, one in setups.items()},
        goals={robot.name: robot.goals[-1] for robot in mission.robots},
    )
    for report in reports.values():
        assert report.ledger.history == agreement.ledger.history
        assert report.ledger.encode() == agreement.ledger.encode()
        assert report.first_value == agreement.values[0]
    handed_in = {name: {"session": encode_report(report)} for name, report in reports.items()}
    planner = find_planner("impacted_paths")
    found = planner.team_plan(mission, handed_in, np.random.default_rng(mission.seed))
    assert_same(found, plan_of(mission))
    assert len(found.objective) > 1
    return reports


@pytest.mark.parametrize("count", [2, 4, pytest.param(8, marks=pytest.mark.full)])
def test_processes_make_the_plan_of_one_process(robot_server, tmp_path, count):
    path = crossing(tmp_path, count)
    with process_team(robot_server, tmp_path, path, count, {}, leaves=True) as team:
        team.start()
        team.until(lambda: all(team.said(name, "report") for name in team.names), 60.0)
        reports = check_same(team, mission_with(path))
        assert all(report.finished and report.lost == () for report in reports.values())
        assert not any(team.lines(name)[-1]["refused"] for name in team.names)


def faulty_and_parted(robot_server, folder, seed, count=4):
    """30 % lost, some doubled, all delayed and so out of order, and parted for a while."""
    options = {"repair_after_s": 0.3}
    path = crossing(folder, count)
    generator = np.random.default_rng([11, seed])
    names = list(generator.permutation(NAMES[:count]))
    cut, entries = int(generator.integers(1, count)), int(generator.integers(1, 3))
    sides = [[str(name) for name in side] for side in (names[:cut], names[cut:])]
    faults = {**FAULTS, "seed": seed}
    with process_team(
        robot_server, folder, path, count, options, leaves=True, faults=faults
    ) as team:
        for side in sides:
            for name in side:
                after = {"what": "part", "entries": entries} if name == names[0] else None
                team.start(name, side=side, after=after)
        team.until(lambda: team.said(names[0], "part"), 60.0)
        parted = team.folder / "parted"
        began_s = team.said(names[0], "part")
        team.until(lambda: team.now() > began_s + PARTED_S, 10.0)
        parted.unlink()
        # If the last words of one that leaves are lost, it counts as lost for who waits for them.
        team.until(lambda: all(team.said(name, "report") for name in team.names), 60.0)
        reports = check_same(team, mission_with(path))
        assert all(report.finished and report.agreed for report in reports.values())


def test_lost_doubled_late_and_parted_messages_change_nothing(robot_server, tmp_path):
    faulty_and_parted(robot_server, tmp_path, 0)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(1, 13))
def test_network_faults_by_seed_change_nothing(robot_server, tmp_path, seed):
    faulty_and_parted(robot_server, tmp_path, seed, count=8 if seed == 4 else 4)


@pytest.mark.full
@pytest.mark.parametrize("count", [2, 4])
def test_command_with_processes_gives_the_plan_of_one_process(tmp_path, count):
    path = crossing(tmp_path, count)
    folder = tmp_path / "run"
    assert main(["team", str(path), "--processes", "--out", str(folder)]) == 0
    results = json.loads((folder / "result.json").read_text(encoding="utf-8"))["results"]
    (found,) = map(plan_of_data, results["plans"])
    assert_same(found, plan_of(mission_with(path)))
    assert found.warnings == ()
    assert list(results["processes"]) == list(NAMES[:count])
    for name in NAMES[:count]:
        assert (folder / "robots" / f"{name}.msgpack").exists()
        assert results["processes"][name]["finished"]


class DoomedChild(Child):
    """The process of cid is killed when it says that it has begun with turns."""

    progress = None

    def __setattr__(self, name, value):
        super().__setattr__(name, value)
        if name == "progress" and self.robot == "cid" and value is not None and value.done:
            os.kill(self.pid, signal.SIGKILL)


def command_with(child, tmp_path, monkeypatch):
    """Results and plan of ``fgplan team --processes`` for four robots with such a child."""
    path = crossing(tmp_path, 4)
    options = "candidates = 8\nrepair_after_s = 0.5\nlost_after_s = 3.0"
    path.write_text(path.read_text(encoding="utf-8").replace("candidates = 8", options))
    folder = tmp_path / "run"
    monkeypatch.setattr(fgplan.processes.team_processes, "Child", child)
    main(["team", str(path), "--processes", "--out", str(folder)])
    results = json.loads((folder / "result.json").read_text(encoding="utf-8"))["results"]
    (plan,) = map(plan_of_data, results["plans"])
    return results, plan


@pytest.mark.full
def test_command_goes_on_without_a_robot_that_is_killed(tmp_path, monkeypatch):
    results, plan = command_with(DoomedChild, tmp_path, monkeypatch)
    assert list(results["processes"]) == ["ann", "bob", "dan"]
    assert all(results["processes"][name]["finished"] for name in ("ann", "bob", "dan"))
    assert plan.agreed
    assert set(plan.paths) == {"ann", "bob", "cid", "dan"}  # its path is kept
    assert "robot 'cid' was lost: ended by signal 9" in plan.warnings


class FrozenChild(Child):
    """The process of cid is frozen when it has begun with turns, and goes on 12 s later."""

    progress = None

    def __setattr__(self, name, value):
        before = self.__dict__.get(name)
        super().__setattr__(name, value)
        begins = name == "progress" and value is not None and value.done
        if begins and self.robot == "cid" and not (before and before.done):
            os.kill(self.pid, signal.SIGSTOP)
            threading.Timer(12.0, os.kill, (self.pid, signal.SIGCONT)).start()


@pytest.mark.full
def test_command_gives_a_plan_though_a_robot_comes_back_after_the_others_have_left(
    tmp_path, monkeypatch
):
    results, plan = command_with(FrozenChild, tmp_path, monkeypatch)
    assert list(results["processes"]) == ["ann", "bob", "cid", "dan"]
    assert all(one["finished"] for one in results["processes"].values())
    assert not plan.agreed
    assert set(plan.paths) == {"ann", "bob", "cid", "dan"}
    assert any(line.startswith("robot 'cid' ended apart") for line in plan.warnings)
