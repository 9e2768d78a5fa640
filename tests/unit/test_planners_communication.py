"""A scenario whose network is faulty plans the same paths, only later."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from fgplan.errors import InvalidInputError, OptionError, UnknownNameError
from fgplan.io.mission_file import load_mission
from fgplan.io.scenario_file import read_scenario
from fgplan.planners.impacted_paths.options import ImpactedPathsOptions, read_options
from fgplan.planners.plan import plan_of
from fgplan.planners.registry import find_planner
from fgplan.team.in_process import NetworkFaults, Partition, read_faults

EXAMPLE = Path(__file__).parents[2] / "examples" / "scenarios" / "two_robots.toml"
TEXT = EXAMPLE.read_text(encoding="utf-8").replace("candidates = 10", "candidates = 6")
FAULTS = """
[team.communication]
loss = 0.3
duplication = 0.2
reordering = 0.5
delay_s = [0.05, 0.4]

[[team.communication.partitions]]
start_s = 0.0
end_s = 3.0
groups = [["ann"], ["bob"]]

"""


def plan_text(folder: Path, text: str):
    path = folder / "team.toml"
    path.write_text(text, encoding="utf-8")
    mission = load_mission(path)
    planner = find_planner(read_scenario(path).planner_name)
    return planner.plan(mission, np.random.default_rng(mission.seed))


@pytest.mark.parametrize("order", ["fixed", "random"])
def test_faulty_network_gives_the_same_paths(tmp_path, order):
    text = TEXT.replace("[[team.multi", f'[team]\norder = "{order}"\n[[team.multi', 1)
    plain = plan_text(tmp_path, text)
    faulty = plan_text(tmp_path, text.replace("[[team.multi", FAULTS + "[[team.multi", 1))
    assert plain.agreed
    assert faulty.agreed
    assert faulty.objective == plain.objective
    for one, other in zip(faulty.robots, plain.robots, strict=True):
        assert one.candidate == other.candidate
        np.testing.assert_array_equal(one.path.poses, other.path.poses)
        np.testing.assert_array_equal(one.covariances, other.covariances)
    # the faults were there: copies were lost, and nobody agreed before the partition healed
    assert sum(counts["lost"] for counts in plain.traffic.values()) == 0
    assert sum(counts["lost"] for counts in faulty.traffic.values()) > 0
    assert plain.details["clock_s"] == 0.0
    assert faulty.details["clock_s"] > 3.0
    assert faulty.options["communication"]["loss"] == 0.3
    assert plan_of(faulty.to_data()).options == faulty.options


def test_exhaustive_lets_the_team_agree_over_the_same_network(tmp_path):
    text = TEXT.replace("impacted_paths", "exhaustive").replace("candidates = 6", "candidates = 3")
    plain = plan_text(tmp_path, text)
    faulty = plan_text(tmp_path, text.replace("[[team.multi", FAULTS + "[[team.multi", 1))
    assert faulty.details["agreed"] == plain.details["agreed"]
    assert sum(counts["lost"] for counts in faulty.traffic.values()) > 0


def test_same_seed_gives_the_same_faults(tmp_path):
    text = TEXT.replace("[[team.multi", FAULTS + "[[team.multi", 1)
    first, second = plan_text(tmp_path, text), plan_text(tmp_path, text)
    assert first.traffic == second.traffic
    assert first.details["clock_s"] == second.details["clock_s"]


def test_options_take_faults_or_their_fields():
    faults = NetworkFaults(loss=0.1, partitions=(Partition(0.0, 1.0, (("ann",), ("bob",))),))
    fields = {
        "loss": 0.1,
        "partitions": [{"start_s": 0.0, "end_s": 1.0, "groups": [["ann"], ["bob"]]}],
    }
    assert read_faults(fields) == faults
    assert ImpactedPathsOptions(communication=fields).communication == faults
    assert ImpactedPathsOptions(communication=faults).communication is faults
    assert ImpactedPathsOptions().communication is None


@pytest.mark.parametrize(
    ("given", "kind", "words"),
    [
        ({"noise": 0.1}, UnknownNameError, "network faults noise: expected one of delay_s, dup"),
        ({"loss": 1.0}, InvalidInputError, "network faults loss: expected a probability below"),
        ({"loss": "much"}, InvalidInputError, "network faults loss: .* got 'much'"),
        ({"delay_s": [1.0]}, InvalidInputError, r"delay_s: expected shape \(2\)"),
        ({"delay_s": [0.2, 0.1]}, InvalidInputError, "delay_s: expected shortest and longest"),
        ({"partitions": [3]}, InvalidInputError, "network partition 0: expected a table, got 3"),
        ({"partitions": [{"end_s": 1}]}, InvalidInputError, "partition 0: expected groups, got no"),
        (
            {"partitions": [{"start_s": 1, "end_s": 1, "groups": []}]},
            InvalidInputError,
            "network partition end_s: expected later than start_s = 1, got 1",
        ),
        ({"partitions": [{"since": 1}]}, UnknownNameError, "partition 0 since: expected one of"),
    ],
)
def test_faults_that_cannot_be_are_refused_by_field(given, kind, words):
    with pytest.raises(kind, match=words):
        read_faults(given)
    with pytest.raises(OptionError, match=words):
        read_options(ImpactedPathsOptions, {"communication": given}, "impacted_paths")


def test_stranger_in_a_partition_is_named():
    mission = load_mission(EXAMPLE)
    partition = {"start_s": 0, "end_s": 1, "groups": [["ann"], ["eve"]]}
    options = {**mission.options, "communication": {"partitions": [partition]}}
    changed = dataclasses.replace(mission, options=options)
    with pytest.raises(UnknownNameError, match="partition: robot 'eve' is not one of ann, bob"):
        find_planner("impacted_paths").plan(changed, np.random.default_rng(1))
