"""Bad input, through Python and through ``fgplan run``: one clear line, nothing half-done.

Every line names file and field (or robot and key), what was expected, what came and the remedy.
"""

import json
import subprocess
import sys
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import gtsam
import numpy as np
import pytest

from fgplan.beliefs.belief import Belief
from fgplan.cli import main
from fgplan.errors import (
    FgplanError,
    IllPosedBeliefError,
    InvalidInputError,
    NoCandidatePathError,
    OptionError,
    ScenarioError,
    UnknownNameError,
)
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.io.g2o import read_g2o
from fgplan.io.mission_file import load_mission
from fgplan.io.result_file import read_result
from fgplan.io.scenario_file import read_scenario
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.planners.impacted_paths.candidates import candidate_sets, planning_problem
from fgplan.planners.mission import Mission, MissionTarget
from fgplan.planners.registry import find_planner
from fgplan.simulation.simulate import simulate
from fgplan.simulation.world import World, WorldRobot
from fgplan.team.communication_graph import CommunicationGraph
from fgplan.team.coordination import coordinate
from fgplan.team.in_process import InProcessTransport
from roadmaps import MapFileError, read_movingai_map, read_ros_map

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "scenarios" / "two_robots.toml"
TEXT = EXAMPLE.read_text(encoding="utf-8")

BETWEEN = "sigmas = [0.2, 0.2, 0.02]"
ANN = "start_sigmas = [0.1, 0.1, 0.01]"
BOUNDS = "bounds = [[0.0, 0.0], [60.0, 40.0]]"
OBJECTIVE = TEXT[TEXT.index("[objective]") : TEXT.index("[planner]\n")]
CELL = (  # a closed room around bob's goal
    "obstacles = [\n  [[50.0, 16.0], [60.0, 16.0], [60.0, 17.0], [50.0, 17.0]],"
    "\n  [[50.0, 0.0], [51.0, 0.0], [51.0, 17.0], [50.0, 17.0]],"
)
BAR = "obstacles = [\n  [[25.0, -1.0], [26.0, -1.0], [26.0, 41.0], [25.0, 41.0]],"


def edited(*changes: tuple[str, str]) -> str:
    text = TEXT
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def term(table: str) -> str:
    return edited((OBJECTIVE, f"[[objective.terms]]\n{table}\n"))


def keys(letter: str) -> list[int]:
    return [int(gtsam.symbol(letter, index)) for index in range(3)]


def past(*extra: str, tie: bool = True) -> str:
    """A g2o past of both robots, three poses each; without ``tie`` nothing joins the two."""
    lines = [
        f"VERTEX_SE2 {key} {4 + index} {y} 0"
        for letter, y in (("a", 6), ("b", 34))
        for index, key in enumerate(keys(letter))
    ]
    pairs = [(one, two) for k in ("a", "b") for one, two in pairwise(keys(k))]
    lines += [f"EDGE_SE2 {one} {two} 1 0 0 100 0 0 100 0 1000" for one, two in pairs]
    if tie:
        lines.append(f"EDGE_SE2 {keys('a')[0]} {keys('b')[0]} 0 28 0 100 0 0 100 0 1000")
    return "\n".join([*lines, *extra]) + "\n"


FIX = f"FIX {keys('a')[0]}"
PGM = b"P5\n2 2\n255\n\xff\xff\xff\xff"
YAML = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n"


class Case(NamedTuple):
    """One scenario that is not usable, the files beside it, and what its line says."""

    text: str
    words: tuple[str, ...]
    files: Mapping[str, str | bytes] = MappingProxyType({})
    status: int = 2


def with_map(name: str, words: tuple[str, ...], **files: str | bytes) -> Case:
    beside = {key.replace("_", "."): content for key, content in files.items()}
    return Case(edited((BOUNDS, f'map = "{name}"')), (*words, "`$.world.map`"), beside)


def with_past(content: str, *words: str, extra: str = "", bob: str = "b2") -> Case:
    text = "\n".join(line for line in TEXT.splitlines() if not line.startswith("start"))
    text += '\n[prior]\nkind = "g2o"\nfiles = ["past.g2o"]\n'
    text += f'start_keys = {{ ann = "a2", bob = "{bob}" }}\n{extra}\n'
    return Case(text, words, {"past.g2o": content})


