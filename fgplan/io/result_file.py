"""The result file: one JSON form for run, demo, bench and reproduce.

    {schema, command, versions, machine, date, seeds, results, requirements, complete, stopped}

The file is replaced as a whole (written beside, then renamed), so that whoever reads it, at any
moment and after any interruption, finds valid JSON; ``complete`` is false until the work has ended,
and ``stopped`` says why it ended before that. Work that is killed has no last word: not complete,
and not stopped by anything.
"""

import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import msgspec

from fgplan.errors import InvalidInputError
from fgplan.io.plain_value import plain_value

RESULT_SCHEMA = 1

_PACKAGES = ("fgplan", "gtsam", "numpy", "scipy", "networkx", "msgspec", "numba", "shapely")


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirement:
    """Something that a result must satisfy.

    Attributes:
        name: What it is about, usually a key of the results.
        required: The demand in words, such as "at least 12".
        value: What came out.
        met: Whether it is satisfied.
    """

    name: str
    required: str
    value: Any
    met: bool


def require_at_least(name: str, value: float, bound: float) -> Requirement:
    """A requirement that a number is not below a bound; nan does not meet it."""
    return Requirement(
        name=name, required=f"at least {bound:g}", value=value, met=bool(value >= bound)
    )


def require_at_most(name: str, value: float, bound: float) -> Requirement:
    """A requirement that a number is not above a bound; nan does not meet it."""
    return Requirement(
        name=name, required=f"at most {bound:g}", value=value, met=bool(value <= bound)
    )


def require_true(name: str, value: bool, required: str = "true") -> Requirement:
    """A requirement that something holds."""
    return Requirement(name=name, required=required, value=bool(value), met=bool(value))


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultFile:
    """Content of a result file.

    Attributes:
        command: The command with its arguments.
        seeds: Seeds used.
        results: What came out; keys as the command documents them.
        requirements: Demands on the results.
        complete: Whether the work was done to its end.
        stopped: The error that ended it before; empty where there was none.
        versions: Version by package, Python included.
        machine: Processor, cores, system.
        date: UTC, ISO 8601.
        schema: Version of this form.
    """

    command: str
    seeds: tuple[int, ...] = ()
    results: Mapping[str, Any] = field(default_factory=dict)
    requirements: tuple[Requirement, ...] = ()
    complete: bool = True
    stopped: str = ""
    versions: Mapping[str, str] = field(default_factory=lambda: package_versions())
    machine: Mapping[str, Any] = field(default_factory=lambda: describe_machine())
    date: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    schema: int = RESULT_SCHEMA

    @property
    def unmet(self) -> tuple[Requirement, ...]:
        """The requirements that are not met."""
        return tuple(requirement for requirement in self.requirements if not requirement.met)


def package_versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide numbers; absent ones are left out."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def describe_machine() -> dict[str, Any]:
    """The machine: system, processor, number of cores this process may use."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "system": platform.platform(),
        "processor": platform.machine(),
        "cores": usable,
        "blas_threads": os.environ.get("OPENBLAS_NUM_THREADS", "default"),
    }


def write_result(path: str | Path, result: ResultFile) -> None:
    """Write a result file in one atomic step; folders are made as needed.

    Args:
        path: The JSON file.
        result: Its content.

    Raises:
        InvalidInputError: If the file cannot be written or a value has no plain form.
    """
    content = plain_value(
        {
            "schema": result.schema,
            "command": result.command,
            "versions": result.versions,
            "machine": result.machine,
            "date": result.date,
            "seeds": result.seeds,
            "results": result.results,
            "requirements": result.requirements,
            "complete": result.complete,
            "stopped": result.stopped,
        }
    )
    text = msgspec.json.format(msgspec.json.encode(content), indent=1)
    replace_file(Path(path), text + b"\n")


def read_result(path: str | Path) -> ResultFile:
    """Read a result file.

    Args:
        path: The JSON file.

    Returns:
        Its content.

    Raises:
        InvalidInputError: If it is unreadable or has another form.
    """
    try:
        content = msgspec.json.decode(Path(path).read_bytes())
        found = msgspec.convert(content, ResultFile)
    except OSError as error:
        raise InvalidInputError(f"{path}: expected a readable result file: {error}") from error
    except (msgspec.DecodeError, RecursionError) as error:
        raise InvalidInputError(f"{path}: expected a result file of fgplan: {error}") from error
    if found.schema != RESULT_SCHEMA:
        raise InvalidInputError(
            f"{path}: expected result schema {RESULT_SCHEMA}, got {found.schema}; "
            "read it with the fgplan that wrote it"
        )
    return found


def replace_file(path: Path, content: bytes) -> None:
    """Replace a file atomically: written beside, flushed, renamed.

    Args:
        path: The file; its folder is made as needed.
        content: The new content.

    Raises:
        InvalidInputError: If the file cannot be written.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        raise InvalidInputError(f"{path}: expected a place to write to: {error}") from error
