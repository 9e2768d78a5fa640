"""Users' own models: ``StateModel`` by the filter of Algorithm 4 over one dense covariance.

What a robot can measure is numbered by its place among the robot's observations. In planning the
predicted measurement is the measurement, so only the covariance changes; the predicted mean, and
with it every Jacobian, is a function of time alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from fgplan.errors import InvalidInputError
from fgplan.models.hidden_state import square_root
from fgplan.models.uncertainty import UncertaintyFunction, uncertainty_function
from fgplan.planners.intermittent.cost_task import CostTask
from fgplan.planners.intermittent.ekf import (
    Form,
    measurement_rows,
    predict_state,
    update_state,
)
from fgplan.planners.intermittent.estimate import Estimate, Filtered, Record
from fgplan.planners.intermittent.state_model import AbstractObservation, AbstractProcess
from fgplan.planners.intermittent.tree_kernels import place_carriers
from fgplan.typing import BoolArray, FloatArray, IntArray
from roadmaps import Workspace


@dataclass(frozen=True, slots=True, eq=False)
class DenseModel:
    """Estimation of one coupled state.

    Attributes:
        process: Dynamics.
        observations: Of each robot.
        workspace: Obstacles block sight.
        metric: Name of a positive uncertainty function.
        every: Steps between measurements.
        parts: Parts of the state whose uncertainty is judged each for itself (targets); the whole
            state if left out.
        form: Kalman or information form; the results are the same.

    Raises:
        InvalidInputError: If the uncertainty function may be negative or needs a prior.
    """

    process: AbstractProcess
    observations: tuple[tuple[AbstractObservation, ...], ...]
    workspace: Workspace
    metric: str = "largest_eigenvalue"
    every: int = 1
    parts: tuple[slice, ...] = ()
    form: Form = "covariance"

    def __post_init__(self) -> None:
        """Check that costs add up."""
        function = uncertainty_function(self.metric)
        if not function.positive or function.needs_prior:
            raise InvalidInputError(
                f"metric {self.metric!r}: expected a positive uncertainty function: Cost must not "
                "fall along a path (section III-C); take largest_eigenvalue, trace or determinant"
            )

    @property
    def size(self) -> int:
        """Number of coordinates n of the state."""
        return self.process.size

    @property
    def _function(self) -> UncertaintyFunction:
        """The uncertainty function."""
        return uncertainty_function(self.metric)

    def predicted_means(self, estimate: Estimate, steps: int) -> FloatArray:
        """Open-loop means."""
        means = [np.asarray(estimate.mean)]
        for step in range(steps):
            means.append(self.process.advance(means[-1], estimate.time + step))
        return np.array(means)

    def uncertainties(self, covariance: FloatArray) -> FloatArray:
        """Uncertainty of each part, of a covariance of shape (1, n, n)."""
        whole = covariance[0]
        parts = self.parts or (slice(0, self.size),)
        return np.array([float(self._function.evaluate(whole[p, p], None)) for p in parts])

    def target_places(self, mean: FloatArray) -> FloatArray:
        """The first two coordinates of parts of two or three; zero for those in no place."""
        parts = self.parts or (slice(0, self.size),)
        values = [np.asarray(mean)[part] for part in parts]
        return np.array([v[:2] if v.size in (2, 3) else np.zeros(2) for v in values])

    def observation_count(self, robot: int) -> int:
        """The robot's observations."""
        return len(self.observations[robot])

    def reading_size(self, robot: int, index: int, state: FloatArray, position: FloatArray) -> int:
        """Size of the observation's prediction."""
        with np.errstate(all="ignore"):
            return int(np.size(self.observations[robot][index].predict(state, position)))

    def measure(
        self, robot: int, state: FloatArray, position: FloatArray, normals: FloatArray
    ) -> tuple[tuple[int, tuple[float, ...]], ...]:
        """Visible observations' predictions with noise M v, v ~ N(0, R)."""
        readings = []
        for index, one in enumerate(self.observations[robot]):
            if one.visible(state, position, self.workspace):
                by_noise = one.jacobians(state, position)[1]
                root = square_root(one.noise(state, position))
                noise = by_noise @ root @ normals[index, : root.shape[1]]
                readings.append((index, tuple((one.predict(state, position) + noise).tolist())))
        return tuple(readings)

    def run(
        self, estimate: Estimate, until: int, records: Sequence[tuple[int, Record]]
    ) -> Filtered:
        """The filter over the whole state."""
        by_time = {
            time: list(group) for time, group in groupby(records, key=lambda item: item[1].time)
        }
        mean, covariance = np.asarray(estimate.mean), estimate.covariance[0]
        means, uncertainty = [], []
        for time in range(estimate.time + 1, until + 1):
            mean, covariance = predict_state(self.process, mean, covariance, time - 1)
            rows = [
                measurement_rows(
                    self.observations[robot][index],
                    mean,
                    np.array(record.position),
                    np.array(value),
                )
                for robot, record in by_time.get(time, ())
                for index, value in record.readings
            ]
            mean, covariance = update_state(mean, covariance, rows, self.form)
            means.append(mean)
            uncertainty.append(float(self._function.evaluate(covariance, None)))
        return Filtered(
            Estimate(until, mean, covariance[None]),
            np.array(means).reshape(-1, self.size),
            np.array(uncertainty),
        )

    def cost_pairs(self, task: CostTask) -> None:
        """Algorithm 4 for pairs of a parent and a child."""
        tree, space, means = task.tree, task.space, task.means
        best = np.inf
        pairs = zip(task.parents, task.positions, task.times, task.limits, strict=True)
        for n, (parent, position, times, limit) in enumerate(pairs):
            start, end = int(tree.time[parent].min()), int(times.min())
            below = min(limit, best) if task.falling else limit
            task.costs[n] = np.inf
            total = float(tree.cost[parent])
            if total >= below or end - space.base >= len(means):
                continue
            place_carriers(
                tree, space, parent, position, times, start, end, task.places, task.there
            )
            covariance = tree.covariance[parent, 0]
            for time in range(start + 1, end + 1):
                row = time - start - 1
                before = means[time - 1 - space.base]
                _, covariance = predict_state(self.process, before, covariance, time - 1)
                if time % self.every == 0:
                    mean = means[time - space.base]
                    rows = self._planned_rows(
                        task.carriers, mean, task.places[row], task.there[row]
                    )
                    _, covariance = update_state(mean, covariance, rows, self.form)
                total += float(self._function.evaluate(covariance, None))
                if total >= below:
                    break
            else:
                task.costs[n], task.covariances[n, 0] = total, covariance
                best = min(best, total)

    def _planned_rows(
        self, carriers: IntArray, mean: FloatArray, places: FloatArray, there: BoolArray
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Rows of what carriers would measure; innovations are zero."""
        return [
            measurement_rows(one, mean, place, one.predict(mean, place))
            for robot, place, takes_part in zip(carriers, places, there, strict=True)
            if takes_part
            for one in self.observations[robot]
            if one.visible(mean, place, self.workspace)
        ]
