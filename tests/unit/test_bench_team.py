"""``fgplan bench team``: the same result over zenoh, and what the issue asks to be counted."""

import pytest

from fgplan.bench.team import run
from fgplan.errors import InvalidInputError
from fgplan.io.command import CommandOptions


def options(**arguments):
    given = {"robots": "2,4,8", "candidates": 50} | arguments
    return CommandOptions(name="team", quick=True, arguments=given)


def test_two_processes_agree_on_what_one_does():
    outcome = run(options())
    in_process, zenoh = outcome.results["rows"]
    assert (in_process["transport"], zenoh["transport"]) == ("in process", "zenoh")
    for row in (in_process, zenoh):
        assert row["robots"] == 2
        assert row["same_result"] is True
        assert 0.0 < row["planning_seconds"] < row["agreement_seconds"]
    assert zenoh["turns"] == in_process["turns"] > 2
    # Every entry reaches the other robot, as in process (again where one was asked for that was
    # still under way); the rest is status and done.
    entries = [kind for kind in zenoh["by_kind"] if kind in ("announcement", "refusal")]
    assert sum(zenoh["by_kind"][kind]["messages"] for kind in entries) >= in_process["messages"]
    assert zenoh["bytes"] > in_process["bytes"]
    assert zenoh["hop_ms"] > 0.0
    assert zenoh["checking_ms"] > 0.0
    assert all(need.met for need in outcome.requirements)


def test_sizes_that_cannot_be_are_refused():
    for robots in ("1", "two", ""):
        with pytest.raises(InvalidInputError, match="--robots: expected sizes of 2 or more"):
            run(options(robots=robots))
