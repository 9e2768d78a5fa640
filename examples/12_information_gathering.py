"""A team that looks for targets: one scenario, six planners, a coupled field, a closed loop.

Run it from anywhere: `python examples/12_information_gathering.py`.
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np

from fgplan.io.mission_file import load_mission
from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.models.linear_observation import FieldSensor
from fgplan.models.motion_primitives import first_order
from fgplan.planners.aia.adaptive import track
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.problem import AcquisitionProblem, SensingRobot, TerminalConstraint
from fgplan.planners.aia.search import search
from fgplan.planners.registry import find_planner
from fgplan.viz.figure import save
from fgplan.viz.information_gathering import draw_team_path, draw_uncertainty
from roadmaps import Workspace

HERE = Path(__file__).parent


def swap_planners() -> None:
    """The same mission, planned by whoever is named."""
    mission = load_mission(HERE / "scenarios" / "information_gathering.toml")
    for name in ("aia", "biased_greedy", "dec_mcts"):
        options = {"delta": 1e-4} | ({"preset": "pruned"} if name == "aia" else {})
        named = dataclasses.replace(mission, options=options)
        plan = find_planner(name).plan(named, np.random.default_rng(0))
        print(f"{name:14} cost {plan.value:6.2f}, horizon {plan.details['horizon']}")


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


def main(out: Path | None) -> None:
    """Plan, show, and close the loop."""
    swap_planners()
    problem = field_problem()
    options = tree_options("pruned", iterations=4000)
    found = search(problem, options, np.random.default_rng(0))
    assert found.plan is not None
    print(f"field: every cell's variance below 0.1 after {found.plan.horizon} steps")
    from fgplan.bench.aia_scene import kantaros_scene

    scene = kantaros_scene(10, 20, np.random.default_rng(1))
    plan = search(scene, tree_options("reproduction"), np.random.default_rng(1)).plan
    assert plan is not None
    print(f"10 robots, 20 targets: cost {plan.cost:.1f}, horizon {plan.horizon}")
    moving = kantaros_scene(4, 6, np.random.default_rng(2), moving=True, delta=1e-4)
    for every in (None, 5):
        loop = tree_options("reproduction", iterations=3000, expand="node")
        run = track(moving, loop, np.random.default_rng(2), steps=100, replan_every=every)
        name = "offline plan" if every is None else f"planned again every {every} steps"
        print(f"{name}: error {run.rms_m[0]:.2f} m at first, {run.rms_m[-1]:.2f} m at the end")
    if out is not None:
        print(save(draw_team_path(scene, plan, "10 robots, 20 targets"), out / "plan.png"))
        print(save(draw_uncertainty(scene, {"aia": plan}), out / "uncertainty.png"))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
