"""What decides a closed loop, as one digest: the same in every process for the same mission.

A user's own sensors, models and criteria count by their type and what they hold: fields of a
dataclass, attributes of an object, module and name of a function. The title does not count.
"""

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fgplan.closed_loop.mission import LoopMission
from fgplan.errors import InvalidInputError
from fgplan.io.run_record import record_workspace
from roadmaps import Workspace


def mission_digest(mission: LoopMission) -> str:
    """Sha256, in hexadecimal, of everything that decides a closed loop.

    Args:
        mission: The mission.

    Returns:
        64 hexadecimal digits.

    Raises:
        InvalidInputError: If an object of a user's own neither is a dataclass nor has attributes.
    """
    content = _described(dataclasses.replace(mission, name=""), "mission")
    canonical = msgspec.json.encode(content, order="sorted")
    return hashlib.sha256(b"fgplan loop 1" + canonical).hexdigest()


def _described(value: object, name: str) -> Any:  # noqa: ANN401 - one line a kind
    """A value as plain JSON that tells it from others of its kind, to the last bit."""
    if value is None or isinstance(value, bool | int | str | Path):
        return value if not isinstance(value, Path) else str(value)
    if isinstance(value, float | np.generic):
        return repr(float(value))  # JSON has no infinity
    if isinstance(value, np.ndarray):
        content = np.ascontiguousarray(value)
        return [str(content.dtype), content.shape, hashlib.sha256(content.tobytes()).hexdigest()]
    if isinstance(value, Mapping):
        return [[_described(k, name), _described(v, f"{name}.{k}")] for k, v in value.items()]
    if isinstance(value, frozenset | set):
        return sorted(_described(item, name) for item in value)
    if isinstance(value, list | tuple):
        return [_described(item, f"{name}[{place}]") for place, item in enumerate(value)]
    if isinstance(value, Workspace):
        value = record_workspace(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        held = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    elif hasattr(value, "__qualname__"):  # a function or class
        return [getattr(value, "__module__", ""), value.__qualname__]
    elif hasattr(value, "__dict__"):
        held = vars(value)
    else:
        raise InvalidInputError(
            f"{name}: expected a dataclass or an object with attributes, by which a mission is "
            f"known again, got {type(value).__name__}"
        )
    kind = type(value)
    return [kind.__module__, kind.__qualname__, _described(held, name)]
