"""``fgplan fields [PLANNER]``: every field of a scenario file, or the options of one planner."""

from fgplan.io.field_text import field_lines, markdown_lines
from fgplan.io.scenario_fields import registered_names, scenario_fields


def show_fields(planner: str | None, *, markdown: bool) -> list[str]:
    """Lines that the command prints.

    Args:
        planner: Registered name or "module:object"; None is the whole file.
        markdown: Whether as Markdown, the whole file as the page ``docs/scenarios.md``.

    Returns:
        The lines.

    Raises:
        UnknownNameError: If there is no such planner; lists those that are.
        InvalidInputError: If the object is no planner.
    """
    tables = scenario_fields(planner)
    if not markdown:
        return field_lines(tables)
    return markdown_lines(tables, registered_names() if planner is None else None)
