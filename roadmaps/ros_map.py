"""ROS map_server maps: a YAML file beside a grey image, read in `trinary` mode.

A pixel of grey value g in [0, 1] has occupancy p = 1 - g (p = g if `negate`), and a cell is

    occupied if p > occupied_thresh,   free if p < free_thresh,   unknown otherwise.

`origin` is the pose (x, y, yaw) of the image's lower-left corner in the world.
"""

import math
from pathlib import Path

import numpy as np

from roadmaps.errors import MapFileError
from roadmaps.map_yaml import MapFields, parse_map_yaml
from roadmaps.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from roadmaps.pgm import read_pgm

_FIELDS = ("image", "resolution", "origin", "mode", "negate", "occupied_thresh", "free_thresh")


def read_ros_map(path: str | Path) -> OccupancyGrid:
    """Read a map_server YAML file and its PGM image.

    `image` is relative to the YAML file. `mode`, `negate`, `occupied_thresh` and `free_thresh`
    may be left out: trinary, 0, 0.65 and 0.25.

    Args:
        path: The YAML file.

    Returns:
        The grid, in the map's world frame.

    Raises:
        MapFileError: If a file is unreadable or malformed, a field is missing, unknown or out
            of range, or the mode is not trinary.

    Example:
        >>> grid = read_ros_map("tests/data/maps/depot.yaml")
        >>> grid.shape, grid.resolution_m
        ((307, 604), 0.05)
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MapFileError(f"{path}: expected a readable map_server YAML file: {error}") from error
    fields = parse_map_yaml(text, path)
    unknown = sorted(set(fields) - set(_FIELDS))
    if unknown:
        raise MapFileError(
            f"{path}: field {unknown[0]!r} is not one of {', '.join(_FIELDS)}; remove or respell it"
        )
    mode = fields.get("mode", "trinary")
    if mode != "trinary":
        raise MapFileError(
            f"{path}: field 'mode': expected trinary, got {mode!r}; scale and raw maps hold "
            "probabilities: threshold them and save the map as trinary"
        )
    resolution_m = _number(fields, "resolution", path)
    if resolution_m <= 0.0:
        raise MapFileError(
            f"{path}: field 'resolution': expected metres a pixel greater than 0, "
            f"got {resolution_m}"
        )
    x, y, yaw_rad = _origin(fields, path)
    occupied_above = _number(fields, "occupied_thresh", path, 0.65)
    free_below = _number(fields, "free_thresh", path, 0.25)
    if not 0.0 <= free_below <= occupied_above <= 1.0:
        raise MapFileError(
            f"{path}: fields 'free_thresh' and 'occupied_thresh': expected 0 <= free <= occupied "
            f"<= 1, got {free_below} and {occupied_above}"
        )
    image = fields.get("image", "")
    if not isinstance(image, str) or not image:
        raise MapFileError(f"{path}: field 'image': expected the name of a PGM file, got {image!r}")
    if not (path.parent / image).is_file():
        raise MapFileError(
            f"{path}: field 'image': expected a PGM file relative to this one, got {image!r}: no "
            f"{path.parent / image}"
        )
    grey = read_pgm(path.parent / image)
    occupancy = grey if _negate(fields, path) else 1.0 - grey
    cells = np.full(grey.shape, UNKNOWN, dtype=np.int8)
    cells[occupancy < free_below] = FREE
    cells[occupancy > occupied_above] = OCCUPIED
    return OccupancyGrid(
        occupancy=cells[::-1],
        resolution_m=resolution_m,
        origin=np.array([x, y]),
        yaw_rad=yaw_rad,
    )


def _number(fields: MapFields, name: str, path: Path, default: float | None = None) -> float:
    """A field as a finite number, or its default."""
    if name not in fields and default is not None:
        return default
    value = fields.get(name)
    try:
        number = float(value) if isinstance(value, str) else math.nan
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        came = "nothing" if value is None else repr(value)
        raise MapFileError(f"{path}: field {name!r}: expected a finite number, got {came}")
    return number


def _origin(fields: MapFields, path: Path) -> tuple[float, float, float]:
    """The field `origin` as x, y (metres) and yaw (radians)."""
    value = fields.get("origin")
    try:
        numbers = [float(item) for item in value] if isinstance(value, list) else []
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(math.isfinite(number) for number in numbers):
        came = "nothing" if value is None else repr(value)
        raise MapFileError(
            f"{path}: field 'origin': expected [x, y, yaw] in metres and radians, got {came}"
        )
    return numbers[0], numbers[1], numbers[2]


def _negate(fields: MapFields, path: Path) -> bool:
    """The field `negate`: 0 or 1 (ROS 2 also writes false or true)."""
    value = fields.get("negate", "0")
    meaning = {"0": False, "1": True, "false": False, "true": True}
    if not isinstance(value, str) or value.lower() not in meaning:
        raise MapFileError(f"{path}: field 'negate': expected 0 or 1, got {value!r}")
    return meaning[value.lower()]
