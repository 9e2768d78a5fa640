"""A path on a roadmap: the product that the searches and the trees hand on."""

from dataclasses import dataclass

import numpy as np

from roadmaps.checks import as_positions, read_only
from roadmaps.errors import ParameterError
from roadmaps.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class VertexPath:
    """Vertices in walking order, where they are, and how long the way is.

    Two paths are equal if their vertices and positions are.

    Attributes:
        vertices: Vertex ids from start to goal, length L + 1.
        positions: Position of each vertex, shape (L + 1, d), metres, world frame, read-only.
        length_m: Sum of the lengths of the edges walked, metres.

    Raises:
        ParameterError: If there is no vertex, or not one position a vertex.
    """

    vertices: tuple[int, ...]
    positions: FloatArray
    length_m: float

    def __post_init__(self) -> None:
        positions = as_positions(self.positions, None, "positions")
        if not self.vertices or len(positions) != len(self.vertices):
            raise ParameterError(
                f"positions: expected one row a vertex and at least one, got {len(positions)} "
                f"rows for {len(self.vertices)} vertices"
            )
        object.__setattr__(self, "positions", read_only(positions))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, VertexPath):
            return NotImplemented
        return self.vertices == other.vertices and np.array_equal(self.positions, other.positions)

    def __hash__(self) -> int:
        return hash(self.vertices)
