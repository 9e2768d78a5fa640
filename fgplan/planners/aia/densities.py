"""A user's own f_V and f_U in place of (8) and (9), checked where they are used.

Assumption 3.1: f_V(k | V) >= epsilon > 0 for every group at every iteration. Assumption 3.2:
f_U(u) >= zeta > 0 for every control. No finite run can show that one epsilon serves for all
iterations; what is checked at each draw is that every probability is at least the one declared and
that they sum to one. Both may change with the iteration.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.checks import check_finite
from fgplan.errors import InvalidInputError
from fgplan.typing import ArrayLike, FloatArray, IntArray

_SUM_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TreeView:
    """What a density may look at; arrays are views of the tree and must not be changed.

    Attributes:
        iteration: n, from 0.
        group_sizes: Number of nodes of each group, shape (K,).
        deepest: Groups that hold a node of greatest depth.
        depth: Greatest depth L_max.
        group: Group drawn (f_U), -1 before.
        time: Depth of the group's node inserted last (f_U).
        poses: Configuration of the group drawn, shape (N, 3) (f_U).
        assigned: Target of each robot there, shape (N,) (f_U).
        covariances: There, shape (M, 2, 2) or (n, n) (f_U).
        places: Predicted places of the targets one step later, shape (M, 2) (f_U).
        feasible: Whether a feasible plan is known.
    """

    iteration: int
    group_sizes: IntArray
    deepest: IntArray
    depth: int
    group: int
    time: int
    poses: FloatArray
    assigned: IntArray
    covariances: FloatArray
    places: FloatArray
    feasible: bool


GroupDensity = Callable[[TreeView], ArrayLike]
"""f_V: probability of each group, shape (K,)."""

ControlDensity = Callable[[TreeView], Sequence[ArrayLike]]
"""f_U: for each robot the probability of each of its controls, shape (U_j,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Densities:
    """A user's own densities; None keeps the paper's.

    Attributes:
        groups: f_V.
        controls: f_U.
        least_group: Epsilon of Assumption 3.1: every probability must be at least this, above zero.
        least_control: Zeta of Assumption 3.2, of each robot's own controls.
    """

    groups: GroupDensity | None = None
    controls: ControlDensity | None = None
    least_group: float = 0.0
    least_control: float = 0.0

    def group_probabilities(self, view: TreeView) -> FloatArray:
        """f_V, checked.

        Args:
            view: The tree.

        Returns:
            Shape (K,).

        Raises:
            InvalidInputError: If Assumption 3.1 does not hold.
        """
        assert self.groups is not None
        return _checked(
            self.groups(view), len(view.group_sizes), self.least_group, "f_V", "3.1", "group"
        )

    def control_probabilities(self, view: TreeView, counts: Sequence[int]) -> list[FloatArray]:
        """f_U, checked.

        Args:
            view: The tree and the group drawn.
            counts: Number of controls of each robot.

        Returns:
            One array a robot, shape (U_j,).

        Raises:
            InvalidInputError: If Assumption 3.2 does not hold.
        """
        assert self.controls is not None
        given = self.controls(view)
        if len(given) != len(counts):
            raise InvalidInputError(
                f"f_U: expected one array of probabilities a robot ({len(counts)}), got "
                f"{len(given)}"
            )
        return [
            _checked(one, count, self.least_control, f"f_U of robot {j}", "3.2", "control")
            for j, (one, count) in enumerate(zip(given, counts, strict=True))
        ]


def _checked(
    given: ArrayLike, size: int, least: float, name: str, assumption: str, what: str
) -> FloatArray:
    """Probabilities that an assumption allows."""
    values = check_finite(given, name, (size,))
    worst = int(np.argmin(values))
    if not (values[worst] > 0.0 and values[worst] >= least):
        raise InvalidInputError(
            f"{name}: Assumption {assumption}(i): expected a probability of at least "
            f"{least or 'more than 0'} for every {what}, got {values[worst]:g} for {what} {worst}; "
            "mix in a uniform density"
        )
    if abs(values.sum() - 1.0) > _SUM_TOLERANCE:
        raise InvalidInputError(f"{name}: expected probabilities that sum to 1, got {values.sum()}")
    return values
