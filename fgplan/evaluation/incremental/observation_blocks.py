"""Information blocks of planned observations of landmarks.

The library's own planar sensors are linearised all at once by a kernel; any other sensor, and
robots in space, one observation after the other by the sensor itself.
"""

from collections.abc import Callable

import numpy as np

from fgplan.evaluation.incremental.factor_blocks import FactorBlocks, stack_rows
from fgplan.evaluation.incremental.observation_table import ObservationTable
from fgplan.evaluation.problem import PlanningProblem
from fgplan.models.pose import PLANAR_DIM
from fgplan.models.range_bearing import BearingRangeSensor, BearingSensor, RangeSensor
from fgplan.typing import FloatArray, IntArray, Key

_ROWS = {BearingSensor: (True, False), RangeSensor: (False, True), BearingRangeSensor: (True, True)}
"""Whether a sensor has a row of bearing and one of range; a subclass may measure something else."""


def observation_blocks(
    problem: PlanningProblem,
    poses: FloatArray,
    observations: ObservationTable,
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
    variables = {key: variable_of(key) for key in observations.landmarks()}
    planar = problem.dim == PLANAR_DIM and all(problem.prior.dim(key) == 2 for key in variables)
    if planar and all(type(problem.sensors[name]) in _ROWS for name in observations.sensors):
        found = _compiled(problem, poses, observations, variables)
        if found is not None:
            return found
    rows: list[list[tuple[int, FloatArray, FloatArray]]] = [[] for _ in poses]
    for state, key, name, noise in observations.each():
        found_rows = problem.sensors[name].linearise(poses[state], problem.prior.point(key), noise)
        rows[state].append((variables[key], *found_rows))
    return stack_rows(rows, problem.dim)


def _compiled(
    problem: PlanningProblem,
    poses: FloatArray,
    observations: ObservationTable,
    variables: dict[Key, int],
) -> FactorBlocks | None:
    """All at once; None where the sensors themselves must say what is wrong."""
    from fgplan.evaluation.incremental.observation_kernels import observation_information

    kinds = [_ROWS[type(problem.sensors[name])] for name in observations.sensors]
    rows = np.array(kinds, dtype=bool).reshape(len(kinds), 2)[observations.sensor]
    rank: IntArray = rows.sum(axis=1).astype(np.int64)
    widths = np.array([len(noise) for noise in observations.noises], np.int64)
    noises = np.zeros((len(observations.noises), 2, 2))
    for place, noise in enumerate(observations.noises):
        if noise.shape not in ((1, 1), (2, 2)) or (noise != noise.T).any():
            return None
        noises[place, : len(noise), : len(noise)] = noise
    if (widths[observations.noise] != rank).any():
        return None
    keys = np.array(list(variables), np.uint64)
    which = np.searchsorted(keys, observations.landmark)
    points = np.array([problem.prior.point(key) for key in variables]).reshape(len(variables), 2)
    size = len(rank)
    own, cross, other = np.zeros((3, size, PLANAR_DIM, PLANAR_DIM))
    wrong = observation_information(
        np.repeat(poses, np.diff(observations.pointer), axis=0),
        points[which],
        rows[:, 0].copy(),
        rows[:, 1].copy(),
        noises[observations.noise],
        own,
        cross,
        other,
    )
    if wrong >= 0:
        return None
    variable = np.array(list(variables.values()), np.int64)[which]
    return FactorBlocks(observations.pointer, variable, rank, own, cross, other)
