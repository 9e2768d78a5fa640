"""Information blocks of planned observations of landmarks.

The library's own planar sensors are linearised all at once by a kernel; any other sensor, and
robots in space, one observation after the other by the sensor itself.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fgplan.evaluation.incremental.factor_blocks import FactorBlocks, stack_rows
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.pose import PLANAR_DIM
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.models.sensor import AbstractSensor
from fgplan.paths.candidate_path import Observation
from fgplan.typing import FloatArray, IntArray, Key

_ROWS = {BearingSensor: (True, False), RangeSensor: (False, True), BearingRangeSensor: (True, True)}
"""Whether a sensor has a row of bearing and one of range; a subclass may measure something else."""


def observation_blocks(
    problem: PlanningProblem,
    poses: FloatArray,
    observations: Sequence[Sequence[Observation]],
    variable_of: Callable[[Key], int],
) -> FactorBlocks:
    """Blocks of the planned observations from some states.

    Args:
        problem: Prior, team and models.
        poses: Of A states, shape (A, 3) or (A, 4, 4), world frame.
        observations: Planned observations from each.
        variable_of: Number of a landmark's variable.

    Returns:
        The table over the A states.

    Raises:
        InvalidInputError: If a sensor's Jacobians or an observation's noise are not usable.
    """
    flat = [seen for here in observations for seen in here]
    sensors = {name: problem.sensors[name] for name in dict.fromkeys(o.sensor for o in flat)}
    keys = dict.fromkeys(o.landmark for o in flat)
    variables = {key: variable_of(key) for key in keys}
    planar = problem.dim == PLANAR_DIM and all(problem.prior.dim(key) == 2 for key in keys)
    if planar and all(type(sensor) in _ROWS for sensor in sensors.values()):
        found = _compiled(problem, poses, observations, flat, variables, sensors)
        if found is not None:
            return found
    return stack_rows(
        [
            [(variables[seen.landmark], *observation_rows(problem, pose, seen)) for seen in here]
            for pose, here in zip(poses, observations, strict=True)
        ],
        problem.dim,
    )


def observation_rows(
    problem: PlanningProblem, pose: FloatArray, seen: Observation
) -> tuple[FloatArray, FloatArray]:
    """Whitened rows of one observation, by pose and by landmark."""
    landmark = problem.prior.point(seen.landmark)
    return problem.sensors[seen.sensor].linearise(pose, landmark, np.asarray(seen.covariance))


def _compiled(
    problem: PlanningProblem,
    poses: FloatArray,
    observations: Sequence[Sequence[Observation]],
    flat: Sequence[Observation],
    variables: dict[Key, int],
    sensors: Mapping[str, AbstractSensor],
) -> FactorBlocks | None:
    """All at once; None where the sensors themselves must say what is wrong."""
    from fgplan.evaluation.incremental.observation_kernels import observation_information

    counts = [len(here) for here in observations]
    pointer = np.zeros(len(counts) + 1, np.int64)
    np.cumsum(counts, out=pointer[1:])
    size = len(flat)
    kinds = {
        name: _ROWS[type(sensor)]
        for name, sensor in problem.sensors.items()
        if type(sensor) in _ROWS
    }  # type: ignore[index]
    rows = np.array([kinds[seen.sensor] for seen in flat], dtype=bool).reshape(size, 2)
    rank: IntArray = rows.sum(axis=1).astype(np.int64)
    noise = np.zeros((size, 2, 2))
    for width in (1, 2):
        here = np.flatnonzero(rank == width)
        given = [np.asarray(flat[place].covariance) for place in here.tolist()]
        if any(item.shape != (width, width) for item in given):
            return None
        if given:
            noise[here, :width, :width] = given
    if (noise[:, 0, 1] != noise[:, 1, 0]).any():
        return None
    number = {key: place for place, key in enumerate(variables)}
    points = np.array([problem.prior.point(key) for key in variables]).reshape(len(variables), 2)
    which = np.array([number[seen.landmark] for seen in flat], np.int64)
    own, cross, other = np.zeros((3, size, PLANAR_DIM, PLANAR_DIM))
    wrong = observation_information(
        np.repeat(poses, counts, axis=0),
        points[which],
        rows[:, 0].copy(),
        rows[:, 1].copy(),
        noise,
        own,
        cross,
        other,
    )
    if wrong >= 0:
        return None
    variable = np.array(list(variables.values()), np.int64)[which]
    return FactorBlocks(pointer, variable, rank, own, cross, other)
