"""`fgplan team` and `fgplan robot`: robots as processes give the plan of one process."""

import json
import os
import signal
import subprocess
import sys
import time

import msgspec
import numpy as np
import pytest
from process_scenarios import GATHERING, MEETINGS, without_work

pytest.importorskip("zenoh")

from fgplan.cli.command_line import main
from fgplan.cli.team_command import run_team
from fgplan.errors import InvalidInputError
from fgplan.io.command import CommandOptions
from fgplan.io.mission_file import load_mission
from fgplan.io.plain_value import plain_value
from fgplan.io.scenario_file import read_scenario
from fgplan.planners.registry import find_planner
from fgplan.team.certificates import make_certificates
from fgplan.team.network_options import free_endpoint


def written(folder, text):
    """The scenario as a file."""
    path = folder / "scenario.toml"
    path.write_text(text)
    return path


def result(folder):
    """Result file of a run folder."""
    return json.loads((folder / "result.json").read_text())


def plan_in(folder):
    """The plan of a run folder."""
    return result(folder)["results"]["plans"][0]


def planned(scenario):
    """The plan of one process, as a result file would hold it."""
    mission = load_mission(scenario)
    generator = np.random.default_rng(mission.seed)
    plan = find_planner(read_scenario(scenario).planner_name).plan(mission, generator)
    return json.loads(msgspec.json.encode(plain_value(plan.to_data())))


def run(*words):
    """The command, to exit status 0."""
    assert main([str(word) for word in words]) == 0


def test_processes_of_distributed_aia_make_the_plan_of_one_process(tmp_path, capsys):
    scenario = written(tmp_path, GATHERING)
    run("team", scenario, "--out", tmp_path / "here")
    capsys.readouterr()
    run("team", scenario, "--processes", "--out", tmp_path / "apart", "--check")
    said = capsys.readouterr()
    assert "two gather: planner distributed_aia, seed 3" in said.out
    assert "messages sent: " in said.out
    assert not said.err  # no progress in a pipe
    expected = without_work(planned(scenario))
    assert without_work(plan_in(tmp_path / "here")) == expected
    apart = plan_in(tmp_path / "apart")
    assert without_work(apart) == expected
    assert apart["warnings"] == []
    assert set(apart["seconds"]) == {"setup", "wait", "run", "compile", "processes"}
    nodes = apart["traffic"]["nodes"]
    assert nodes["sent"] == nodes["delivered"] > 10
    assert nodes["sent_bytes"] == nodes["delivered_bytes"]
    processes = result(tmp_path / "apart")["results"]["processes"]
    assert set(processes) == {"ann", "bob"}
    assert all(one["finished"] and not one["refused"] for one in processes.values())
    # The files of fgplan run, and what each robot handed in.
    names = {path.name for path in (tmp_path / "here").iterdir()}
    assert names > {"scenario.toml", "result.json", "record.json", "plans.json"}
    assert {path.name for path in (tmp_path / "apart").iterdir()} == names | {"robots"}
    for name in ("ann", "bob"):
        log = (tmp_path / "apart" / "robots" / f"{name}.log").read_text()
        assert log.startswith(f"{name}: came to its end; sent ")
        assert log.count("\n") == 3  # and nothing of anybody else's
    met = {one["name"]: one["met"] for one in result(tmp_path / "apart")["requirements"]}
    assert met["nobody_lost"]
    assert "nobody_lost" not in (tmp_path / "here" / "result.json").read_text()


def test_processes_of_an_intermittent_team_and_their_world_make_the_plan_of_one(tmp_path):
    scenario = written(tmp_path, MEETINGS)
    run("team", scenario, "--processes", "--out", tmp_path / "apart")
    expected, apart = planned(scenario), plan_in(tmp_path / "apart")
    assert without_work(apart) == without_work(expected)
    assert apart["report"] == expected["report"]
    assert apart["report"]["meetings"] >= 2
    assert apart["traffic"]["tick"]["sent"] == 2 * 80
    assert set(result(tmp_path / "apart")["results"]["processes"]) == {"ann", "bob", "world"}


