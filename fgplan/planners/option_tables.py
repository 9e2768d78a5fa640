"""Which options ``[planner.NAME]`` takes: the fields of the dataclasses that a planner names.

A planner names them as ``option_tables``, and as ``presets`` what a preset changes of the defaults.
The same lists check a scenario and are printed by ``fgplan fields``, so neither has a field that
the other has not. A user's own planner may name its tables too.
"""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from fgplan.errors import OptionError


def option_tables(planner: object) -> tuple[type, ...]:
    """Dataclasses whose fields are a planner's options.

    Args:
        planner: Any planner.

    Returns:
        The dataclasses in their order; none if it does not say.
    """
    return tuple(getattr(planner, "option_tables", ()))


def planner_presets(planner: object) -> dict[str, Mapping[str, Any]]:
    """What each preset of a planner changes of the defaults.

    Args:
        planner: Any planner.

    Returns:
        Changed options by name of the preset; none if it has no presets.
    """
    return dict(getattr(planner, "presets", {}))


def option_names(tables: Sequence[type]) -> tuple[str, ...]:
    """Names of all options of some tables.

    Args:
        tables: Dataclasses.

    Returns:
        Names in the order of the tables.
    """
    return tuple(option.name for table in tables for option in fields(table))


def check_option_names(given: Mapping[str, Any], tables: Sequence[type], planner: str) -> None:
    """Refuse an option that a planner does not have.

    Args:
        given: Options by name.
        tables: Dataclasses whose fields are known.
        planner: Name of the planner, for the message.

    Raises:
        OptionError: If a name is not known; lists those that are, near names first.
    """
    known = option_names(tables)
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known)
            listed = ", ".join([*near, *(one for one in known if one not in near)])
            remedy = f"; did you mean {near[0]!r}?" if near else ""
            raise OptionError(
                f"option {name!r} of planner {planner!r}: expected one of {listed}{remedy}"
            )
