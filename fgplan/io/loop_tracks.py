"""The trajectories of a closed loop as TUM files, estimated and true."""

from pathlib import Path
from urllib.parse import quote

import numpy as np

from fgplan.closed_loop.records import LoopHistory
from fgplan.errors import InvalidInputError
from fgplan.io.tum import write_tum


def write_tracks(history: LoopHistory, folder: Path) -> tuple[Path, ...]:
    """Write estimated and true trajectories as TUM files.

    Args:
        history: A loop that has ended.
        folder: Its run folder.

    Returns:
        The files: ``trajectories/ROBOT.tum`` and ``truth/ROBOT.tum``, %2F for / in a name, with a
        pose of the truth for each estimated one.

    Raises:
        InvalidInputError: If the loop has not ended, or the files cannot be written.
        ScenarioError: If a file cannot be written.
    """
    if history.final is None:
        raise InvalidInputError(
            f"closed loop {history.name!r}: expected a final SLAM result, got none: it still runs"
        )
    times = np.array([step.time_s for step in history.steps])
    files = []
    try:
        for name in ("trajectories", "truth"):
            (folder / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInputError(f"{folder}: expected a folder to write to: {error}") from error
    for robot, poses in history.final.trajectories.items():
        steps = list(history.final.trajectory_steps[robot])
        truth = np.array([history.steps[step].truth[robot] for step in steps])
        for name, each in (("trajectories", poses), ("truth", truth)):
            files.append(folder / name / f"{quote(robot, safe='')}.tum")
            write_tum(files[-1], times[steps], each)
    return tuple(files)
