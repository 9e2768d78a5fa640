"""A temperature field that diffuses: a hidden state whose cells are coupled, by the dense path.

Run it from anywhere: `python examples/13_temperature_field.py`.
"""

import numpy as np

from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.models.linear_observation import FieldSensor
from fgplan.models.motion_primitives import first_order
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.problem import AcquisitionProblem, SensingRobot, TerminalConstraint
from fgplan.planners.aia.search import search
from roadmaps import Workspace


def field_problem() -> AcquisitionProblem:
    """A temperature field of 16 cells that diffuses: section II's hidden state with a dense A."""
    side = 4
    cells = np.array([(x + 0.5, y + 0.5) for y in range(side) for x in range(side)])
    gaps = np.abs(cells[:, None] - cells[None]).sum(axis=-1)
    neighbours = (gaps == 1.0).astype(float)
    diffusion = np.eye(16) + 0.05 * (neighbours - np.diag(neighbours.sum(axis=1)))
    field = HiddenBlock(
        targets=tuple(f"cell{i}" for i in range(16)),
        sizes=(1,) * 16,
        transition=diffusion,
        process=1e-4 * np.eye(16),
    )
    sensor = FieldSensor(cells=cells, width_m=0.6, sigma=0.2)
    robots = tuple(
        SensingRobot(
            name=name,
            pose=np.array([*start, 0.0]),
            primitives=first_order(0.5),
            sensors=(sensor,),
        )
        for name, start in (("ann", (0.5, 0.5)), ("bob", (3.5, 0.5)))
    )
    return AcquisitionProblem(
        workspace=Workspace(lower=[0.0, 0.0], upper=[4.0, 4.0]),
        robots=robots,
        hidden=HiddenState((field,)),
        mean=np.full(16, 20.0),
        priors=(np.exp(-0.5 * gaps),),
        terminal=TerminalConstraint(limit=0.1),
        places=cells,
    )


def main() -> None:
    """Plan until every cell is known well enough."""
    problem = field_problem()
    found = search(problem, tree_options("pruned", iterations=4000), np.random.default_rng(0))
    assert found.plan is not None
    worst = [np.diag(covariance).max() for covariance in found.plan.covariances]
    print(f"variance of the worst cell: {worst[0]:.2f} at first, {worst[-1]:.3f} at the end")
    print(f"every cell below 0.1 after {found.plan.horizon} steps")


if __name__ == "__main__":
    main()
