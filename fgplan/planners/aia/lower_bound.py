"""Is the terminal constraint out of reach, whatever the robots do?

A target learns most if every robot measures it at every step with the least noise there is. With
J_max = sum of 1 / sigma_min^2 over all sensors, J(t) <= J_max I, and the Riccati map is monotone,

    Sigma(t) >= S(t),  S(0) = Sigma(0),  S(t + 1) = rho(J_max, S(t)),

so a constraint that no S(t) satisfies is never satisfied: with process noise S(t) settles above
zero. Measuring at the child S(t) is after the measurements of t, and S(0) too. Sensors without a
least noise (a bearing at distance zero) give no bound.
"""

import numpy as np

from fgplan.models.position_sensor import PositionSensor
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.models.range_bearing import RangeSensor
from fgplan.models.uncertainty import uncertainty_function
from fgplan.planners.aia.problem import AcquisitionProblem, MeasureAt, Observer
from fgplan.riccati.block_diagonal import riccati_map_blocks, update_blocks
from fgplan.typing import FloatArray

_STEPS = 2000
_SETTLED = 1e-12


def unreachable_reason(problem: AcquisitionProblem, measure_at: MeasureAt = "parent") -> str:
    """Why no plan can be feasible.

    Args:
        problem: The problem.
        measure_at: Whether covariances are those before measuring (``parent``) or after.

    Returns:
        A sentence with the best uncertainty that could be reached, or nothing.
    """
    function = uncertainty_function(problem.terminal.function)
    most = sum(_most_information(sensor) for robot in problem.robots for sensor in robot.sensors)
    simple = problem.packed and problem.terminal.scope == "each" and not function.needs_prior
    if not (simple and function.monotone and np.isfinite(most)):
        return ""
    limits = problem.terminal.limits(problem.targets)
    now = np.array(problem.priors)
    information = np.broadcast_to(most * np.eye(2), now.shape)
    at_child = measure_at == "child"
    if at_child:
        now = update_blocks(now, information)
    best = np.full(problem.targets, np.inf)
    varying = max(
        (
            len(series)
            for block in problem.hidden.blocks
            for series in (block.transition, block.process)
            if series.ndim == 3
        ),
        default=0,
    )
    for step in range(_STEPS):
        best = np.minimum(best, function.evaluate(now, None))
        if (best <= limits).all():
            return ""
        A, Q = _dynamics(problem, step)  # noqa: N806
        after = riccati_map_blocks(now, information, A, Q, at_child=at_child)
        # Other targets may go on shrinking; dynamics that vary may yet let a settled one go on.
        open_ones = np.flatnonzero(best > limits)
        moved = np.abs(after - now)[open_ones].max(axis=(1, 2))
        settled = moved <= _SETTLED * np.abs(now)[open_ones].max(axis=(1, 2))
        if step >= varying and settled.any():
            worst = int(open_ones[int(np.argmax(settled))])
            break
        now = after
    else:
        return ""
    return (
        f"target {problem.hidden.targets[worst]!r}: its process noise keeps its "
        f"{problem.terminal.function} at {best[worst]:.3g} or more, the best uncertainty reached "
        f"if every robot measured it at every step; {limits[worst]:.3g} is asked for"
    )


def _dynamics(problem: AcquisitionProblem, step: int) -> tuple[FloatArray, FloatArray]:
    """A and Q of all targets at a step, shape (M, 2, 2) each."""
    steps = [block.at(step) for block in problem.hidden.blocks]
    return np.array([one[0] for one in steps]), np.array([one[2] for one in steps])


def _most_information(sensor: Observer) -> float:
    """Largest information of one measurement in any direction; infinite where not known."""
    if type(sensor) is ProportionalRangeSensor:
        return 1.0 / max(sensor.floor_m, sensor.sigma_m) ** 2
    if type(sensor) in (RangeSensor, PositionSensor):
        return 1.0 / float(sensor.sigma_m) ** 2  # type: ignore[union-attr]
    return np.inf
