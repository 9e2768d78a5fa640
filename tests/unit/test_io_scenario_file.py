"""Scenario files: what is read, and what every refusal says."""

import tomllib
from pathlib import Path

import pytest
import yaml

from fgplan.errors import MissingExtraError, ScenarioError
from fgplan.io.scenario_file import landmark_name, read_scenario

BASE = """
schema = 1
[world]
bounds = [[0, 0], [10, 10]]
[sensors.sonar]
kind = "range"
sigma_m = 0.1
[[robots]]
name = "ann"
start = [1, 1, 0]
start_sigmas = [0.1, 0.1, 0.01]
goal = [9, 9]
motion = { sigmas = [0.1, 0.1, 0.01] }
[[robots]]
name = "bob"
start = [1, 9, 0]
start_sigmas = [0.1, 0.1, 0.01]
goal = [9, 1]
motion = { sigmas = [0.1, 0.1, 0.01] }
sensors = ["sonar"]
[[landmarks]]
position = [5, 5]
sigma_m = 0.5
[planner]
name = "impacted_paths"
[planner.impacted_paths]
candidates = 7
"""


def write(folder: Path, text: str, name: str = "team.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def edited(old: str, new: str) -> str:
    assert old in BASE
    return BASE.replace(old, new, 1)


def test_scenario_is_read_with_its_defaults(tmp_path):
    scenario = read_scenario(write(tmp_path, BASE))
    assert [robot.name for robot in scenario.robots] == ["ann", "bob"]
    assert scenario.robots[1].goal == (9.0, 1.0)
    assert scenario.planner_name == "impacted_paths"
    assert scenario.planner_options == {"candidates": 7}
    assert scenario.team.order is None
    assert scenario.seed == 0
    assert landmark_name(scenario, 0) == "l0"


def test_yaml_gives_the_same_scenario(tmp_path):
    text = yaml.safe_dump(tomllib.loads(BASE))
    from_yaml = read_scenario(write(tmp_path, text, "team.yaml"))
    assert from_yaml == read_scenario(write(tmp_path, BASE))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            edited("goal = [9, 9]\n", "goal = [9]\n"),
            ["length >= 2", "got [9]", "$.robots[0].goal", "robot 'ann'"],
        ),
        (
            edited("goal = [9, 1]\n", 'goal = "east"\n'),
            ["Expected `array`", "'east'", "$.robots[1].goal", "'bob'"],
        ),
        (
            edited("start_sigmas = [0.1, 0.1, 0.01]", "start_sigmas = [0.1, 0, 0.01]"),
            ["> 0.0", "got 0", "$.robots[0].start_sigmas[1]"],
        ),
        (
            edited("sigma_m = 0.5", "sigma_m = -1.0"),
            ["> 0.0", "got -1.0", "$.landmarks[0].sigma_m"],
        ),
        (edited("sigma_m = 0.5", "sigma_m = nan"), ["finite", "got nan", "$.landmarks[0].sigma_m"]),
        (
            edited("start = [1, 1, 0]", "start = [1, inf, 0]"),
            ["finite", "got inf", "$.robots[0].start[1]"],
        ),
        (edited("schema = 1", "schema = 2"), ["expected 1, got 2 - at `$.schema`"]),
        (
            edited("schema = 1\n", "\n"),
            ["missing required field `schema`; it has", "; write schema = 1 - at `$`"],
        ),
        (
            edited("[planner]", "[objective]\npreset = 'length_and_uncertanty'\n[planner]"),
            [
                "toml: expected 'length_and_uncertainty', got 'length_and_uncertanty'; did you "
                "mean 'length_and_uncertainty'? - at `$.objective.preset`"
            ],
        ),
        (
            edited("[planner]", "[team]\norder = 'sorted'\n[planner]"),
            ["toml: expected one of 'fixed', 'random', got 'sorted' - at `$.team.order`"],
        ),
        (
            edited("[planner]", "[[objective.terms]]\nkind = 'path_lenght'\n[planner]"),
            [
                "toml: expected one of 'path', 'path_length', 'travel_time', 'uncertainty', got "
                "'path_lenght'; did you mean 'path_length'? - at `$.objective.terms[0].kind`"
            ],
        ),
        (
            edited("[planner]", "[[objective.terms]]\nweight = 1.0\n[planner]"),
            ["it has weight; kind is one of 'path', 'path_length', 'travel_time', 'uncertainty'"],
        ),
        (
            edited(
                "[planner]",
                "[[objective.terms]]\nkind = 'uncertainty'\nlandmarks = 'al'\n[planner]",
            ),
            ["expected 'all' or a list, got 'al'; did you mean 'all'? - at"],
        ),
        (
            edited("[planner]", "[prior]\nkind = 'g2'\n[planner]"),
            ["expected one of 'g2o', ", ", got 'g2'; did you mean 'g2o'? - at `$.prior.kind`"],
        ),
        (
            edited("[planner]", "[prior]\nfile = 'a.g2o'\n[planner]"),
            [
                "missing required field `kind`; it has file; kind is one of 'g2o', 'independent', "
                "'mrclam', 'pyfg', 'python', 'tum' - at `$.prior`"
            ],
        ),
        (edited("[world]\n", "[world]\ncolour = 3\n"), ["unknown field `colour`", "$.world"]),
        (edited('name = "bob"', 'name = "ann"'), ["unique", "'ann'", "$.robots[1].name"]),
        (
            edited('sensors = ["sonar"]', 'sensors = ["radar"]'),
            ["sonar", "'radar'", "$.robots[1].sensors"],
        ),
        (
            edited('name = "impacted_paths"', ""),
            ["name of a planner", "got nothing", "$.planner.name"],
        ),
        (
            edited("[planner.impacted_paths]\ncandidates = 7", "candidates = 7"),
            ["table of options", "[planner.impacted_paths]", "$.planner.candidates"],
        ),
        (edited("[planner]", "[prior]\nkind = 'gps'\n[planner]"), ["gps", "$.prior"]),
        ("schema = =", ["expected TOML", "line 1"]),
    ],
)
def test_refusal_names_file_field_expectation_and_what_came(tmp_path, text, words):
    path = write(tmp_path, text)
    with pytest.raises(ScenarioError) as caught:
        read_scenario(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_missing_field_of_yaml_is_written_as_yaml(tmp_path):
    text = yaml.safe_dump(tomllib.loads(edited("schema = 1\n", "\n")))
    with pytest.raises(ScenarioError, match="; write schema: 1 - at"):
        read_scenario(write(tmp_path, text, "team.yaml"))


def test_yaml_number_trap_is_explained(tmp_path):
    text = yaml.safe_dump(tomllib.loads(BASE)).replace("sigma_m: 0.5", "sigma_m: 5e-1")
    with pytest.raises(ScenarioError, match=r"'5e-1' \(YAML reads 1e-3 as text"):
        read_scenario(write(tmp_path, text, "team.yml"))


def test_yaml_syntax_is_checked(tmp_path):
    with pytest.raises(ScenarioError, match="expected YAML"):
        read_scenario(write(tmp_path, "world: [", "team.yaml"))


def test_yaml_without_pyyaml_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "yaml", None)
    with pytest.raises(MissingExtraError, match=r"fgplan\[yaml\]"):
        read_scenario(write(tmp_path, "{}", "team.yaml"))


def test_other_file_names_are_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"\.toml, \.yaml or \.yml, got '\.json'"):
        read_scenario(write(tmp_path, "{}", "team.json"))


def test_missing_file_is_named(tmp_path):
    with pytest.raises(ScenarioError, match=r"readable scenario file.*absent\.toml"):
        read_scenario(tmp_path / "absent.toml")


def test_a_scenario_that_is_no_table_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match="Expected `object`"):
        read_scenario(write(tmp_path, "- 1\n", "team.yaml"))
