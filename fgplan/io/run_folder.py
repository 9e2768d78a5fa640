"""A run folder: the scenario, the result, the record that figures are drawn from, figures.

scenario.toml (or .yaml)   copy of what was run; with it what it names beside itself
result.json                fgplan/io/result_file.py; valid at any moment
record.json                RunRecord: paths, covariances, joined states, map
*.png                      figures; ``fgplan plot`` draws them again from record.json
"""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.io.plain_value import plain_value
from fgplan.io.result_file import replace_file
from fgplan.io.run_record import RunRecord

RECORD = "record.json"

FIGURES = ("candidate_paths", "chosen_paths", "objective", "impacted_paths_[0-9]*")
"""Names of the figures that a run draws, as patterns."""


def begin_run(scenario: Path, folder: Path, beside: Sequence[Path] = ()) -> Path:
    """Copy a scenario file into a run folder; what an earlier run left for figures goes.

    Without this a run with fewer figures, or one that ends early, would leave those of the earlier
    run beside its own result.

    Args:
        scenario: The file that is run.
        folder: The run folder.
        beside: Files that the scenario names, relative to its folder (``named_files``); copied
            under the same names, so that the copy runs again.

    Returns:
        The copy, ``scenario`` with the file's suffix.

    Raises:
        InvalidInputError: If it cannot be copied, or the earlier files cannot be removed.
    """
    copy = folder / f"scenario{scenario.suffix}"
    try:
        for name in (RECORD, *(f"{figure}.png" for figure in FIGURES)):
            for earlier in folder.glob(name):
                earlier.unlink()
        _copy(scenario, copy)
        for named in beside:
            (folder / named).parent.mkdir(parents=True, exist_ok=True)
            _copy(scenario.parent / named, folder / named)
    except OSError as error:
        raise InvalidInputError(f"{copy}: expected a place to write to: {error}") from error
    return copy


def _copy(source: Path, copy: Path) -> None:
    """Copy a file, unless it is the same."""
    if not (copy.exists() and copy.samefile(source)):
        shutil.copyfile(source, copy)


def write_record(folder: Path, record: RunRecord) -> Path:
    """Write the record that figures are drawn from.

    Args:
        folder: The run folder.
        record: What was planned.

    Returns:
        The file.

    Raises:
        InvalidInputError: If it cannot be written.
    """
    path = folder / RECORD
    replace_file(path, msgspec.json.encode(plain_value(record)))
    return path


def read_record(folder: Path) -> RunRecord:
    """Read the record of a run folder.

    Args:
        folder: A folder that ``fgplan run`` or a demo wrote.

    Returns:
        The record.

    Raises:
        InvalidInputError: If the folder has none, or it is not one.
    """
    path = folder / RECORD
    try:
        content = msgspec.json.decode(path.read_bytes())
        return msgspec.convert(content, RunRecord, str_keys=True, dec_hook=_read_array)
    except OSError as error:
        raise InvalidInputError(
            f"{path}: expected a run folder that fgplan run or fgplan demo wrote: {error}"
        ) from error
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise InvalidInputError(f"{path}: expected the record of a run: {error}") from error


def _read_array(kind: Any, value: Any) -> Any:  # noqa: ANN401 - msgspec's hook
    """Nested lists to a read-only array of the type that is wanted."""
    wanted = np.int64 if "int64" in str(kind) else np.float64
    array = np.array(value, dtype=wanted)
    array.setflags(write=False)
    return array