def between(first: str, second: str) -> Case:
    return Case(edited((BETWEEN, first)), (second, "`$.team.multi_robot[0].sensor.covariance`"))


def planner(option: str, *words: str) -> Case:
    return Case(edited(("candidates = 10", option)), (*words, "`$.planner.impacted_paths`"))


def team(table: str, *words: str, status: int = 2) -> Case:
    return Case(edited(("[[team.multi", f"{table}\n[[team.multi")), words, status=status)


CASES = {
    # noise
    "nan noise": Case(
        edited((BETWEEN, "sigmas = [0.2, nan, 0.02]")),
        ("finite number, got nan; write a number", "`$.team.multi_robot[0].sensor.sigmas[1]`"),
    ),
    "nan motion noise": Case(
        edited(("motion = { sigmas = [0.05", "motion = { sigmas = [nan")),
        ("finite number, got nan", "`$.robots[0].motion.sigmas[0]` (robot 'ann')"),
    ),
    "infinite noise": Case(
        edited(("sigma_m = 0.2", "sigma_m = inf")),
        ("got inf; leave it out where there is no limit", "`$.landmarks[0].sigma_m`"),
    ),
    "heading in degrees": Case(
        edited(("start = [4.0, 34.0, 0.0]", "start = [4.0, 34.0, 90.0]")),
        ("heading within two turns, radians, got 90; is it in degrees?", "(robot 'bob')"),
    ),
    "asymmetric start": Case(
        edited((ANN, "start_covariance = [[0.1, 0.02, 0], [0, 0.1, 0], [0, 0, 0.01]]")),
        (
            "expected a symmetric matrix, got |M - M'| up to 0.02; symmetrise it",
            "`$.robots[0].start_covariance` (robot 'ann')",
        ),
    ),
    "indefinite start": Case(
        edited((ANN, "start_covariance = [[0.1, 0.2, 0], [0.2, 0.1, 0], [0, 0, 0.01]]")),
        (
            "expected a positive definite matrix, got smallest eigenvalue -1",
            "check signs",
            "`$.robots[0].start_covariance` (robot 'ann')",
        ),
    ),
    "start of another size": Case(
        edited((ANN, "start_sigmas = [0.1, 0.1]")),
        ("expected 3 numbers, got 2", "`$.robots[0].start_sigmas` (robot 'ann')"),
    ),
    "asymmetric between robots": between(
        "covariance = [[0.1, 0.02, 0], [0, 0.1, 0], [0, 0, 0.01]]", "a symmetric matrix, got"
    ),
    "indefinite between robots": between(
        "covariance = [[0.1, 0.2, 0], [0.2, 0.1, 0], [0, 0, 0.01]]", "a positive definite matrix"
    ),
    "two rows between robots": between(
        "covariance = [[0.1, 0], [0, 0.1]]", "3 or 6 rows, got rows of 2, 2 numbers"
    ),
    "noise in space between planar robots": Case(
        edited((BETWEEN, "sigmas = [0.1, 0.1, 0.1, 0.1, 0.1, 0.1]")),
        ("noise of 3 numbers for these robots' poses, got 6", "`$.team.multi_robot[0].sensor`"),
    ),
    "indefinite target process": Case(
        TEXT + '[[targets]]\nname = "fox"\nmean = [1, 2]\nsigmas = [1, 1]\n'
        "process = [[-1, 0], [0, 1]]\n",
        ("process: expected a positive semidefinite matrix, got an eigenvalue of -1", "'fox'"),
    ),
    "zero sigma of a sensor": Case(
        edited(("bearing_sigma_rad = 0.02", "bearing_sigma_rad = 0.0")),
        (
            "> 0.0, got 0.0; what is known exactly needs a small positive sigma, such as 1e-6",
            "`$.sensors.lidar.bearing_sigma_rad`",
        ),
    ),
    "zero sigma of a start": Case(
        edited((ANN, "start_sigmas = [0.1, 0.0, 0.01]")),
        ("> 0.0, got 0.0; what is known", "`$.robots[0].start_sigmas[1]` (robot 'ann')"),
    ),
    "zero motion noise": Case(
        edited((TEXT[TEXT.index("motion =") :].splitlines()[0], "motion = { sigmas = [0, 1, 1] }")),
        ("above zero in every direction, got [0. 1. 1.]", "`$.robots[0].motion` (robot 'ann')"),
    ),
    # gauge and keys
    "missing gauge": with_past(
        past(),
        "expected a pose to hold, got neither a FIX line in the files nor gauge; add gauge = ",
        "`$.prior.gauge`",
    ),
    "past in two pieces": with_past(
        past(FIX, tie=False),
        "b0, b1, b2 could move together, and nothing connects them to a0, a1, a2. Add a",
        "`$.prior`",
    ),
    "unknown gauge key": with_past(
        past(), "key of a pose in the files, got a9", "`$.prior.gauge.key`", extra='gauge.key="a9"'
    ),
    "unknown start key": with_past(
        past(FIX), "key of a pose in the files, got b9", "`$.prior.start_keys.bob`", bob="b9"
    ),
    "unknown key in the objective": Case(
        term('kind = "uncertainty"\nkeys = ["l9"]'),
        ("key l9", "is not in the belief", "near names: l1", "`$.objective.terms[0].keys`"),
    ),
    "unknown landmark": Case(
        term('kind = "uncertainty"\nlandmarks = ["tree"]'),
        ("landmarks among l0, l1, got 'tree'", "`$.objective.terms[0].landmarks`"),
    ),
    # robots and goals
    "duplicate robot": Case(
        edited(('name = "bob"', 'name = "ann"')),
        ("unique names, got 'ann', which robots[0] has; rename one", "`$.robots[1].name`"),
    ),
    "goal inside an obstacle": Case(
        edited(("goal = [55.0, 33.0]", "goal = [37.0, 26.0]")),
        (
            "expected a goal in free space, got [37.0, 26.0], which is inside an obstacle",
            "radius (0.5 m); move the goal",
            "`$.robots[0].goal` (robot 'ann')",
        ),
    ),
    "second goal out of bounds": Case(
        edited(("goal = [55.0, 33.0]", "goals = [[55.0, 33.0], [65.0, 33.0]]")),
        (
            "within the bounds [0.0, 0.0] to [60.0, 40.0], got [65.0, 33.0]; move",
            "`$.robots[0].goals[1]` (robot 'ann')",
        ),
    ),
    "unreachable goal": Case(
        edited(("obstacles = [", CELL)),
        (
            "team.toml: robot 'bob': expected at least one candidate path, got none",
            "goal 1 at [55.0, 8.0] cannot be reached",
            "to go on without it, set without_path = 'stay' (in a scenario: under [team])",
        ),
        status=1,
    ),
    "no goal can be reached": Case(
        edited(("obstacles = [", BAR), ("[[team.m", '[team]\nwithout_path = "stay"\n[[team.m')),
        ("robot 'ann'", "(nor has robot 'bob')", "nothing is left to plan"),
        status=1,
    ),
    "empty candidate set": Case(
        edited(("candidates = 10", "candidates = 10\nmax_length_m = 59")),
        ("robot 'ann'", "got none: the shortest path is 6", "longer than max_length_m = 59"),
        status=1,
    ),
    "no candidates asked for": planner(
        "candidates = 0", "candidates: expected a whole number of at least 1, got 0"
    ),
    # planner options and communication
    "unknown option": planner(
        "candidate = 10", "option 'candidate' of planner 'impacted_paths': expected one of cand"
    ),
    "option of another type": planner('candidates = "ten"', "at least 1, got 'ten'"),
    "option seed": planner("seed = -1", "planner option seed: expected a whole number", "got -1"),
    "option communication": planner(
        "communication = { noise = 0.5 }", "network faults noise: expected one of delay_s"
    ),
    "option communication is no table": planner(
        "communication = 0.5", "communication: expected a table of network faults, got 0.5"
    ),
    "unknown evaluator": Case(
        edited(("candidates = 10", 'evaluator = "magic"')),
        ("team.toml: evaluator 'magic': expected one of as_published",),
    ),
    "certain loss": team(
        "[team.communication]\nloss = 1.0", "< 1.0, got 1.0", "`$.team.communication.loss`"
    ),
    "delays the wrong way round": team(
        "[team.communication]\ndelay_s = [0.5, 0.1]",
        "delay_s: expected shortest and longest, zero or more, got",
        "`$.team.communication`",
    ),
    "partition of a stranger": team(
        "[[team.communication.partitions]]\nstart_s = 0\nend_s = 1\ngroups = [['ann'], ['eve']]",
        "names of robots (ann, bob), got 'eve'",
        "`$.team.communication.partitions[0].groups`",
    ),
    "partition that never begins": team(
        "[[team.communication.partitions]]\nstart_s = 2\nend_s = 1\ngroups = []",
        "end_s: expected later than start_s = 2, got 1",
        "`$.team.communication`",
    ),
    # scenario
    "wrong type": Case(
        edited(("goal = [55.0, 33.0]", 'goal = "east"')),
        ("Expected `array`, got `str` 'east'", "`$.robots[0].goal` (robot 'ann')"),
    ),
    "unknown field": Case(
        edited(("[world]", "[world]\ncolour = 3")),
        ("unknown field `colour`; expected one of bounds, map, map_cell_m", "`$.world`"),
    ),
    "unknown field of a robot's motion": Case(
        edited(("per_metre", "per_meter")),
        ("`per_meter`; expected one of sigmas, per_metre", "`$.robots[0].motion` (robot 'ann')"),
    ),
    "unknown field of a prior": with_past(
        past(FIX), "`colour`; expected one of kind, files, start_keys", extra="colour = 3"
    ),
    "missing field": Case(
        edited(('name = "bob"\n', "")),
        ("missing required field `name`; it has start, start_sigmas, goal", "`$.robots[1]`"),
    ),
    "empty scenario": Case("", ("missing required field `schema`; it has nothing", "`$`")),
    "broken TOML": Case(
        edited(("schema = 1", "schema = = 1")), ("expected TOML", "line 3", "got 'schema = = 1'")
    ),
    # maps
    "missing map": with_map("none.map", ("file relative to the scenario, got 'none.map'",)),
    "MovingAI map of another width": with_map(
        "m.map",
        ("m.map, line 5: expected 2 characters, got 3",),
        m_map="type octile\nheight 1\nwidth 2\nmap\n...\n",
    ),
    "MovingAI map cut short": with_map(
        "m.map", ("expected 3 rows", "got 1"), m_map="type octile\nheight 3\nwidth 2\nmap\n..\n"
    ),
    "MovingAI map with a strange cell": with_map(
        "m.map",
        ("m.map, line 5: expected one of . G S @ O T W, got 'x' in column 2",),
        m_map="type octile\nheight 1\nwidth 2\nmap\n.x\n",
    ),
    "ROS map without its image": with_map(
        "m.yaml", ("m.yaml: field 'image': expected a PGM file", "got 'm.pgm'"), m_yaml=YAML
    ),
    "ROS map without resolution": with_map(
        "m.yaml",
        ("m.yaml: field 'resolution': expected a finite number, got nothing",),
        m_yaml=YAML.replace("resolution: 0.05\n", ""),
        m_pgm=PGM,
    ),
    "broken YAML of a ROS map": with_map(
        "m.yaml", ("m.yaml: expected YAML",), m_yaml="image: [", m_pgm=PGM
    ),
    "image cut short": with_map(
        "m.yaml",
        ("m.pgm: pixels: expected 2 x 2 = 4, got 3; the file is cut off",),
        m_yaml=YAML,
        m_pgm=PGM[:-1],
    ),
    "image with more than it says": with_map(
        "m.yaml",
        ("m.pgm: pixels: expected 2 x 2 = 4, got 5; the header is wrong",),
        m_yaml=YAML,
        m_pgm=PGM + b"\xff",
    ),
    "image of another format": with_map(
        "m.yaml", ("m.pgm: expected a PGM image", "convert"), m_yaml=YAML, m_pgm=b"P6\n1 1\n255\n"
    ),
    # g2o
    "g2o edge cut short": with_past(
        past(FIX, f"EDGE_SE2 {keys('a')[0]} {keys('b')[1]} 1 0"),
        "past.g2o:13: EDGE_SE2 has 2 ids and 9 numbers, got 4 fields; is the line cut short?",
        "`$.prior.files`",
    ),
    "g2o tag": with_past(
        past(FIX, "EDGE_SIM3 1 2 3"), "past.g2o:13: unknown tag EDGE_SIM3; known are", "comment"
    ),
    "g2o edge to a vertex that is not there": with_past(
        past(FIX, f"EDGE_SE2 {keys('a')[0]} 99 1 0 0 1 0 0 1 0 1"),
        "past.g2o:13: EDGE_SE2 names vertex 99",
        "read all files in one call",
    ),
    "g2o nan": with_past(
        past(FIX, f"EDGE_SE2 {keys('a')[0]} {keys('b')[1]} nan 0 0 1 0 0 1 0 1"),
        "past.g2o:13: EDGE_SE2: expected finite numbers, got ['nan'",
    ),
    "g2o indefinite information": with_past(
        past(FIX, f"EDGE_SE2 {keys('a')[0]} {keys('b')[1]} 1 0 0 1 5 0 1 0 1"),
        "past.g2o:13: EDGE_SE2: expected a positive definite information matrix",
    ),
    "g2o without a line": with_past("", "past.g2o: expected vertices and edges, got none"),
}


