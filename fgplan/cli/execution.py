"""Running one command: options, result file, summary, exit status.

``run``, ``demo``, ``bench`` and ``reproduce`` are the same thing here: a function of
``CommandOptions`` to a ``CommandOutcome``. Results so far are on disk whenever it records them.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fgplan.cli.command_registry import REGISTRY
from fgplan.cli.progress import TerminalProgress
from fgplan.errors import FgplanError, InvalidInputError, NoCandidatePathError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.result_file import ResultFile, write_result
from roadmaps import NoCandidatePathError as NoRoadmapPathError
from roadmaps import RoadmapError, UnreachableError

DONE, NOT_MET, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

_SHARED = ("verb", "name", "out", "json", "seeds", "first_seed", "quick", "check")


def execute(arguments: argparse.Namespace, words: Sequence[str]) -> int:
    """Run the command that was asked for.

    Args:
        arguments: Parsed arguments.
        words: The words they were parsed from, for the record.

    Returns:
        Exit status.
    """
    progress = TerminalProgress()
    try:
        if arguments.verb == "plot":
            from fgplan.cli.run_figures import draw_run_figures

            return _print_lines(
                f"wrote {path}" for path in draw_run_figures(Path(arguments.folder))
            )
        if arguments.verb == "check":
            from fgplan.cli.check_command import check_scenario

            return _print_lines(check_scenario(Path(arguments.scenario)))
        if arguments.verb == "fields":
            from fgplan.cli.fields_command import show_fields

            return _print_lines(show_fields(arguments.planner, markdown=arguments.markdown))
        if arguments.verb == "robot":
            from fgplan.cli.robot_command import run_robot_command

            lines, finished = run_robot_command(arguments, progress)
            progress.close()
            _print_lines(lines)
            return DONE if finished else NOT_MET
        return _execute_work(arguments, words, progress)
    except (NoCandidatePathError, UnreachableError, NoRoadmapPathError) as error:
        return _fail(progress, f"fgplan: no feasible plan: {error}", NOT_MET)
    except (FgplanError, RoadmapError) as error:
        return _fail(progress, f"fgplan: error: {error}", BAD_INPUT)
    except KeyboardInterrupt:
        return _fail(progress, "fgplan: interrupted", INTERRUPTED)
    finally:
        progress.close()


def _execute_work(
    arguments: argparse.Namespace, words: Sequence[str], progress: TerminalProgress
) -> int:
    """Run a function of the contract and write, print and judge what it returns."""
    function, name = _find_function(arguments)
    folder, made = _make_folder(arguments, name)
    files = [folder / "result.json"]
    if arguments.json is not None:
        files.append(Path(arguments.json))
    command = " ".join(["fgplan", *words])
    so_far: list[ResultFile] = []

    def record(results: Mapping[str, Any]) -> None:
        so_far[:] = [ResultFile(command=command, results=results, complete=False)]
        _write(files, so_far[0])

    # run and team check their scenario first: bad input changes no run folder
    if arguments.verb not in ("run", "team"):
        record({})
    options = CommandOptions(
        name=name,
        out=folder,
        seeds=getattr(arguments, "seeds", None),
        first_seed=getattr(arguments, "first_seed", None),
        quick=arguments.quick,
        arguments={k: v for k, v in vars(arguments).items() if k not in _SHARED},
        progress=progress,
        record=record,
    )
    try:
        outcome = function(options)
    except BaseException as error:
        if so_far:
            _write(files, replace(so_far[0], stopped=_reason(error)))
        elif made and not any(folder.iterdir()):  # refused before anything was done
            folder.rmdir()
        raise
    progress.close()
    result = ResultFile(
        command=command,
        seeds=outcome.seeds,
        results=outcome.results,
        requirements=outcome.requirements,
    )
    _write(files, result)
    _print_lines(_report(outcome, files))
    if outcome.infeasible is not None:
        return _fail(progress, f"fgplan: no feasible plan: {outcome.infeasible}", NOT_MET)
    return NOT_MET if arguments.check and result.unmet else DONE


def _find_function(
    arguments: argparse.Namespace,
) -> tuple[Callable[[CommandOptions], CommandOutcome], str]:
    """The function behind the command, and the command's name."""
    if arguments.verb == "run":
        from fgplan.cli.run_command import run_scenario

        return run_scenario, Path(arguments.scenario).stem
    if arguments.verb == "team":
        from fgplan.cli.team_command import run_team

        return run_team, Path(arguments.scenario).stem
    module, _, function = REGISTRY[arguments.verb][arguments.name].target.partition(":")
    return getattr(importlib.import_module(module), function), arguments.name


def _make_folder(arguments: argparse.Namespace, name: str) -> tuple[Path, bool]:
    """The run folder, and whether it was made here."""
    folder = Path(arguments.out or Path("runs") / f"{arguments.verb}-{name}")
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInputError(
            f"--out {folder}: expected a folder to write to: {error}"
        ) from error
    return folder, made


def _reason(error: BaseException) -> str:
    """Why work ended, in one line."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    return " ".join(f"{type(error).__name__}: {error}".split())


def _write(files: Sequence[Path], result: ResultFile) -> None:
    """Write the same result to every file asked for."""
    for file in files:
        write_result(file, result)


def _report(outcome: CommandOutcome, files: Sequence[Path]) -> list[str]:
    """Lines to print: the summary, requirements, files."""
    lines = list(outcome.summary)
    for requirement in outcome.requirements:
        verdict = "met" if requirement.met else "NOT MET"
        value = requirement.value
        shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        lines.append(f"{verdict}: {requirement.name} = {shown}, required {requirement.required}")
    return lines + [f"wrote {path}" for path in (*outcome.figures, *files)]


def _print_lines(lines: Sequence[str] | Any) -> int:  # noqa: ANN401 - any iterable of lines
    """Print to standard output; one that is closed, as by ``head``, has seen enough."""
    try:
        for line in lines:
            sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
    except BrokenPipeError:
        # Python flushes once more when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return DONE


def _fail(progress: TerminalProgress, message: str, status: int) -> int:
    """One line on standard error."""
    progress.close()
    sys.stderr.write(" ".join(message.split()) + "\n")
    return status
