"""Small problems of information gathering, shared by tests."""

import numpy as np

from fgplan.models.hidden_state import independent_targets
from fgplan.models.motion_primitives import first_order
from fgplan.models.proportional_range import ProportionalRangeSensor
from fgplan.planners.aia.problem import AcquisitionProblem, SensingRobot, TerminalConstraint
from roadmaps import Workspace


def lattice_problem(
    starts,
    targets,
    *,
    side=6.0,
    step=1.0,
    boxes=(),
    delta=2e-3,
    drifts=None,
    process=0.0,
    sensor=None,
    primitives=None,
    prior=0.2,
    **terminal,
):
    """Robots on a lattice in a square room, with planar targets."""
    targets = np.asarray(targets, dtype=float)
    sensor = sensor or ProportionalRangeSensor(max_range_m=2.0)
    primitives = primitives or first_order(step)
    if drifts is None:
        drifts = np.zeros_like(targets)
    return AcquisitionProblem(
        workspace=Workspace(
            lower=np.zeros(2),
            upper=np.full(2, side),
            obstacles=[[(a, b), (c, b), (c, d), (a, d)] for a, b, c, d in boxes],
        ),
        robots=tuple(
            SensingRobot(
                name=f"r{j}",
                pose=np.array([*start, 0.0]),
                primitives=primitives,
                sensors=(sensor,),
            )
            for j, start in enumerate(starts)
        ),
        hidden=independent_targets(
            [f"t{i}" for i in range(len(targets))], drifts, process * np.eye(2)
        ),
        mean=targets.ravel(),
        priors=(prior * np.eye(2),) * len(targets),
        terminal=TerminalConstraint(limit=delta, **terminal),
    )


OPTIMA = (0.5460894312515795, 0.26796140175640354)
"""Costs of the optimal plans of the tiny instances, from exhaustive search."""


def tiny_problem(which=0):
    """The two tiny instances whose optimum exhaustive search finds."""
    if which == 0:
        return lattice_problem(
            [(0.0, 0.0)],
            [(4.6, 1.3), (1.4, 4.7)],
            side=6.0,
            step=1.0,
            boxes=[(2.2, 2.2, 3.8, 3.8)],
            delta=2e-3,
        )
    return lattice_problem([(0.5, 0.5)], [(2.7, 1.2), (1.3, 3.1)], side=4.0, step=0.5, delta=2e-3)
