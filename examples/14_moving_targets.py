"""Targets that move: execute a plan, or measure, filter and plan again every few steps.

One seed shows how, not how well: `fgplan reproduce kantaros-adaptive` runs ten.
Run it from anywhere: `python examples/14_moving_targets.py`.
"""

import numpy as np

from fgplan.bench.aia_scene import kantaros_scene
from fgplan.planners.aia.adaptive import track
from fgplan.planners.aia.options import tree_options

SEED = 2


def main() -> None:
    """The same truth and noise, planned once and planned again."""
    scene = kantaros_scene(4, 6, np.random.default_rng(SEED), moving=True, delta=1e-4)
    options = tree_options("reproduction", iterations=3000, expand="node")
    for every in (None, 5):
        run = track(scene, options, np.random.default_rng(SEED), steps=100, replan_every=every)
        name = "offline plan" if every is None else f"planned again every {every} steps"
        print(f"{name}: error {run.rms_m[0]:.2f} m at first, {run.rms_m[-1]:.2f} m at the end")


if __name__ == "__main__":
    main()
