"""A closed loop on disk: every record as it comes, so that a stopped run can go on.

    loop.jsonl    first line: what the mission is, by digest, and what figures need of it
                  then one line a record (fgplan.closed_loop.records), in order

A line is on disk before its record is handed on. A last line that was cut off by a crash is dropped
when the run goes on, and where that was the first, the run begins; a cut anywhere else is an error.
Floats are written with all their digits, so a run that goes on computes with the very numbers that
it would have had.
"""

import os
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fgplan.closed_loop.comparison import OURS, Contestant
from fgplan.closed_loop.loop import Record, run_loop
from fgplan.closed_loop.mission import LoopMission
from fgplan.closed_loop.records import (
    GivenUpRecord,
    LoopHistory,
    SessionRecord,
    SlamRecord,
    StepRecord,
)
from fgplan.errors import InvalidInputError
from fgplan.io.mission_digest import mission_digest
from fgplan.io.plain_value import plain_value
from fgplan.io.run_record import WorkspaceRecord, record_workspace
from fgplan.typing import FloatArray, Key

LOOP = "loop.jsonl"
LOOP_SCHEMA = "loop.v1"

_KINDS: Mapping[str, type] = {
    "step": StepRecord,
    "session": SessionRecord,
    "given_up": GivenUpRecord,
    "slam": SlamRecord,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopHeader:
    """First line of a loop's file.

    Attributes:
        schema: Version of this form.
        digest: Of the mission, see ``mission_digest``.
        name: Title.
        robots: Names in the order of the team.
        goals: Goals of each robot, shape (G, 2) or (G, 3), metres.
        landmarks: True position of every landmark, metres.
        workspace: The world's bounds and obstacles.
    """

    schema: str
    digest: str
    name: str
    robots: tuple[str, ...]
    goals: Mapping[str, FloatArray]
    landmarks: Mapping[Key, FloatArray]
    workspace: WorkspaceRecord


def run_in_folder(
    mission: LoopMission,
    folder: Path,
    *,
    contestants: Mapping[str, Contestant] = OURS,
    compare: bool | Collection[int] = False,
) -> Iterator[Record]:
    """Run a closed loop and write every record, or go on with one that was stopped.

    Args:
        mission: What is given.
        folder: Made as needed; if it holds records of this mission, the run goes on after them.
        contestants: As in ``run_loop``.
        compare: As in ``run_loop``.

    Yields:
        The new records, each after it is on disk.

    Raises:
        InvalidInputError: If the folder holds another mission's records, or cannot be written.
        NoCandidatePathError: As ``run_loop``.
    """
    path = folder / LOOP
    header = _header(mission)
    past: list[Record] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if _is_begun(path, header):
            past = _read(path, drop_cut_off=True)[1]
        else:
            path.write_bytes(b"")
            _append(path, plain_value(header))
        for record in run_loop(mission, past=past, contestants=contestants, compare=compare):
            _append(path, {"kind": _kind(record), **plain_value(record)})
            yield record
    except OSError as error:
        raise InvalidInputError(f"{path}: expected a place to write to: {error}") from error


def check_loop_folder(mission: LoopMission, folder: Path) -> None:
    """Refuse a folder that holds another mission's records; nothing is changed.

    Args:
        mission: What is to be run.
        folder: The run folder; it may be empty or missing.

    Raises:
        InvalidInputError: If it holds the records of another mission, or something else.
    """
    path = folder / LOOP
    try:
        _is_begun(path, _header(mission))
    except OSError as error:
        raise InvalidInputError(
            f"{path}: expected the records of a closed loop: {error}"
        ) from error


def read_loop(folder: Path) -> tuple[LoopHistory, WorkspaceRecord]:
    """Read what a closed loop has written so far.

    Args:
        folder: The run folder.

    Returns:
        The history, and the world's bounds and obstacles.

    Raises:
        InvalidInputError: If the folder holds no loop, or a line of it is not one.
    """
    header, records = _read(folder / LOOP, drop_cut_off=False)
    return (
        LoopHistory(
            name=header.name,
            robots=header.robots,
            goals=header.goals,
            landmarks=header.landmarks,
            steps=tuple(r for r in records if isinstance(r, StepRecord)),
            sessions=tuple(r for r in records if isinstance(r, SessionRecord)),
            final=next((r for r in records if isinstance(r, SlamRecord)), None),
            given_up=next((r for r in records if isinstance(r, GivenUpRecord)), None),
        ),
        header.workspace,
    )


def _header(mission: LoopMission) -> LoopHeader:
    """What the first line says."""
    world = mission.world
    return LoopHeader(
        schema=LOOP_SCHEMA,
        digest=mission_digest(mission),
        name=mission.name,
        robots=tuple(robot.name for robot in mission.robots),
        goals=mission.goals,
        landmarks=dict(zip(world.landmark_keys, world.landmark_positions, strict=True)),
        workspace=record_workspace(world.workspace or mission.workspace),
    )


def _is_begun(path: Path, header: LoopHeader) -> bool:
    """Whether a file has this first line; nothing, or the beginning of that line, is a cut."""
    if not path.exists():
        return False
    with path.open("rb") as file:
        first = file.readline()
    if not first.endswith(b"\n"):
        if msgspec.json.encode(plain_value(header)).startswith(first):
            return False
        raise InvalidInputError(
            f"{path}: expected the records of a closed loop, got {first[:40]!r}; choose another "
            "folder"
        )
    found = _decoded(path, 1, first, lambda data: _converted(data, LoopHeader))
    if found.digest != header.digest:
        raise InvalidInputError(
            f"{path}: expected records of {header.name!r}, got another mission's "
            f"({found.name!r}), or of that mission with other numbers; choose another folder"
        )
    return True


def _kind(record: Record) -> str:
    """Name of a record's type in the file."""
    return next(name for name, kind in _KINDS.items() if isinstance(record, kind))


def _append(path: Path, data: Mapping[str, Any]) -> None:
    """Write one line and make sure that it is on disk."""
    with path.open("ab") as file:
        file.write(msgspec.json.encode(data) + b"\n")
        file.flush()
        os.fsync(file.fileno())


def _read(path: Path, *, drop_cut_off: bool) -> tuple[LoopHeader, list[Record]]:
    """Header and records; a cut-off last line is left out, and taken off the file if wanted."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InvalidInputError(
            f"{path}: expected the records of a closed loop: {error}"
        ) from error
    lines = content.split(b"\n")
    if lines[-1] and drop_cut_off:
        with path.open("rb+") as file:
            file.truncate(len(content) - len(lines[-1]))
    if not lines[0] and len(lines) == 1:
        raise InvalidInputError(f"{path}: expected {LOOP_SCHEMA!r} on the first line, got nothing")
    header = _decoded(path, 1, lines[0], lambda data: _converted(data, LoopHeader))
    if header.schema != LOOP_SCHEMA:
        raise InvalidInputError(
            f"{path}: expected {LOOP_SCHEMA!r} on the first line, got {header.schema!r}"
        )
    records = [
        _decoded(path, number, line, _record) for number, line in enumerate(lines[1:-1], start=2)
    ]
    return header, records


def _decoded(path: Path, number: int, line: bytes, read: Callable[[Any], Any]) -> Any:  # noqa: ANN401
    """One line, read; what is wrong with it is said with its number."""
    try:
        return read(msgspec.json.decode(line))
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise InvalidInputError(
            f"{path}, line {number}: expected a record of a closed loop: {error}"
        ) from error


def _record(data: Any) -> Record:  # noqa: ANN401 - plain data
    """Plain data to the record that its kind names."""
    kind = data.pop("kind", None) if isinstance(data, dict) else None
    if not isinstance(kind, str) or kind not in _KINDS:
        raise ValueError(f"expected a kind, one of {', '.join(_KINDS)}, got {kind!r}")
    record: Record = _converted(data, _KINDS[kind])
    return record


def _converted(data: Any, kind: type) -> Any:  # noqa: ANN401 - of the kind asked for
    """Plain data to a record; nested lists become read-only arrays."""
    return msgspec.convert(data, kind, str_keys=True, dec_hook=_read_array)


def _read_array(kind: Any, value: Any) -> Any:  # noqa: ANN401 - msgspec's hook
    """Nested lists to a read-only array."""
    array: FloatArray = np.array(value, dtype=np.float64)
    array.setflags(write=False)
    return array
