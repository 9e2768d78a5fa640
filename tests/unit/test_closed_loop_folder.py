"""A closed loop on disk: read back bit by bit, stopped anywhere and gone on with."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import closed_loop_worlds as worlds
import numpy as np
import pytest

from fgplan.closed_loop.loop import run_loop
from fgplan.closed_loop.records import GivenUpRecord
from fgplan.errors import InvalidInputError
from fgplan.io.loop_folder import LOOP, read_loop, run_in_folder
from fgplan.io.mission_digest import mission_digest
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.paths.multi_robot import MultiRobotModel
from fgplan.simulation.world import World

HERE = Path(__file__).parents[1]

SCRIPT = """
import sys
from pathlib import Path
import closed_loop_worlds as worlds
from fgplan.io.loop_folder import run_in_folder
for record in run_in_folder(worlds.small_mission(1), Path(sys.argv[1])):
    print(type(record).__name__, flush=True)
    sys.stdin.readline()
"""


@pytest.fixture(scope="module")
def mission():
    return worlds.small_mission(1)


@pytest.fixture(scope="module")
def folder(mission, tmp_path_factory):
    path = tmp_path_factory.mktemp("loop")
    list(run_in_folder(mission, path))
    return path


def test_records_read_back_to_the_last_bit(mission, folder):
    records = list(run_loop(mission))
    history, workspace = read_loop(folder)
    worlds.assert_same(worlds.history_of(mission, records), history)
    assert history.reached == {"ann": 2, "bob": 2}
    assert workspace.workspace().upper.tolist() == [120.0, 100.0]
    for session in history.sessions:
        for paths in session.candidates.values():
            assert all(not path.poses.flags.writeable for path in paths)


def test_records_of_space_obstacles_and_goals_given_up_read_back(tmp_path):
    wall = np.array([(5.0, 30.0), (20.0, 30.0), (20.0, 34.0), (5.0, 34.0)])
    cage = np.array([(90.0, 70.0), (110.0, 70.0), (110.0, 90.0), (90.0, 90.0)])
    mission = worlds.small_mission(
        0,
        spatial=True,
        multi_robot=(worlds.spatial_meeting(),),
        measured={"meet": worlds.spatial_meeting()},
        obstacles=(wall, cage),
        obstacle_range_m=15.0,
        goals={"ann": ((10.0, 60.0),), "bob": ((70.0, 60.0), (100.0, 80.0))},
    )
    records = list(run_in_folder(mission, tmp_path))
    history, workspace = read_loop(tmp_path)
    assert any(session.obstacles for session in history.sessions)
    assert isinstance(records[-2], GivenUpRecord)
    worlds.assert_same(history.given_up, records[-2])
    assert history.unreachable.keys() == {"bob"}
    worlds.assert_same(history.sessions, tuple(worlds.sessions_of(records)))
    worlds.assert_same(history.steps, tuple(worlds.steps_of(records)))
    worlds.assert_same(history.final, records[-1])
    assert len(workspace.obstacles) == 2


def test_finished_folder_is_left_as_it_is(mission, folder):
    before = (folder / LOOP).read_bytes()
    assert list(run_in_folder(mission, folder)) == []
    assert (folder / LOOP).read_bytes() == before


def cuts_of(content):
    """Ten lengths: within the first line, at its end, at an end of a line, and anywhere."""
    generator = random.Random(7)
    first = content.index(b"\n")
    ends = [place + 1 for place, byte in enumerate(content) if byte == ord("\n")]
    anywhere = [generator.randrange(first, len(content)) for _ in range(5)]
    return [0, generator.randrange(1, first), first, first + 1, generator.choice(ends), *anywhere]


@pytest.mark.parametrize("number", range(10))
def test_run_cut_at_any_byte_ends_as_if_it_had_not_been(mission, folder, tmp_path, number):
    content = (folder / LOOP).read_bytes()
    cut = cuts_of(content)[number]
    (tmp_path / LOOP).write_bytes(content[:cut])
    new = list(run_in_folder(mission, tmp_path))
    whole = content[:cut].count(b"\n")
    assert len(new) == content.count(b"\n") - max(whole, 1)
    assert_same_folder(folder, tmp_path)
    assert (tmp_path / LOOP).read_bytes().startswith(content[:cut])


def assert_same_folder(one, other):
    """The same records, all fields but seconds."""
    (first, one_space), (second, other_space) = read_loop(one), read_loop(other)
    worlds.assert_same(first, second)
    worlds.assert_same(one_space, other_space)
    lines = [(path / LOOP).read_bytes().splitlines() for path in (one, other)]
    assert lines[0][0] == lines[1][0]
    assert len(lines[0]) == len(lines[1])


@pytest.mark.parametrize(
    "number", [0, *[pytest.param(n, marks=pytest.mark.full) for n in range(1, 10)]]
)
def test_process_that_is_killed_is_gone_on_with(folder, tmp_path, mission, number):
    lines = (folder / LOOP).read_bytes().count(b"\n")
    generator = random.Random(number)
    allowed = generator.randrange(1, lines - 2)  # it waits after so many records and one more
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), str(HERE.parent)])}
    with subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(tmp_path)],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        process.stdin.write("\n" * allowed)
        process.stdin.flush()
        for _ in range(allowed):
            process.stdout.readline()
        time.sleep(generator.uniform(0.0, 0.05))
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    written = (tmp_path / LOOP).read_bytes().count(b"\n")
    assert written < lines
    list(run_in_folder(mission, tmp_path))
    assert_same_folder(folder, tmp_path)


def test_half_a_run_reads_back_as_far_as_it_has_come(folder, tmp_path):
    lines = (folder / LOOP).read_bytes().splitlines(keepends=True)
    (tmp_path / LOOP).write_bytes(b"".join(lines[:6]) + lines[6][:100])
    before = (tmp_path / LOOP).read_bytes()
    history, _ = read_loop(tmp_path)
    assert history.final is None
    assert len(history.steps) + len(history.sessions) == 5
    assert (tmp_path / LOOP).read_bytes() == before  # reading changes nothing


def test_folder_of_another_mission_is_refused(mission, folder):
    with pytest.raises(InvalidInputError, match=r"got another mission's \('small'\)"):
        list(run_in_folder(replace(mission, seed=2), folder))


def test_file_that_is_no_loop_is_refused_and_left(mission, tmp_path):
    path = tmp_path / LOOP
    path.write_text("my notes")
    with pytest.raises(InvalidInputError, match="expected the records of a closed loop, got b'my"):
        list(run_in_folder(mission, tmp_path))
    path.write_text("my notes\n")
    with pytest.raises(InvalidInputError, match="line 1: expected a record of a closed loop"):
        list(run_in_folder(mission, tmp_path))
    assert path.read_text() == "my notes\n"


def test_folder_that_is_a_file_is_refused(mission, tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(InvalidInputError, match="expected a place to write to"):
        list(run_in_folder(mission, tmp_path / "taken"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: [*lines[:3], b"{}\n"], "line 4: expected a record"),
        (lambda lines: [*lines[:3], b'{"kind":"dance"}\n'], "line 4: expected a record"),
        (lambda lines: [*lines[:3], b'{"kind":"step"}\n'], "line 4: expected a record"),
        (lambda lines: [*lines[:3], b"[1]\n"], "line 4: expected a record"),
        (lambda lines: [*lines[:2], lines[2][:50] + b"\n"], "line 3: expected a record"),
        (
            lambda lines: [lines[0].replace(b"loop.v1", b"loop.v9")],
            "expected 'loop.v1' on the first line, got 'loop.v9'",
        ),
        (lambda _: [b""], "expected 'loop.v1' on the first line, got nothing"),
    ],
)
def test_broken_records_are_refused_by_line(folder, tmp_path, change, message):
    lines = (folder / LOOP).read_bytes().splitlines(keepends=True)
    (tmp_path / LOOP).write_bytes(b"".join(change(lines)))
    with pytest.raises(InvalidInputError, match=message):
        read_loop(tmp_path)


def test_folder_without_records_is_refused(tmp_path):
    shutil.rmtree(tmp_path / "none", ignore_errors=True)
    with pytest.raises(InvalidInputError, match="expected the records of a closed loop"):
        read_loop(tmp_path / "none")


@dataclass(frozen=True)
class Nearness:
    """A criterion of one's own."""

    distance_m: float

    def __call__(self, first, second):
        return bool(np.linalg.norm(first.pose[:2] - second.pose[:2]) < self.distance_m)


