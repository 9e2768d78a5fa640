"""The command line: exit status, result files, messages."""

import argparse
import io
import json
from pathlib import Path

import pytest

from fgplan.cli import execution, main
from fgplan.cli.command_registry import REGISTRY, RegisteredCommand
from fgplan.cli.progress import TerminalProgress
from fgplan.errors import NoCandidatePathError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import read_result, require_at_least

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "scenarios" / "two_robots.toml"
HERE = f"{Path(__file__).stem}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robots", type=int, default=2)


def count(options: CommandOptions) -> CommandOutcome:
    options.record({"part": 1})
    options.progress(1, 2, "counting")
    return CommandOutcome(
        results={"robots": options.arguments["robots"], "quick": options.quick},
        requirements=(require_at_least("robots", options.arguments["robots"], 3),),
        seeds=options.seed_range(4),
        summary=("counted",),
    )


def interrupted(options: CommandOptions) -> CommandOutcome:
    options.record({"part": 1})
    raise KeyboardInterrupt


def without_plan(options: CommandOptions) -> CommandOutcome:
    raise NoCandidatePathError("robot 'ann': goal\ncannot be reached")


def infeasible(options: CommandOptions) -> CommandOutcome:
    return CommandOutcome(results={}, infeasible="every meeting is too late")


@pytest.fixture
def bench(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    for name in ("count", "interrupted", "without_plan", "infeasible"):
        monkeypatch.setitem(REGISTRY["bench"], name, RegisteredCommand(f"{HERE}:{name}", name))
    return tmp_path


def test_command_writes_results_and_ends_with_zero(bench, capsys):
    assert main(["bench", "count", "--robots", "4", "--quick", "--seeds", "2"]) == 0
    result = read_result(bench / "runs" / "bench-count" / "result.json")
    assert result.results == {"robots": 4, "quick": True}
    assert result.command == "fgplan bench count --robots 4 --quick --seeds 2"
    assert result.seeds == (0, 1)
    assert result.complete
    shown = capsys.readouterr()
    assert shown.out.splitlines()[:2] == ["counted", "met: robots = 4, required at least 3"]
    assert shown.err == ""


def test_unmet_requirement_fails_only_with_check(bench, capsys):
    assert main(["bench", "count", "--out", "here"]) == 0
    assert main(["bench", "count", "--out", "here", "--check", "--json", "deep/own.json"]) == 1
    assert "NOT MET: robots = 2, required at least 3" in capsys.readouterr().out
    assert json.loads(Path("deep/own.json").read_text())["requirements"][0]["met"] is False


def test_interruption_leaves_what_was_done(bench, capsys):
    assert main(["bench", "interrupted", "--out", "here"]) == 130
    result = read_result("here/result.json")
    assert result.results == {"part": 1}
    assert not result.complete
    assert capsys.readouterr().err == "fgplan: interrupted\n"


@pytest.mark.parametrize(
    ("name", "words"),
    [("without_plan", "robot 'ann': goal cannot be reached"), ("infeasible", "too late")],
)
def test_no_feasible_plan_ends_with_one_and_the_reason(bench, capsys, name, words):
    assert main(["bench", name]) == 1
    error = capsys.readouterr().err
    assert error.startswith("fgplan: no feasible plan: ")
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "absent.toml"], "readable scenario file"),
        (["plot", "."], "run folder that fgplan run or fgplan demo wrote"),
        (["bench", "count", "--out", "file/deep"], "expected a folder to write to"),
    ],
)
def test_bad_input_ends_with_two_and_one_line(bench, capsys, words, message):
    Path("file").write_text("")
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("fgplan: error: ")
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "expected a command"),
        (["fly"], "invalid choice: 'fly'"),
        (["bench", "count", "--seeds", "0"], "whole number, 1 or more, got '0'"),
        (["bench", "count", "--first-seed", "-1"], "whole number, 0 or more, got '-1'"),
        (["bench", "count", "--colour"], "unrecognized arguments: --colour"),
        (["bench", "nothing"], "invalid choice: 'nothing'"),
        (["run"], "SCENARIO"),
    ],
)
def test_wrong_words_end_with_two_and_one_line(bench, capsys, words, message):
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_help_of_a_command_shows_its_own_arguments(bench, capsys):
    with pytest.raises(SystemExit) as end:
        main(["bench", "count", "--help"])
    assert end.value.code == 0
    assert "--robots" in capsys.readouterr().out


def test_version_is_shown(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out.startswith("fgplan ")


def test_a_bug_keeps_its_traceback(bench, monkeypatch):
    def broken(options):
        raise ZeroDivisionError

    monkeypatch.setattr(execution, "_find_function", lambda arguments: (broken, "count"))
    with pytest.raises(ZeroDivisionError):
        main(["bench", "count"])


@pytest.mark.parametrize(
    ("verb", "name"), [(verb, name) for verb, group in REGISTRY.items() for name in group]
)
def test_registered_command_exists_and_explains_itself(verb, name, capsys):
    module, _, function = REGISTRY[verb][name].target.partition(":")
    assert callable(getattr(__import__(module, fromlist=[function]), function))
    with pytest.raises(SystemExit) as end:
        main([verb, name, "--help"])
    assert end.value.code == 0
    assert "--check" in capsys.readouterr().out


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_progress_shows_on_a_terminal_and_clears_its_line():
    stream = Terminal()
    progress = TerminalProgress(stream)
    progress(1, 10, "evaluating")
    progress(2, 10, "evaluating")  # within a tenth of a second: not shown
    progress(10, 10, "evaluating")
    progress.close()
    assert stream.getvalue().split("\r") == [
        "",
        "evaluating 1/10",
        "evaluating 10/10",
        " " * 16,
        "",
    ]


def test_progress_keeps_to_one_line(monkeypatch):
    monkeypatch.setenv("COLUMNS", "12")
    stream = Terminal()
    TerminalProgress(stream)(3, 10, "many robots at work")
    assert stream.getvalue() == "\rmany robots"


def test_progress_is_silent_in_a_pipe():
    stream = io.StringIO()
    progress = TerminalProgress(stream)
    progress(1, 1, "evaluating")
    progress.close()
    assert stream.getvalue() == ""
