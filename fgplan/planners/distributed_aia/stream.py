"""A robot's own random numbers, drawn beforehand, so that compiled code can hold many robots'.

Compiled code can take one ``numpy.random.Generator``, not one a robot. Each robot's numbers are
drawn from its own generator a block at a time; ``random`` hands them out in order. So a robot's
tree depends on its own numbers alone: not on who else is planned in the same process.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload_method

from fgplan.typing import FloatArray, IntArray

BLOCK = 8192
"""Numbers drawn at a time."""
RESERVE = 1024
"""Numbers that an iteration may count on, beside those for its nodes' candidates."""


class Stream(NamedTuple):
    """Numbers of one robot.

    Attributes:
        numbers: Uniform in [0, 1), shape (B,).
        place: Of the next one, shape (1,).
    """

    numbers: FloatArray
    place: IntArray

    def random(self) -> float:
        """The next number; whoever calls has made sure that there is one."""
        number = self.numbers[self.place[0]]
        self.place[0] += 1
        return float(number)


@overload_method(types.NamedTuple, "random")
def _random(stream: Any) -> Any:  # noqa: ANN401 - numba's types
    """``Stream.random`` compiled."""
    if getattr(stream, "instance_class", None) is not Stream:
        return None

    def handed_out(stream: Any) -> Any:  # noqa: ANN401 - numba wants the same annotations
        number = stream.numbers[stream.place[0]]
        stream.place[0] += 1
        return number

    return handed_out


def refilled(
    numbers: FloatArray, place: IntArray, generators: tuple[np.random.Generator, ...], least: int
) -> FloatArray:
    """Blocks with at least so many numbers left in each row; numbers not used yet come first.

    Args:
        numbers: Shape (R, B).
        place: Of each row's next number, shape (R, 1); set to the new places.
        generators: One a row.
        least: Numbers that must be left.

    Returns:
        Shape (R, B'), B' at least B.
    """
    size = max(numbers.shape[1], BLOCK, 2 * least)
    fresh = np.empty((len(numbers), size))
    for row, generator in enumerate(generators):
        left = numbers[row, place[row, 0] :]
        fresh[row, : len(left)] = left
        fresh[row, len(left) :] = generator.random(size - len(left))
    place[:] = 0
    return fresh
