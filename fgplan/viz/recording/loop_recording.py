"""A closed loop as a recording: the ending of the file's name says in which format."""

from pathlib import Path

from fgplan.closed_loop.records import LoopHistory
from fgplan.errors import InvalidInputError
from fgplan.viz.recording.mcap_recording import record_mcap
from fgplan.viz.recording.rerun_recording import record_rerun
from roadmaps import Workspace

WRITERS = {".rrd": record_rerun, ".mcap": record_mcap}


def record_loop(
    history: LoopHistory, path: str | Path, *, workspace: Workspace | None = None
) -> Path:
    """Write a recording of the whole mission.

    True and estimated poses, covariance ellipses, candidate and chosen paths of each planning
    session with multi-robot factors, landmarks, measurements, and metrics over time; stamped with
    seconds since the start, in the frame "map".

    Args:
        history: The loop; at least one step.
        path: Ends in .rrd (Rerun) or .mcap (Foxglove); its folder is made if missing, a file of
            that name is replaced.
        workspace: Bounds and obstacles, or None.

    Returns:
        The path.

    Raises:
        InvalidInputError: If the name ends otherwise, there is no step, or a step lacks a robot.
        MissingExtraError: If the package for the format is not installed.
    """
    path = Path(path)
    if path.suffix not in WRITERS:
        raise InvalidInputError(
            f"recording {path.name!r}: expected a name that ends in {' or '.join(WRITERS)}"
        )
    return WRITERS[path.suffix](history, path, workspace=workspace)
