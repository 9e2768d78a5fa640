"""Which formats a team's past may have, and what reads each: one line a format.

A new format is a function that recognises a path, one that reads it into a ``TeamPast``, and a line
in ``READERS``; a scenario that names it needs a kind of ``[prior]`` too. Trajectories beside a
graph or a log are taken for its results and not read.
"""

from collections.abc import Callable
from pathlib import Path

from fgplan.errors import ScenarioError
from fgplan.io.mrclam_past import is_mrclam, read_mrclam_past
from fgplan.io.team_past import TeamPast, read_g2o_past, read_pyfg_past
from fgplan.io.tum_past import read_tum_past


def is_team_past(path: Path) -> bool:
    """Whether a path is to be read as a log rather than a scenario: a folder, or by its ending."""
    return path.is_dir() or path.suffix.lower() in (".g2o", ".pyfg", ".tum")


def is_log_file(path: Path) -> bool:
    """Whether a file is one that some format reads, by its ending."""
    return path.is_file() and path.suffix.lower() in (".g2o", ".pyfg", ".tum", ".dat")


def read_team_past(path: Path | str) -> TeamPast:
    """Read a team's past, whatever its format.

    Args:
        path: A file or folder.

    Returns:
        The past.

    Raises:
        ScenarioError: If the format is not known (lists those that are), or the content is wrong.
    """
    path = Path(path)
    if not path.exists():
        raise ScenarioError(f"{path}: expected a file or folder, found none")
    every = [name for name, (is_it, _) in READERS.items() if is_it(path)]
    found = [name for name in every if name != "tum"] or every
    if len(found) != 1:
        came = " and ".join(found) if found else "none of them"
        raise ScenarioError(
            f"{path}: expected a .g2o, .pyfg or .tum file, or a folder of one of "
            f"{', '.join(READERS)}, got {came}"
        )
    return READERS[found[0]][1](path)


def _has(pattern: str, suffix: str) -> Callable[[Path], bool]:
    """Recognise a file by its suffix and a folder by what lies in it."""

    def recognise(path: Path) -> bool:
        if path.is_dir():
            return any(path.glob(pattern))
        return path.suffix.lower() == suffix

    return recognise


READERS: dict[str, tuple[Callable[[Path], bool], Callable[[Path], TeamPast]]] = {
    "g2o": (_has("*.g2o", ".g2o"), read_g2o_past),
    "pyfg": (_has("*.pyfg", ".pyfg"), read_pyfg_past),
    "mrclam": (is_mrclam, read_mrclam_past),
    "tum": (_has("*.tum", ".tum"), read_tum_past),
}
"""By format: what recognises a path, and what reads it."""
