"""Types and defaults of a table's fields in plain words, meanings from its docstring.

Tables are msgspec structs (what a scenario holds) and dataclasses (options); both are read by their
type hints, so that a field is described by what checks it.
"""

import dataclasses
import inspect
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

_ATTRIBUTES = re.compile(r"^Attributes:\n((?:[ ]+.*\n?|\n)*)", re.MULTILINE)
_ATTRIBUTE = re.compile(r"^ {4}(\w+): (.*(?:\n {5,}.*)*)", re.MULTILINE)
_WORDS = {bool: "true or false", int: "whole number", float: "number", str: "text", Path: "file"}
_PLURAL = {bool: "true or false", int: "whole numbers", float: "numbers", str: "texts"}
KIND_MEANING = "Which table this is."
"""Meaning of the field by which a table is told from others in its place."""


@dataclass(frozen=True, slots=True)
class FieldWords:
    """One field as a reader sees it.

    Attributes:
        name: Its name in the file.
        type: What it holds.
        default: What is taken if it is left out; "required" if it may not be.
        meaning: Sentence of the docstring.
    """

    name: str
    type: str
    default: str
    meaning: str


def describe_fields(table: type, *more: type) -> tuple[FieldWords, ...]:
    """Describe the fields of a table.

    Args:
        table: A msgspec struct or a dataclass; the tag of a struct that has one comes first.
        *more: Classes whose docstrings say what the table's own leaves unsaid.

    Returns:
        The fields in their order.
    """
    hints = get_type_hints(table, include_extras=True)
    meanings: dict[str, str] = {}
    for documented in (*more, table):
        meanings |= _meanings(documented)
    described = []
    if issubclass(table, msgspec.Struct):
        tag = table.__struct_config__
        if tag.tag_field is not None:
            described.append(
                FieldWords(tag.tag_field, value_words(tag.tag), "required", KIND_MEANING)
            )
        absent: object = msgspec.NODEFAULT
        found = [
            (one.name, one.default, one.default_factory) for one in msgspec.structs.fields(table)
        ]
    else:
        absent = dataclasses.MISSING
        options: Any = table
        found = [
            (one.name, one.default, one.default_factory) for one in dataclasses.fields(options)
        ]
    for name, default, factory in found:
        words = "required"
        if default is not absent:
            words = value_words(default)
        elif factory is not absent:
            words = value_words(factory())
        described.append(FieldWords(name, type_words(hints[name]), words, meanings.get(name, "")))
    return tuple(described)


def summary_of(table: type) -> str:
    """What a table's docstring says before its attributes, without the name it begins with.

    Args:
        table: Any class.

    Returns:
        Plain text; paragraphs are joined.
    """
    text = re.split(r"^(?:Attributes|Raises):$", _docstring(table), flags=re.MULTILINE)[0]
    text = " ".join(_plain(text).split())
    text = re.sub(r"\A`[^`\n]*`(?: and `[^`\n]*`)?(?:: |\.)", "", text).strip()
    return text[:1].upper() + text[1:]


def type_words(hint: Any, *, many: bool = False) -> str:  # noqa: ANN401 - any type
    """A type in plain words.

    Args:
        hint: The type hint, with msgspec's constraints.
        many: Whether the words are for several of it.

    Returns:
        Words such as "list of 3 to 6 numbers from 0 up".
    """
    limits: dict[str, Any] = {}
    if get_origin(hint) is Annotated:
        hint, *metas = get_args(hint)
        for meta in metas:
            limits |= {
                name: getattr(meta, name)
                for name in ("gt", "ge", "lt", "min_length", "max_length", "pattern")
                if getattr(meta, name, None) is not None
            }
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Literal:
        return _either([value_words(value) for value in inner])
    if origin in (Union, UnionType):
        parts = [part for part in inner if part is not NoneType]
        return _either(list(dict.fromkeys(type_words(part, many=many) for part in parts)))
    if origin is tuple and inner[-1] is not Ellipsis:
        return f"[{', '.join(type_words(part) for part in inner)}]"
    if origin in (tuple, list):
        name = "lists" if many else "list"
        return f"{name} of {_count(limits)}{type_words(inner[0], many=True)}"
    if origin in (dict, Mapping) and inner[-1] is not Any:
        held = type_words(inner[-1], many=True).removesuffix(" by name")
        return f"{'tables' if many else 'table'} of {held} by name"
    if hint in _WORDS:
        return _word(hint, many=many) + _bounds(limits)
    return "tables" if many else "table"


def value_words(value: Any) -> str:  # noqa: ANN401 - any default
    """A value as a scenario would say it.

    Args:
        value: A default, or one of the values that a field may have.

    Returns:
        TOML where that can say it, else plain words.
    """
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return "no limit" if math.isinf(value) else f"{value:.6g}"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple | list):
        return f"[{', '.join(value_words(item) for item in value)}]"
    if isinstance(value, msgspec.Struct):
        tag = value.__struct_config__
        return "its defaults" if tag.tag is None else f"{tag.tag_field} = {value_words(tag.tag)}"
    return "{}" if isinstance(value, Mapping) else str(value)


def _word(kind: type, *, many: bool) -> str:
    """One word for a plain type."""
    return _PLURAL.get(kind, f"{_WORDS[kind]}s") if many else _WORDS[kind]


def _bounds(limits: Mapping[str, Any]) -> str:
    """What a number or a text may be."""
    if "pattern" in limits:
        return f" like {limits['pattern']}"
    if "gt" in limits:
        return f" above {limits['gt']}"
    if "ge" not in limits:
        return ""
    return f" from {limits['ge']}" + (f" to below {limits['lt']}" if "lt" in limits else " up")


def _count(limits: Mapping[str, Any]) -> str:
    """How many a list may hold."""
    least, most = limits.get("min_length"), limits.get("max_length")
    if most is not None:
        return f"{least or 0} {'or' if most - (least or 0) == 1 else 'to'} {most} "
    return "" if least is None else f"{least} or more "


def _either(words: list[str]) -> str:
    """Words joined by commas and an or."""
    return words[-1] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def _meanings(table: type) -> dict[str, str]:
    """Sentences by attribute, of a class and of those that it inherits from."""
    found: dict[str, str] = {}
    for kind in reversed(table.__mro__):
        section = _ATTRIBUTES.search(_docstring(kind))
        if section is not None and kind.__module__ != "msgspec":
            found |= {
                name: " ".join(_plain(text).split())
                for name, text in _ATTRIBUTE.findall(section.group(1))
            }
    return found


def _docstring(table: type) -> str:
    """A class's own docstring."""
    return inspect.cleandoc(table.__dict__.get("__doc__") or "")


def _plain(text: str) -> str:
    """Text with single marks about code, as Markdown and readers have it."""
    return text.replace("``", "`")
