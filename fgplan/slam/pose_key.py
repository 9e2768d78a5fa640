"""Keys of the poses that SLAM estimates: readable, and apart from every landmark's.

A pose is a LabeledSymbol x, its label the robot's letter (A for the first, then B ... Z, a ... z),
its index counts the robot's poses from 0: ``xA0``, ``xA1``, ``xB0``. A Symbol ``x5`` has no label,
so it is another key.
"""

from string import ascii_lowercase, ascii_uppercase

from fgplan.errors import InvalidInputError
from fgplan.factors.keys import MAX_STEPS
from fgplan.typing import Key

_LETTERS = ascii_uppercase + ascii_lowercase
MAX_TEAM = len(_LETTERS)
"""Robots that have a letter."""


def pose_key(robot_index: int, count: int) -> Key:
    """Key of one pose of one robot.

    Args:
        robot_index: Place of the robot in the team's order, 0 to 51.
        count: Which of its poses, from 0.

    Returns:
        The key, unique for each pair.

    Raises:
        InvalidInputError: If either is out of range.
    """
    if not 0 <= robot_index < MAX_TEAM:
        raise InvalidInputError(f"robot_index: expected 0 to {MAX_TEAM - 1}, got {robot_index}")
    if not 0 <= count < MAX_STEPS:
        raise InvalidInputError(f"count: expected 0 to 2**48 - 1, got {count}")
    return ord("x") << 56 | ord(_LETTERS[robot_index]) << 48 | int(count)


def is_pose_key(key: Key) -> bool:
    """Tell whether a key has the form of a pose of SLAM, of whatever robot."""
    return int(key) >> 56 == ord("x") and chr(int(key) >> 48 & 0xFF) in _LETTERS
