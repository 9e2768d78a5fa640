"""The reference of scenario files: complete, as the page in docs, as the planners check."""

import dataclasses
import inspect
import math
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import yaml

from fgplan.cli import main
from fgplan.errors import OptionError
from fgplan.evaluation.objective import UncertaintyTerm, length_and_uncertainty
from fgplan.io.field_words import FieldWords, describe_fields, summary_of, type_words
from fgplan.io.mission_file import load_mission
from fgplan.io.scenario import ObjectiveTable, Scenario, TermTable
from fgplan.io.scenario_fields import scenario_fields
from fgplan.io.table import KeyName, Matrix, Polygon, Positive, Probability
from fgplan.io.table_fields import table_fields
from fgplan.planners.option_tables import option_tables
from fgplan.planners.registry import PLANNERS, find_planner

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "scenarios"
EXAMPLES = sorted(path for path in FOLDER.iterdir() if path.suffix in (".toml", ".yaml"))
PAGE = ROOT / "docs" / "scenarios.md"


def fields_of_the_page():
    """Fields by heading, read from the page as a reader sees it."""
    found, heading = {}, ""
    for line in PAGE.read_text("utf-8").splitlines():
        if line.startswith("## "):
            heading = line[3:].strip("`")
            found[heading] = []
        elif line.startswith("| `"):
            found[heading].append(line.split("`")[1])
    return found


def test_the_page_is_what_the_command_writes(capsys):
    assert main(["fields", "--markdown"]) == 0
    said = capsys.readouterr().out
    assert PAGE.read_text("utf-8") == said, "run: fgplan fields --markdown > docs/scenarios.md"


def test_every_field_says_what_it_means_and_what_it_holds():
    for table in scenario_fields():
        assert table.summary, table.heading
        names = [one.name for one in table.fields]
        assert len(names) == len(set(names)), table.heading
        for one in table.fields:
            assert one.type, one
            assert one.default, one
            assert one.meaning.endswith((".", "?")), f"{table.heading} {one.name}"


def tables_of(raw, place="$", name=""):
    """Place for msgspec, name on the page and content of every table of a scenario's raw text."""
    if isinstance(raw, list):
        for index, item in enumerate(raw):
            yield from tables_of(item, f"{place}[{index}]", name)
    if isinstance(raw, dict):
        yield place, name, raw
        for key, value in raw.items():
            inner = f"{name}.{key}" if name else key
            yield from tables_of(
                value, f"{place}.{key}", re.sub(r"^sensors\.\w+", "sensors.NAME", inner)
            )


BY_NAME = ("sensors", "prior.start_keys")
"""Tables whose fields are names of the user's own."""


@pytest.mark.parametrize("path", EXAMPLES, ids=[path.name for path in EXAMPLES])
def test_every_field_of_an_example_is_on_the_page(path):
    text = path.read_text("utf-8")
    raw = tomllib.loads(text) if path.suffix == ".toml" else yaml.safe_load(text)
    page = fields_of_the_page()
    for place, name, table in tables_of(raw):
        if name in BY_NAME or ":" in name:
            continue
        kind = table.get("kind")
        named = (f"[{name}]", f"[[{name}]]", f'[{name}] kind = "{kind}"')
        headings = [
            heading
            for heading in page
            if (not name and heading == "The file")
            or any(one in named for one in heading.split(", "))
        ]
        assert len(headings) == 1, f"{place}: {headings}"
        known = set(page[headings[0]])
        if name == "planner":
            known |= {*PLANNERS, *(key for key in table if ":" in key)}
        assert set(table) <= known, place
        checked = table_fields(Scenario, raw, place)
        if checked:
            assert set(checked) == known, f"{place}: the page says what is checked, no more"


def test_what_sentences_say_of_defaults_is_so():
    terms, preset = describe_fields(TermTable), describe_fields(ObjectiveTable)
    said = {one.name: one.meaning for one in (*preset, *terms)}
    for name in ("function", "block", "read"):
        (default,) = [f.default for f in dataclasses.fields(UncertaintyTerm) if f.name == name]
        assert f'"{default}" if left out' in said[name]
    for name in ("path_weight", "uncertainty_weight"):
        default = inspect.signature(length_and_uncertainty).parameters[name].default
        assert f"; {default:g} if left out" in said[name]


def refusal(name, options):
    """What a planner says to options of which it refuses one."""
    gathers = name not in ("impacted_paths", "exhaustive")
    path = FOLDER / ("information_gathering.toml" if gathers else "two_robots.toml")
    with pytest.raises(OptionError) as caught:
        find_planner(name).plan(
            replace(load_mission(path), options=options), np.random.default_rng(0)
        )
    return str(caught.value)


def fields_of(name):
    """Fields that the page lists for a planner."""
    page = fields_of_the_page()
    (heading,) = [one for one in page if f"[planner.{name}]" in one.split(", ")]
    return page[heading]


@pytest.mark.parametrize("name", PLANNERS)
def test_a_planner_takes_what_the_page_lists_and_nothing_else(name):
    listed = refusal(name, {"no_such_option": 1}).partition("expected one of ")[2]
    assert listed.split(", ") == fields_of(name)


