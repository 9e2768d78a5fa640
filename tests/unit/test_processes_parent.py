"""What the parent of a team's processes does, with small processes in place of robots."""

import subprocess
import sys
import time
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from process_scenarios import GATHERING

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.io.mission_file import load_mission
from fgplan.planners.program import participants, run_programs
from fgplan.planners.registry import find_planner
from fgplan.processes.child import child_environment, python_module
from fgplan.processes.robot_file import RobotFile, read_robot, robot_path, write_robot
from fgplan.processes.team_processes import Ended, run_team_processes
from fgplan.processes.team_result import plan_of_files
from fgplan.team.in_process import InProcessTransport

READY = """
import json, pathlib, sys, time
def say(done, doing="steps"):
    print(json.dumps({"done": done, "total": 3, "doing": doing}), flush=True)
def until(file):
    while not pathlib.Path(file).exists():
        time.sleep(0.01)
print("a library says hello", flush=True)
say(0, "waiting for the team")
"""


def scripts(**robots):
    """A command a robot."""
    return {name: [sys.executable, "-c", script] for name, script in robots.items()}


def test_processes_that_end_well_and_one_that_crashes(tmp_path):
    told, seen = [], tmp_path / "two was seen"

    def progress(done, total, doing):
        told.append((done, total, doing))
        if "ann 2/3" in doing:
            seen.touch()

    ended = run_team_processes(
        scripts(
            ann=READY + f"say(2); until({str(seen)!r}); say(3)",
            bob=READY + "say(1); print('worn out', file=sys.stderr); raise RuntimeError('broken')",
            cat=READY + "import os, signal; os.kill(os.getpid(), signal.SIGKILL)",
        ),
        tmp_path,
        progress=progress,
    )
    assert ended["ann"] == Ended(0)
    assert ended["bob"].status == 1
    assert "ended with status 1" in ended["bob"].why
    assert "RuntimeError: broken" in ended["bob"].why
    assert "worn out" in ended["bob"].why
    assert ended["cat"] == Ended(-9, "ended by signal 9")
    assert told[0] == (0, 3, "ann starts, bob starts, cat starts; processes ended")
    assert told[-1][:2] == (3, 3)
    assert any("ann 2/3" in doing for _, _, doing in told)


@pytest.mark.parametrize(
    ("script", "error", "match"),
    [
        ("sys.exit('fgplan: no feasible plan: the way\\nis blocked')", None, ""),
        ("print('fgplan: no feasible plan: blocked', file=sys.stderr); sys.exit(1)", 1, "blocked"),
        ("print('fgplan: error: bad sensor', file=sys.stderr); sys.exit(2)", 2, "bad sensor"),
    ],
)
def test_a_refusal_before_the_start_stops_the_team(tmp_path, script, error, match):
    began = time.monotonic()
    commands = scripts(ann=READY + "sys.stdin.read()", bob="import sys; " + script)
    kinds = {1: NoCandidatePathError, 2: InvalidInputError, None: NoCandidatePathError}
    with pytest.raises(kinds[error], match=f"process of 'bob': .*{match}"):
        run_team_processes(commands, tmp_path)
    assert time.monotonic() - began < 30  # ann was ended too


def test_who_does_not_end_is_stopped_when_patience_is_over(tmp_path):
    deaf = repr(str(tmp_path / "bob is deaf"))
    ignores = f"import signal; signal.signal(15, signal.SIG_IGN); pathlib.Path({deaf}).touch(); "
    commands = scripts(ann=READY + f"until({deaf})", bob=READY + ignores + "time.sleep(60)")
    from fgplan.processes import child

    child._STOP_S, before = 0.3, child._STOP_S
    try:
        ended = run_team_processes(commands, tmp_path, patience_s=0.2)
    finally:
        child._STOP_S = before
    assert ended["ann"].status == 0
    assert ended["bob"] == Ended(-9, "ended by signal 9")


LISTENS = """
from fgplan.processes.parent import Parent
parent = Parent()
pathlib.Path("LISTENS").touch()
while parent.ended() != frozenset({"dan", "zoë"}):
    time.sleep(0.01)
say(3)
while not parent.has_gone():
    time.sleep(0.01)
sys.exit(5)
"""


def test_who_still_waits_for_a_robot_is_told_that_it_has_ended(tmp_path):
    dies = READY + "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
    # Patience begins when zoë has ended well, so not before ann can hear of it.
    listens = str(tmp_path / "ann listens")
    ann, zoe = READY + LISTENS.replace("LISTENS", listens), READY + f"until({listens!r})"
    commands = scripts(ann=ann, dan=dies) | {"zoë": scripts(zoe=zoe)["zoe"]}
    told = []
    ended = run_team_processes(
        commands, tmp_path, patience_s=3.0, progress=lambda *line: told.append(line[2])
    )
    assert ended["dan"].status == -9
    assert any("ann 3/3" in line for line in told)
    assert ended["ann"].status == 5  # and that the parent has ended it hears too