def write(case: Case, folder: Path) -> Path:
    for name, content in case.files.items():
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(data)
    (folder / "team.toml").write_text(case.text, encoding="utf-8")
    return folder / "team.toml"


def plan_file(path: Path) -> None:
    """What a user of Python does with a scenario."""
    mission = load_mission(path)
    find_planner("impacted_paths").plan(mission, np.random.default_rng(mission.seed))


@pytest.mark.parametrize("name", CASES)
def test_one_clear_line_and_nothing_half_done(name, tmp_path, capsys):
    case = CASES[name]
    path, out = write(case, tmp_path), tmp_path / "out"
    assert main(["run", str(path), "--out", str(out), "--quick"]) == case.status
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    assert shown.err.startswith(
        "fgplan: error: " if case.status == 2 else "fgplan: no feasible plan: "
    )
    assert "team.toml: " in shown.err
    for words in case.words:
        assert words in shown.err
    left = {item.name for item in out.iterdir()} if out.exists() else set()
    assert left or not out.exists()
    assert left <= {"result.json", "scenario.toml"}
    if "result.json" in left:
        result = json.loads((out / "result.json").read_text())
        assert result["complete"] is False
        assert result["results"] == {}
        assert result["stopped"].partition(": ")[2] in " ".join(shown.err.split())
    # the same through Python; the run adds the file where a planner does not know it
    kind = NoCandidatePathError if case.status == 1 else FgplanError
    with pytest.raises(kind) as caught:
        plan_file(path)
    text = " ".join(str(caught.value).split())
    assert text.removeprefix(f"{path}: ").removesuffix("`") in shown.err


