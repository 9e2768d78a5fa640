"""The reference of scenario files as lines: for a terminal, and as Markdown for ``docs``."""

import textwrap
from collections.abc import Sequence

from fgplan.io.field_words import FieldWords
from fgplan.io.scenario_fields import FieldTable

WIDTH = 100
_INTRODUCTION = """\
# Scenario files

A scenario is a TOML file, or YAML with the same tables. It says where the team is, what it knows,
what it wants and which planner plans; `fgplan run FILE` does the rest, and `fgplan check FILE`
says beforehand what is wrong. Unknown fields are refused by name. Lengths are in metres, angles
in radians, times in seconds. A pose in the plane is `[x, y, heading]`, one in space `[x, y, z,
qx, qy, qz, qw]`. File names count from the scenario's folder. A default of none, or None in a
sentence, is a field that is left out. Whole files to start from:
[examples/scenarios](../examples/scenarios), explained in [examples](../examples/README.md).

This page is what `fgplan fields --markdown` writes; `fgplan fields NAME` shows the options of one
planner. Numbers in brackets are equations of the planner's paper.
"""


def field_lines(tables: Sequence[FieldTable]) -> list[str]:
    """Tables for a terminal.

    Args:
        tables: What to show.

    Returns:
        Lines of at most 100 characters, but for long names.
    """
    lines: list[str] = []
    for table in tables:
        lines += [*([""] if lines else []), table.heading, *_wrapped(table.summary, 2)]
        for one in table.fields:
            lines += ["", *_wrapped(f"{one.name}: {one.type}; {_default(one)}", 2)]
            lines += _wrapped(one.meaning, 6)
        if table.notes:
            lines += ["", *(line for note in table.notes for line in _wrapped(note, 2))]
    return lines


def markdown_lines(
    tables: Sequence[FieldTable], names: dict[str, tuple[str, ...]] | None = None
) -> list[str]:
    """Tables as a page, or as a part of one.

    Args:
        tables: What to show.
        names: Registered names by what they name, for a whole page; None has no introduction.

    Returns:
        Lines.
    """
    lines = [] if names is None else _INTRODUCTION.splitlines()
    for what, known in (names or {}).items():
        listed = ", ".join(f"`{name}`" for name in known)
        lines += ["", *_wrapped(f"Registered {what}: {listed}.", 0)]
    for table in tables:
        title = table.heading if table.places == ("",) else f"`{table.heading}`"
        lines += [*([""] if lines else []), f"## {title}", "", *_wrapped(table.summary, 0)]
        if table.fields:
            lines += ["", "| field | type | default | meaning |", "| --- | --- | --- | --- |"]
        for one in table.fields:
            cells = (f"`{one.name}`", one.type, one.default, one.meaning)
            lines.append(f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |")
        for note in table.notes:
            lines += ["", *_wrapped(note, 0)]
    return lines


def _default(one: FieldWords) -> str:
    """What is taken if a field is left out."""
    return one.default if one.default == "required" else f"default {one.default}"


def _wrapped(text: str, indent: int) -> list[str]:
    """Text in lines."""
    space = " " * indent
    return textwrap.wrap(
        text,
        WIDTH,
        initial_indent=space,
        subsequent_indent=space,
        break_long_words=False,
        break_on_hyphens=False,
    )
