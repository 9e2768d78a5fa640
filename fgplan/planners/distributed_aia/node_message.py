"""What a robot tells its neighbours after each sweep: the nodes that it has made.

Remark 2 of Tzes et al. 2021 asks and answers: robot i sends the set S_i, and gets one covariance of
each neighbour. Here a robot sends each new node once, unasked, so that a neighbour draws among
them by itself: the same covariances travel, in one trip instead of two, and a message that is lost
or late leaves the trees valid.

A robot that notices a hole in what it has of a neighbour says so in its next message, and gets the
nodes again from there: without them it could never follow the neighbour beyond the hole.

A node is 4 bytes for its parent, 4 for its depth, 2 for its target, 16 for its position and 24 a
target for its covariance.
"""

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.message_reader import MessageReader
from fgplan.typing import FloatArray, IntArray

_PARTS: tuple[tuple[str, Any], ...] = (
    ("parents", np.dtype("<i4")),
    ("depths", np.dtype("<i4")),
    ("covariances", np.dtype("<f8")),
    ("assigned", np.dtype("<u2")),
    ("positions", np.dtype("<f8")),
)
MOST_NODES = 2**31 - 1
_LARGEST = 1e100


class Nodes(NamedTuple):
    """Consecutive nodes of one robot's tree as arrays, checked.

    Attributes:
        first: Number of the first one.
        wants: First node of the receiver's tree that the sender misses; -1 for none.
        parents: Shape (n,), -1 for the root.
        depths: Steps from the root, shape (n,).
        covariances: (xx, xy, yy) of each target before measuring there, square metres, (n, 3 M).
        assigned: Target of the robot, shape (n,).
        positions: Of the robot, shape (n, 2), metres, world frame.
    """

    first: int
    wants: int
    parents: IntArray
    depths: IntArray
    covariances: FloatArray
    assigned: IntArray
    positions: FloatArray


class NodeMessage(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag="nodes.v1",
    tag_field="schema",
):
    """``Nodes`` on the wire.

    Attributes:
        first: Number of the first one.
        wants: First node of the receiver's tree that the sender misses; -1 for none.
        parents: Number of each one's parent, -1 for the root.
        depths: Steps from the root.
        covariances: (xx, xy, yy) of each target, square metres, before measuring there.
        assigned: Target of the robot.
        positions: Of the robot, metres, world frame.
    """

    first: Annotated[int, msgspec.Meta(ge=0, le=MOST_NODES)]
    wants: Annotated[int, msgspec.Meta(ge=-1, le=MOST_NODES)]
    parents: bytes
    depths: bytes
    covariances: bytes
    assigned: bytes
    positions: bytes

    @classmethod
    def of(cls, nodes: Nodes) -> "NodeMessage":
        """A message of arrays.

        Args:
            nodes: The nodes.
        """
        parts = {
            name: np.ascontiguousarray(getattr(nodes, name), dtype=kind).tobytes()
            for name, kind in _PARTS
        }
        return cls(first=nodes.first, wants=nodes.wants, **parts)

    def __len__(self) -> int:
        """Number of nodes."""
        return len(self.parents) // 4

    @property
    def byte_size(self) -> int:
        """Bytes of the message as msgpack, without its envelope."""
        return len(msgspec.msgpack.encode(self))

    def nodes(self, targets: int) -> Nodes:
        """The nodes, checked.

        Args:
            targets: Number of targets M.

        Returns:
            Arrays.

        Raises:
            InvalidInputError: If sizes do not fit each other, a number is not finite, a covariance
                is not positive definite or its inverse has no bound, a parent does not come before
                its child, or a depth is not one more than the parent's.
        """
        count = len(self)
        parts = dict(self._read(count, targets))
        parents, depths, covariances = parts["parents"], parts["depths"], parts["covariances"]
        covariances = covariances.reshape(count, 3 * targets)
        positions = parts["positions"].reshape(count, 2)
        numbers = self.first + np.arange(count)
        least = np.where(numbers == 0, -1, 0)
        if ((parents < least) | (parents >= numbers)).any() or (
            (depths == 0) != (numbers == 0)
        ).any():
            raise InvalidInputError("nodes: expected each parent before its child, and one root")
        if (depths < 0).any() or (parts["assigned"] >= targets).any():
            raise InvalidInputError(
                f"nodes: expected depths of at least 0 and targets below {targets}"
            )
        inside = parents >= max(self.first, 0)
        if (depths[inside] != depths[parents[inside] - self.first] + 1).any():
            raise InvalidInputError("nodes: expected depths one more than those of the parents")
        if not np.isfinite(covariances).all() or not np.isfinite(positions).all():
            raise InvalidInputError("nodes: expected finite covariances and positions")
        xx, xy, yy = covariances[:, 0::3], covariances[:, 1::3], covariances[:, 2::3]
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            determinants, traces = xx * yy - xy * xy, xx + yy
            # An inverse that overflows would spread over the receiver's own tree.
            usable = (traces < _LARGEST) & (traces / determinants < _LARGEST)
        if not ((xx > 0.0) & (determinants > 0.0)).all():
            raise InvalidInputError("nodes: expected positive definite covariances")
        if not usable.all():
            raise InvalidInputError(
                f"nodes: expected traces of covariances and their inverses below {_LARGEST:g}"
            )
        return Nodes(
            self.first, self.wants, parents, depths, covariances, parts["assigned"], positions
        )

    def _read(self, count: int, targets: int) -> Iterator[tuple[str, Any]]:
        """Every part as an array, its size checked."""
        wide = {"covariances": 3 * targets, "positions": 2}
        for name, kind in _PARTS:
            data = getattr(self, name)
            expected = count * wide.get(name, 1) * kind.itemsize
            if len(data) != expected:
                raise InvalidInputError(
                    f"nodes: {name}: expected {expected} bytes for {count} nodes, got {len(data)}"
                )
            yield name, np.frombuffer(data, dtype=kind)


_READER: MessageReader[NodeMessage] = MessageReader(NodeMessage)


def read_nodes(data: bytes, targets: int) -> Nodes:
    """Read a message of nodes.

    Args:
        data: Payload of an envelope.
        targets: Number of targets M.

    Returns:
        The nodes, checked.

    Raises:
        InvalidInputError: If it is malformed, or ``NodeMessage.nodes`` refuses what is in it.
    """
    return _READER.read(data, "nodes").nodes(targets)