@pytest.mark.parametrize("name", ["nan noise", "unreachable goal", "g2o edge cut short"])
def test_process_ends_with_the_status_and_one_line(name, tmp_path):
    path = write(CASES[name], tmp_path)
    program = "import sys; from fgplan.cli import main; sys.exit(main())"
    words = [sys.executable, "-c", program, "run", str(path), "--out", str(tmp_path / "out")]
    ended = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=False)
    assert ended.returncode == CASES[name].status
    assert ended.stdout == ""
    assert ended.stderr.count("\n") == 1
    assert "Traceback" not in ended.stderr
    for words_of_it in CASES[name].words:
        assert words_of_it in ended.stderr


@pytest.mark.usefixtures("no_pictures")
def test_the_others_go_on_where_the_user_says_so(tmp_path, capsys):
    text = edited(("obstacles = [", CELL), ("[[team", '[team]\nwithout_path = "stay"\n[[team'))
    path = write(Case(text, ()), tmp_path)
    assert main(["run", str(path), "--out", str(tmp_path / "out"), "--quick"]) == 0
    shown = capsys.readouterr().out
    assert "bob: stays" in shown
    assert "warning: robot 'bob' stays: goal 1 at [55.0, 8.0] cannot be reached" in shown
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["complete"] is True
    ann, bob = result["results"]["plans"][0]["robots"]
    assert ann["path"] is not None
    assert bob["path"] is None


