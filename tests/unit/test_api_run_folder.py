"""What a run leaves: a folder that runs again, a summary that fits the planner."""

import subprocess
import sys
from pathlib import Path

import pytest

from fgplan.cli import main
from fgplan.cli.run_command import summary_lines
from fgplan.io.named_files import named_files
from fgplan.io.run_folder import begin_run
from fgplan.io.scenario_file import read_scenario
from fgplan.planners.plan import ObjectiveValue, Plan

ROOT = Path(__file__).parents[2]
SCENARIOS = ROOT / "examples" / "scenarios"


def test_command_runs_as_a_module():
    done = subprocess.run(
        [sys.executable, "-m", "fgplan", "--version"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("fgplan ")


@pytest.mark.parametrize(
    ("scenario", "named"),
    [
        ("own_planner.toml", ["greedy_planner.py"]),
        ("rooms.toml", ["room-32-32-4.map"]),
        ("shared_past.yaml", ["shared_past.g2o"]),
        ("two_robots.toml", []),
    ],
)
def test_files_that_a_scenario_names_are_found(scenario, named):
    path = SCENARIOS / scenario
    assert [str(name) for name in named_files(read_scenario(path), path)] == named


def test_modules_maps_and_their_images_are_copied_and_nothing_from_elsewhere(tmp_path):
    home, out = tmp_path / "home", tmp_path / "out"
    for folder in (home / "own" / "parts", home / "maps", home / "fgplan", out):
        folder.mkdir(parents=True)
    for name in ("own/__init__.py", "own/parts/sonar.py", "fgplan/__init__.py", "maps/hall.pgm"):
        (home / name).write_text("")
    (home / "maps" / "hall.yaml").write_text("image: hall.pgm\nresolution: 0.1\n")
    (tmp_path / "outside.g2o").write_text("")
    text = (SCENARIOS / "two_robots.toml").read_text()
    text = text.replace("bounds =", 'map = "maps/hall.yaml"\nbounds =', 1)
    text = text.replace("impacted_paths", "fgplan.planners.impacted_paths.planner:P", 1)
    text = text.replace("[planner.impacted_paths]", "[planner.other]")
    text += '\nevaluator = "own.parts.sonar:E"\nfile = "../outside.g2o"\nold = "absent:E"\n'
    (home / "team.toml").write_text(text)
    found = named_files(read_scenario(home / "team.toml"), home / "team.toml")
    names = ["maps/hall.pgm", "maps/hall.yaml", "own/__init__.py", "own/parts/sonar.py"]
    assert [name.as_posix() for name in found] == names
    begin_run(home / "team.toml", out, found)
    copied = sorted(p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file())
    assert copied == [*names, "scenario.toml"]
    begin_run(out / "scenario.toml", out, found)  # a run of the copy leaves the copies alone
    assert (out / "maps" / "hall.yaml").read_text().startswith("image")


@pytest.mark.usefixtures("no_pictures")
def test_run_folder_of_an_own_planner_runs_again(tmp_path, monkeypatch, capsys):
    first, second = tmp_path / "first", tmp_path / "second"
    for source, out in ((SCENARIOS / "own_planner.toml", first), (first / "scenario.toml", second)):
        monkeypatch.delitem(sys.modules, "greedy_planner", raising=False)  # as a new process
        assert main(["run", str(source), "--quick", "--out", str(out)]) == 0
        assert Path(sys.modules["greedy_planner"].__file__).parent == source.parent
        said = capsys.readouterr().out.splitlines()
        lines = [line for line in said if line.startswith("objective ")]
        assert len(lines) == 1
        assert "->" not in lines[0]  # it chooses once: one value
    monkeypatch.delitem(sys.modules, "greedy_planner")
    assert (second / "greedy_planner.py").read_bytes() == (
        SCENARIOS / "greedy_planner.py"
    ).read_bytes()


def test_summary_says_one_value_where_nothing_was_announced():
    def line(*values):
        plan = Plan(
            planner="p",
            mission="m",
            scenario_digest="",
            seed=0,
            robots=(),
            objective=tuple(ObjectiveValue(i, "", value) for i, value in enumerate(values)),
        )
        return summary_lines(plan)[1]

    assert line(3.5) == "objective 3.5"
    assert line(3.5, 2.25) == "objective 3.5 -> 2.25 in 1 announcement"
    assert line(3.5, 2.25, 2.0) == "objective 3.5 -> 2 in 2 announcements"


def test_failed_run_of_a_missing_module_copies_nothing(tmp_path, capsys):
    text = (SCENARIOS / "own_planner.toml").read_text()
    (tmp_path / "team.toml").write_text(text.replace("greedy_planner", "no_such_planner"))
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "team.toml"), "--out", str(out)]) == 2
    assert "no_such_planner.py" in capsys.readouterr().err
    assert list(out.rglob("*.*")) == []
