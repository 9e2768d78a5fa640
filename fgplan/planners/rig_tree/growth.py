"""RIG-tree (Hollinger and Sukhatme 2014) adapted as in footnote 3 of Kantaros et al. 2019.

A configuration of the whole team is sampled uniformly in free space; the nearest node (sum of
squared distances) is extended by one step of each robot towards its sample; a new node is pruned if
one within half a step is no more expensive and no more uncertain (their pruning by an upper bound,
with objective (5)); the budget of the original is replaced by the terminal constraint. The tree is
grown until it is feasible.
"""

import numpy as np

from fgplan.planners.aia.arrays import unpacked
from fgplan.planners.aia.baseline import BaselineResult, Budget
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.team_model import TeamModel, TeamState
from fgplan.typing import FloatArray, IntArray

_FIRST = 1024


def grow_rig_tree(
    problem: AcquisitionProblem, budget: Budget, generator: np.random.Generator
) -> BaselineResult:
    """Plan by the adapted RIG-tree.

    Args:
        problem: What is planned for.
        budget: Nodes and seconds.
        generator: Source of random numbers.

    Returns:
        The first feasible path.
    """
    model = TeamModel(problem)
    clock = budget.start()
    states = [model.start()]
    robots = len(problem.robots)
    places = np.empty((_FIRST, 2 * robots))
    places[0] = model.poses(states[0].rows)[:, :2].ravel()
    closest, shortfall = states[0], model.shortfall(states[0])
    radius = 0.5 * min(robot.primitives.reach_m() for robot in problem.robots)
    lower, upper = problem.workspace.lower, problem.workspace.upper
    tries = 0
    while not clock.late and tries < 20 * budget.nodes:
        tries += 1
        sample = generator.uniform(lower, upper, (robots, 2))
        if not problem.workspace.are_positions_valid(sample).all():
            continue
        square = ((places[: len(states)] - sample.ravel()) ** 2).sum(axis=1)
        nearest = states[int(np.argmin(square))]
        after = model.advance(nearest, _steer(model, nearest, sample))
        place = model.poses(after.rows)[:, :2].ravel()
        if _is_pruned(problem, states, places, after, place, radius):
            continue
        if len(states) == len(places):
            places = np.concatenate([places, np.empty_like(places)])
        places[len(states)] = place
        states.append(after)
        clock.nodes = len(states)
        if (reached := model.shortfall(after)) < shortfall:
            closest, shortfall = after, reached
        if model.is_final(after):
            return clock.result(model.path(after), shortfall, model.farthest(closest))
    return clock.result(None, shortfall, model.farthest(closest))


def _steer(model: TeamModel, state: TeamState, sample: FloatArray) -> IntArray:
    """One step of each robot towards its sample."""
    out = np.array(state.rows)
    for j, row in enumerate(state.rows):
        rows = model.controls(j, int(row))
        offset = model.poses(rows)[:, :2] - sample[j]
        out[j] = rows[int(np.argmin((offset * offset).sum(axis=1)))]
    return out


def _is_pruned(
    problem: AcquisitionProblem,
    states: list[TeamState],
    places: FloatArray,
    state: TeamState,
    place: FloatArray,
    radius_m: float,
) -> bool:
    """Whether a node near by is as good in every respect."""
    square = ((places[: len(states)] - place) ** 2).sum(axis=1)
    matrix = unpacked(state.covariance, packed=problem.packed)
    for index in np.flatnonzero(square <= radius_m * radius_m):
        other = states[int(index)]
        if other.cost > state.cost:
            continue
        gap = matrix - unpacked(other.covariance, packed=problem.packed)
        if np.linalg.eigvalsh(gap).min() >= 0.0:
            return True
    return False
