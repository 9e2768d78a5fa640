"""GTSAM keys as text in scenario files: ``x12`` a Symbol, ``aB3`` a LabeledSymbol, or a number."""

import re

import gtsam

from fgplan.io.place import Place
from fgplan.typing import Key

_SYMBOL = re.compile(r"([A-Za-z])([A-Za-z]?)(\d+)")


def read_key(name: str | int, place: Place) -> Key:
    """Read a key from a scenario.

    Args:
        name: ``x12``, ``aB3``, ``12`` or the number itself.
        place: Where it is, for messages.

    Returns:
        The key.

    Raises:
        ScenarioError: If it has none of these forms.
    """
    if isinstance(name, int):
        return name
    if name.isdecimal():
        return int(name)
    match = _SYMBOL.fullmatch(name)
    if match is None:
        raise place.error(f"expected a key such as 'x12', 'aB3' or 12, got {name!r}")
    letter, label, index = match.groups()
    if label:
        return int(gtsam.LabeledSymbol(ord(letter), ord(label), int(index)).key())
    return int(gtsam.symbol(letter, int(index)))
