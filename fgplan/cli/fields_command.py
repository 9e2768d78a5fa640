"""``fgplan fields [PLANNER]``: every field of a scenario file, or the options of one planner."""

from pathlib import Path

from fgplan.io.field_text import field_lines, markdown_lines
from fgplan.io.place import Place
from fgplan.io.scenario_fields import registered_names, scenario_fields
from fgplan.io.user_object import is_object_name, load_object


def show_fields(planner: str | None, *, markdown: bool) -> list[str]:
    """Lines that the command prints.

    Args:
        planner: Registered name, or "module:object" of a user's own, for which the working folder
            is searched first; None is the whole file.
        markdown: Whether as Markdown, the whole file as the page ``docs/scenarios.md``.

    Returns:
        The lines.

    Raises:
        UnknownNameError: If there is no such planner; lists those that are.
        ScenarioError: If a user's own cannot be imported.
        InvalidInputError: If the object is no planner.
    """
    if planner is not None and is_object_name(planner):
        load_object(planner, Place(Path("fgplan fields")).at("planner.name"))
    tables = scenario_fields(planner)
    if not markdown:
        return field_lines(tables)
    return markdown_lines(tables, registered_names() if planner is None else None)
