"""Independent targets and built-in sensors: ``StateModel`` by the compiled filter over blocks.

What a robot can measure is numbered sensor by sensor, target by target: index = c M + i for its
sensor c and target i of M.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.models.hidden_state import HiddenState
from fgplan.models.sensor import AbstractSensor
from fgplan.planners.aia.obstacle_arrays import obstacle_arrays
from fgplan.planners.aia.obstacle_kernels import Obstacles
from fgplan.planners.intermittent.cost_task import CostTask
from fgplan.planners.intermittent.estimate import Estimate, Filtered, Record
from fgplan.planners.intermittent.filter_kernels import Readings, Targets, look, run_filter
from fgplan.planners.intermittent.measurement_kernels import (
    DETERMINANT,
    LARGEST_EIGENVALUE,
    POSITION,
    TRACE,
    block_uncertainty,
)
from fgplan.planners.intermittent.sensor_rows import sensor_rows
from fgplan.planners.intermittent.tree_kernels import cost_pairs
from fgplan.typing import FloatArray
from roadmaps import Workspace

METRICS = {"largest_eigenvalue": LARGEST_EIGENVALUE, "trace": TRACE, "determinant": DETERMINANT}
"""Uncertainty functions that the kernels know."""


@dataclass(frozen=True, slots=True, eq=False)
class BlockModel:
    """Estimation of independent targets by robots that carry sensors.

    Attributes:
        hidden: One block a target, all of two or all of three coordinates.
        sensors: Of each robot.
        workspace: Obstacles block sight.
        metric: Uncertainty function: one of ``METRICS``.
        every: Steps between measurements.
        targets: Dynamics as arrays; made here.
        table: Sensors as arrays; made here.
        obstacles: Workspace as arrays; made here.

    Raises:
        InvalidInputError: If the kernels do not know targets, sensors or metric.
    """

    hidden: HiddenState
    sensors: tuple[tuple[AbstractSensor, ...], ...]
    workspace: Workspace
    metric: str = "largest_eigenvalue"
    every: int = 1
    targets: Targets = field(init=False)
    table: FloatArray = field(init=False)
    obstacles: Obstacles = field(init=False)

    def __post_init__(self) -> None:
        """Lay everything out as arrays."""
        table = sensor_rows(list(self.sensors))
        if table is None or not is_block_state(self.hidden) or self.metric not in METRICS:
            raise InvalidInputError(
                "block model: expected independent targets of two or of three coordinates, "
                f"built-in sensors and one of {', '.join(METRICS)}; use the dense model"
            )
        blocks = self.hidden.blocks
        object.__setattr__(self, "table", table)
        object.__setattr__(self, "obstacles", obstacle_arrays(self.workspace))
        object.__setattr__(
            self,
            "targets",
            Targets(
                transition=_series([block.transition for block in blocks], 2),
                drift=_series([block.drift for block in blocks], 1),
                process=_series([block.process for block in blocks], 2),
            ),
        )

    @property
    def size(self) -> int:
        """Number of coordinates n of the state."""
        return self.hidden.size

    def predicted_means(self, estimate: Estimate, steps: int) -> FloatArray:
        """Open-loop means, all targets at once."""
        # As ``HiddenState.predicted_means``.
        transition, drift, _ = self.targets
        means = np.empty((steps + 1, *drift.shape[1:], 1))
        means[0] = np.asarray(estimate.mean).reshape(means.shape[1:])
        times = np.arange(estimate.time, estimate.time + steps)
        at = np.minimum(times, len(transition) - 1).tolist()
        moved = drift[np.minimum(times, len(drift) - 1)][..., None]
        for step, row in enumerate(at):
            means[step + 1] = transition[row] @ means[step] + moved[step]
        return means.reshape(steps + 1, -1)

    def uncertainties(self, covariance: FloatArray) -> FloatArray:
        """Uncertainty of each target, of covariances of shape (M, s, s)."""
        metric = METRICS[self.metric]
        return np.array([block_uncertainty(block, metric) for block in covariance])

    def target_places(self, mean: FloatArray) -> FloatArray:
        """The first two coordinates of each target."""
        return np.asarray(mean).reshape(len(self.hidden.blocks), -1)[:, :2]

    def observation_count(self, robot: int) -> int:
        """Sensors times targets."""
        del robot
        return int(self.table.shape[1]) * len(self.hidden.blocks)

    def reading_size(self, robot: int, index: int, state: FloatArray, position: FloatArray) -> int:
        """Size of the sensor's prediction; zero where the robot has no such sensor."""
        carried, count = self.sensors[robot], len(self.hidden.blocks)
        if index // count >= len(carried):
            return 0
        target = np.asarray(state).reshape(count, -1)[index % count]
        with np.errstate(all="ignore"):
            return int(np.size(carried[index // count].predict(np.array([*position, 0.0]), target)))

    def measure(
        self, robot: int, state: FloatArray, position: FloatArray, normals: FloatArray
    ) -> tuple[tuple[int, tuple[float, ...]], ...]:
        """Readings of the sensors that see a target, compiled."""
        count, size = len(self.hidden.blocks), self.hidden.blocks[0].size
        sensors = self.table[robot]
        values, seen = np.zeros_like(normals), np.zeros(len(normals), dtype=np.bool_)
        x, y = float(position[0]), float(position[1])
        look(sensors, self.obstacles, x, y, state.reshape(count, size), normals, values, seen)
        rows = [size if sensor[0] == POSITION else int(sensor[-1]) for sensor in sensors]
        return tuple(
            (index, tuple(values[index, : rows[index // count]].tolist()))
            for index in np.flatnonzero(seen).tolist()
        )

    def run(
        self, estimate: Estimate, until: int, records: Sequence[tuple[int, Record]]
    ) -> Filtered:
        """The filter over blocks, compiled."""
        count, size = len(self.hidden.blocks), self.hidden.blocks[0].size
        mean = np.array(estimate.mean).reshape(count, size)
        covariance = np.array(estimate.covariance)
        steps = until - estimate.time
        means, uncertainty = np.empty((steps, count, size)), np.empty(steps)
        run_filter(
            self.targets,
            self.table,
            _readings(records, count),
            estimate.time,
            until,
            METRICS[self.metric],
            mean,
            covariance,
            means,
            uncertainty,
            np.empty_like(mean),
            np.zeros((size + 2, size)),
        )
        return Filtered(
            Estimate(until, mean.reshape(-1), covariance), means.reshape(steps, -1), uncertainty
        )

    def cost_pairs(self, task: CostTask) -> None:
        """Algorithm 4 for pairs of a parent and a child, compiled."""
        count, size = len(self.hidden.blocks), self.hidden.blocks[0].size
        cost_pairs(
            task.tree,
            task.space,
            self.targets,
            self.table[task.carriers],
            self.obstacles,
            task.means.reshape(-1, count, size),
            self.every,
            METRICS[self.metric],
            task.parents,
            task.positions,
            task.times,
            task.limits,
            task.falling,
            task.costs,
            task.covariances,
            task.places,
            task.there,
            np.zeros((size + 2, size)),
        )


def is_block_state(hidden: HiddenState) -> bool:
    """Whether targets are independent points, all in the plane or all in space.

    Args:
        hidden: The state.

    Returns:
        Whether ``BlockModel`` takes it.
    """
    return hidden.independent and set(hidden.sizes) in ({2}, {3})


def _series(values: list[FloatArray], axes: int) -> FloatArray:
    """Stack targets, with a leading axis over time: one row where all are constant."""
    steps = max(1 if value.ndim == axes else len(value) for value in values)
    rows = []
    for value in values:
        series = value[None] if value.ndim == axes else value
        rows.append(series[np.minimum(np.arange(steps), len(series) - 1)])
    return np.ascontiguousarray(np.stack(rows, axis=1))


def _readings(records: Sequence[tuple[int, Record]], targets: int) -> Readings:
    """Records as arrays."""
    times, sensors, which, positions, values = [], [], [], [], []
    for robot, record in records:
        for index, value in record.readings:
            times.append(record.time)
            sensors.append((robot, index // targets))
            which.append(index % targets)
            positions.append(record.position)
            values.append((*value, 0.0, 0.0, 0.0)[:3])
    return Readings(
        time=np.array(times, dtype=np.int64),
        sensor=np.array(sensors, dtype=np.int64).reshape(-1, 2),
        target=np.array(which, dtype=np.int64),
        position=np.array(positions, dtype=np.float64).reshape(-1, 2),
        value=np.array(values, dtype=np.float64).reshape(-1, 3),
    )