WRONG = {
    "impacted_paths": ({"candidates": 0},),
    "exhaustive": ({"candidates": 0},),
    "aia": ({"step_m": 0}, {"p_group": 2}),
    "distributed_aia": ({"step_m": 0}, {"p_group": 2}, {"wait_s": 0}),
    "greedy": ({"step_m": 0}, {"nodes": 0}),
    "biased_greedy": ({"step_m": 0}, {"nodes": 0}),
    "fvi": ({"step_m": 0}, {"nodes": 0}),
    "rig_tree": ({"step_m": 0}, {"nodes": 0}),
    "dec_mcts": ({"step_m": 0}, {"nodes": 0}),
    "intermittent": ({"every": 0}, {"samples": 0}),
}
"""A value that is refused of each dataclass of options, once all its fields are taken."""
GIVEN = {"of_robot": {}, "graph": {"kind": "complete"}, "communication": {}}
DENSITIES = ("f_group", "f_control", "least_group", "least_control")


@pytest.mark.parametrize("name", PLANNERS)
def test_a_planner_takes_every_option_that_the_page_lists(name):
    values = {}
    for table in option_tables(find_planner(name)):
        for option in dataclasses.fields(table):
            if option.name not in DENSITIES:
                value = 1 if option.default is None else option.default
                values[option.name] = GIVEN.get(option.name, value)
    assert [one for one in fields_of(name) if one not in DENSITIES] == list(values)
    for wrong in WRONG[name]:
        assert f"option {next(iter(wrong))}: expected" in refusal(name, {**values, **wrong})


def test_densities_are_among_the_options_of_aia():
    assert set(DENSITIES) <= set(fields_of("aia"))
    own = {"f_group": "math:floor", "f_control": "math:floor", "least_control": 0.1}
    assert "option least_group: expected" in refusal("aia", {**own, "least_group": "a"})


def test_fields_of_one_planner_and_of_one_that_says_nothing(capsys, monkeypatch):
    assert main(["fields", "exhaustive"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("[planner.exhaustive]\n")
    assert "  combinations: whole number; default 20000\n      Most combinations" in said
    assert "[planner.aia]" not in said
    assert max(len(line) for line in said.splitlines()) <= 100
    monkeypatch.chdir(FOLDER)
    assert main(["fields", "greedy_planner:GreedyPlanner"]) == 0
    assert "  candidates: whole number; default 50\n" in capsys.readouterr().out
    monkeypatch.chdir(Path(__file__).parent)
    assert main(["fields", f"{Path(__file__).stem}:Silent"]) == 0
    assert "It does not say which it takes" in capsys.readouterr().out


def test_fields_of_an_unknown_planner_end_in_one_line(capsys):
    assert main(["fields", "aja"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "aja" in said
    assert "distributed_aia" in said
    assert main(["fields", "no_module:Planner"]) == 2
    assert "expected an importable module, got 'no_module'" in capsys.readouterr().err


def test_a_reader_who_has_seen_enough_ends_the_command():
    child = subprocess.Popen(
        [sys.executable, "-m", "fgplan", "fields"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert child.stdout is not None
    child.stdout.close()
    assert child.stderr is not None
    with child.stderr:
        assert child.stderr.read() == b""
    assert child.wait() == 0


class Silent:
    """A planner without ``option_tables``."""

    name = "silent"

    def plan(self, mission, generator, progress=None):
        raise NotImplementedError


@pytest.mark.parametrize(
    ("hint", "words"),
    [
        (Positive, "number above 0"),
        (Probability, "number from 0 to below 1"),
        (KeyName | None, "text or whole number from 0 up"),
        (Matrix, "list of 1 or more lists of numbers"),
        (Polygon, "list of 3 or more [number, number]"),
        (Literal["all"] | tuple[str, ...] | None, '"all" or list of texts'),
        (dict[str, Path], "table of files by name"),
        (dict[str, Any], "table"),
        (Mapping[str, Mapping[str, float]] | None, "table of tables of numbers by name"),
        (bool, "true or false"),
    ],
)
def test_types_in_plain_words(hint, words):
    assert type_words(hint) == words


@dataclass
class Base:
    """Fields that are inherited.

    Attributes:
        far_m: How far, metres;
            and on.
        near_m: How near.
    """

    far_m: float = math.inf
    near_m: float | None = None


@dataclass
class Derived(Base):
    """Some of its own.

    Attributes:
        near_m: How near, metres.
        files: Files.

    Raises:
        ValueError: Never.
    """

    files: tuple[str, ...] = field(default_factory=lambda: ("a", "b"))


def test_fields_of_a_dataclass_with_those_it_inherits():
    assert describe_fields(Derived) == (
        FieldWords("far_m", "number", "no limit", "How far, metres; and on."),
        FieldWords("near_m", "number", "none", "How near, metres."),
        FieldWords("files", "list of texts", '["a", "b"]', "Files."),
    )
    assert summary_of(Derived) == "Some of its own."
