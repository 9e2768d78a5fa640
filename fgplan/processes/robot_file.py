"""``robots/NAME.msgpack`` of a run folder: what one participant hands in when it ends.

Robots of several machines write theirs into folders of their own; a copy of all in one folder is
as good as one run on one machine.
"""

from pathlib import Path
from typing import Annotated, Any

import msgspec

from fgplan.errors import InvalidInputError
from fgplan.io.result_file import replace_file
from fgplan.message_reader import MessageReader

ROBOTS = "robots"
"""Folder of a run folder that holds them."""

Count = Annotated[int, msgspec.Meta(ge=0)]


class RobotFile(
    msgspec.Struct, frozen=True, kw_only=True, tag="robot_report.v1", tag_field="schema"
):
    """What one participant hands in.

    Attributes:
        robot: Its name.
        planner: Name of the planner.
        scenario_digest: Digest of the scenario that it read.
        seed: Seed of the run.
        finished: Whether it came to its end, not to a limit.
        report: What the planner's ``team_plan`` reads.
        traffic: Messages and bytes that it sent and got, by kind.
        refused: Messages that were refused, by reason.
        first_refused: What was wrong with the first of each reason.
        seconds: Real seconds: ``setup``, ``wait`` for the team, ``run``.
        missing: Participants that were not there when it began.
    """

    robot: str
    planner: str
    scenario_digest: str
    seed: int
    finished: bool
    report: dict[str, Any]
    traffic: dict[str, dict[str, Count]]
    refused: dict[str, Count]
    first_refused: dict[str, str]
    seconds: dict[str, float]
    missing: tuple[str, ...]


_READER: MessageReader[RobotFile] = MessageReader(RobotFile)


def robot_path(folder: Path, robot: str) -> Path:
    """Where a participant's file is.

    Args:
        folder: The run folder.
        robot: Name of the participant.
    """
    return folder / ROBOTS / f"{robot}.msgpack"


def write_robot(folder: Path, file: RobotFile) -> Path:
    """Write what a participant hands in.

    Args:
        folder: The run folder; folders are made as needed.
        file: It.

    Returns:
        The file.

    Raises:
        InvalidInputError: If it cannot be written.
    """
    path = robot_path(folder, file.robot)
    replace_file(path, msgspec.msgpack.encode(file))
    return path


def read_robot(folder: Path, robot: str) -> RobotFile | None:
    """Read what a participant handed in.

    Args:
        folder: The run folder.
        robot: Name of the participant.

    Returns:
        It, or None where there is none.

    Raises:
        InvalidInputError: If the file is another robot's, or malformed.
    """
    path = robot_path(folder, robot)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InvalidInputError(f"{path}: expected what a robot handed in: {error}") from error
    file = _READER.read(data, f"{path}: expected what a robot handed in")
    if file.robot != robot:
        raise InvalidInputError(f"{path}: expected robot {robot!r}, got {file.robot!r}")
    return file
