"""Which fields a table of a scenario has, so that a message can list them.

A place such as ``$.robots[3].motion`` is walked through msgspec's own description of the types.
"""

import re
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
    node: Any = _plain(inspect.type_info(kind), raw)
    for name, index in STEP.findall(place):
        if isinstance(node, inspect.StructType):
            found = [field.type for field in node.fields if field.encode_name == name]
            node = found[0] if found else None
        elif isinstance(node, inspect.DictType):
            node = node.value_type
        else:
            node = getattr(node, "item_type", None)
        raw = _inner(raw, name or int(index))
        node = _plain(node, raw)
    if not isinstance(node, inspect.StructType):
        return ()
    tag = (node.tag_field,) if node.tag_field is not None else ()
    return (*tag, *(field.encode_name for field in node.fields))


def _inner(raw: Any, step: str | int) -> Any:  # noqa: ANN401
    """Content one step further in, or None."""
    try:
        return raw[step]
    except (LookupError, TypeError):
        return None


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