def test_bad_input_leaves_an_earlier_run_as_it_was(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["run", str(EXAMPLE), "--out", str(out), "--quick"]) == 0
    (out / "impacted_paths_9.png").write_bytes(b"an earlier run had more figures")
    (out / "notes.png").write_bytes(b"the user's own")
    before = {item.name: item.read_bytes() for item in out.iterdir()}
    path = write(CASES["goal inside an obstacle"], tmp_path)
    assert main(["run", str(path), "--out", str(out), "--quick"]) == 2
    assert {item.name: item.read_bytes() for item in out.iterdir()} == before
    # a run that begins removes what the earlier one drew, and nothing else
    path = write(CASES["unreachable goal"], tmp_path)
    assert main(["run", str(path), "--out", str(out), "--quick"]) == 1
    assert {item.name for item in out.iterdir()} == {"result.json", "scenario.toml", "notes.png"}
    stopped = json.loads((out / "result.json").read_text())
    assert stopped["complete"] is False
    assert "cannot be reached" in stopped["stopped"]
    capsys.readouterr()


def test_a_folder_that_was_empty_before_stays(tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    path = write(CASES["goal inside an obstacle"], tmp_path)
    assert main(["run", str(path), "--out", str(out), "--quick"]) == 2
    assert list(out.iterdir()) == []
    capsys.readouterr()


@pytest.mark.parametrize(
    ("error", "said", "status"),
    [
        (KeyboardInterrupt(), "interrupted", 130),
        (
            InvalidInputError("robot 'ann': no\nnoise"),
            "InvalidInputError: robot 'ann': no noise",
            2,
        ),
    ],
)
def test_the_result_says_what_ended_the_work_and_keeps_what_was_done(
    error, said, status, tmp_path, monkeypatch, capsys
):
    def begun(options):
        options.record({"plans": [1, 2]})
        raise error

    monkeypatch.setattr("fgplan.cli.run_command.run_scenario", begun)
    assert main(["run", str(EXAMPLE), "--out", str(tmp_path)]) == status
    result = read_result(tmp_path / "result.json")
    assert (result.complete, result.stopped) == (False, said)
    assert result.results == {"plans": [1, 2]}
    capsys.readouterr()


def test_noise_is_refused_where_it_is_made():
    asymmetric = [[0.1, 0.02, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.01]]
    indefinite = [[0.1, 0.2, 0.0], [0.2, 0.1, 0.0], [0.0, 0.0, 0.01]]
    for covariance, words in (
        (np.full((3, 3), np.nan), "relative pose covariance: expected finite numbers, got nan"),
        (asymmetric, "relative pose covariance: expected a symmetric matrix"),
        (indefinite, "relative pose covariance: expected a positive definite matrix"),
        (np.zeros((3, 3)), "expected positive variances, got 0 at index 0"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            RelativePoseSensor(covariance=np.array(covariance))
    with pytest.raises(InvalidInputError, match="bearing_sigma_rad: expected a number above zero"):
        BearingRangeSensor(bearing_sigma_rad=0.0, range_sigma_m=0.1)
    with pytest.raises(InvalidInputError, match=r"finite.* got nan"):
        MotionModel(sigmas=np.array([np.nan, 0.1, 0.1]))
    for process, words in (
        ([[-1.0, 0.0], [0.0, 1.0]], "'fox' process: expected a positive semidefinite matrix"),
        ([[1.0, 0.5], [0.0, 1.0]], "'fox' process: expected a symmetric matrix"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            MissionTarget(
                name="fox",
                mean=np.zeros(2),
                covariance=np.eye(2),
                transition=np.eye(2),
                drift=np.zeros(2),
                process=np.array(process),
            )


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        (lambda: gtsam.noiseModel.Diagonal.Sigmas(np.array([0.1, np.nan, 0.1])), "finite sigmas"),
        (lambda: gtsam.noiseModel.Diagonal.Sigmas(np.array([0.1, 0.0, 0.1])), "hard constraint"),
        (
            lambda: gtsam.noiseModel.Gaussian.Covariance(
                np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
            ),
            "symmetric positive definite covariance",
        ),
    ],
)
def test_noise_of_the_users_own_graph_is_refused_by_factor(noise, words):
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose2(gtsam.symbol("x", 0), gtsam.Pose2(), noise()))
    values.insert(gtsam.symbol("x", 0), gtsam.Pose2())
    with pytest.raises(InvalidInputError, match=rf"factor 0 \(PriorFactorPose2 on x0\).*{words}"):
        Belief(graph, values)


def test_missing_gauge_and_unknown_key_of_the_users_own_graph():
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)
    graph.add(gtsam.BetweenFactorPose2(0, 1, gtsam.Pose2(1, 0, 0), noise))
    values.insert(0, gtsam.Pose2())
    values.insert(1, gtsam.Pose2(1, 0, 0))
    with pytest.raises(IllPosedBeliefError, match=r"no factor fixes.*Add a PriorFactorPose2 on 0"):
        Belief(graph, values).covariance(1)
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), noise))
    with pytest.raises(UnknownNameError, match=r"key 7 .*is not in the belief of 2 variables"):
        Belief(graph, values).covariance(7)


