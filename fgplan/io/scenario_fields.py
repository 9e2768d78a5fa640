"""Every field of a scenario file, read from what checks the file: the reference of the format.

Tables that ``Scenario`` holds are found by their types. What it holds as plain tables is read where
its fields are checked: sensors and communication graphs by kind, the network, and the options of
every registered planner.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import msgspec

from fgplan.evaluation.registry import EVALUATORS
from fgplan.io.field_words import (
    KIND_MEANING,
    FieldWords,
    describe_fields,
    summary_of,
    value_words,
)
from fgplan.io.scenario import Scenario
from fgplan.io.sensor_table import SENSOR_KINDS, RelativePoseTable
from fgplan.models.uncertainty import UNCERTAINTY_FUNCTIONS
from fgplan.planners.option_tables import option_tables, planner_presets
from fgplan.planners.registry import PLANNERS, find_planner
from fgplan.team.communication_table import KINDS
from fgplan.team.network_options import NetworkOptions

_GRAPH_PLANNER = "distributed_aia"


@dataclass(frozen=True, slots=True)
class FieldTable:
    """One table of a scenario file.

    Attributes:
        places: Where it may stand, as ``team.network``; the empty name is the file itself.
        summary: What it is.
        fields: Its fields in their order.
        many: Whether it is a list of tables.
        notes: Plain sentences about several fields.
    """

    places: tuple[str, ...]
    summary: str
    fields: tuple[FieldWords, ...]
    many: bool = False
    notes: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """Its name as it stands in the file, and its kind where there are several."""
        if self.places == ("",):
            return "The file"
        opening, closing = ("[[", "]]") if self.many else ("[", "]")
        names = ", ".join(f"{opening}{place}{closing}" for place in self.places)
        kinds = [one.type for one in self.fields if one.meaning == KIND_MEANING]
        return f"{names} kind = {kinds[0]}" if kinds else names


def scenario_fields(planner: str | None = None) -> tuple[FieldTable, ...]:
    """Every field of a scenario file, or the options of one planner.

    Args:
        planner: Registered name or "module:object"; None is the whole file.

    Returns:
        Tables in the order of the file.

    Raises:
        UnknownNameError: If there is no such planner; lists those that are.
        InvalidInputError: If the object is no planner.
    """
    if planner is not None:
        return tuple(_planner_tables((planner,)))
    tables = [
        *_tables(Scenario, "", many=False),
        _planner_table(),
        *_planner_tables(tuple(PLANNERS)),
    ]
    return tuple({table.heading: table for table in tables}.values())  # two priors have a gauge


def registered_names() -> dict[str, tuple[str, ...]]:
    """Names that fields such as ``evaluator`` and ``function`` may have, beside a user's own.

    Returns:
        Registered names by what they name.
    """
    return {
        "planners": tuple(PLANNERS),
        "evaluators": tuple(EVALUATORS),
        "uncertainty functions": tuple(UNCERTAINTY_FUNCTIONS),
    }


def _tables(kind: type[msgspec.Struct], place: str, *, many: bool) -> Iterator[FieldTable]:
    """A table of the scenario, then those within it."""
    yield FieldTable((place,), summary_of(kind), describe_fields(kind), many)
    for name, hint in get_type_hints(kind, include_extras=True).items():
        within = f"{place}.{name}" if place else name
        for inner, listed in _structs(hint, listed=False):
            yield from _tables(inner, within, many=listed)
        yield from _plain_tables(within)


def _structs(hint: Any, *, listed: bool) -> Iterator[tuple[type[msgspec.Struct], bool]]:  # noqa: ANN401
    """Structs that a field holds, and whether it holds a list of them."""
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        yield hint, listed
        return
    inner = get_args(hint)[:1] if get_origin(hint) is Annotated else get_args(hint)
    for one in inner:
        yield from _structs(one, listed=listed or get_origin(hint) is tuple)


def _plain_tables(place: str) -> Iterator[FieldTable]:
    """Tables that the scenario holds unread, where another module checks their fields."""
    if place == "sensors":
        for kind, (table, model) in SENSOR_KINDS.items():
            yield _of_kind("sensors.NAME", kind, summary_of(model), describe_fields(table, model))
    if place == "team.multi_robot.sensor":
        found = describe_fields(RelativePoseTable)
        yield _of_kind(place, "relative_pose", summary_of(RelativePoseTable), found)
    if place == "team.network":
        yield FieldTable((place,), summary_of(NetworkOptions), describe_fields(NetworkOptions))


def _planner_table() -> FieldTable:
    """``[planner]`` itself."""
    name = FieldWords(
        "name",
        'text: a registered planner, or a user\'s own as "module:object"',
        "required",
        f"The planner: {', '.join(PLANNERS)}; its options are in the table of its name.",
    )
    return FieldTable(("planner",), "Which planner plans.", (name,))


def _planner_tables(names: tuple[str, ...]) -> Iterator[FieldTable]:
    """Options of planners; those with the same options share a table."""
    alike: dict[tuple[type, ...], list[str]] = {}
    for name in names:
        alike.setdefault(option_tables(find_planner(name)), []).append(name)
    for options, planners in alike.items():
        found = tuple(one for table in options for one in describe_fields(table))
        presets = planner_presets(find_planner(planners[0]))
        places = tuple(f"planner.{_quoted(name)}" for name in planners)
        summary = f"Options of {', '.join(f'`{name}`' for name in planners)}."
        if not found:
            summary += " It does not say which it takes: its class has no `option_tables`."
        yield FieldTable(
            places, summary, found, notes=tuple(map(_preset_note, presets, presets.values()))
        )
        if _GRAPH_PLANNER in planners:
            for kind, table in KINDS.items():
                graph = f"planner.{_GRAPH_PLANNER}.graph"
                yield _of_kind(graph, kind, summary_of(table), describe_fields(table))


def _of_kind(place: str, kind: str, summary: str, fields: tuple[FieldWords, ...]) -> FieldTable:
    """A table that is told from others by its kind."""
    return FieldTable(
        (place,),
        summary,
        (FieldWords("kind", value_words(kind), "required", KIND_MEANING), *fields),
    )


def _preset_note(name: str, changes: Mapping[str, Any]) -> str:
    """What a preset changes."""
    changed = ", ".join(f"{option} = {value_words(value)}" for option, value in changes.items())
    return f'`preset = "{name}"` changes defaults to: {changed}.'


def _quoted(name: str) -> str:
    """A planner's name as a part of a table's name."""
    return f'"{name}"' if ":" in name else name
