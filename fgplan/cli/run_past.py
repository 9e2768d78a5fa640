"""``fgplan run LOG``: read a team's past, estimate it, derive a scenario, say what was done.

The run folder gets the derived scenario and a copy of the log in ``past``, so that
``fgplan run RUN/scenario.toml`` plans the same again, with whatever was changed in it.
"""

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fgplan.errors import FgplanError, InvalidInputError, ScenarioError
from fgplan.io.named_files import named_files
from fgplan.io.past_estimate import PastEstimate, estimate_past
from fgplan.io.past_formats import is_log_file, read_team_past
from fgplan.io.past_scenario import DerivedScenario, derive_scenario
from fgplan.io.place import Place
from fgplan.io.run_folder import begin_run
from fgplan.io.scenario import Scenario
from fgplan.io.scenario_file import convert_table
from fgplan.io.scenario_text import scenario_text

COPIED = "past"
"""Folder of a run folder that holds the log."""

_DERIVED = "Derived by fgplan run from a log; see fgplan/io/past_scenario.py."
"""First remark of a derived scenario."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogRun:
    """A log made ready to plan from.

    Attributes:
        estimate: The past and its joint belief.
        derived: The scenario derived from it, as plain tables, and how.
        scenario: The same, checked.
    """

    estimate: PastEstimate
    derived: DerivedScenario
    scenario: Scenario


def open_log_run(path: Path) -> LogRun:
    """Read and estimate a log and derive its scenario.

    Args:
        path: The log, a file or folder.

    Returns:
        What to plan.

    Raises:
        ScenarioError: If the log is wrong or does not determine a belief.
    """
    past = read_team_past(path)
    try:
        estimate = estimate_past(past)
    except FgplanError as error:
        raise ScenarioError(f"{path}: {error}") from error
    derived = derive_scenario(estimate, path.resolve().stem)
    scenario = convert_table(derived.tables, Scenario, Place(path))
    return LogRun(estimate=estimate, derived=derived, scenario=scenario)


def copy_log_run(run: LogRun, folder: Path) -> None:
    """Put derived scenario and log into a run folder; an earlier run's log goes.

    Args:
        run: What is run.
        folder: The run folder.

    Raises:
        InvalidInputError: If it cannot be written, or files that no run wrote are in its way.
    """
    past = run.estimate.past
    in_the_way = _other_copies(past.files, folder)
    with tempfile.TemporaryDirectory() as made:
        scenario = Path(made) / "scenario.toml"
        try:
            scenario.write_text(scenario_text(run.derived.tables, _remarks(run)), encoding="utf-8")
            (Path(made) / COPIED).mkdir()
            for file in past.files:
                # A folder is read by its *.g2o files, whatever case a single file's ending has.
                by_ending = past.format in ("g2o", "tum")
                name = f"{file.stem}.{past.format}" if by_ending else file.name
                shutil.copyfile(file, Path(made) / COPIED / name)
            for earlier in in_the_way:
                earlier.unlink()
        except OSError as error:
            raise InvalidInputError(
                f"{folder}: expected a place to copy the log to: {error}"
            ) from error
        begin_run(scenario, folder, named_files(run.scenario, scenario))


def past_lines(estimate: PastEstimate | None, run: LogRun | None) -> list[str]:
    """What was read, estimated and derived, for the summary.

    Args:
        estimate: The past of the run, or None.
        run: The log that was run; None where a scenario was.

    Returns:
        Lines to print.
    """
    if estimate is None:
        return []
    past = estimate.past
    poses = sum(len(keys) for keys in past.robots.values())
    robots = "1 robot" if len(past.robots) == 1 else f"{len(past.robots)} robots"
    lines = [
        f"past: {past.format}, {robots}, {poses} poses, {past.graph.size()} "
        f"factors, from {len(past.files)} file{'s' if len(past.files) > 1 else ''}"
    ]
    if estimate.optimised:
        lines.append(
            f"  joint estimate: half squared error {estimate.error_before:.6g} -> "
            f"{estimate.error_after:.6g} in {estimate.iterations} iterations, "
            f"{estimate.seconds:.2f} s"
            f"{'' if estimate.converged else '; NOT converged'}"
        )
    lines += [f"  {note}" for note in (*past.notes, *estimate.notes)]
    if run is not None:
        lines += [f"  {note}" for note in run.derived.notes]
        lines.append("  to plan otherwise, change scenario.toml in the run folder and run that")
    return lines


def _other_copies(files: Sequence[Path], folder: Path) -> list[Path]:
    """Files of another log where this one is copied to; only those that a run has put there."""
    own = {file.resolve() for file in files}
    found = [file for file in sorted((folder / COPIED).glob("*")) if file.resolve() not in own]
    if not found:
        return []
    try:
        text = (folder / "scenario.toml").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        text = ""
    if not text.startswith(f"# {_DERIVED}"):
        raise InvalidInputError(
            f"{folder / COPIED}: expected no such folder, or one that fgplan run wrote, got "
            f"{found[0].name} in it; the log is copied there: choose another --out"
        )
    return [file for file in found if is_log_file(file)]


def _remarks(run: LogRun) -> list[str]:
    """What stands above the derived scenario."""
    return [_DERIVED, *run.derived.notes]
