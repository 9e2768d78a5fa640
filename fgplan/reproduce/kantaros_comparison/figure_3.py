"""Figures 3(a) and 3(b) of Kantaros et al. 2019: the tree's paths and biased greedy's, one scene.

The paper's show differential drive; so do these. With them the worst target's uncertainty against
time, and a film of the tree's plan.
"""

from pathlib import Path

import numpy as np

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.planners.aia.baseline import Budget
from fgplan.planners.aia.options import tree_options
from fgplan.planners.aia.search import search
from fgplan.planners.biased_greedy.planner import solve
from fgplan.viz.figure import save
from fgplan.viz.information_gathering import draw_team_path, draw_uncertainty, film_team_path

_SEED = 0
_FRAMES = 40


def draw_figure_3(folder: Path, seconds: float) -> tuple[Path, ...]:
    """Plan 10 robots and 20 targets both ways and draw them.

    Args:
        folder: Takes the files.
        seconds: Budget of biased greedy.

    Returns:
        The files.
    """
    generator = np.random.default_rng(_SEED)
    problem = kantaros_scene(10, 20, generator, dynamics="differential-drive")
    ours = search(problem, tree_options("reproduction"), np.random.default_rng(_SEED)).plan
    budget = Budget(nodes=10**7, seconds=seconds)
    theirs = solve(problem, budget, np.random.default_rng(_SEED))
    files, paths = [], {}
    for name, letter, path, feasible in (
        ("aia", "a", ours, True),
        ("biased greedy", "b", theirs.walked, theirs.plan is not None),
    ):
        if path is None:
            continue
        paths[name] = path
        ended = "" if feasible else ", targets left"
        title = f"10/20, {name}: cost {path.cost:.2f}, F = {path.horizon}{ended}"
        files.append(save(draw_team_path(problem, path, title), folder / f"figure-3{letter}.png"))
    files.append(save(draw_uncertainty(problem, paths), folder / "uncertainty.png"))
    if ours is not None:
        files.append(film_team_path(problem, ours, folder / "figure-3a.gif", frames=_FRAMES))
    return tuple(files)
