"""Products as plain JSON values: dictionaries, lists, numbers, text.

JSON has no nan and no infinity: both become null (an objective value that a bound excluded is
infinite; a term that was not computed is nan).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.errors import InvalidInputError


def plain_value(value: object, name: str = "result") -> Any:  # noqa: ANN401 - JSON
    """Turn a value into what JSON holds.

    Args:
        value: Numbers, text, arrays, dataclasses, mappings, sequences, sets of text, paths.
        name: What it is, for the message.

    Returns:
        The plain value; arrays become nested lists, sets sorted lists, keys of mappings text.

    Raises:
        InvalidInputError: If something inside has no plain form; names where.
    """
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.generic | np.ndarray):
        return plain_value(value.tolist(), name)
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            field.name: plain_value(getattr(value, field.name), f"{name}.{field.name}")
            for field in dataclasses.fields(value)
        }
    if isinstance(value, Mapping):
        return {str(key): plain_value(item, f"{name}.{key}") for key, item in value.items()}
    if isinstance(value, set | frozenset):
        return [plain_value(item, name) for item in sorted(value)]
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray):
        return [plain_value(item, f"{name}[{index}]") for index, item in enumerate(value)]
    raise InvalidInputError(
        f"{name}: expected numbers, text, arrays or dataclasses, got {type(value).__name__}"
    )