class Plain:
    """One that is no dataclass."""

    def __init__(self, distance_m):
        self.distance_m = distance_m

    __call__ = Nearness.__call__


class Slotted:
    """One that holds nothing to be known by."""

    __slots__ = ()
    __call__ = Nearness.__call__


def near(first, second):
    """One that is a function."""
    return bool(np.linalg.norm(first.pose[:2] - second.pose[:2]) < 30.0)


def with_criterion(mission, criterion):
    model = MultiRobotModel(criterion=criterion, sensor=worlds.MEETING.sensor)
    return replace(mission, multi_robot=(model,))


def test_digest_is_that_of_the_content():
    one, other = worlds.small_mission(1), worlds.small_mission(1)
    assert one is not other
    assert mission_digest(one) == mission_digest(other)
    assert mission_digest(replace(one, name="another title")) == mission_digest(one)
    for make in (Nearness, Plain):
        same = [mission_digest(with_criterion(one, make(30.0))) for _ in range(2)]
        assert same[0] == same[1] != mission_digest(with_criterion(one, make(31.0)))
    assert mission_digest(with_criterion(one, near)) != mission_digest(one)
    with pytest.raises(InvalidInputError, match="expected a dataclass or an object with attri"):
        mission_digest(with_criterion(one, Slotted()))


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 2},
        {"path_weight": 0.2},
        {"uncertainty_weight": 2.0},
        {"others_landmarks": False},
        {"relinearise_m": 0.2},
        {"max_steps": 3},
        {"obstacle_range_m": 3.0},
        {"multi_robot": ()},
    ],
    ids=lambda change: next(iter(change)),
)
def test_digest_tells_missions_apart(mission, change):
    assert mission_digest(replace(mission, **change)) != mission_digest(mission)


def test_digest_tells_worlds_apart(mission):
    world = mission.world
    eye = BearingRangeSensor(
        bearing_sigma_rad=0.01, range_sigma_m=0.2, max_range_m=np.nextafter(25.0, 26.0)
    )
    positions = world.landmark_positions.copy()
    positions[3, 1] = np.nextafter(positions[3, 1], 0.0)
    changes = (
        {"sensors": {"eye": eye}},
        {"landmark_positions": positions},
        {"multi_robot": {"meet": worlds.MEETING}},
        {"step_s": 2.0},
        {"workspace": None},
    )
    digests = {mission_digest(replace(mission, world=_changed(world, each))) for each in changes}
    assert len(digests | {mission_digest(mission)}) == len(changes) + 1


def _changed(world: World, change):
    return replace(world, **change)