def test_a_child_that_reads_its_input_ends_with_the_parent(tmp_path):
    there = repr(str(tmp_path / "bob is there"))
    waits = READY + f"pathlib.Path({there}).touch(); sys.stdin.read(); say(3); sys.exit(5)"
    ann = READY + f"until({there})"
    ended = run_team_processes(scripts(ann=ann, bob=waits), tmp_path, patience_s=0.2)
    assert ended["bob"].status == 5  # by itself: its input had ended


@pytest.fixture(name="handed_in", scope="module")
def what_two_robots_hand_in(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenario")
    (folder / "two.toml").write_text(GATHERING)
    mission = load_mission(folder / "two.toml")
    planner = find_planner("distributed_aia")
    names = participants(planner, mission)
    programs = {
        name: planner.program(mission, name, np.random.default_rng(mission.seed)) for name in names
    }
    ended = run_programs(programs, InProcessTransport(names))
    counts = dict.fromkeys(("sent", "sent_bytes", "delivered", "delivered_bytes", "lost"), 2)
    files = {
        name: RobotFile(
            robot=name,
            planner=planner.name,
            scenario_digest=mission.digest,
            seed=mission.seed,
            finished=True,
            report=one.report(one.state),
            traffic={"nodes": counts},
            refused={},
            first_refused={},
            seconds={"setup": 1.0 if name == "ann" else 2.0},
            missing=(),
        )
        for name, one in ended.items()
    }
    return planner, mission, files


def test_files_of_robots_survive_the_disk_and_make_the_plan(handed_in, tmp_path):
    planner, mission, files = handed_in
    expected = planner.plan(mission, np.random.default_rng(mission.seed))
    read = {}
    for name, file in files.items():
        assert write_robot(tmp_path, file) == robot_path(tmp_path, name)
        read[name] = read_robot(tmp_path, name)
        assert msgspec.msgpack.encode(read[name]) == msgspec.msgpack.encode(file)
    plan = plan_of_files(planner, mission, read)
    assert plan.value == expected.value
    assert plan.traffic["nodes"]["sent"] == 4
    assert plan.seconds["setup"] == 2.0
    assert plan.warnings == ()
    assert read_robot(tmp_path, "cat") is None


def test_what_went_wrong_at_a_robot_is_in_the_warnings(handed_in):
    planner, mission, files = handed_in
    troubled = msgspec.structs.replace(
        files["ann"],
        finished=False,
        missing=("bob",),
        refused={"form": 3},
        first_refused={"form": "from robot 'bob': truncated"},
    )
    plan = plan_of_files(planner, mission, {"ann": troubled}, {"bob": "ended by signal 9"})
    assert plan.warnings == (
        "robot 'ann' did not come to its end",
        "robot 'ann' began without bob",
        "robot 'ann' refused 3 messages (form), the first from robot 'bob': truncated",
        "robot 'bob' was lost: ended by signal 9",
    )
    assert plan.details["lost"] == ["bob"]
    plan = plan_of_files(planner, mission, {"ann": files["ann"]})
    assert plan.warnings == ("robot 'bob' was lost: it handed in nothing",)


def test_files_that_do_not_belong_together_are_refused(handed_in, tmp_path):
    planner, mission, files = handed_in
    for changes, match in (
        ({"seed": 9}, "robot 'ann': expected seed 9, got 3"),
        ({"digest": "0" * 64}, "expected scenario 0000"),
    ):
        with pytest.raises(InvalidInputError, match=match):
            plan_of_files(planner, replace(mission, **changes), files)
    with pytest.raises(InvalidInputError, match="expected planner intermittent"):
        plan_of_files(find_planner("intermittent"), mission, files)
    path = write_robot(tmp_path, files["ann"])
    path.rename(robot_path(tmp_path, "bob"))
    with pytest.raises(InvalidInputError, match="expected robot 'bob', got 'ann'"):
        read_robot(tmp_path, "bob")
    robot_path(tmp_path, "ann").write_bytes(b"\x81")
    with pytest.raises(InvalidInputError, match="what a robot handed in"):
        read_robot(tmp_path, "ann")
    robot_path(tmp_path, "cat").mkdir()
    with pytest.raises(InvalidInputError, match="what a robot handed in"):
        read_robot(tmp_path, "cat")


def test_a_child_runs_this_package_whatever_lies_in_the_working_folder(tmp_path):
    (tmp_path / "fgplan").mkdir()
    (tmp_path / "fgplan" / "__init__.py").write_text("raise SystemExit('the wrong one')")
    done = subprocess.run(
        [*python_module("fgplan"), "--version"],
        cwd=tmp_path,
        env=child_environment(),
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("fgplan ")
