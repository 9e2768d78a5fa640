"""Which fields a table of a scenario has, and which values a field, so that messages can list them.

A place such as ``$.robots[3].motion`` is walked through msgspec's own description of the types.
"""

import re
from collections.abc import Iterable
from typing import Any

import msgspec.inspect as inspect

STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]")
"""One step of a place: a field's name, or an index."""


def table_fields(kind: type, raw: Any, place: str) -> tuple[str, ...]:  # noqa: ANN401
    """Names of the fields of the table at a place.

    Args:
        kind: Type of the outermost table.
        raw: Its raw content; a table of several kinds is told by its tag.
        place: The place within it, ``$`` for itself.

    Returns:
        The names in their order; none where the place is no table of fixed fields.
    """
    node, raw = _walk(kind, raw, STEP.findall(place))
    node = _plain(node, raw)
    if not isinstance(node, inspect.StructType):
        return ()
    tag = (node.tag_field,) if node.tag_field is not None else ()
    return (*tag, *(field.encode_name for field in node.fields))


def field_values(kind: type, raw: Any, place: str) -> tuple[tuple[str | int, ...], bool]:  # noqa: ANN401
    """Values of a field that takes a few only.

    Args:
        kind: Type of the outermost table.
        raw: Its raw content.
        place: The field; one that tells tables of several kinds apart takes their tags.

    Returns:
        The values, none where any will do; and whether a list is taken too.
    """
    *outer, (name, _) = STEP.findall(place)
    table, inner = _walk(kind, raw, outer)
    tags = [
        part.tag
        for part in _parts(table)
        if isinstance(part, inspect.StructType) and part.tag_field == name and part.tag is not None
    ]
    table = _plain(table, inner)
    if tags or not isinstance(table, inspect.StructType):
        return tuple(sorted(tags, key=str)), False
    parts = [
        part for field in table.fields if field.encode_name == name for part in _parts(field.type)
    ]
    values: list[str | int] = []
    for part in parts:
        if isinstance(part, inspect.LiteralType):
            values += [one for one in part.values if isinstance(one, str | int)]
    return tuple(values), any(isinstance(part, inspect.VarTupleType) for part in parts)


def _walk(kind: type, raw: Any, steps: Iterable[tuple[str, str]]) -> tuple[Any, Any]:  # noqa: ANN401
    """Type and content some steps further in."""
    node: Any = inspect.type_info(kind)
    for name, index in steps:
        node = _plain(node, raw)
        if isinstance(node, inspect.StructType):
            found = [field.type for field in node.fields if field.encode_name == name]
            node = found[0] if found else None
        elif isinstance(node, inspect.DictType):
            node = node.value_type
        else:
            node = getattr(node, "item_type", None)
        raw = _inner(raw, name or int(index))
    return node, raw


def _inner(raw: Any, step: str | int) -> Any:  # noqa: ANN401
    """Content one step further in, or None."""
    try:
        return raw[step]
    except (LookupError, TypeError):
        return None


def _parts(node: Any) -> list[Any]:  # noqa: ANN401
    """The types of a union, or the one that it is, without constraints."""
    if isinstance(node, inspect.Metadata):
        return _parts(node.type)
    if isinstance(node, inspect.UnionType):
        return [part for one in node.types for part in _parts(one)]
    return [node]


def _plain(node: Any, raw: Any) -> Any:  # noqa: ANN401
    """A type without its constraints; of a union the table that the content's tag names."""
    if isinstance(node, inspect.Metadata):
        return _plain(node.type, raw)
    if not isinstance(node, inspect.UnionType):
        return node
    parts = [_plain(part, raw) for part in node.types]
    tables = [part for part in parts if isinstance(part, inspect.StructType)]
    for table in tables:
        if isinstance(raw, dict) and raw.get(table.tag_field) == table.tag:
            return table
    others = [part for part in parts if not isinstance(part, inspect.NoneType)]
    return (tables or others)[0]