def test_mission_made_in_python_is_checked_too():
    mission = load_mission(EXAMPLE)
    with pytest.raises(InvalidInputError, match="unique names, got robot 'ann' twice"):
        Mission(
            name="twice",
            workspace=mission.workspace,
            robots=(mission.robots[0], mission.robots[0]),
            prior=mission.prior,
            objective=mission.objective,
        )
    problem = planning_problem(mission)
    with pytest.raises(NoCandidatePathError, match="robot 'ann': expected at least one candidate"):
        Incremental().start(problem, "ann", ())
    with pytest.raises(NoCandidatePathError, match=r"robot 'ann'.*without_path='stay'"):
        coordinate(problem, {}, FromScratch())


def test_files_are_refused_by_their_own_readers(tmp_path):
    write(CASES["unknown field"], tmp_path)
    with pytest.raises(ScenarioError, match=r"team\.toml.*colour.*\$\.world"):
        read_scenario(tmp_path / "team.toml")
    write(CASES["image cut short"], tmp_path)
    with pytest.raises(MapFileError, match=r"m\.pgm: pixels"):
        read_ros_map(tmp_path / "m.yaml")
    write(CASES["MovingAI map cut short"], tmp_path)
    with pytest.raises(MapFileError, match=r"m\.map: expected 3 rows"):
        read_movingai_map(tmp_path / "m.map")
    write(CASES["g2o edge cut short"], tmp_path)
    with pytest.raises(ScenarioError, match=r"past\.g2o:13: EDGE_SE2"):
        read_g2o(tmp_path / "past.g2o")


