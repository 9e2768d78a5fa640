"""A scenario as TOML text: plain tables in, a file that ``read_scenario`` reads back out.

Tables of numbers, text, true and false, lists and tables; a list of tables becomes ``[[name]]``,
every other list stands in one line. None is left out, as TOML has none.
"""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from fgplan.errors import InvalidInputError

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def scenario_text(tables: Mapping[str, Any], remarks: Sequence[str] = ()) -> str:
    """Write tables as TOML.

    Args:
        tables: The scenario as plain data.
        remarks: Lines to put above it as comments.

    Returns:
        The text.

    Raises:
        InvalidInputError: If a value has no form in TOML.
    """
    lines = [f"# {remark}" for remark in remarks]
    if lines:
        lines.append("")
    _write(tables, "", lines)
    return "\n".join(lines).strip() + "\n"


def _write(table: Mapping[str, Any], prefix: str, lines: list[str]) -> None:
    """One table: its plain values first, tables inside it after."""
    inner = []
    for name, value in table.items():
        key = name if _BARE.fullmatch(name) else json.dumps(name)
        if isinstance(value, Mapping) or _is_list_of_tables(value):
            inner.append((f"{prefix}{key}", value))
        elif value is not None:
            lines.append(f"{key} = {_value(value)}")
    for path, value in inner:
        for one in [value] if isinstance(value, Mapping) else value:
            lines += ["", f"[{path}]" if isinstance(value, Mapping) else f"[[{path}]]"]
            _write(one, f"{path}.", lines)


def _is_list_of_tables(value: object) -> bool:
    """Whether a value is a list of tables."""
    listed = isinstance(value, list | tuple) and len(value) > 0
    return listed and all(isinstance(item, Mapping) for item in value)  # type: ignore[attr-defined]


def _value(value: object) -> str:
    """One plain value."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):  # numpy's float64 is a float with another repr
        return repr(value if isinstance(value, int) else float(value))
    if isinstance(value, str):  # JSON's escapes are TOML's, but for DEL
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(item) for item in value)}]"
    raise InvalidInputError(f"scenario: expected plain values, got {type(value).__name__}")
