"""The contract between the command line and the work behind it.

Every demo, bench and reproduction is a function of ``CommandOptions`` that returns a
``CommandOutcome``. Its module may add arguments of its own with

    def add_arguments(parser: argparse.ArgumentParser) -> None: ...

whose values arrive in ``options.arguments``. The command line writes the result file, prints the
summary, and turns requirements into an exit status; the function does none of this.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fgplan.io.result_file import Requirement


def _no_progress(done: int, total: int, doing: str) -> None:
    """Say nothing."""
    del done, total, doing


def _no_record(results: Mapping[str, Any]) -> None:
    """Keep nothing."""
    del results


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandOptions:
    """What every command is given.

    Attributes:
        name: Name of the demo, bench or reproduction.
        out: Folder for figures and files; it exists. None writes no files.
        seeds: Number of seeds asked for, or None for the command's own number.
        first_seed: The first of them, or None for the command's own: 0, or the scenario's.
        quick: A short version, for tests and CI.
        arguments: Values of the command's own arguments, by name.
        progress: Called as ``progress(done, total, doing)``; shows a line on a terminal.
        record: Called with all results so far; an interrupted command leaves them on disk.
    """

    name: str = ""
    out: Path | None = None
    seeds: int | None = None
    first_seed: int | None = None
    quick: bool = False
    arguments: Mapping[str, Any] = field(default_factory=dict)
    progress: Callable[[int, int, str], None] = _no_progress
    record: Callable[[Mapping[str, Any]], None] = _no_record

    def seed_range(self, default: int, quick: int = 1) -> tuple[int, ...]:
        """Seeds 0, 1, ..., or from ``first_seed`` on, as many as asked for.

        Args:
            default: How many where nothing is asked for.
            quick: How many of these with ``--quick``.

        Returns:
            The seeds.
        """
        count = (quick if self.quick else default) if self.seeds is None else self.seeds
        first = 0 if self.first_seed is None else self.first_seed
        return tuple(range(first, first + count))


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandOutcome:
    """What a command hands back.

    Attributes:
        results: What came out, for the result file; numpy arrays and dataclasses are fine.
        requirements: Demands on the results; ``--check`` fails where one is not met.
        seeds: Seeds used.
        summary: Lines to print.
        figures: Figures written into ``out``.
        infeasible: Why there is no plan, or None; the exit status is 1 where given.
    """

    results: Mapping[str, Any]
    requirements: tuple[Requirement, ...] = ()
    seeds: tuple[int, ...] = ()
    summary: tuple[str, ...] = ()
    figures: tuple[Path, ...] = ()
    infeasible: str | None = None
