"""A team that looks for targets: one scenario, planners swapped by name, and pictures of a plan.

Run it from anywhere: `python examples/12_information_gathering.py [FOLDER]`.
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.io.mission_file import load_mission
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.search import search
from fgplan.planners.registry import find_planner
from fgplan.viz.figure import save
from fgplan.viz.information_gathering import draw_team_path, draw_uncertainty, film_team_path

HERE = Path(__file__).parent


def swap_planners() -> None:
    """The same mission, planned by whoever is named."""
    mission = load_mission(HERE / "scenarios" / "information_gathering.toml")
    for name in ("aia", "biased_greedy", "dec_mcts"):
        options = {"delta": 1e-4} | ({"preset": "pruned"} if name == "aia" else {})
        named = dataclasses.replace(mission, options=options)
        plan = find_planner(name).plan(named, np.random.default_rng(0))
        print(f"{name:14} cost {plan.value:6.2f}, horizon {plan.details['horizon']}")


def main(out: Path | None) -> None:
    """Plan by name, then the scene of figure 3 of Kantaros et al. 2019."""
    swap_planners()
    scene = kantaros_scene(10, 20, np.random.default_rng(1))
    plan = search(scene, tree_options("reproduction"), np.random.default_rng(1)).plan
    assert plan is not None
    print(f"10 robots, 20 targets: cost {plan.cost:.1f}, horizon {plan.horizon}")
    if out is not None:
        print(save(draw_team_path(scene, plan, "10 robots, 20 targets"), out / "plan.png"))
        print(save(draw_uncertainty(scene, {"aia": plan}), out / "uncertainty.png"))
        print(film_team_path(scene, plan, out / "plan.gif", frames=40))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
