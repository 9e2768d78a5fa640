"""Greedy controls: the greatest immediate decrease of the cost, step by step.

Section VI-C of Kantaros et al. 2019. The measurements of a control are those taken where it leads;
``alone``: each robot chooses as if it were alone, and equal controls are drawn uniformly (the
greedy method); otherwise in order of index, each given the choices of those before it, and where
all controls of a robot are equal the control of f_U (9) is taken (coordinate descent, biased).
"""

import numpy as np

from fgplan.planners.aia.baseline import BaselineResult, Budget
from fgplan.planners.aia.problem import AcquisitionProblem
from fgplan.planners.aia.team_model import TeamModel, TeamState
from fgplan.typing import IntArray

_EQUAL = 1e-12


def choose_greedily(
    problem: AcquisitionProblem, budget: Budget, generator: np.random.Generator, *, alone: bool
) -> BaselineResult:
    """Plan greedily until the terminal constraint holds.

    Args:
        problem: What is planned for.
        budget: ``steps`` and ``seconds`` count.
        generator: Source of random numbers.
        alone: Each robot for itself; otherwise coordinate descent with the biased density.

    Returns:
        The path.
    """
    model = TeamModel(problem)
    state = model.start()
    clock = budget.start()
    while not model.is_final(state) and state.time < budget.steps and not clock.late:
        state = model.advance(state, _controls(model, state, generator, alone=alone))
        clock.nodes += 1
    walked = model.path(state)
    path = walked if model.is_final(state) else None
    return clock.result(path, model.shortfall(state), model.farthest(state), walked)


def _controls(
    model: TeamModel, state: TeamState, generator: np.random.Generator, *, alone: bool
) -> IntArray:
    """Where each robot goes."""
    left = model.left(state)
    known = np.zeros_like(left)
    chosen = np.array(state.rows)
    for j in range(len(chosen)):
        rows = model.controls(j, int(state.rows[j]))
        gained = [model.information(j, int(row), state.time + 1) for row in rows]
        terms = np.array([model.propagate(left, known + one, state.time + 1)[1] for one in gained])
        best = np.flatnonzero(terms <= terms.min() * (1.0 + _EQUAL))
        if len(best) == len(rows) and not alone:
            chosen[j] = model.draw(state, j, generator)
        else:
            chosen[j] = rows[best[int(generator.random() * len(best))]]
        if not alone:
            known = known + model.information(j, int(chosen[j]), state.time + 1)
    return chosen
