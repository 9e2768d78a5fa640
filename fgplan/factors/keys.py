"""GTSAM keys: how they are read by people, and which of them fgplan keeps for itself.

A key is 64 bits. GTSAM packs a Symbol as character (8 bits) and index (56 bits), and a
LabeledSymbol as character (8), label (8) and index (48). fgplan's own variables, the poses of
robots along the paths that they may follow, are LabeledSymbols with the reserved character ``~``:

    key = ord("~") << 56 | robot_index << 48 | step          step = 1, 2, ...

No other key of a problem may begin with ``~``. Step 0 has no key of its own: it is the robot's
present pose, a key of the user's.
"""

from collections.abc import Iterable

from fgplan.errors import InvalidInputError
from fgplan.typing import Key

FUTURE_CHARACTER = "~"
"""First character of every key that fgplan makes; refused in the user's graphs."""

MAX_ROBOTS = 2**8
MAX_STEPS = 2**48
_FUTURE_PREFIX = ord(FUTURE_CHARACTER) << 56


def symbol_key(character: str, index: int) -> Key:
    """GTSAM's Symbol, as ``gtsam.symbol`` makes it.

    Args:
        character: One ASCII character.
        index: 0 or more.

    Returns:
        The key.
    """
    return (ord(character) << 56) | index


def describe_key(key: Key) -> str:
    """Name a key as its maker would write it.

    Args:
        key: A GTSAM key.

    Returns:
        ``x12`` for a Symbol, ``aB3`` for a LabeledSymbol, digits for a plain integer, and
        ``~0.7`` for fgplan's own pose of robot 0 at look-ahead step 7.
    """
    key = int(key)
    character, label, index = key >> 56, (key >> 48) & 0xFF, key & (MAX_STEPS - 1)
    if is_future_key(key):
        return f"{FUTURE_CHARACTER}{label}.{index}"
    if not 32 < character < 127:
        return str(key)
    if label == 0:
        return f"{chr(character)}{index}"
    if 32 < label < 127:
        return f"{chr(character)}{chr(label)}{index}"
    return f"{chr(character)}{key & (2**56 - 1)}"


def describe_keys(keys: Iterable[Key], limit: int = 6) -> str:
    """Name several keys, at most ``limit`` of them."""
    names = [describe_key(key) for key in keys]
    shown = ", ".join(names[:limit])
    return shown if len(names) <= limit else f"{shown} and {len(names) - limit} more"


def future_key(robot_index: int, step: int) -> Key:
    """Key of a robot's pose at a look-ahead step of whatever path it follows.

    Args:
        robot_index: Place of the robot in the team's order, 0 to 255.
        step: Look-ahead step, 1 or more; step 0 is the robot's present pose, the user's own key.

    Returns:
        The key; unique for each (robot_index, step).

    Raises:
        InvalidInputError: If either is out of range.
    """
    if not 0 <= robot_index < MAX_ROBOTS:
        raise InvalidInputError(f"robot_index: expected 0 to {MAX_ROBOTS - 1}, got {robot_index}")
    if not 1 <= step < MAX_STEPS:
        raise InvalidInputError(
            f"step: expected 1 to 2**48 - 1, got {step}; "
            "step 0 is the robot's present pose, which has the user's own key"
        )
    return _FUTURE_PREFIX | (int(robot_index) << 48) | int(step)


def is_future_key(key: Key) -> bool:
    """Tell whether a key has fgplan's reserved form."""
    return int(key) >> 56 == ord(FUTURE_CHARACTER)


def check_no_future_keys(keys: Iterable[Key]) -> None:
    """Refuse keys of the reserved form in what a user passes in.

    Raises:
        InvalidInputError: Naming the first such key.
    """
    for key in keys:
        if is_future_key(key):
            raise InvalidInputError(
                f"key {describe_key(key)} ({int(key)}): symbols that begin with "
                f"'{FUTURE_CHARACTER}' are kept for fgplan's own look-ahead poses; "
                "use another character, as in gtsam.symbol('x', 0)"
            )
