"""Arrays on the wire: dtype, shape and raw little-endian bytes, column by column.

Nothing executes on reading. A column is checked against its own byte count before an array is
made of it, so that a huge shape in a small message allocates nothing.
"""

from math import prod
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from fgplan.errors import InvalidInputError

Size = Annotated[int, msgspec.Meta(ge=0, le=10_000_000)]
Shape = Annotated[tuple[Size, ...], msgspec.Meta(max_length=4)]
ItemType = Literal["<f8", "<i8", "<u8"]

ITEM_BYTES = 8


class ArrayData(msgspec.Struct, frozen=True, forbid_unknown_fields=True, array_like=True):
    """One column.

    Attributes:
        dtype: ``<f8``, ``<i8`` or ``<u8``.
        shape: At most four sizes.
        data: Bytes in C order.
    """

    dtype: ItemType
    shape: Shape
    data: bytes


def pack(values: Any, dtype: ItemType) -> ArrayData:  # noqa: ANN401 - anything NumPy takes
    """Column of an array-like of numbers."""
    array = np.ascontiguousarray(values, dtype=dtype)
    return ArrayData(dtype, array.shape, array.tobytes())


def unpack(column: ArrayData, name: str, dtype: ItemType, dimensions: tuple[int, ...]) -> NDArray:
    """Array of a column.

    Args:
        column: As received.
        name: Robot and field, for the message.
        dtype: Item type that the field must have.
        dimensions: Numbers of dimensions that the field may have.

    Returns:
        Read-only view of the bytes.

    Raises:
        InvalidInputError: If item type, dimensions or byte count are wrong.
    """
    if column.dtype != dtype:
        raise InvalidInputError(f"{name}: expected items {dtype}, got {column.dtype}")
    if len(column.shape) not in dimensions:
        raise InvalidInputError(
            f"{name}: expected {' or '.join(map(str, dimensions))} dimensions, got shape "
            f"{column.shape}"
        )
    wanted = prod(column.shape) * ITEM_BYTES
    if len(column.data) != wanted:
        raise InvalidInputError(
            f"{name}: expected {wanted} bytes for shape {column.shape}, got {len(column.data)}"
        )
    return np.frombuffer(column.data, dtype=dtype).reshape(column.shape)
