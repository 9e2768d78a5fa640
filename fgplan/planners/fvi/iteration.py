"""Feedforward value iteration over team configurations and covariances: exact, and exponential.

Layer by layer every joint control of every state is tried (Le Ny and Pappas 2009, as used in
section VI-C of Kantaros et al. 2019). Two things are left out that no optimal plan needs: states
whose cost is not below that of a feasible one (costs only grow), and dominated ones: of two states
of one configuration and time the one with no smaller cost and no smaller covariance in the Loewner
order. A layer in which nothing is left ends the search: what was found is the optimum.
"""

import itertools

import numpy as np

from fgplan.planners.aia.arrays import unpacked
from fgplan.planners.aia.baseline import BaselineResult, Budget
from fgplan.planners.aia.problem import AcquisitionProblem, is_monotone
from fgplan.planners.aia.team_model import TeamModel, TeamState
from fgplan.typing import FloatArray


def iterate_values(
    problem: AcquisitionProblem,
    budget: Budget,
    generator: np.random.Generator,
    *,
    dominance: bool = True,
    bound: float = np.inf,
) -> BaselineResult:
    """Plan exhaustively.

    Args:
        problem: What is planned for.
        budget: Nodes and seconds; spent, the search hands back what it has only if it is the
            optimum, nothing otherwise.
        generator: Not used: the search is deterministic.
        dominance: Whether dominated states are left out; never where a larger covariance may give
            a smaller number.
        bound: Cost of a plan that is known: nothing dearer is looked at.

    Returns:
        The optimum, or nothing within the budget.
    """
    del generator
    dominance = dominance and is_monotone(problem)
    model = TeamModel(problem)
    clock = budget.start()
    root = model.start()
    best = root if model.is_final(root) else None
    closest, shortfall = root, model.shortfall(root)
    layer = [] if best is not None else [root]
    while layer:
        groups: dict[tuple[int, ...], tuple[list[TeamState], list[FloatArray]]] = {}
        for state in sorted(layer, key=lambda one: one.cost):
            left = model.left(state)
            choices = [model.controls(j, int(row)) for j, row in enumerate(state.rows)]
            for rows in itertools.product(*choices):
                after = model.advance(state, np.array(rows), left)
                if after.cost > bound or (best is not None and after.cost >= best.cost):
                    break  # the cost is the same for all controls
                if _keep(groups, after, packed=problem.packed, dominance=dominance):
                    clock.nodes += 1
                if clock.late:
                    return clock.result(None, shortfall, model.farthest(closest))
        layer = []
        for states, _ in groups.values():
            for after in states:
                if (reached := model.shortfall(after)) < shortfall:
                    closest, shortfall = after, reached
                if model.is_final(after):
                    if best is None or after.cost < best.cost:
                        best = after
                else:
                    layer.append(after)
        layer = [state for state in layer if best is None or state.cost < best.cost]
        if layer and layer[0].time >= budget.steps:
            return clock.result(None, shortfall, model.farthest(closest))
    path = None if best is None else model.path(best)
    return clock.result(path, shortfall, model.farthest(closest))


def _keep(
    groups: dict[tuple[int, ...], tuple[list[TeamState], list[FloatArray]]],
    state: TeamState,
    *,
    packed: bool,
    dominance: bool,
) -> bool:
    """Put a state into its group unless it is dominated; False where it is."""
    states, matrices = groups.setdefault(tuple(state.rows.tolist()), ([], []))
    matrix = unpacked(state.covariance, packed=packed)
    if dominance and states:
        # States come by increasing cost of their parents, so that most dominators come first.
        costs = np.array([one.cost for one in states])
        cheaper = costs <= state.cost
        gaps = matrix - np.array(matrices)[cheaper]
        if len(gaps):
            smallest = np.linalg.eigvalsh(gaps).reshape(len(gaps), -1).min(axis=1)
            if (smallest >= 0.0).any():
                return False
    states.append(state)
    matrices.append(matrix)
    return True