def fgplan_robot(scenario, name, folder, *words, **options):
    """A robot as several machines would start it."""
    command = [sys.executable, "-m", "fgplan", "robot", str(scenario), "--name", name]
    return subprocess.Popen(
        [*command, "--out", str(folder), *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


@pytest.mark.full
def test_robots_started_one_by_one_hand_in_what_makes_the_plan(tmp_path):
    scenario = written(tmp_path, GATHERING)
    first = free_endpoint()
    bob = fgplan_robot(scenario, "bob", tmp_path / "bob", "--connect", first)
    ann = fgplan_robot(scenario, "ann", tmp_path / "ann", "--listen", first)
    for name, robot in (("ann", ann), ("bob", bob)):
        out, err = robot.communicate(timeout=200)
        assert robot.returncode == 0, err
        assert f"{name}: came to its end; sent " in out
        assert f"wrote {tmp_path / name / 'robots' / name}.msgpack" in out
    (tmp_path / "both" / "robots").mkdir(parents=True)
    for name in ("ann", "bob"):
        file = f"robots/{name}.msgpack"
        (tmp_path / "both" / file).write_bytes((tmp_path / name / file).read_bytes())
    run("team", scenario, "--gather", tmp_path / "both", "--out", tmp_path / "gathered")
    found = without_work(plan_in(tmp_path / "gathered"))
    assert found == without_work(planned(scenario))


@pytest.mark.full
def test_processes_with_certificates_of_their_own_make_the_same_plan(tmp_path):
    network = """
[team.network]
ca = "keys/ca.pem"
certificate = "keys/{robot}.pem"
key = "keys/{robot}.key"
connect = ["tls/127.0.0.1:1"]
"""
    scenario = written(tmp_path, GATHERING + network)
    make_certificates(tmp_path / "keys", ["ann", "bob"])
    run("team", scenario, "--out", tmp_path / "here")
    run("team", scenario, "--processes", "--out", tmp_path / "apart")
    apart = plan_in(tmp_path / "apart")
    assert without_work(apart) == without_work(plan_in(tmp_path / "here"))
    assert apart["warnings"] == []
    assert not list((tmp_path / "apart").rglob("*.key"))


@pytest.mark.full
def test_a_robot_that_is_killed_is_named_and_the_rest_goes_on(tmp_path, monkeypatch, capsys):
    # Slow enough that there is a middle: the world sleeps a little in each step.
    from fgplan.processes import team_processes
    from fgplan.processes.child import Child

    scenario = written(tmp_path, MEETINGS.replace("steps = 80", "steps = 2000"))
    killed = []

    def watched(self):
        told = self.progress
        if self.robot == "bob" and told is not None and told.done > 10 and not killed:
            killed.append(told.done)
            os.kill(self.pid, signal.SIGKILL)
        return status(self)

    status = Child.status.fget
    monkeypatch.setattr(team_processes.Child, "status", property(watched))
    run("team", scenario, "--processes", "--out", tmp_path / "apart")
    plan = plan_in(tmp_path / "apart")
    assert not plan["agreed"]
    met = {one["name"]: one["met"] for one in result(tmp_path / "apart")["requirements"]}
    assert not met["nobody_lost"]
    lost = [line for line in plan["warnings"] if "'bob' was lost" in line]
    assert len(lost) == 2  # the world says since which step, the parent why
    assert any("ended by signal 9" in line for line in lost)
    still = next(robot for robot in plan["robots"] if robot["robot"] == "bob")["path"]["poses"]
    assert still[-1][:2] == still[-2][:2]
    assert "did not come to an agreement" in capsys.readouterr().out


@pytest.mark.full
def test_a_child_ends_with_its_parent(tmp_path):
    scenario = written(tmp_path, GATHERING)
    robot = fgplan_robot(
        scenario, "ann", tmp_path, "--child", "--start-wait-s", "0", stdin=subprocess.PIPE
    )
    assert msgspec.json.decode(robot.stdout.readline())["doing"] == "waiting for the team"
    began = time.monotonic()
    robot.stdin.close()
    robot.stdout.close()
    robot.stderr.close()
    robot.wait(30)
    assert time.monotonic() - began < 20


def test_a_team_needs_a_folder_for_what_robots_hand_in(tmp_path):
    scenario = str(written(tmp_path, GATHERING))
    with pytest.raises(InvalidInputError, match="expected a run folder"):
        run_team(CommandOptions(arguments={"scenario": scenario}))


@pytest.mark.parametrize(
    ("verb", "text", "words", "status", "match"),
    [
        ("team", GATHERING.replace("distributed_aia", "aia"), [], 2, "fgplan run plans in one"),
        ("team", GATHERING, ["--processes", "--gather", "."], 2, "--processes or --gather"),
        ("team", GATHERING, ["--gather", "nowhere"], 2, "files of robots ann, bob, got none"),
        ("team", GATHERING.replace("1e-4", "1e-40"), [], 1, "no plan brings"),
        ("team", GATHERING + "[team.network]\nlisten_to = 3\n", [], 2, "network listen_to"),
        ("robot", GATHERING, ["--name", "zoe", "--child"], 2, "'zoe': expected one of ann, bob"),
        ("robot", GATHERING, ["--name", "ann", "--listen", "tcp/0.0.0.0:0"], 2, "public = true"),
        ("robot", GATHERING, ["--name", "ann", "--linger-s", "-1"], 2, "zero or more, got '-1'"),
        ("robot", GATHERING, [], 2, "--name"),
    ],
)
def test_what_cannot_be_run_is_refused_in_one_line(
    tmp_path, monkeypatch, capsys, verb, text, words, status, match
):
    monkeypatch.chdir(tmp_path)
    scenario = written(tmp_path, text)
    try:
        left = main([verb, str(scenario), *words])
    except SystemExit as refused:
        left = refused.code
    assert left == status
    said = capsys.readouterr().err
    assert match in said
    assert said.count("\n") == 1
