"""What planning and estimation ask of a model of the state: one interface, two implementations.

``BlockModel`` has compiled kernels for independent targets and built-in sensors, ``DenseModel``
takes users' own.
"""

from collections.abc import Sequence
from typing import Protocol

from fgplan.planners.intermittent.cost_task import CostTask
from fgplan.planners.intermittent.estimate import Estimate, Filtered, Record
from fgplan.typing import FloatArray


class StateModel(Protocol):
    """How the state moves, is measured and estimated, and what paths cost."""

    @property
    def metric(self) -> str:
        """Name of the uncertainty function."""

    @property
    def every(self) -> int:
        """Steps between measurements."""

    @property
    def size(self) -> int:
        """Number of coordinates n of the state."""

    def predicted_means(self, estimate: Estimate, steps: int) -> FloatArray:
        """Open-loop means from an estimate on.

        Args:
            estimate: Where to start.
            steps: Number of steps.

        Returns:
            Shape (steps + 1, n).
        """

    def uncertainties(self, covariance: FloatArray) -> FloatArray:
        """Uncertainty of each target, or other part of the state that is judged for itself.

        Args:
            covariance: As an ``Estimate`` of the model has it.

        Returns:
            Shape (M,).
        """

    def target_places(self, mean: FloatArray) -> FloatArray:
        """Where these are, seen from above.

        Args:
            mean: Shape (n,).

        Returns:
            Shape (M, 2), metres.
        """

    def observation_count(self, robot: int) -> int:
        """Number of things that a robot can measure.

        Args:
            robot: Its row.
        """

    def reading_size(self, robot: int, index: int, state: FloatArray, position: FloatArray) -> int:
        """Numbers that a measurement has.

        Args:
            robot: Its row.
            index: Of the thing measured.
            state: Any state, shape (n,).
            position: Any place, shape (2,), metres.
        """

    def measure(
        self, robot: int, state: FloatArray, position: FloatArray, normals: FloatArray
    ) -> tuple[tuple[int, tuple[float, ...]], ...]:
        """What a robot measures of the true state.

        Args:
            robot: Its row.
            state: Shape (n,).
            position: Of the robot, shape (2,), metres.
            normals: Standard normal numbers, shape (observation_count, 3).

        Returns:
            Index and value of each measurement, ascending.
        """

    def run(
        self, estimate: Estimate, until: int, records: Sequence[tuple[int, Record]]
    ) -> Filtered:
        """Filter on with records of the steps after the estimate.

        Args:
            estimate: Where to start.
            until: Last step.
            records: Robot and record, in order of time, then of robot.

        Returns:
            The estimate at ``until`` and the way there.
        """

    def cost_pairs(self, task: CostTask) -> None:
        """Algorithm 4 for pairs of a parent and a child: fills ``costs`` and ``covariances``.

        Args:
            task: The pairs, and room for what is found.
        """