def test_option_error_is_what_callers_of_either_kind_catch():
    assert issubclass(OptionError, InvalidInputError)
    assert issubclass(OptionError, UnknownNameError)


@pytest.mark.parametrize(
    ("call", "whose"),
    [
        (lambda mission, seed: find_planner("aia").plan(mission, seed), "planner 'aia'"),
        (lambda mission, seed: find_planner("greedy").plan(mission, seed), "planner 'greedy'"),
        (
            lambda mission, seed: find_planner("distributed_aia").plan(mission, seed),
            "planner 'distributed_aia'",
        ),
        (
            lambda mission, seed: find_planner("intermittent").plan(mission, seed),
            "planner 'intermittent'",
        ),
        (
            lambda mission, seed: find_planner("impacted_paths").plan(mission, seed),
            "candidate paths",
        ),
        (lambda mission, seed: find_planner("exhaustive").plan(mission, seed), "candidate paths"),
        (lambda mission, seed: candidate_sets(mission, generator=seed), "candidate paths"),
        (
            lambda mission, seed: simulate(
                World(robots=(WorldRobot(name="ann", pose=np.zeros(3)),)), {}, seed
            ),
            "simulation",
        ),
        (
            lambda mission, seed: InProcessTransport(("ann", "bob"), None, seed),
            "in-process transport",
        ),
        (
            lambda mission, seed: CommunicationGraph.random_connected(("ann", "bob"), 1.0, seed),
            "communication graph",
        ),
    ],
)
def test_a_seed_in_place_of_a_generator_is_refused(call, whose):
    with pytest.raises(InvalidInputError) as refused:
        call(load_mission(EXAMPLE), 7)
    assert str(refused.value) == (
        f"{whose}: generator: expected a numpy.random.Generator, got 7; pass "
        "numpy.random.default_rng(7)"
    )
