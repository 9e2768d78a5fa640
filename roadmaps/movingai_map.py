"""MovingAI benchmark maps (`.map`, type octile).

    type octile / height R / width C / map / R lines of C characters, the first one at the top

`.`, `G` and `S` (swamp) are free; `@`, `O` (out of bounds), `T` (trees) and `W` (water, which
cannot be entered from land) are occupied. The benchmarks count rows downwards from the top; here
y points up, so their cell (x, y) has its centre at (x + 1/2, R - y - 1/2) cells.

Sturtevant, "Benchmarks for Grid-Based Pathfinding", IEEE Transactions on Computational
Intelligence and AI in Games 4(2), 2012.
"""

from pathlib import Path

import numpy as np

from roadmaps.checks import check_positive
from roadmaps.errors import MapFileError
from roadmaps.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

_FREE_LETTERS, _OCCUPIED_LETTERS = b".GS", b"@OTW"


def read_movingai_map(path: str | Path, *, cell_size_m: float = 1.0) -> OccupancyGrid:
    """Read a MovingAI `.map` file.

    Args:
        path: The file.
        cell_size_m: Side of a cell, metres; the files do not say.

    Returns:
        The grid, its lower-left corner at the origin of the world.

    Raises:
        MapFileError: If the header or a row is not as the format says; names the line.
        ParameterError: If `cell_size_m` is not positive.
    """
    check_positive(cell_size_m, "cell_size_m")
    path = Path(path)
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise MapFileError(f"{path}: expected a readable MovingAI map: {error}") from error
    _expect(lines, 0, "type octile", path)
    height = _header_count(lines, 1, "height", path)
    width = _header_count(lines, 2, "width", path)
    _expect(lines, 3, "map", path)
    rows = lines[4:]
    while rows and not rows[-1].strip():
        rows.pop()
    if len(rows) != height:
        raise MapFileError(f"{path}: expected {height} rows after line 4, got {len(rows)}")
    for number, row in enumerate(rows, start=5):
        if len(row) != width:
            raise MapFileError(
                f"{path}, line {number}: expected {width} characters, got {len(row)}"
            )
    letters = np.frombuffer("".join(rows).encode("ascii"), dtype=np.uint8).reshape(height, width)
    free = np.isin(letters, np.frombuffer(_FREE_LETTERS, dtype=np.uint8))
    known = free | np.isin(letters, np.frombuffer(_OCCUPIED_LETTERS, dtype=np.uint8))
    if not known.all():
        row_index, column = np.argwhere(~known)[0].tolist()
        raise MapFileError(
            f"{path}, line {row_index + 5}: expected one of . G S @ O T W, got "
            f"{chr(letters[row_index, column])!r} in column {column + 1}"
        )
    return OccupancyGrid(
        occupancy=np.where(free, FREE, OCCUPIED)[::-1],
        resolution_m=cell_size_m,
        origin=np.zeros(2),
    )


def _expect(lines: list[str], index: int, wanted: str, path: Path) -> None:
    """Raise unless a header line is as wanted."""
    came = lines[index].split() if index < len(lines) else []
    if came != wanted.split():
        raise MapFileError(f"{path}, line {index + 1}: expected {wanted!r}, got {' '.join(came)!r}")


def _header_count(lines: list[str], index: int, name: str, path: Path) -> int:
    """The positive integer of a header line."""
    words = lines[index].split() if index < len(lines) else []
    if len(words) != 2 or words[0] != name or not words[1].isdigit() or int(words[1]) < 1:
        raise MapFileError(
            f"{path}, line {index + 1}: expected '{name} N' with N at least 1, "
            f"got {' '.join(words)!r}"
        )
    return int(words[1])
